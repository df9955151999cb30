"""Wind beyond what the aircraft can hold, and the recovery after it: true speeds and places."""

from __future__ import annotations

import math

import pytest

from moar_companion.settings.risk_model import RiskModel
from sitl.conditions import Conditions

from ..copies import flown_once
from ..flights import lockstep
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
)
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import ACCEPTED, DENIED, EVACUATION, EXIT, INSPECTION, MISSION_HOLD, Manner
from ..thorough import sampled
from .marks import ARDUPILOT_FIRST

SIH_DRAG_PER_S = 1.0
"""PX4's SIH (SIH_KDV over SIH_MASS); with it 13 m/s are too much for its 45 degrees, too."""
SPEED_MPS = 0.7
UNWINDING_MPS = 3.5
"""Speed that the autopilot's velocity integral, full of the wind, adds while it unwinds."""
UNWINDING_S = 10.0


@flown_once
def blown_off(manner: Manner, from_deg: float = 250.0) -> Lockstep:
    """An inspection for 4 s, then wind of 13 m/s for 4 s, which continues."""
    flight = hovering(manner=manner)
    if manner is Manner.PX4:
        flight.autopilot.conditions.drag_per_s = SIH_DRAG_PER_S
    flight.begin(INSPECTION)
    flight.run(4.0)
    conditions: Conditions = flight.autopilot.conditions
    conditions.wind_mps, conditions.wind_from_deg = 13.0, from_deg
    flight.run(4.0)
    return flight


def judge(flight):
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


def error_m(flight) -> float:
    routes, pose = flight.companion.state.routes, flight.companion.pose
    return routes.flight.error_m(pose)


def watched(flight, seconds, look):
    """Values of a function, ten times a second."""
    values = []
    for _ in range(round(seconds * 10.0)):
        flight.run(0.1)
        values.append(look())
    return values


def speed_mps(flight) -> float:
    return math.hypot(*flight.truth.velocity_ned_mps)


def outside_m(flight) -> float:
    x_m, _, z_m = flight.companion.pose.position_m
    return flight.site.workspace.outside_m((x_m, z_m))


@ARDUPILOT_FIRST
def test_the_setpoint_follows_the_aircraft_and_the_pilot_receives_a_text(manner):
    flight = blown_off(manner)
    assert outside_m(flight) > 6.0
    assert error_m(flight) <= 1.0
    texts = flight.operator.texts()
    reported = [text for text in texts if text.startswith("MOAR: wind too strong, drifting ")]
    assert sum(text.endswith(", holding") for text in reported) == 1
    assert all(len(text) <= 50 for text in texts if "drifting" in text)
    assert flight.state == "holding"


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_after_the_wind_the_aircraft_returns_at_its_own_speed_and_the_mission_resumes(manner):
    flight = blown_off(manner)
    flight.autopilot.conditions.wind_mps = 0.0
    calmed_s = flight.now_s
    back = watched(flight, UNWINDING_S, lambda: (speed_mps(flight), error_m(flight), flight.state))
    assert max(speed for speed, _, _ in back) <= UNWINDING_MPS
    assert {state for _, _, state in back} == {"holding"}
    way = []
    while flight.state == "holding":
        way += watched(flight, 1.0, lambda: (speed_mps(flight), error_m(flight)))
    assert len(way) > 50
    assert max(speed for speed, _ in way[20:]) <= 1.5 * SPEED_MPS
    assert max(error for _, error in way) <= 1.0
    assert any(text.endswith(", returning") for text in flight.operator.texts())
    assert flight.state == "flying"
    assert outside_m(flight) == 0.0
    assert flight.now_s - calmed_s < 60.0
    flight.run(5.0)
    assert flight.state == "flying"
    judge(flight)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "mission"),
    sampled([(Manner.ARDUPILOT, EVACUATION)], [(Manner.PX4, EXIT), (Manner.ARDUPILOT, EVACUATION)]),
)
def test_an_escape_route_is_flown_from_the_place_where_the_wind_took_the_aircraft(manner, mission):
    flight = blown_off(manner)
    flight.autopilot.conditions.wind_mps = 0.0
    flight.run(4.0)
    assert outside_m(flight) > 5.0
    flight.operator.mission(mission)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    errors = []
    while outside_m(flight) > 0.0:
        errors += watched(flight, 1.0, lambda: error_m(flight))
    assert max(errors) <= flight.vehicle.guidance.leash_m
    assert flight.state in {"flying", "landing_leg"}
    flight.run(5.0)
    judge(flight)


