"""Parameters that a ground station sets in flight: what counts at once, and what with new maps."""

from __future__ import annotations

import itertools
import json
import math
import random

import pytest

from moar_companion.analysis.replay.exact import ExactReplay
from moar_companion.companion.planning.map_jobs import MapAnswer, SettingsJob
from moar_companion.companion.planning.plan_jobs import answer_job
from moar_companion.service.recording.calls import call_encoded
from moar_companion.settings.flight_parameters import NONE, flight_parameters
from moar_companion.types import Mission

from ..copies import flown_once
from ..flights.judging import assert_nothing_was_touched
from ..flights.operator import EXIT, INSPECTION
from ..flights.parameter_flight import ParameterFlight
from ..thorough import sampled


def flying(mission=INSPECTION, seconds=2.0):
    return under_way(mission, seconds).with_planner()


@flown_once
def under_way(mission, seconds):
    flight = ParameterFlight()
    flight.start_in_the_air()
    flight.begin(mission, 0 if mission == INSPECTION else -1)
    flight.run(seconds)
    return flight


def shown(flight, name):
    """Values of a parameter that ground stations were sent."""
    values = [item for item in flight.sent("PARAM_VALUE") if item.param_id == name]
    return [pytest.approx(item.param_value) for item in values]


def jobs_since(flight, kind):
    """Plan jobs after the last map job of a kind."""
    jobs = [
        job
        for call in flight.calls
        if call.method in {"map_jobs", "plan_jobs"}
        for job in call.result
    ]
    last = max(index for index, job in enumerate(jobs) if isinstance(job, kind))
    return jobs[last + 1 :]


def fail_maps(flight):
    """The planner fails at the last map job that it was given."""
    *_, job = (job for call in flight.calls if call.method == "map_jobs" for job in call.result)
    flight.companion.maps_answered(MapAnswer(job_id=job.job_id, site_maps=None))


def speed_mps(flight):
    message = flight.setpoints[-1].message
    return math.hypot(message.vx, message.vy, message.vz)


def greatest_change_mps(flight, since_s):
    """Greatest change of velocity from one setpoint to the next."""
    sent = [item.message for item in flight.setpoints if item.time_s >= since_s]
    velocities = [(item.vx, item.vy, item.vz) for item in sent]
    return max(itertools.starmap(math.dist, itertools.pairwise(velocities)))


@pytest.mark.slow
def test_weights_and_limits_count_at_once():
    flight = flying()
    flight.set(WGT_INSP_SAFETY=9.0, LIM_WIND=8.0, SETPOINT_RATE=25.0, LIM_GCS_ACTION=2.0)
    flight.run(1.0)
    state = flight.companion.state
    assert flight.companion.setpoint_rate_hz == 25.0
    assert state.vehicle.weights[Mission.INSPECTION].safety > 0.9
    assert state.routes.flight.adaptation.base.safety > 0.9, "the plan after it has the weights"
    assert state.config.supervision.wind_limit_mps == 8.0
    assert flight.noted("settings") == [], "no maps are made for these"
    assert "settings were changed" in [item["reason"] for item in flight.noted("replan")]
    assert flight.state == "flying"


def test_the_heading_counts_at_once_and_on_the_path_that_is_flown():
    flight = flying(EXIT, 0.5)
    before = flight.companion.state.routes.flight.path.reference.trajectory
    flight.planning = False
    flight.set(GUID_YAW_MODE=2.0, GUID_YAW_FIXED=0.0, GUID_YAW_RATE=180.0)
    flight.run(2.0)
    assert flight.companion.state.routes.flight.path.reference.trajectory is before
    assert flight.setpoints[-1].message.yaw == pytest.approx(0.0, abs=0.01)
    assert not any(call.result for call in flight.calls if call.method == "map_jobs")


@pytest.mark.slow
def test_a_limit_that_was_lowered_below_the_wind_holds_the_flight():
    flight = flying()
    flight.autopilot.conditions.wind_mps = 6.0
    flight.run(5.0)
    assert flight.state == "flying"
    flight.set(LIM_WIND=3.0)
    flight.run_until_state("holding", 5.0)
    assert "wind" in [item["name"] for item in flight.noted("condition")]


def test_distances_make_new_maps_while_the_flight_goes_on():
    flight = flying()
    before = flight.companion.state.site
    flight.plan_delay_s = 2.0
    flight.set(SAFE_D_MAX=5.0, SAFE_D_MIN=2.5)
    flight.run(1.5)
    assert flight.companion.state.vehicle.safety.d_max_m == 3.0, "until the maps are made"
    assert flight.state == "flying"
    assert speed_mps(flight) > 0.1
    flight.run(4.0)
    assert flight.companion.state.vehicle.safety.d_max_m == 5.0
    assert flight.companion.state.vehicle.safety.d_min_m == 2.5
    assert flight.companion.state.site == before
    assert flight.planner.vehicle.safety.d_max_m == 5.0
    assert flight.state == "flying"


