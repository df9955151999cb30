"""A condition against a flight: its cause, its action, its override, its texts. Values.

`conditions` is the table of all of them.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from ...settings.config import Supervision
from ...texts.text_format import pilot_text
from ...types import Mission
from ..mission_states import MissionState
from .check_inputs import CheckInputs

BATTERY_MISREAD = "battery {0|255}: {16.0 V|655.3 V}, not {12|100}S"
"""Text before control only: the answer to an order."""
_FIELD = re.compile(r"\{([^{}]*)\}")


class Action(enum.IntEnum):
    """Effect of a condition on the flight; the greater takes precedence."""

    CONTINUE = 0
    """The flight continues."""
    SLOW = 1
    HOLD = 2
    EXIT = 3
    EVACUATION = 4
    LEAVE = 5
    """Flies a checked leg to the nearest place where what threatens hits nothing, and holds."""
    RELEASE = 6
    """The stream ends: the autopilot or the pilot flies."""

    @property
    def words(self) -> str:
        """Text for operators; empty where the flight continues."""
        return _WORDS.get(self, "")


_WORDS = {
    Action.SLOW: "slowing",
    Action.HOLD: "holding",
    Action.EXIT: "exiting",
    Action.EVACUATION: "evacuating",
    Action.LEAVE: "leaving",
    Action.RELEASE: "released",
}


class Override(enum.Enum):
    """Orders that are carried out although a condition acts."""

    NONE = "no order"
    SAFER = "a hold, an exit or an evacuation that is ordered"
    ORDER = "any new order"


class Look(NamedTuple):
    """What a cause is looked for in. off_path_m: the vehicle's."""

    seen: CheckInputs
    limits: Supervision
    off_path_m: float
    now_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A row of the table.

    starts: the cause that starts it, for the reference. cause: finds it, as a text with the value;
    None: healthy. texts: its forms, as pilots read them, without the details in parentheses, which
    they do not receive. Braces have an example of what varies, and after a bar the longest value;
    names are cut to the available room, which their longest value fills. after_s: time that its
    cause lasts before it acts, including breaks shorter than that and over_s. over_s: time that the
    cause must be over before it clears. latched: it then still needs a new order to clear.
    last_setpoint: one at rest is useful when the stream ends. rest: the mission's state after that.
    passing: late or missing data alone end the stream, and may come again: the rest of the mission
    is kept for a `continue`. All other causes are a fault, or a decision of the autopilot.
    """

    name: str
    starts: str
    cause: Callable[[Look], str | None]
    action: Action
    texts: tuple[str, ...]
    after_s: float = 0.0
    over_s: float = 0.0
    latched: bool = False
    override: Override = Override.NONE
    last_setpoint: bool = True
    rest: MissionState = MissionState.RELEASED
    passing: bool = False

    def objects_to(self, mission: Mission) -> bool:
        """True if this mission must not be ordered while the condition lasts."""
        if self.override is Override.SAFER:
            return mission.visits_targets
        return self.override is Override.NONE

    def action_words(self, text: str) -> str:
        """The action in one of its texts; empty where the flight continues."""
        if text == BATTERY_MISREAD:
            return "rejected"
        if self.action is Action.RELEASE:
            return self.rest.words
        if self.action is Action.CONTINUE and self.override is Override.NONE:
            return "rejected"
        return self.action.words

    @property
    def examples(self) -> list[str]:
        """Its texts as they are sent, with example values."""
        return [pilot_text(filled(text), self.action_words(text)) for text in self.texts]


def filled(text: str, *, longest: bool = False) -> str:
    """A text with its example values, or with the longest ones."""
    return _FIELD.sub(lambda field: field[1].split("|")[-1 if longest else 0], text)