@ARDUPILOT_FIRST
def test_an_inspection_is_rejected_because_of_the_wind_while_the_aircraft_drifts(manner):
    flight = blown_off(manner)
    flight.operator.mission(INSPECTION)
    flight.run(1.0)
    assert flight.operator.answers()[-1] != ACCEPTED
    assert any("wind too strong, drifting" in text for text in flight.operator.texts()[-2:])
    assert error_m(flight) <= 1.0


@pytest.mark.slow
def test_too_far_outside_an_order_is_refused_with_the_distance():
    flight = blown_off(Manner.ARDUPILOT)
    flight.run(22.0)
    flight.autopilot.conditions.wind_mps = 0.0
    flight.run(4.0)
    assert outside_m(flight) > flight.vehicle.guidance.recovery_m
    flight.operator.mission(EVACUATION)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == DENIED
    assert any(" workspace > 60" in text for text in flight.operator.texts()), (
        flight.operator.texts()
    )


@pytest.mark.slow
def test_blown_off_across_the_plane_the_aircraft_returns_straight_to_it():
    """Wind of 13 m/s across the plane."""
    flight = blown_off(Manner.ARDUPILOT, 340.0)
    assert abs(flight.companion.pose.position_m[1]) > 9.0
    assert error_m(flight) <= 1.0
    flight.autopilot.conditions.wind_mps = 0.0
    flight.run_until_state("flying", 120.0)
    assert abs(flight.companion.pose.position_m[1]) < flight.vehicle.guidance.leash_m
    flight.run_until(lambda: abs(flight.companion.pose.position_m[1]) < 1.0, 10.0)
    judge(flight)


@pytest.mark.slow
def test_a_hold_ordered_during_the_return_ends_it_until_the_next_order():
    flight = blown_off(Manner.ARDUPILOT)
    flight.autopilot.conditions.wind_mps = 0.0
    flight.run_until(lambda: "returning" in flight.operator.texts()[-1], 60.0)
    flight.run(2.0)
    flight.operator.mission(MISSION_HOLD)
    flight.run(3.0)
    held_m, far_m = flight.companion.pose.position_m, outside_m(flight)
    assert far_m > 2.0
    flight.run(15.0)
    assert math.dist(flight.companion.pose.position_m, held_m) < 0.5
    flight.operator.mission(EXIT)
    flight.run_until(lambda: outside_m(flight) < far_m - 1.0, 20.0)
    judge(flight)


@pytest.mark.slow
@pytest.mark.parametrize("drag_per_s", sampled([1.0], [0.1, 1.0]))
def test_still_air_moves_no_path_whatever_the_drag(drag_per_s, monkeypatch):
    """The vehicle file has the default drag; with 1.0 /s gusts of 3.9 m/s were reported."""
    monkeypatch.setattr(lockstep, "as_simulated", lambda vehicle, _: vehicle)
    flight = Lockstep()
    assert flight.vehicle.risk == RiskModel()
    flight.autopilot.conditions.drag_per_s = drag_per_s
    flight.take_off()
    flight.begin(INSPECTION)

    def reported():
        risk = flight.companion.risk
        values = {item.name: item.value or 0.0 for item in risk.report.wind.inputs}
        return values["wind from tilt"], values["gusts"], risk.indices.wind

    seen = watched(flight, 25.0, reported)
    assert max(wind for wind, _, _ in seen) < 3.0
    assert max(gusts for _, gusts, _ in seen) < 1.0
    settled = seen[150:]  # at first the wind is unknown, which raises the risk
    assert max(risk for _, _, risk in settled) < 0.15
    assert not any("wind" in text for text in flight.operator.texts())
