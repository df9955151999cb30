"""Commands to PX4 and their acknowledgements.

Inputs: COMMAND_LONG and COMMAND_INT addressed to the autopilot. Outputs: effects, COMMAND_ACK.
Every DO_SET_MODE gets two ACKs: ACCEPTED at once, then the real result one tick later (measured
on PX4 v1.17.0).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

from sitl.px4 import voice as say
from sitl.px4.commander import Commander
from sitl.px4.flight import FlightTasks
from sitl.px4.modes import Mode, requested
from sitl.px4.navigation import Navigation
from sitl.px4.parameters import Parameters

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
_CUSTOM_MODE_BIT: Final = 1
_FORCE: Final = 21196
_FRAME_GLOBAL_INT: Final = 5
_DEG_1E7: Final = 1e7


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command, COMMAND_LONG and COMMAND_INT alike; x and y in degrees where they are."""

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
    """What commands need of the vehicle around them."""

    def acknowledge(self, command: Command, result: int, *, later: bool = False) -> None:
        """Send a COMMAND_ACK to the sender, now or in the next tick."""

    def set_interval(self, link: str, msgid: int, interval_us: int) -> bool:
        """Set a message interval; False where PX4 fails."""

    def send_interval(self, link: str, msgid: int) -> None:
        """Send MESSAGE_INTERVAL."""

    def send_message(self, link: str, msgid: int) -> bool:
        """Send a message once; False when there is no such data."""

    def reboot(self) -> None:
        """Restart."""


def read_command(link: str, message: Any, source: tuple[int, int]) -> Command:
    """Bring both kinds of command into one form."""
    integer = message.get_type() == "COMMAND_INT"
    scale = _DEG_1E7 if integer else 1.0
    x, y, z = (
        (message.x, message.y, message.z)
        if integer
        else (message.param5, message.param6, message.param7)
    )
    return Command(
        link=link, system=source[0], component=source[1], number=message.command,
        p1=message.param1, p2=message.param2, p3=message.param3, p4=message.param4,
        x=x / scale, y=y / scale, z=z,
    )  # fmt: skip


class Commands:
    """The table of commands."""

    def __init__(
        self,
        host: Host,
        commander: Commander,
        tasks: FlightTasks,
        navigation: Navigation,
        parameters: Parameters,
        voice: say.Voice,
    ) -> None:
        """Connect the handlers."""
        self._host = host
        self._commander = commander
        self._tasks = tasks
        self._nav = navigation
        self._parameters = parameters
        self._voice = voice
        self._handlers: dict[int, Callable[[Command], int | None]] = {
            20: self._return, 21: self._land, 22: self._take_off, 176: self._set_mode,
            179: self._set_home, 192: self._reposition, 246: self._restart, 400: self._arm,
            410: self._get_home, 510: self._get_interval, 511: self._set_interval,
            512: self._request_message, 519: self._request_protocol,
            520: self._request_capabilities,
        }  # fmt: skip

    def run(self, command: Command) -> None:
        """Carry a command out and answer it."""
        handler = self._handlers.get(command.number)
        result = UNSUPPORTED if handler is None else handler(command)
        if result is not None:
            self._host.acknowledge(command, result)

    def _set_mode(self, command: Command) -> int | None:
        if not int(_number(command.p1)) & _CUSTOM_MODE_BIT:
            return DENIED
        mode = requested(int(_number(command.p2)), int(_number(command.p3)))
        if mode is None:
            return DENIED
        self._host.acknowledge(command, ACCEPTED)
        done = self._commander.request_mode(mode)
        self._host.acknowledge(command, ACCEPTED if done else TEMPORARILY_REJECTED, later=True)
        return None

    def _arm(self, command: Command) -> int:
        arm = round(_number(command.p1))
        if arm not in (0, 1):
            return UNSUPPORTED
        force = round(_number(command.p2)) == _FORCE
        if arm:
            done = self._commander.arm("external command")
        else:
            done = self._commander.disarm("external command", force=force)
        return ACCEPTED if done else TEMPORARILY_REJECTED

    def _mode(self, mode: Mode) -> int:
        return ACCEPTED if self._commander.request_mode(mode) else TEMPORARILY_REJECTED

    def _return(self, _: Command) -> int:
        return self._mode(Mode.RTL)

    def _land(self, _: Command) -> int:
        result = self._mode(Mode.LAND)
        if result == ACCEPTED:
            self._voice.say(say.INFO, "Landing at current position")
        return result

    def _take_off(self, command: Command) -> int:
        result = self._mode(Mode.TAKEOFF)
        if result == ACCEPTED and math.isfinite(command.z) and command.z:
            self._tasks.climb_to(self._nav.origin_altitude_m - command.z)
        return result

    def _reposition(self, command: Command) -> int:
        if round(_number(command.p2)) & 1 and self._commander.mode is not Mode.HOLD:
            if not self._commander.request_mode(Mode.HOLD):
                return TEMPORARILY_REJECTED
        elif self._commander.mode is not Mode.HOLD:
            return DENIED
        x = y = math.nan
        if math.isfinite(command.x) and math.isfinite(command.y) and (command.x or command.y):
            x, y = self._nav.origin.project(command.x, command.y)
        self._tasks.reposition(x, y, self._nav.origin_altitude_m - command.z, command.p4)
        return ACCEPTED

    def _set_home(self, command: Command) -> int:
        if round(_number(command.p1)) != 1 or not self._nav.position_valid:
            return DENIED
        self._nav.set_home()
        return ACCEPTED

    def _restart(self, command: Command) -> int | None:
        if self._commander.armed:
            return DENIED
        if round(_number(command.p1)) != 1:
            return UNSUPPORTED
        self._host.acknowledge(command, ACCEPTED)
        self._host.reboot()
        return None

    def _get_home(self, command: Command) -> int:
        return self._send(command, 242)

    def _get_interval(self, command: Command) -> int | None:
        self._host.acknowledge(command, ACCEPTED)
        self._host.send_interval(command.link, int(_number(command.p1)))
        return None

    def _set_interval(self, command: Command) -> int:
        msgid, interval_us = int(_number(command.p1)), int(_number(command.p2))
        done = self._host.set_interval(command.link, msgid, interval_us)
        return ACCEPTED if done else FAILED

    def _request_message(self, command: Command) -> int:
        return self._send(command, int(_number(command.p1)))

    def _request_protocol(self, command: Command) -> int:
        return self._send(command, 300)

    def _request_capabilities(self, command: Command) -> int:
        return self._send(command, 148)

    def _send(self, command: Command, msgid: int) -> int:
        return ACCEPTED if self._host.send_message(command.link, msgid) else DENIED


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0
