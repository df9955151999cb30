"""Flight in the line's frame: pose, setpoints and texts of a desk whose sensor sees the line."""

from __future__ import annotations

import itertools
import math
from dataclasses import astuple, replace

import pytest

from moar_companion.companion.status import LatestDecisions
from moar_companion.perception.perception_report import LineOffset
from moar_companion.perception.pose_notes import PositionNote

from .desk import HOLD, INSPECTION, STEP_S
from .watched import Watched, by_line

AHEAD_M = (0.9, -0.6)


def estimate_m(desk):
    """(x, z) by the autopilot alone."""
    x_m, _, z_m = desk.companion.state.pose_tracker.estimate.position_m
    return x_m, z_m


def place_m(desk):
    x_m, _, z_m = desk.companion.pose.position_m
    return x_m, z_m


def off_m(desk):
    (x_m, z_m), (by_x_m, by_z_m) = place_m(desk), estimate_m(desk)
    return x_m - by_x_m, z_m - by_z_m


def test_without_a_known_line_the_pose_is_the_autopilots():
    desk = Watched().run(2.0)
    desk.line = LineOffset(offset_m=AHEAD_M)
    desk.run(2.0)
    assert off_m(desk) == (0.0, 0.0)


def test_before_the_stream_the_pose_is_moved_at_once():
    desk = by_line(Watched().run(2.0), *AHEAD_M).run(0.3)
    assert off_m(desk) == pytest.approx(AHEAD_M)


SMALL_M = (0.25, -0.35)


def sent_steps_m(desk, since_s):
    sent = [(m.x, m.y, m.z) for m in desk.setpoints(since_s)]
    return [math.dist(one, other) for one, other in itertools.pairwise(sent)]


def test_in_flight_a_small_offset_moves_as_fast_as_a_drift_and_no_setpoint_jumps():
    desk = Watched().fly(1.0)
    by_line(desk, *SMALL_M)
    began_s = desk.now_s
    desk.run(1.0)
    assert 0.2 < math.hypot(*off_m(desk)) < 0.31
    desk.run(2.0)
    assert off_m(desk) == pytest.approx(SMALL_M)
    assert desk.state == "flying"
    fastest_mps = max(astuple(desk.vehicle.speed))
    assert max(sent_steps_m(desk, began_s)) < (fastest_mps + 0.3) * STEP_S + 1e-3


@pytest.mark.uncounted
def test_in_flight_a_large_offset_moves_the_pose_at_once_and_nothing_that_is_sent():
    desk = Watched().fly(1.0)
    by_line(desk, *AHEAD_M)
    began_s = desk.now_s
    desk.run(0.3)
    assert off_m(desk) == pytest.approx(AHEAD_M)
    desk.run(5.0)
    assert desk.state == "flying"
    fastest_mps = max(astuple(desk.vehicle.speed)) + desk.vehicle.speed.min_mps
    assert max(sent_steps_m(desk, began_s)) < fastest_mps * STEP_S + 1e-3


@pytest.mark.uncounted
def test_a_slow_vehicles_setpoints_follow_the_line_too():
    """Its least speed leaves the check of jumps in the autopilot's frame no room for it."""
    desk = Watched().fly(1.0)
    desk.order(HOLD).run(4.0)
    assert desk.state == "holding"
    setpoints = desk.companion.state.setpoints
    setpoints._greatest_mps = 0.05
    setpoints._vehicle = replace(desk.vehicle, speed=replace(desk.vehicle.speed, min_mps=0.02))
    by_line(desk, *SMALL_M).run(3.0)
    assert off_m(desk) == pytest.approx(SMALL_M)
    assert desk.state == "holding"
    assert not desk.said("jumps")


def test_the_setpoint_that_is_sent_has_the_offset_taken_off():
    desk = by_line(Watched().run(2.0), *AHEAD_M).fly(2.0)
    plane, last = desk.companion.state.pose_tracker.plane, desk.setpoints()[-1]
    setpoint = desk.companion.state.routes.flight.progress(desk.companion.pose).setpoint
    assert plane.position_to_ned(setpoint.position_m) == pytest.approx((last.x, last.y, last.z))
    as_surveyed = plane.moved(-AHEAD_M[0], -AHEAD_M[1])
    x_m, _, z_m = as_surveyed.position_from_ned((last.x, last.y, last.z))
    assert (x_m + AHEAD_M[0], z_m + AHEAD_M[1]) == pytest.approx(
        (setpoint.position_m[0], setpoint.position_m[2])
    )


