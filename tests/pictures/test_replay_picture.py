"""The picture of a replay: what is drawn of what, and names that do not overlap."""

from __future__ import annotations

import io
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib import image

from moar_companion.analysis.pictures import replay_picture
from moar_companion.analysis.pictures.figure import Page
from moar_companion.analysis.pictures.replay_picture import draw_replay
from moar_companion.analysis.replay.replay_report import (
    Replay,
    ReplayEvent,
    ReplayPlace,
    ReplaySample,
)

INDICES = ("wind", "communication", "localization", "battery")


def sample(time_s, risk=0.5, *, why="tilt", armed=True, mode="HOLD", **others):
    return ReplaySample(
        time_s=time_s,
        risk=dict.fromkeys(INDICES, risk),
        why=dict.fromkeys(INDICES, why),
        armed=armed,
        mode=mode,
        mission_state=others.get("mission_state"),
        place=others.get("place"),
    )


def replay_of(samples, events=(), **changes):
    values = {
        "recording": "flight.tlog",
        "vehicle": "X500",
        "autopilot": "px4",
        "vehicle_type": "quadrotor",
        "duration_s": samples[-1].time_s,
        "samples": tuple(samples),
        "events": tuple(events),
        "inputs": {},
        "measures": {},
    }
    return Replay(**values | changes)


def pixels(replay):
    stream = io.BytesIO()
    draw_replay(replay, stream)
    stream.seek(0)
    return image.imread(stream)[..., :3]


@pytest.mark.slow
def test_a_picture_has_a_panel_more_for_clearance_and_a_band_more_for_missions():
    times_s = np.arange(0.0, 20.0, 0.5)
    plain = pixels(replay_of([sample(t) for t in times_s]))
    place = ReplayPlace(position_m=(1.0, 0.0, 2.0), clearance_m=3.0, evacuation_s=9.0)
    placed = pixels(replay_of([sample(t, place=place) for t in times_s]))
    flown = pixels(replay_of([sample(t, mission_state="flying") for t in times_s]))
    assert plain.shape[1] == placed.shape[1] == flown.shape[1]
    assert plain.shape[0] < flown.shape[0] < placed.shape[0]


@pytest.mark.slow
def test_an_unknown_value_is_no_curve_at_zero():
    unknown = pixels(replay_of([sample(t, None, armed=None) for t in range(20)]))
    zero = pixels(replay_of([sample(t, 0.0, armed=None) for t in range(20)]))
    blue = np.array([0x1F, 0x77, 0xB4]) / 255.0

    def curve(picture):
        """Pixels of the wind's colour, left of what is written beside the panel."""
        near = np.abs(picture - blue).max(axis=2) < 0.02
        return int(near[:, : int(0.8 * picture.shape[1])].sum())

    assert curve(zero) > 500
    assert curve(unknown) == 0


def test_the_reason_of_a_high_index_is_shown_at_its_first_time():
    samples = [sample(0.0, 0.1), sample(1.0, 0.9, why=None), sample(2.0, 0.9), sample(3.0, 0.9)]
    assert replay_picture._greatest("wind", samples) == "at most 0.90, at 2 s\ntilt"
    assert replay_picture._greatest("wind", samples[:1]) == "at most 0.10, at 0 s"
    assert (
        replay_picture._greatest("wind", samples[1:2]) == "at most 0.90, at 1 s\nnothing measured"
    )
    assert replay_picture._greatest("wind", [sample(0.0, None)]) == "unknown"


@pytest.mark.parametrize("name", ["a" * 300, "$x^$ \x07 \u4e2d\u6587.tlog"])
def test_any_name_can_be_drawn(name):
    events = [ReplayEvent(time_s=0.0, kind="text", text=f"autopilot warning: {name}")]
    assert pixels(replay_of([sample(0.0)], events, recording=name, autopilot="unknown")).size


