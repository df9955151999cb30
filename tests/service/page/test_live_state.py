"""Frames for viewers: what each has after any sequence of them."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.service.page.live_state import LiveState, merge_patch
from tests.service.page.merging import merged

_SCALARS = st.none() | st.booleans() | st.integers(-5, 5) | st.text("ab", max_size=2)
_VALUES = st.recursive(
    _SCALARS | st.lists(_SCALARS, max_size=3),
    lambda inner: st.dictionaries(st.sampled_from("abcd"), inner, max_size=4),
    max_leaves=12,
)
_STATES = st.dictionaries(st.sampled_from("abcd"), _VALUES, max_size=4)


def without_nulls(value):
    """A state as a display knows it: null is absent."""
    if not isinstance(value, dict):
        return value
    return {name: without_nulls(item) for name, item in value.items() if item is not None}


@given(before=_STATES, after=_STATES)
def test_a_state_and_its_patch_give_the_next_state(before, after):
    patch = merge_patch(before, after)
    assert without_nulls(merged(before, patch)) == without_nulls(after)
    assert bool(patch) or without_nulls(before) == without_nulls(after)


def test_a_patch_has_what_has_changed_and_nothing_else():
    before = {"mission": {"state": "flying", "goal": "a"}, "risk": [1, 2], "path": {"left_m": 1.0}}
    after = {"mission": {"state": "holding", "goal": "a"}, "risk": [1, 2], "path": None}
    assert merge_patch(before, after) == {"mission": {"state": "holding"}, "path": None}


def status(x_m=1.0, **sections):
    return {"time_s": 5.0, "aircraft": {"position_m": [x_m, 0.0, 2.0]}, "plan": None} | sections


def plan(paths, *corners, target="a", mission="inspection"):
    return {"paths": paths, "path": list(corners), "target": target, "mission": mission}


def test_sections_that_change_by_their_ages_alone_come_twice_a_second():
    live = LiveState()
    seen = []
    for cycle in range(13):
        live.update(status(age_s={"battery": float(cycle)}), 0.1 * cycle)
        seen.append(live.state["age_s"]["battery"])
    assert sorted(set(seen)) == [0.0, 5.0, 10.0]


def test_the_flown_path_has_places_apart_and_none_of_a_missing_position():
    live = LiveState()
    for x_m in (0.0, 0.05, 0.09, 0.2, 0.21):
        live.update(status(x_m), 0.0)
    live.update(status() | {"aircraft": {"position_m": None}}, 0.0)
    assert [place[0] for place in live.flown] == [0.0, 0.2]
    assert json.loads(live.whole())["flown"] == [[0.0, 0.0, 2.0], [0.2, 0.0, 2.0]]


def test_the_path_before_the_last_change_is_kept_until_the_flight_goes_elsewhere():
    live = LiveState()
    live.update(status(plan=plan(1, 1)), 0.0)
    assert live.state["before"] is None
    live.update(status(plan=plan(2, 2)), 0.0)
    live.update(status(plan=plan(2, 2)), 0.1)
    assert live.state["before"] == {"path": [1]}
    live.update(status(plan=plan(3, 3)), 0.2)
    assert live.state["before"] == {"path": [2]}
    live.update(status(plan=plan(4, 4, target="b")), 0.3)
    assert live.state["before"] is None
    live.update(status(), 0.4)
    assert live.state["before"] is None


@pytest.mark.parametrize(("now_s", "silent_s"), [(0.9, None), (1.1, 1.0), (7.2, 7.0)])
def test_silence_of_the_service_is_part_of_the_state(now_s, silent_s):
    live = LiveState()
    assert not live.note_silence(100.0)
    live.update(status(), 0.0)
    assert live.note_silence(now_s) == (silent_s is not None)
    assert live.state.get("silent_s") == silent_s
    live.update(status(), 8.0)
    assert live.state.get("silent_s") is None


def test_numbers_are_as_exact_as_a_display_needs_them():
    live = LiveState()
    live.update(status(link={"age_s": 1.23456, "rate_hz": 1.23456789012}, words=[0.1 + 0.2]), 0.0)
    assert live.state["link"] == {"age_s": 1.2, "rate_hz": 1.2345679}
    assert live.state["words"] == [0.3]