def test_the_perception_is_told_the_autopilots_own_positions():
    desk = by_line(Watched().run(2.0), *AHEAD_M).run(1.0)
    notes = [note for note in desk.notes if isinstance(note, PositionNote)]
    assert notes[-1].position_m == pytest.approx(
        desk.companion.state.pose_tracker.estimate.position_m
    )


@pytest.mark.uncounted
def test_a_line_that_is_out_of_sight_keeps_its_last_offset():
    desk = by_line(Watched().run(2.0), *AHEAD_M).fly(1.0)
    desk.line = replace(desk.line, seen_s=None, covariance_m2=(2.25, 0.0, 2.25))
    desk.run(5.0)
    assert off_m(desk) == pytest.approx(AHEAD_M)


def test_a_jump_of_the_estimate_moves_nothing_in_the_lines_frame():
    """The estimate jumps by 1.2 m; the next report of the perception does not know it yet."""
    desk = by_line(Watched().run(2.0), *AHEAD_M).fly(2.0)
    before_m, before = place_m(desk), desk.setpoints()[-1]
    place_ned_m, jump_ned_m = desk.position_ned_m, (0.9, -0.8, -0.4)
    desk.jump(*jump_ned_m).run(0.06)
    assert math.dist(place_m(desk), before_m) < 0.1
    after = desk.setpoints()[-1]
    jumped_m = (after.x - before.x, after.y - before.y, after.z - before.z)
    assert jumped_m == pytest.approx(jump_ned_m, abs=0.1)
    assert math.dist(desk.position_ned_m, place_ned_m) < 0.1  # the aircraft has not followed it
    jumped_by_m = desk.companion.state.pose_tracker.jumped_by_m
    by_line(desk, AHEAD_M[0] - jumped_by_m[0], AHEAD_M[1] - jumped_by_m[2], jumped_m=jumped_by_m)
    desk.run(2.0)
    assert desk.state == "flying"
    assert math.dist(desk.position_ned_m, place_ned_m) < 2.5
    assert not desk.said("jumped")


def test_a_line_that_is_too_far_off_holds_the_flight():
    desk = by_line(Watched().run(2.0), 0.2, 0.0).fly(2.0)
    by_line(desk, 4.4, 4.5)
    desk.run(1.0)
    assert desk.state == "holding"
    assert desk.said("line off by 6.3 m > 6, holding")
    by_line(desk, 0.2, 0.0)
    desk.run(8.0)
    assert desk.state == "holding"  # until a new order: the wrong wires may have been matched
    desk.order(INSPECTION, 1).run(1.0)
    assert desk.state == "flying"


def test_the_record_has_the_offset_while_there_is_one():
    desk = Watched().run(2.0)
    assert "line_offset_m" not in desk.decided("status")[-1]
    by_line(desk, *AHEAD_M).run(1.0)
    assert desk.decided("status")[-1]["line_offset_m"] == pytest.approx(list(AHEAD_M))


def test_the_status_has_the_offset_its_covariance_and_what_is_flown_with():
    desk = by_line(Watched().run(2.0), *AHEAD_M, turned_rad=-0.3).run(1.0)
    status = LatestDecisions().status_of(
        desk.companion, desk.now_s, clock_offset_s=0.0, recorder=None
    )
    line = status["perception"]["line"]
    assert tuple(line["offset_m"]) == AHEAD_M
    assert tuple(line["applied_m"]) == pytest.approx(AHEAD_M)
    assert line["covariance_m2"][0] == 0.01
    assert line["heading_offset_rad"] == -0.3
    assert line["wires"] == 5
    assert line["age_s"] == pytest.approx(0.1, abs=0.1)


def uncertainty_m(desk):
    return desk.companion.risk.position_uncertainty_m


def test_while_the_line_is_seen_its_place_counts_and_not_what_the_autopilot_reports():
    desk = by_line(Watched(), 0.2, 0.0)
    desk.set(accuracy_m=3.5)
    desk.fly(2.0)
    assert desk.state == "flying"
    assert uncertainty_m(desk) == pytest.approx(0.2, abs=0.03)  # two deviations of a decimetre
    text = next(
        item.phrase
        for item in desk.companion.risk.report.localization.inputs
        if item.name == "place by the line"
    )
    assert text == "place by the line 0.2 m (by 5 wires)"


