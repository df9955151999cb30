"""Texts for pilots: one chunk each, with value, limit and action, for all reasons and names."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.mission.state_changes import state_words
from moar_companion.companion.mission.values import Task, Verdict
from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.safety.check_inputs import Host
from moar_companion.companion.safety.condition_types import Action, Look
from moar_companion.companion.safety.conditions import CONDITIONS, causes
from moar_companion.mavlink.telemetry import PeerHeartbeat
from moar_companion.planner.planner import Planner
from moar_companion.settings.config import Supervision
from moar_companion.texts.text_format import exceeds, pilot_text
from moar_companion.types import ARDUPILOT, PX4, Mission

from ..losses import loss_of
from ..safety.seen import (
    HOVERING,
    IN_FLIGHT,
    NOW_S,
    flies,
    leaves,
    moves,
    receives,
    risk,
    wind,
    with_telemetry,
)
from ..safety.test_checks import STORIES
from ..safety.test_checks_of_place import STORIES as OF_PLACE
from .desk import ACCEPTED, EXIT, INSPECTION, Desk, usual_planner

properties = settings(deadline=None, max_examples=300, derandomize=True, database=None)
ACTIONS = (
    "",
    "over",
    *(action.words for action in Action if action.words),
    *(state.words for state in MissionState),
    "no evacuation",
)
ACTIONS += tuple(verdict.value.rpartition(" ")[2] for verdict in Verdict)
LONG = "the-third-splice-of-the-left-upper-conductor-of-span-12"
EXTREMES = (1e-9, 0.04, 0.96, 1.0001, 9.99, 12.0, 101.5, 99_999.0, 1e30, math.inf)


def assert_is_for_pilots(text):
    assert len(text) <= 50, text
    assert not re.search(r"(?<!\d)0\.0+ ", text), text
    assert not re.search("[a-z]_[a-z]", text), text
    assert text.startswith("MOAR: "), text


@properties
@given(value=st.floats(0.0, 9e4), limit=st.sampled_from((0.0, 0.5, 0.9, 1.0, 3.0, 15.0, 200.0)))
def test_a_value_above_its_limit_is_reported_with_so_many_digits_that_both_differ(value, limit):
    words = exceeds("wind", value, limit, "m/s")
    if value <= limit:
        assert words is None
        return
    if value < limit + 0.0049:  # more than two digits
        assert words == f"wind over {limit:g} m/s"
        return
    shown, shown_limit = re.fullmatch(r"wind (\S+) m/s > (\S+)", words).groups()
    assert float(shown) > float(shown_limit) == limit
    assert_is_for_pilots(pilot_text(words, "holding"))


def test_values_are_reported_with_as_many_digits_as_a_pilot_reads():
    assert exceeds("localization risk", 0.93, 0.9, "") == "localization risk 0.93 > 0.9"
    assert exceeds("moving at", 1.04, 1.0, "m/s") == "moving at 1.04 m/s > 1"
    assert exceeds("no new plan for", 12.001, 12.0, "s") == "no new plan for over 12 s"
    assert exceeds("localization risk", 0.9001, 0.9, "") == "localization risk over 0.9"
    assert exceeds("wind", 12.34, 10.0, "m/s") == "wind 12.3 m/s > 10"
    assert exceeds("off the path", 97.0, 1.5, "m") == "off the path 97.0 m > 1.5"


@properties
@given(reason=st.text(max_size=300), action=st.sampled_from(ACTIONS))
def test_every_reason_fits_into_one_chunk_with_its_action(reason, action):
    text = pilot_text(reason, action)
    assert len(text) <= 50
    assert text.endswith(f", {action}" if action else "")


def extreme(value):
    """Inputs in which every measurement is beyond its limit by this much."""
    late = PeerHeartbeat(received_s=NOW_S - value, system_id=255)
    place = (value, -value, -value)
    return [
        flies(received_s=NOW_S - value),
        replace(IN_FLIGHT, position_moved_s=NOW_S - value),
        replace(IN_FLIGHT, origin_moved_m=value, global_off_m=value),
        replace(IN_FLIGHT, home_off_m=value),
        replace(IN_FLIGHT, jumped_m=value, error_m=value, stopped=True, plan_awaited_s=value),
        replace(IN_FLIGHT, room_m=-value, host=Host(disk_free=1e-9, memory_available=0.0)),
        replace(IN_FLIGHT, risk=risk(wind(value))),
        with_telemetry(ground_station=late),
        moves(position_m=place, velocity_mps=place),
        leaves(Mission.EXIT, -value),
        leaves(Mission.EVACUATION, 30.0),
        receives(received_s=NOW_S - value),
    ]


def test_every_condition_is_reported_in_one_chunk_with_its_limit_and_action():
    limits = Supervision()
    seen = [row[1] for row in STORIES + OF_PLACE]
    seen += itertools.chain(*map(extreme, EXTREMES))
    received = set()
    for each, azimuth_rad in itertools.product(seen, (None, 0.0, 0.8, 2.4)):
        found = causes(Look(replace(each, azimuth_rad=azimuth_rad), limits, 1.5, NOW_S))
        for row in CONDITIONS:
            reason = found.get(row.name)
            if reason is None:
                continue
            received.add(row.name)
            for action in ("", "over", "rejected", row.action.words, row.rest.words):
                text = pilot_text(reason, action)
                assert_is_for_pilots(text)
                if ">" in reason:
                    assert reason.partition(" (")[0].partition(", ")[0] in text
    assert received == {row.name for row in CONDITIONS}


def test_the_effect_of_an_offboard_loss_is_reported_in_one_chunk():
    reach = usual_planner().maps.reach
    for action in range(9):
        loss = loss_of(PX4, COM_OBL_RC_ACT=float(action), RTL_TYPE=1.0)
        for words in (loss.objection_anywhere, loss._against(f" through {LONG}")):
            if words is not None:
                assert_is_for_pilots(pilot_text(words, "holding"))
    slow = loss_of(ARDUPILOT, WP_ACC=0.333333, GUID_TIMEOUT=99.0)
    assert reach is not None
    for words in (slow.lag(1.23456), slow.objection_anywhere):
        assert_is_for_pilots(pilot_text(words, "rejected"))


@pytest.mark.parametrize("state", MissionState)
@pytest.mark.parametrize("mission", Mission)
def test_every_state_is_reported_without_machine_words(state, mission):
    stops = (LONG,) if mission is Mission.INSPECTION else ()
    for task in (None, Task(mission=mission, stops=stops)):
        assert_is_for_pilots(pilot_text(state_words(state, task)))


def test_a_long_target_name_is_cut_and_the_rest_of_the_text_is_whole():
    assert pilot_text(f"at target {LONG}") == "MOAR: at target the-third-spli.."
    assert pilot_text(f"{LONG} too near obstacles", "denied") == (
        "MOAR: the-third-spli.. too near obstacles, denied"
    )


def test_details_in_details_are_left_out_too():
    reason = "no free path (the start at (15, 24) is outside (by far))"
    assert pilot_text(reason, "denied") == "MOAR: no free path, denied"


def test_the_side_of_the_plane_is_reported_by_compass_direction():
    beside = replace(moves(position_m=(5.0, 22.3, 5.0)), azimuth_rad=math.pi / 2.0)
    words = causes(Look(beside, Supervision(), 1.5, NOW_S))["off_plane"]
    assert words == "22.3 m N of plane > 2"
    other = replace(beside, azimuth_rad=math.radians(315.0))
    assert causes(Look(other, Supervision(), 1.5, NOW_S))["off_plane"] == "22.3 m SW of plane > 2"


def test_a_battery_with_another_number_of_cells_is_reported_at_once_and_in_the_refusal():
    usual = usual_planner()
    vehicle = replace(usual.vehicle, risk=replace(usual.vehicle.risk, cells=12))
    desk = Desk(planner=Planner(usual.site, vehicle))
    desk.run(2.0)
    assert [text for text in desk.texts() if "not 12S" in text]
    seen = replace(
        HOVERING,
        escape_route=leaves(Mission.EXIT, 0.0).escape_route,
        misread="battery 0: 16.0 V, not 12S",
    )
    found = causes(Look(seen, Supervision(), 1.5, NOW_S))
    reason = found.get("energy_exit") or found["energy_evacuation"]
    assert pilot_text(reason, "rejected") == "MOAR: battery 0: 16.0 V, not 12S, rejected"


@pytest.mark.uncounted
def test_a_mission_of_targets_with_long_names_is_reported_in_single_chunks():
    usual = usual_planner()
    first, *others = usual.site.targets
    site = replace(usual.site, targets=(replace(first, name=LONG), *others))
    desk = Desk(planner=Planner(site, usual.vehicle))
    desk.come_to("flying")
    desk.run_until("at_target", 120.0)
    assert desk.said("MOAR: at target the-third-spli..")
    desk.order(EXIT)
    desk.run(2.0)
    assert ACCEPTED in desk.answers()
    for message in desk.messages("STATUSTEXT"):
        assert message.id == 0
        assert_is_for_pilots(message.text)


@pytest.mark.parametrize(
    ("height_m", "words"),
    [(120.0, " m off workspace > 60, denied"), (2.6, None)],
)
def test_a_start_outside_the_workspace_is_reported_with_the_aircrafts_position(height_m, words):
    desk = Desk(height_m=height_m)
    desk.run(1.0)
    desk.order(INSPECTION)
    desk.run(2.0)
    assert words is None or [text for text in desk.texts() if text.endswith(words)]
    assert not desk.said("(")