@pytest.mark.slow
def test_lower_speeds_slow_the_flight_down_without_a_jump():
    flight = flying(EXIT, 4.0)
    assert speed_mps(flight) > 0.9
    began_s = flight.now_s
    slow = dict.fromkeys(("SPEED_UP", "SPEED_DOWN", "SPEED_DIAG_UP", "SPEED_DIAG_DOWN"), 0.5)
    flight.set(SPEED_MIN=0.2, SPEED_HORIZONTAL=0.5, **slow)
    flight.run(3.0)
    assert speed_mps(flight) <= 0.7
    braked_mps = 2.0 * flight.vehicle.guidance.acceleration_mps2 * 0.02
    assert greatest_change_mps(flight, began_s) <= braked_mps + 0.01
    assert flight.state in {"flying", "landing_leg"}


def test_a_margin_that_bars_its_place_brakes_and_holds():
    flight = flying()
    began_s, speed = flight.now_s, speed_mps(flight)
    assert speed > 0.4
    flight.set(SAFE_TRK_MARGIN=6.0)
    flight.run_until_state("holding", 3.0)
    flight.run(3.0)
    assert flight.state == "holding"
    assert speed_mps(flight) == 0.0
    assert greatest_change_mps(flight, began_s) < 0.1
    assert flight.noted("text")[-1]["reason"] == "no room at SAFE_TRK_MARGIN 6"
    flight.operator.mission(INSPECTION, 0)
    flight.run_until_state("flying", 3.0)


@pytest.mark.slow
@pytest.mark.parametrize("radius_m", [8.0, 100.0])
def test_a_size_for_which_there_is_no_room_holds_with_the_settings_before(radius_m):
    flight = flying(seconds=3.0)
    before_m = flight.vehicle.radius_m
    flight.set(SAFE_RADIUS=radius_m)
    flight.run(4.0)
    assert flight.state == "holding"
    assert speed_mps(flight) == 0.0
    assert flight.now_s - flight.last_setpoint_s < 0.1
    assert flight.companion.state.vehicle.radius_m == before_m
    assert flight.planner.vehicle.radius_m == before_m
    assert flight.noted("settings") == []
    assert shown(flight, "SAFE_RADIUS") == [radius_m, pytest.approx(before_m)]
    assert not any(parameters.changed for parameters in flight.kept), "nothing is stored"
    texts = [item["text"] for item in flight.noted("text")]
    assert texts[-1] == f"MOAR: no room at SAFE_RADIUS {radius_m:g}, holding"
    flight.set(SAFE_RADIUS=0.5)
    flight.run(1.0)
    assert flight.companion.state.vehicle.radius_m == 0.5
    assert flight.state == "holding", "until an order"
    flight.operator.go_on()
    flight.run(1.5)
    assert flight.state == "flying"


@pytest.mark.slow
def test_an_order_leads_away_from_where_a_size_has_no_room():
    flight = flying(seconds=3.0)
    flight.set(SAFE_RADIUS=8.0)
    flight.run_until_state("holding", 3.0)
    flight.run(1.5)
    flight.operator.mission(EXIT, -1)
    flight.run(6.0)
    assert flight.state == "landing_leg"
    assert speed_mps(flight) > 0.1


def test_a_size_without_room_withdraws_an_offered_flight_as_any_reason_to_hold_does():
    flight = ParameterFlight()
    flight.start_in_the_air()
    flight.operator.mission(INSPECTION, 0)
    flight.run_until_state("ready", 5.0)
    flight = flight.with_planner()
    flight.set(SAFE_RADIUS=100.0)
    flight.run(3.0)
    assert flight.state == "idle"
    texts = [item["text"] for item in flight.noted("text")]
    assert "MOAR: no room at SAFE_RADIUS 100, idle" in texts


def test_a_planner_that_fails_leaves_the_settings_of_the_maps():
    flight = flying()
    flight.planning = False
    flight.set(SAFE_D_MAX=5.0)
    flight.run(0.2)
    fail_maps(flight)
    flight.planning = True
    flight.run(1.0)
    assert flight.companion.state.vehicle.safety.d_max_m == 3.0
    assert "MOAR: no maps at SAFE_D_MAX 5, set back" in [
        item["text"] for item in flight.noted("text")
    ]
    assert shown(flight, "SAFE_D_MAX") == [5.0, 3.0]
    assert not any(parameters.changed for parameters in flight.kept), "nothing is stored"
    assert flight.state == "flying"


