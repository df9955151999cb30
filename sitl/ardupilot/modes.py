"""ArduCopter's flight modes, and their requirements."""

from dataclasses import dataclass
from enum import Enum
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeFacts:
    """One mode: its number, its name, need of a position, permission to arm in it."""

    number: int
    title: str
    needs_position: bool = True
    armable: bool = True


class Mode(Enum):
    """The modes this vehicle has."""

    STABILIZE = ModeFacts(number=0, title="STABILIZE", needs_position=False)
    ALT_HOLD = ModeFacts(number=2, title="ALT_HOLD", needs_position=False)
    AUTO = ModeFacts(number=3, title="AUTO", armable=False)
    GUIDED = ModeFacts(number=4, title="GUIDED")
    LOITER = ModeFacts(number=5, title="LOITER")
    RTL = ModeFacts(number=6, title="RTL", armable=False)
    LAND = ModeFacts(number=9, title="LAND", needs_position=False, armable=False)
    POSHOLD = ModeFacts(number=16, title="POSHOLD")
    BRAKE = ModeFacts(number=17, title="BRAKE", armable=False)
    GUIDED_NOGPS = ModeFacts(number=20, title="GUIDED_NOGPS", needs_position=False)
    SMART_RTL = ModeFacts(number=21, title="SMART_RTL", armable=False)

    @property
    def number(self) -> int:
        """The number in HEARTBEAT.custom_mode."""
        return self.value.number

    @property
    def title(self) -> str:
        """ArduPilot's own name."""
        return self.value.title


_BY_NUMBER: Final = {mode.number: mode for mode in Mode}


def requested(number: int) -> Mode | None:
    """Return the mode of a number; None when there is none."""
    return _BY_NUMBER.get(number)
