"""Commands to PX4 and their acknowledgements.

Inputs: COMMAND_LONG and COMMAND_INT addressed to the autopilot. Outputs: effects, COMMAND_ACK.
Every DO_SET_MODE gets two ACKs: ACCEPTED at once, then the real result one tick later (measured
on PX4 v1.17.0).
"""

import math
from typing import Protocol

from sitl.commands import (
    ACCEPTED,
    CUSTOM_MODE_BIT,
    DENIED,
    FORCE,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    CommandTable,
    Host,
    number,
)
from sitl.px4 import texts
from sitl.px4.commander import Commander
from sitl.px4.flight import FlightTasks
from sitl.px4.modes import Mode, requested
from sitl.px4.navigation import Navigation


class Px4Host(Host, Protocol):
    """Further interface of the vehicle for PX4's commands."""

    def acknowledge_later(self, command: Command, result: int) -> None:
        """Send a COMMAND_ACK to the sender in the next tick."""


class Commands(CommandTable):
    """The table of commands."""

    def __init__(
        self,
        host: Px4Host,
        commander: Commander,
        tasks: FlightTasks,
        navigation: Navigation,
        text_sender: texts.TextSender,
    ) -> None:
        """Connect the handlers."""
        super().__init__(
            host,
            {
                20: self._return, 21: self._land, 22: self._take_off, 176: self._set_mode,
                179: self._set_home, 192: self._reposition, 246: self._restart, 400: self._arm,
                410: self._get_home, 519: self._request_protocol, 520: self._request_capabilities,
            },
        )  # fmt: skip
        self._px4 = host
        self._commander = commander
        self._tasks = tasks
        self._nav = navigation
        self._text_sender = text_sender

    def _set_mode(self, command: Command) -> int | None:
        if not int(number(command.p1)) & CUSTOM_MODE_BIT:
            return DENIED
        mode = requested(int(number(command.p2)), int(number(command.p3)))
        if mode is None:
            return DENIED
        self._host.acknowledge(command, ACCEPTED)
        done = self._commander.request_mode(mode)
        self._px4.acknowledge_later(command, ACCEPTED if done else TEMPORARILY_REJECTED)
        return None

    def _arm(self, command: Command) -> int:
        arm = round(number(command.p1))
        if arm not in (0, 1):
            return UNSUPPORTED
        force = round(number(command.p2)) == FORCE
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
            self._text_sender.send(texts.INFO, "Landing at current position")
        return result

    def _take_off(self, command: Command) -> int:
        result = self._mode(Mode.TAKEOFF)
        if result == ACCEPTED and math.isfinite(command.z) and command.z:
            self._tasks.climb_to(self._nav.origin_altitude_m - command.z)
        return result

    def _reposition(self, command: Command) -> int:
        if round(number(command.p2)) & 1 and self._commander.mode is not Mode.HOLD:
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
        if round(number(command.p1)) != 1 or not self._nav.position_valid:
            return DENIED
        self._nav.set_home()
        return ACCEPTED

    def _restart(self, command: Command) -> int | None:
        if self._commander.armed:
            return DENIED
        if round(number(command.p1)) != 1:
            return UNSUPPORTED
        self._host.acknowledge(command, ACCEPTED)
        self._host.restart()
        return None

    def _get_home(self, command: Command) -> int:
        return self._host.send_message(command.link, 242)

    def _get_interval(self, command: Command) -> int | None:
        """Acknowledge first; the other autopilot acknowledges last."""
        self._host.acknowledge(command, ACCEPTED)
        self._host.send_interval(command.link, int(number(command.p1)))
        return None

    def _request_protocol(self, command: Command) -> int:
        return self._host.send_message(command.link, 300)

    def _request_capabilities(self, command: Command) -> int:
        return self._host.send_message(command.link, 148)