def test_a_refused_size_takes_nothing_back_that_counted_at_once_meanwhile():
    flight = flying(seconds=3.0)
    flight.plan_delay_s = 1.0
    flight.set(LIM_WIND=8.0, SAFE_RADIUS=8.0)
    flight.run(0.5)
    flight.set(LIM_BATTERY=0.3)
    flight.run(4.0)
    assert flight.companion.state.vehicle.radius_m == flight.vehicle.radius_m
    assert flight.companion.state.config.supervision.battery_reserve == 0.3
    assert flight.companion.parameters.changed == {"LIM_WIND": 8.0, "LIM_BATTERY": 0.3}
    assert flight.companion.state.session.parameters.changed == flight.companion.parameters.changed


def test_values_valid_beside_a_new_distance_alone_wait_for_its_maps():
    flight = flying()
    flight.set(SAFE_POS_MARGIN=0.6, LIM_UNCERTAINTY=0.6)
    flight.run(1.0)
    before = dict(flight.companion.parameters.changed)
    flight.planning = False
    flight.set(SAFE_POS_MARGIN=0.4, LIM_UNCERTAINTY=0.5)
    flight.run(0.3)
    assert flight.companion.state.config.supervision.position_uncertainty_limit_m == 0.6
    fail_maps(flight)
    flight.run(0.3)
    assert flight.companion.state.session.parameters.changed == before
    assert flight.companion.parameters.changed == before


def test_a_size_that_is_set_back_by_its_station_before_its_maps_are_made_is_never_flown():
    flight = flying(seconds=3.0)
    flight.plan_delay_s = 1.0
    flight.set(SAFE_RADIUS=8.0)
    flight.run(0.5)
    flight.set(SAFE_RADIUS=0.38)
    flight.run(4.0)
    assert flight.state == "flying"
    assert flight.noted("settings") == []
    assert flight.planner.vehicle.radius_m == flight.vehicle.radius_m


def test_nothing_is_planned_while_the_planner_has_maps_for_settings_that_are_not_in_force():
    flight = flying(seconds=2.0)
    flight.set(SAFE_RADIUS=0.5)
    flight.plan_delay_s = 4.0
    flight.run(0.1)
    asked = len(flight.noted("replan"))
    *_, before = (job for call in flight.calls if call.method == "plan_jobs" for job in call.result)
    flight.companion.plan_answered(answer_job(flight.planners, before))
    flight.plan_delay_s = 0.1
    flight.set(WGT_INSP_SAFETY=9.0)
    flight.run(3.5)
    assert len(flight.noted("replan")) == asked
    assert jobs_since(flight, SettingsJob) == []
    flight.run(1.5)
    assert flight.companion.state.vehicle.radius_m == 0.5
    assert len(flight.noted("replan")) > asked


def test_an_order_while_maps_for_settings_are_made_is_planned_on_the_maps_in_force():
    flight = flying(seconds=3.0)
    flight.plan_delay_s = 4.0
    flight.set(SAFE_RADIUS=0.5)
    flight.run(0.1)
    flight.plan_delay_s = 0.1
    flight.operator.mission(EXIT, -1)
    flight.run(3.5)
    assert jobs_since(flight, SettingsJob) == []
    flight.run(1.0)
    assert jobs_since(flight, SettingsJob)[0].request.mission is Mission.EXIT
    assert flight.companion.status.task.mission is Mission.EXIT


@pytest.mark.slow
def test_a_planner_that_never_answers_with_maps_for_settings_holds_the_inspection():
    flight = flying(seconds=0.5)
    flight.planning = False
    flight.set(SAFE_RADIUS=0.5)
    flight.run(flight.config.supervision.plan_stale_s + 3.0)
    assert flight.state == "holding"
    assert "no new plan" in flight.noted("text")[-1]["text"]
    flight.operator.mission(EXIT, -1)
    flight.run(5.5)
    assert "MOAR: no plan in 5 s, denied" in [item["text"] for item in flight.noted("text")]
    assert flight.state == "holding"


