"""The `watch` command: a fleet in the terminal, a row per vehicle, from an MQTT broker."""

from __future__ import annotations

import argparse
import contextlib
import logging
import select
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, SimpleQueue

from rich.console import Console
from rich.live import Live

from ..errors import LinkError
from ..service.mqtt.fleet import SUBSCRIPTION, Fleet
from ..service.mqtt.topics import Message
from ..service.mqtt_client import MqttClient
from ..service.mqtt_settings import SettingNames, read_broker
from ..settings.mqtt_config import Mqtt
from .fleet_view import FleetView, lines_of
from .options import add_file
from .outputs import print_text
from .view import keyboard, quit_typed

_DRAW_S = 0.5
_LINES_S = 5.0
"""Periods of the table, and of lines of plain text."""
_CONNECT_S = 10.0
_RETAINED_S = 2.0
"""With --once: longest wait for the broker; then time for the vehicles' periodic messages."""
_MOST_WAITING = 10_000
"""Messages that wait to be drawn; more are dropped."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the broker, the topics and the output."""
    parser.add_argument(
        "--mqtt", metavar="URL", required=True, help="mqtt://HOST[:PORT] or mqtts://HOST[:PORT]"
    )
    add_file(parser, "--ca-file", "certificates that the broker's leads to (default: the system's)")
    add_file(parser, "--certificate-file", "our certificate, where the broker asks for one")
    add_file(parser, "--key-file", "its key, in a file that its owner alone can read")
    parser.add_argument("--username", metavar="NAME", help="where the broker asks for one")
    add_file(parser, "--password-file", "its password, in a file that its owner alone can read")
    parser.add_argument("--once", action="store_true", help="print the table once and end")


def run(arguments: argparse.Namespace) -> int:
    """Shows the fleet until q or Ctrl-C, which is status 0."""
    names = SettingNames(source="")
    if (arguments.certificate_file is None) != (arguments.key_file is None):
        given = "key_file" if arguments.certificate_file is None else "certificate_file"
        raise names.refused(given, "must be given with the other of the client's certificate")
    if arguments.password_file is not None and arguments.username is None:
        raise names.refused("password_file", "must be given with --username")
    settings = Mqtt(
        url=arguments.mqtt,
        username=arguments.username,
        ca_file=_path(arguments.ca_file),
        certificate_file=_path(arguments.certificate_file),
        key_file=_path(arguments.key_file),
        password_file=_path(arguments.password_file),
    )
    broker = read_broker(settings, names)
    assert broker is not None
    logging.disable(logging.WARNING)  # the head of the table has the connection
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    console, traffic = Console(), _Traffic()
    with (
        contextlib.suppress(KeyboardInterrupt),
        contextlib.closing(MqttClient(broker, traffic, identifier=None)) as client,
    ):
        if arguments.once:
            console.print(_once(client, traffic))
        elif console.is_terminal and not console.is_dumb_terminal:
            _watch(client, traffic, console)
        else:
            _write_lines(client, traffic)
    return 0


def _path(name: str | None) -> Path | None:
    return None if name is None else Path(name)


class _Traffic:
    """Received messages, for the thread that draws them."""

    will: Message | None = None
    subscriptions: Sequence[tuple[str, int]] = ((SUBSCRIPTION, 0),)

    def __init__(self) -> None:
        self.fleet = Fleet()
        self._waiting: SimpleQueue[tuple[str, bytes, float, bool]] = SimpleQueue()

    def connected(self) -> Sequence[Message]:
        """No message is published."""
        return []

    outgoing = last_messages = connected

    def published(self) -> None:
        """Does nothing."""

    def received(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Keeps a message for `take`."""
        if self._waiting.qsize() < _MOST_WAITING:
            self._waiting.put((topic, payload, time.monotonic(), retained))

    def take(self) -> Fleet:
        """The fleet with all messages received until now."""
        with contextlib.suppress(Empty):
            while True:
                topic, payload, received_s, retained = self._waiting.get_nowait()
                self.fleet.take(topic, payload, received_s, retained=retained)
        return self.fleet


def _view(client: MqttClient, traffic: _Traffic, note: str = "") -> FleetView:
    fleet = traffic.take()
    rows = fleet.rows()
    head = f"{client.state}   {len(rows)} vehicles"
    if fleet.unreadable:
        head += f"   {fleet.unreadable} messages unreadable"
    return FleetView(rows, head + note, now_s=time.monotonic(), wall_s=time.time())


def _once(client: MqttClient, traffic: _Traffic) -> FleetView:
    """The table after the first messages; LinkError without a connection."""
    deadline_s = time.monotonic() + _CONNECT_S
    while not client.connected:
        if time.monotonic() > deadline_s or client.state.startswith("no connection"):
            raise LinkError(client.state)
        time.sleep(0.05)
    time.sleep(_RETAINED_S)
    return _view(client, traffic)


def _watch(client: MqttClient, traffic: _Traffic, console: Console) -> None:
    """Shows the table until q is typed."""
    with keyboard() as keys, Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            live.update(_view(client, traffic, "   q: end"), refresh=True)
            ready, _, _ = select.select([*keys], [], [], _DRAW_S)
            if quit_typed(keys, ready):
                return


def _write_lines(client: MqttClient, traffic: _Traffic) -> None:
    """Writes a line for each vehicle every `_LINES_S`, or one about the connection."""
    while True:
        time.sleep(_LINES_S)
        rows = traffic.take().rows()
        lines = list(lines_of(rows, now_s=time.monotonic(), wall_s=time.time()))
        if not client.connected or not lines:
            lines.insert(0, client.state)
        print_text("".join(f"{line}\n" for line in lines))
