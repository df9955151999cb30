"""Commands to ArduPilot and their acknowledgements.

Inputs: COMMAND_LONG and COMMAND_INT that the routing left to the autopilot. Outputs: effects and
one COMMAND_ACK each.
"""

from typing import Final

from sitl.ardupilot.battery import BatteryMonitor
from sitl.ardupilot.commander import Commander
from sitl.ardupilot.fence import Fence
from sitl.ardupilot.modes import Mode
from sitl.ardupilot.navigation import Navigation
from sitl.commands import (
    ACCEPTED,
    CUSTOM_MODE_BIT,
    DENIED,
    FAILED,
    FORCE,
    UNSUPPORTED,
    Command,
    CommandTable,
    Host,
    number,
)

_FORCE_ARMING: Final = 2989


class Commands(CommandTable):
    """The table of commands."""

    def __init__(
        self,
        host: Host,
        commander: Commander,
        navigation: Navigation,
        battery: BatteryMonitor,
        fence: Fence,
    ) -> None:
        """Connect the handlers."""
        super().__init__(
            host,
            {
                20: self._return, 21: self._land, 22: self._take_off, 176: self._set_mode,
                179: self._set_home, 207: self._switch_fence, 246: self._restart, 400: self._arm,
                42651: self._reset_battery,
            },
        )  # fmt: skip
        self._commander = commander
        self._nav = navigation
        self._battery = battery
        self._fence = fence

    def _set_mode(self, command: Command) -> int:
        if not int(number(command.p1)) & CUSTOM_MODE_BIT:
            return DENIED
        return _done(self._commander.request_mode(int(number(command.p2))))

    def _arm(self, command: Command) -> int:
        wish, magic = round(number(command.p1)), round(number(command.p2))
        if wish == 1:
            return _done(self._commander.arm(force=magic == _FORCE_ARMING))
        if wish == 0:
            return _done(self._commander.disarm(force=magic == FORCE))
        return UNSUPPORTED

    def _return(self, _: Command) -> int:
        return _done(self._commander.request_mode(Mode.RTL.number))

    def _land(self, _: Command) -> int:
        return _done(self._commander.request_mode(Mode.LAND.number))

    def _take_off(self, command: Command) -> int:
        return _done(self._commander.take_off(number(command.z)))

    def _set_home(self, command: Command) -> int:
        if round(number(command.p1)) != 1 or not self._nav.position_ok:
            return FAILED
        self._nav.set_home()
        return ACCEPTED

    def _switch_fence(self, command: Command) -> int:
        wish = round(number(command.p1))
        if wish not in (0, 1):
            return FAILED
        self._fence.switch(on=wish == 1)
        return ACCEPTED

    def _restart(self, command: Command) -> int | None:
        if self._commander.armed or round(number(command.p1)) != 1:
            return FAILED
        self._host.acknowledge(command, ACCEPTED)
        self._host.restart()
        return None

    def _reset_battery(self, command: Command) -> int:
        if not int(number(command.p1)) & 1:
            return FAILED
        self._battery.reset(number(command.p2))
        return ACCEPTED


def _done(done: bool) -> int:
    return ACCEPTED if done else FAILED
