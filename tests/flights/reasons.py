"""The reason why a target was not reached, from the state and the texts to operators."""

from __future__ import annotations

from moar_companion.companion.mission.values import Verdict
from moar_companion.companion.safety.condition_types import Action
from moar_companion.companion.safety.conditions import CONDITIONS

_REFUSALS = (Verdict.TEMPORARILY_REJECTED, Verdict.DENIED, Verdict.FAILED)

ENDS = frozenset(
    (
        *(action.words for action in Action if action.words),
        *(row.rest.words for row in CONDITIONS if row.action is Action.RELEASE),
        *(verdict.value.rpartition(" ")[2] for verdict in _REFUSALS),
    )
)
"""Ends of the texts that have the reason of a stop: of conditions and of refused orders."""


def reason(state: str, texts: list[str]) -> str:
    """The state in which a flight ended, and the last reason that an operator was told."""
    state = "on its way" if state == "flying" else state
    ends = tuple(f", {end}" for end in ENDS)
    reasons = [text for text in texts if text.endswith(ends)]
    return f"{state}: {reasons[-1] if reasons else 'nothing was said of it'}"
