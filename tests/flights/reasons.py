"""The reason why a target was not reached, from the state and the texts to operators."""

from __future__ import annotations

_STOPS = (", holding", ", denied", ", slowing", ", released", ", overridden", ", exiting")
"""Ends of the texts that have the reason of a hold."""


def reason(state: str, texts: list[str]) -> str:
    """The state in which a flight ended, and the last reason that an operator was told."""
    state = "on its way" if state == "flying" else state
    reasons = [text for text in texts if text.endswith(_STOPS)]
    return f"{state}: {reasons[-1] if reasons else 'nothing was said of it'}"
