"""The `view` command: the live view of a running service, read from its Unix socket."""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import os
import select
import signal
import socket
import sys
import termios
import time
import tty
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from rich.console import Console
from rich.live import Live

from ..errors import LinkError
from .live_view import LiveView, line_of, silence_of
from .options import file_name
from .outputs import print_text

DEFAULT_SOCKET = "/run/moar-companion/view.sock"
_LONGEST_LINE = 1_000_000
_TICK_S = 1.0
_FIRST_WORD_S = 5.0
"""The service sends four statuses a second."""
_LINE_PERIOD_S = 1.0
"""Period of lines of plain text."""
_REASONS = {
    errno.ENOENT: "no such socket: is the service running, and has it a view.socket?",
    errno.ECONNREFUSED: "no service answers: is it running?",
    errno.EACCES: "may not be read by this user: members of the service's group may",
}
_SECTIONS = ("mission", "aircraft", "risk", "weights", "age_s")
"""Sections that every status of a service has."""

Status = dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the socket and the form of the output."""
    parser.add_argument(
        "socket",
        nargs="?",
        metavar="SOCKET",
        type=file_name("SOCKET"),
        default=DEFAULT_SOCKET,
        help=f"the service's view.socket (default: {DEFAULT_SOCKET})",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--once", action="store_true", help="print one page and end")
    form.add_argument("--json", action="store_true", help="print every status as a line of JSON")


def run(arguments: argparse.Namespace) -> int:
    """Shows the statuses of the service until q or Ctrl-C, which is status 0."""
    console = Console()
    # Either signal raises KeyboardInterrupt, so that the terminal is restored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with (
        contextlib.suppress(KeyboardInterrupt),
        contextlib.closing(Statuses(arguments.socket)) as (statuses),
    ):
        if arguments.once:
            console.print(LiveView(statuses.first()))
        elif arguments.json:
            _write_json(statuses)
        elif console.is_terminal and not console.is_dumb_terminal:
            _watch(statuses, console)
        else:
            _write_lines(statuses)
    return 0


class Statuses:
    """Statuses that a service sends on its view socket.

    Raises LinkError when no service is there, when it ends, and when another program serves.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._rest = b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            reason = _REASONS.get(error.errno or 0) or error.strerror or str(error)
            raise LinkError(f"{path}: {reason}") from error

    def fileno(self) -> int:
        """File descriptor for `select`."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def waiting(self, timeout_s: float = 0.0) -> bool:
        """Returns True if there is something to read now, or within a time."""
        return bool(select.select([self], [], [], timeout_s)[0])

    def first(self) -> Status:
        """The first status; LinkError when none arrives in time."""
        deadline_s = time.monotonic() + _FIRST_WORD_S
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self.waiting(left_s):
                for status in self.read():
                    return status
        raise LinkError(f"{self._path}: the service sends nothing")

    def read(self) -> list[Status]:
        """Statuses received since, oldest first; waits for data, perhaps part of a status."""
        try:
            data = self._socket.recv(65_536)
        except ConnectionError:
            data = b""
        if not data:
            raise LinkError(f"{self._path}: the service has ended")
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST_LINE:
            raise LinkError(f"{self._path}: is served by another program")
        return [self._status(line) for line in lines]

    def _status(self, line: bytes) -> Status:
        try:
            status = json.loads(line)
        except (ValueError, RecursionError):
            status = None
        if not isinstance(status, dict) or not all(
            isinstance(status.get(name), dict) for name in _SECTIONS
        ):
            raise LinkError(f"{self._path}: is served by another program")
        return status


def _write_json(statuses: Statuses) -> NoReturn:
    """Writes a line for every status."""
    while True:
        for status in statuses.read():
            print_text(f"{json.dumps(status)}\n")


def _write_lines(statuses: Statuses) -> NoReturn:
    """Writes each `_LINE_PERIOD_S` the last status in short, or that the service is silent."""
    status, received_s = statuses.first(), time.monotonic()
    while True:
        print_text(f"{silence_of(time.monotonic() - received_s) or line_of(status)}\n")
        due_s = time.monotonic() + _LINE_PERIOD_S
        while (left_s := due_s - time.monotonic()) > 0.0:
            if statuses.waiting(left_s) and (received := statuses.read()):
                status, received_s = received[-1], time.monotonic()


def _watch(statuses: Statuses, console: Console) -> None:
    """Shows the page until q is typed."""
    status, received_s = statuses.first(), time.monotonic()
    with keyboard() as keys, Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            silent_s = time.monotonic() - received_s
            live.update(LiveView(status, notes=["q: end"], silent_s=silent_s), refresh=True)
            ready, _, _ = select.select([statuses.fileno(), *keys], [], [], _TICK_S)
            if statuses.fileno() in ready and (received := statuses.read()):
                status, received_s = received[-1], time.monotonic()
            if quit_typed(keys, ready):
                return


def quit_typed(keys: set[int], ready: Sequence[int]) -> bool:
    """Returns True when q was typed at a ready key descriptor; takes one at its end out of keys."""
    for key in keys & set(ready):
        typed = os.read(key, 1024)
        if b"q" in typed:
            return True
        if not typed:
            keys.remove(key)
    return False


@contextlib.contextmanager
def keyboard() -> Iterator[set[int]]:
    """The keyboard, if there is one, as a descriptor that delivers each key at once, no echo."""
    if not sys.stdin or not sys.stdin.isatty():
        yield set()
        return
    keyboard = sys.stdin.fileno()
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard)
    try:
        yield {keyboard}
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