def test_an_instant_without_an_autopilot_can_be_drawn():
    none = sample(0.0, None, why=None, armed=None, mode=None)
    assert pixels(replay_of([none], autopilot="unknown", vehicle_type=None)).size


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 100.0), st.sampled_from(["armed", "gps", "battery", "link"])),
        max_size=40,
    )
)
def test_names_of_events_do_not_overlap_and_no_line_crosses_one(happened):
    events = [ReplayEvent(time_s=t, kind=kind, text=f"{kind} happened") for t, kind in happened]
    labels, left_out = replay_picture._placed(events, 100.0)
    assert len(labels) + left_out == len(events)
    spans = [
        (label, label.begin_s, label.begin_s + replay_picture._width_s(label.text, 100.0))
        for label in labels
    ]
    for (one, begin, stop), (other, other_begin, other_stop) in itertools.permutations(spans, 2):
        if one.lane == other.lane:
            assert stop <= other_begin or other_stop <= begin
        elif one.lane < other.lane:
            assert not begin < other.event.time_s < stop


def test_the_important_events_find_room_first():
    crowd = [ReplayEvent(time_s=50.0, kind="text", text=f"autopilot error: {n}") for n in range(30)]
    alarm = ReplayEvent(time_s=50.0, kind="failsafe", text="failsafe")
    labels, left_out = replay_picture._placed([*crowd, alarm], 100.0)
    assert alarm in [label.event for label in labels]
    assert left_out > 0


def test_unimportant_texts_are_not_named():
    texts = ["autopilot info: x", "companion notice: y", "autopilot warning: z"]
    events = [ReplayEvent(time_s=1.0, kind="text", text=text) for text in texts]
    labels, left_out = replay_picture._placed(events, 10.0)
    assert ([label.text for label in labels], left_out) == (["warning: z"], 0)


def drawn(replay, monkeypatch):
    """The names in the bands and in the lanes of events, with their boxes on the page."""
    pages = []
    monkeypatch.setattr(replay_picture, "Page", lambda *size: pages.append(Page(*size)) or pages[0])
    draw_replay(replay, io.BytesIO())
    figure = pages[0].figure
    renderer = figure.canvas.get_renderer()
    return [
        (text.get_text(), text.get_window_extent(renderer))
        for axes in figure.axes
        if not axes.axison
        for text in axes.texts
        if text.get_text() not in {"mode", "mission"}
    ]


@pytest.mark.parametrize("kind", ["mode", "mission"])
def test_a_mode_too_short_for_its_name_is_named_above_and_names_do_not_overlap(monkeypatch, kind):
    """Eight in seven seconds, one of them between two samples, as in a recording of a pilot's."""
    began = [(0.0, "GUIDED"), (16.2, "LOITER"), (18.2, "GUIDED"), (40.3, "POSHOLD")]
    began += [(41.5, "GUIDED"), (42.7, "ACRO"), (43.2, "GUIDED"), (43.3, "BRAKE")]
    began += [(43.6, "POSHOLD"), (44.4, "RTL"), (44.8, "GUIDED_NOGPS"), (46.0, "GUIDED")]

    def at(time_s):
        return next(name for begin_s, name in reversed(began) if begin_s <= time_s)

    word = {"mode": "mode", "mission": "mission_state"}[kind]
    samples = [sample(t, **{"mode": None, word: at(t)}) for t in np.arange(0.0, 47.0, 0.5)]
    events = [ReplayEvent(time_s=time_s, kind=kind, text=name) for time_s, name in began]
    names = drawn(replay_of(samples, events), monkeypatch)
    assert sorted(text for text, _ in names) == sorted(name for _, name in began)
    for (one, box), (other, other_box) in itertools.combinations(names, 2):
        assert not box.overlaps(other_box), (one, other)


def test_a_long_mode_is_named_in_its_band_alone(monkeypatch):
    samples = [
        sample(t, mode="HOLD" if t < 10.0 else "OFFBOARD") for t in np.arange(0.0, 20.0, 0.5)
    ]
    events = [
        ReplayEvent(time_s=time_s, kind="mode", text=name)
        for time_s, name in [(0.0, "HOLD"), (9.6, "OFFBOARD")]
    ]
    names = [text for text, _ in drawn(replay_of(samples, events), monkeypatch)]
    assert names == ["HOLD", "OFFBOARD"]
