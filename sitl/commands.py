"""Commands and their answers, as both autopilots read and write them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from sitl.wire import layout, packet_header

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
CUSTOM_MODE_BIT: Final = 1
FORCE: Final = 21196
"""Param2 of an arming command that skips the checks."""
_DEG_1E7: Final = 1e7


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command, COMMAND_LONG and COMMAND_INT alike; x and y in degrees as coordinates."""

    link: str
    system: int
    component: int
    number: int
    p1: float
    p2: float
    p3: float
    p4: float
    x: float
    y: float
    z: float


class Host(Protocol):
    """Interface of the vehicle for commands."""

    def acknowledge(self, command: Command, result: int) -> None:
        """Send a COMMAND_ACK to the sender."""

    def set_interval(self, link: str, msgid: int, interval_us: int) -> int:
        """Set a message interval; returns the result."""

    def send_interval(self, link: str, msgid: int) -> int:
        """Send MESSAGE_INTERVAL; returns the result."""

    def send_message(self, link: str, msgid: int) -> int:
        """Send a message once; returns the result."""

    def restart(self) -> None:
        """Restart as commanded."""


Handler = Callable[[Command], int | None]
"""Carries a command out; returns the result, or None when it was acknowledged already."""


class CommandTable:
    """The commands by number: those about messages, and an autopilot's own."""

    def __init__(self, host: Host, handlers: Mapping[int, Handler]) -> None:
        """Connect the handlers."""
        self._host = host
        self._handlers: dict[int, Handler] = {
            510: self._get_interval,
            511: self._set_interval,
            512: self._request_message,
            **handlers,
        }

    def run(self, command: Command) -> None:
        """Carry a command out and answer it."""
        handler = self._handlers.get(command.number)
        result = UNSUPPORTED if handler is None else handler(command)
        if result is not None:
            self._host.acknowledge(command, result)

    def _get_interval(self, command: Command) -> int | None:
        return self._host.send_interval(command.link, int(number(command.p1)))

    def _set_interval(self, command: Command) -> int:
        msgid, interval_us = int(number(command.p1)), int(number(command.p2))
        return self._host.set_interval(command.link, msgid, interval_us)

    def _request_message(self, command: Command) -> int:
        return self._host.send_message(command.link, int(number(command.p1)))


def read_command(link: str, message: Any) -> Command:
    """Bring both kinds of command into one form."""
    integer = message.get_type() == "COMMAND_INT"
    scale = _DEG_1E7 if integer else 1.0
    x, y, z = (
        (message.x, message.y, message.z)
        if integer
        else (message.param5, message.param6, message.param7)
    )
    system, component = source(message)
    return Command(
        link=link, system=system, component=component, number=message.command,
        p1=message.param1, p2=message.param2, p3=message.param3, p4=message.param4,
        x=x / scale, y=y / scale, z=z,
    )  # fmt: skip


def source(message: Any) -> tuple[int, int]:
    """Return the system and component that sent a message."""
    _, system, component = packet_header(message.get_msgbuf())
    return system, component


def acknowledgement(command: Command, result: int) -> bytes:
    """Return COMMAND_ACK's payload, addressed to the command's sender."""
    return layout("COMMAND_ACK").payload(
        command=command.number,
        result=result,
        progress=0,
        result_param2=0,
        target_system=command.system,
        target_component=command.component,
    )


def timesync_answer(message: Any, since_boot_us: int) -> bytes:
    """Return the answer to a TIMESYNC request (one with tc1 of 0)."""
    return layout("TIMESYNC").payload(tc1=since_boot_us * 1000, ts1=message.ts1)


def number(value: float) -> float:
    """Return a parameter that may be NaN, which counts as 0."""
    return value if math.isfinite(value) else 0.0
