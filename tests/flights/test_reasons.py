"""The reason of an unreached target: every text that tells a stop is found."""

from __future__ import annotations

import pytest

from moar_companion.companion.safety.conditions import CONDITIONS

from .reasons import reason

TEXTS = {
    words: text
    for row in CONDITIONS
    for text in row.examples
    if (words := row.action_words("")) and text.endswith(f", {words}")
}
"""A text of a condition for each action."""
ANSWERS = [
    "MOAR: no path to splice-1, denied",
    "MOAR: the service ends, failed",
]


@pytest.mark.parametrize("text", [*TEXTS.values(), *ANSWERS], ids=[*TEXTS, "denied", "failed"])
def test_the_last_text_that_tells_a_stop_is_the_reason(text):
    said = ["MOAR: wind 12 m/s > 10, holding", text, "MOAR: flying inspection to splice-1"]
    assert reason("holding", said) == f"holding: {text}"


def test_each_action_has_a_text_here():
    assert TEXTS.keys() >= {
        "slowing", "holding", "exiting", "evacuating", "leaving", "released", "overridden", "idle",
        "rejected",
    }  # fmt: skip


def test_a_flight_without_a_stop_has_no_reason():
    said = ["MOAR: flying inspection to splice-1", "MOAR: replaced by a newer order, cancelled"]
    assert reason("flying", said) == "on its way: nothing was said of it"
