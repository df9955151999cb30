"""An MQTT broker as a process: Mosquitto where it is installed, otherwise amqtt from pip.

The environment's MOAR_BROKER may name one of the two, `mosquitto` or `amqtt`.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from .processes import Process

_START_S = 20.0
"""Import time of amqtt: a second, on a busy machine ten."""
_POLL_S = 0.05


class BrokerError(Exception):
    """A missing broker, or one that does not start; one line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificates:
    """PEM files of a broker with TLS. ca: for the certificates of clients."""

    ca: Path
    certificate: Path
    key: Path


def broker_name() -> str:
    """`mosquitto` or `amqtt`; BrokerError if neither is installed."""
    wanted = os.environ.get("MOAR_BROKER")
    if wanted not in {None, "mosquitto", "amqtt"}:
        raise BrokerError(f"MOAR_BROKER is {wanted!r}, must be mosquitto or amqtt")
    if wanted != "amqtt" and _mosquitto() is not None:
        return "mosquitto"
    if wanted != "mosquitto" and (Path(sys.executable).parent / "amqtt").exists():
        return "amqtt"
    raise BrokerError('no broker: install mosquitto, or pip install "moar-companion[broker]"')


def _mosquitto() -> str | None:
    """Debian has it in /usr/sbin, which no user's path includes."""
    return shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")


def free_tcp_port() -> int:
    """TCP port of this machine that is not in use."""
    with socket.socket() as item:
        item.bind(("127.0.0.1", 0))
        return int(item.getsockname()[1])


@contextlib.contextmanager
def running_broker(
    folder: Path, port: int, *, certificates: Certificates | None = None
) -> Iterator[Process]:
    """A broker on a port of this machine, for any client there, once it listens.

    folder: for its configuration and its log. certificates: with TLS; clients without a certificate
    of the same authority are then refused (by amqtt: those with a wrong one). Raises BrokerError.
    """
    name = broker_name()
    log = folder / "broker.log"
    if name == "mosquitto":
        config = folder / "mosquitto.conf"
        config.write_text(_mosquitto_config(port, certificates), encoding="utf-8")
        command = [str(_mosquitto()), "-c", str(config)]
    else:
        config = folder / "amqtt.yaml"
        config.write_text(yaml.safe_dump(_amqtt_config(port, certificates)), encoding="utf-8")
        command = [str(Path(sys.executable).parent / "amqtt"), "-c", str(config)]
    process = Process("broker", log, *command)
    try:
        _wait(process, port)
        yield process
    finally:
        process.stop()


def _wait(process: Process, port: int) -> None:
    deadline_s = time.monotonic() + _START_S
    while True:
        ended = process.ended()
        if ended is not None:
            raise BrokerError(ended)
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0):
                return
        except OSError:
            if time.monotonic() > deadline_s:
                raise BrokerError(f"the broker does not listen after {_START_S:g} s") from None
        time.sleep(_POLL_S)


def _mosquitto_config(port: int, certificates: Certificates | None) -> str:
    lines = [f"listener {port} 127.0.0.1", "allow_anonymous true", "persistence false"]
    if os.geteuid() == 0:
        lines.append("user root")
    if certificates is not None:
        lines += [
            f"cafile {certificates.ca}",
            f"certfile {certificates.certificate}",
            f"keyfile {certificates.key}",
            "require_certificate true",
        ]
    return "\n".join([*lines, ""])


def _amqtt_config(port: int, certificates: Certificates | None) -> dict[str, object]:
    listener: dict[str, object] = {"type": "tcp", "bind": f"127.0.0.1:{port}"}
    if certificates is not None:
        listener |= {
            "ssl": True,
            "cafile": str(certificates.ca),
            "certfile": str(certificates.certificate),
            "keyfile": str(certificates.key),
        }
    return {
        "listeners": {"default": listener},
        "plugins": {
            "amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True},
        },
    }