def test_out_of_sight_the_place_by_the_line_counts_until_the_autopilots_is_better():
    """The last offset, 0.2 m, may be wrong by then: it is added."""
    desk = by_line(Watched(), 0.2, 0.0)
    desk.set(accuracy_m=0.9)
    desk.fly(2.0)
    desk.sees_line = False
    desk.run(1.5)
    for deviation_m, expected_m in ((0.3, 0.8), (0.44, 1.08), (0.6, 1.1), (3.0, 1.1)):
        desk.line = replace(desk.line, covariance_m2=(deviation_m**2, 0.0, 0.01))
        desk.run(0.4)
        assert uncertainty_m(desk) == pytest.approx(expected_m, abs=0.02)


def localization(desk):
    """What the index tends to."""
    return desk.companion.risk.report.localization.target


@pytest.mark.parametrize(
    ("accuracy_m", "alone", "with_line"), [(4.0, 0.75, 0.5), (4.95, 0.99, 0.975)]
)
def test_while_the_line_is_seen_an_accuracy_counts_where_the_autopilot_gives_up(
    accuracy_m, alone, with_line
):
    """Its range is from 1 to 5 m; the autopilot drops its position at 5."""
    desk = by_line(Watched(), 0.2, 0.0)
    desk.set(accuracy_m=accuracy_m)
    desk.run(2.0)
    assert localization(desk) == pytest.approx(with_line, abs=0.02)
    desk.sees_line = False
    desk.line = replace(desk.line, seen_s=None)
    desk.run(1.0)
    assert localization(desk) == pytest.approx(alone, abs=0.02)


def test_out_of_sight_the_place_by_the_line_is_no_risk_of_its_own():
    """The pose is the autopilot's again, with the last offset: no worse than these two."""
    desk = by_line(Watched(), 0.9, 0.0)
    desk.set(accuracy_m=0.5)
    desk.fly(2.0)
    desk.sees_line = False
    for deviation_m in (1.0, 2.9):
        desk.line = replace(desk.line, covariance_m2=(deviation_m**2, 0.0, deviation_m**2))
        desk.run(1.0)
        assert localization(desk) < 0.1
    desk.line = replace(desk.line, seen_s=None)
    desk.run(1.0)
    assert localization(desk) < 0.1
    assert desk.state in {"flying", "at_target"}


def test_the_way_to_the_lines_place_that_is_not_flown_yet_counts_too():
    desk = by_line(Watched(), 0.2, 0.0).fly(2.0)
    by_line(desk, 0.65, 0.0)
    desk.run(0.3)
    assert uncertainty_m(desk) == pytest.approx(0.2 + 0.36, abs=0.1)
    desk.run(3.0)
    assert uncertainty_m(desk) == pytest.approx(0.2, abs=0.03)


def test_an_offset_of_which_nothing_is_known_any_more_counts_as_an_error():
    """The estimate may have come back meanwhile: then the pose is wrong by the offset."""
    desk = by_line(Watched().run(2.0), 1.2, 0.0)
    desk.set(accuracy_m=0.3)
    desk.fly(2.0)
    desk.line = replace(desk.line, seen_s=None, covariance_m2=(9.0, 0.0, 9.0))
    desk.run(1.0)
    assert off_m(desk) == pytest.approx((1.2, 0.0))
    assert uncertainty_m(desk) == pytest.approx(1.5)


def place_known_m(desk):
    """Uncertainty of the place by the line; None while that does not count."""
    inputs = desk.companion.risk.report.localization.inputs
    return next(each.value for each in inputs if each.name == "place by the line")


def test_a_perception_that_is_silent_leaves_the_autopilots_accuracy_and_the_last_offset():
    desk = by_line(Watched(), 0.2, 0.0)
    desk.set(accuracy_m=3.0)
    desk.run(2.0)
    assert localization(desk) == pytest.approx(0.0, abs=0.02)
    desk.works = False
    desk.run(0.6)
    assert place_known_m(desk) == pytest.approx(0.2 + 0.6 * 0.6, abs=0.1)
    desk.run(0.9)
    assert place_known_m(desk) is None
    assert uncertainty_m(desk) == pytest.approx(3.0 + 0.2)
    assert localization(desk) == pytest.approx(0.5, abs=0.02)


def test_a_line_that_scans_contradict_gives_no_accuracy_after_a_second():
    desk = by_line(Watched(), 0.2, 0.0)
    desk.set(accuracy_m=0.9)
    desk.run(2.0)
    desk.line = replace(desk.line, contradicted_s=desk.now_s)
    desk.run(0.6)
    assert place_known_m(desk) == pytest.approx(0.2 + 0.6 * 0.6, abs=0.1)
    desk.run(0.9)
    assert place_known_m(desk) is None
    assert uncertainty_m(desk) == pytest.approx(0.9 + 0.2)