def test_maps_for_the_settings_in_force_are_made_again_until_the_planner_has_them():
    flight = flying(seconds=3.0)
    flight.plan_delay_s = 1.0
    flight.set(SAFE_RADIUS=8.0)
    flight.run(0.1)
    flight.planning = False
    flight.run_until_state("holding", 4.0)
    flight.run(0.1)
    for _ in range(3):
        assert flight.planner.vehicle.radius_m == 8.0
        fail_maps(flight)
        flight.run(0.1)
    flight.planning = True
    fail_maps(flight)
    flight.run(2.0)
    assert flight.planner.vehicle.radius_m == flight.vehicle.radius_m
    assert not any("no maps" in item["reason"] for item in flight.noted("text"))


@pytest.mark.parametrize(
    ("radius_m", "reason"),
    [
        (3.0, "no path round right-middle"),
        pytest.param(5.0, "no room at SAFE_RADIUS 5", marks=pytest.mark.slow),
        (6.0, "no room at SAFE_RADIUS 6"),
    ],
)
def test_a_size_without_a_path_or_room_holds_once_for_one_reason(radius_m, reason):
    flight = flying(seconds=3.0)
    flight.set(SAFE_RADIUS=radius_m)
    flight.run(8.0)
    assert flight.state == "holding"
    texts = [item["text"] for item in flight.noted("text")]
    assert texts[texts.index("MOAR: flying inspection to splice-outer") + 1 :] == [
        f"MOAR: {reason}, holding"
    ]


def test_what_a_parameter_may_not_be_changes_nothing_and_is_told():
    flight = flying()
    before = flight.companion.parameters
    flight.set(SAFE_D_MIN=9.0)
    flight.run(0.5)
    assert flight.companion.parameters is before
    assert [message.error for message in flight.sent("PARAM_ERROR")] == [2]
    texts = [item["text"] for item in flight.noted("text")]
    assert "MOAR: SAFE_D_MIN is 9, must be < SAFE_D_MAX" in texts


def test_what_was_set_is_on_record():
    flight = flying()
    flight.set(LIM_WIND=8.0, SAFE_RADIUS=0.5)
    flight.run(1.0)
    assert flight.noted("parameter") == [
        {"name": "LIM_WIND", "value": 8.0, "before": 15.0, "sender": 255},
        {"name": "SAFE_RADIUS", "value": 0.5, "before": 0.38, "sender": 255},
    ]
    assert flight.noted("settings") == [{"changed": {"LIM_WIND": 8.0, "SAFE_RADIUS": 0.5}}]
    jobs = [job for call in flight.calls if call.method == "map_jobs" for job in call.result]
    assert [job.vehicle.radius_m for job in jobs if isinstance(job, SettingsJob)] == [0.5]


@pytest.mark.slow
def test_a_flight_with_parameters_of_before_and_of_now_is_repeated_exactly():
    flight = ParameterFlight(stored={"SAFE_D_MAX": 4.0, "LIM_WIND": 12.0})
    assert flight.vehicle.safety.d_max_m == 4.0
    flight.start_in_the_air()
    flight.begin(INSPECTION, 0)
    flight.set(SAFE_D_MAX=5.0, WGT_INSP_SAFETY=2.0, SPEED_HORIZONTAL=2.0, LIM_WIND=300.0)
    flight.run(4.0)
    replay = ExactReplay()
    calls = [json.loads(json.dumps(call_encoded(call), allow_nan=False)) for call in flight.calls]
    assert [item for call in calls for item in replay.feed(call)] == []
    assert replay.compared["map job"] >= 1


def any_value(pick, flight):
    """A parameter and a value of it: a choice, or its present one by some factor."""
    row = pick.choice(list(flight_parameters().values()))
    if row.choices:
        return {row.name: float(pick.randrange(len(row.choices)))}
    if row.optional and pick.random() < 0.3:
        return {row.name: NONE}
    present = max(flight.companion.parameters.value(row.name), 0.5)
    return {row.name: present * pick.choice((0.2, 0.5, 0.8, 1.3, 2.0, 4.0))}


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled([3], range(20)))
def test_any_parameters_in_flight_raise_nothing_and_let_no_setpoint_jump(seed):
    pick, flight = random.Random(seed), flying(EXIT, 0.5)
    for _ in range(30):
        for _ in range(pick.choice((1, 3, 10))):
            flight.set(**any_value(pick, flight))
        flight.run(pick.choice((0.2, 1.0)))
        if flight.state in {"holding", "idle", "ready", "released"}:
            flight.operator.mission(pick.choice((INSPECTION, EXIT)), -1)
            flight.operator.mode("ours")
    assert len(flight.noted("parameter")) > 50
    assert len(flight.noted("settings")) > 10
    reasons = {item["reason"] for item in flight.noted("text")}
    assert not any("setpoint" in reason for reason in reasons), "which the gate has refused"
    assert_nothing_was_touched(flight)
