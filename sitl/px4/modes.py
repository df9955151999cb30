"""PX4's flight modes on the wire, and their requirements.

custom_mode = sub << 24 | main << 16; base_mode values as measured on PX4 v1.17.0.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeFacts:
    """One mode: its numbers, its PX4 name, and its requirements."""

    label: str
    title: str
    main: int
    sub: int
    base_mode: int
    needs_position: bool = True
    needs_sticks: bool = False


class Mode(Enum):
    """The modes this vehicle has."""

    MANUAL = ModeFacts(
        label="MANUAL", title="Manual", main=1, sub=0, base_mode=81,
        needs_position=False, needs_sticks=True,
    )  # fmt: skip
    ALTCTL = ModeFacts(
        label="ALTCTL", title="Altitude", main=2, sub=0, base_mode=81,
        needs_position=False, needs_sticks=True,
    )  # fmt: skip
    POSCTL = ModeFacts(
        label="POSCTL", title="Position", main=3, sub=0, base_mode=81, needs_sticks=True
    )
    TAKEOFF = ModeFacts(label="AUTO.TAKEOFF", title="Takeoff", main=4, sub=2, base_mode=29)
    HOLD = ModeFacts(label="AUTO.LOITER", title="Hold", main=4, sub=3, base_mode=29)
    MISSION = ModeFacts(label="AUTO.MISSION", title="Mission", main=4, sub=4, base_mode=29)
    RTL = ModeFacts(label="AUTO.RTL", title="Return", main=4, sub=5, base_mode=29)
    LAND = ModeFacts(label="AUTO.LAND", title="Land", main=4, sub=6, base_mode=29)
    DESCEND = ModeFacts(
        label="AUTO.LAND", title="Descend", main=4, sub=6, base_mode=29, needs_position=False
    )
    OFFBOARD = ModeFacts(label="OFFBOARD", title="Offboard", main=6, sub=0, base_mode=17)

    @property
    def custom_mode(self) -> int:
        """The number in HEARTBEAT.custom_mode."""
        return self.value.sub << 24 | self.value.main << 16

    @property
    def label(self) -> str:
        """PX4's own name, as ground stations print it."""
        return self.value.label

    @property
    def title(self) -> str:
        """The name in PX4's texts."""
        return self.value.title


AUTO_MODES: Final = frozenset(
    {Mode.TAKEOFF, Mode.HOLD, Mode.MISSION, Mode.RTL, Mode.LAND, Mode.DESCEND}
)
_BY_NUMBERS: Final = {
    (mode.value.main, mode.value.sub): mode for mode in Mode if mode is not Mode.DESCEND
}
_READY: Final = (4, 1)


def requested(main: int, sub: int) -> Mode | None:
    """Return the mode that DO_SET_MODE's param2 and param3 name; None when there is none."""
    if (main, sub) in (_READY, (4, 0)):
        return Mode.MISSION
    if main in (1, 2, 3, 6):
        sub = 0
    return _BY_NUMBERS.get((main, sub))
