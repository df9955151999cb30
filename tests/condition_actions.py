"""Every action that can be sent with a text of a condition."""

from __future__ import annotations

from moar_companion.companion.safety.condition_types import Action, Override


def all_actions(row):
    words = {"over", row.rest.words if row.action is Action.RELEASE else row.action.words}
    if row.action >= Action.HOLD or row.override is Override.NONE:
        words |= {"rejected", "failed", "idle"}
    if row.action in {Action.EXIT, Action.EVACUATION}:
        words |= {"exiting", "evacuating", "holding"}
    return words
