"""Blown off by wind: motion of the setpoint and the recovery path, without a flying aircraft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.guidance.path_follower import PathFollower
from moar_companion.companion.mission.values import MissionStatus
from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.companion.safety.supervisor import Acting, Ruling
from moar_companion.companion.wind_recovery import WindRecovery
from moar_companion.mavlink.statustext import StatusTexts
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.texts.text_format import pilot_text
from moar_companion.types import PX4

from ..losses import loss_of
from ..planner.problems import conductor
from .desk import STEP_S, usual_planner

PX4 = loss_of(PX4)
RIGHT_M = usual_planner().site.workspace.upper_m[0]
FENCE = PlaneFence(
    bounds=(Bound(name="GF_MAX_HOR_DIST 14 m", x_m=((-1e3, RIGHT_M - 3.0),)),), margin_m=1.5
)


def within(min_altitude_m):
    """The usual airspace with a least altitude."""
    planner = usual_planner()
    workspace = replace(planner.site.workspace, min_altitude_m=min_altitude_m)
    site = replace(planner.site, workspace=workspace)
    return volume(site=site, maps=Planner(site, planner.vehicle).maps)


class Silent:
    """Reports that are discarded."""

    def send_text(self, *_, **__):
        pass


class Sent:
    """Texts that operators get, with the action of each: repeats within 10 s are dropped."""

    def __init__(self):
        self._texts = StatusTexts()
        self.texts = []
        self.given_s = []
        """Times of all texts, dropped or not."""

    def send_text(self, severity, reason, now_s, *, action="", is_new=False):
        self.given_s.append(now_s)
        if self._texts.messages(severity, pilot_text(reason, action), now_s, is_new=is_new):
            self.texts.append((reason, action))


def volume(**changes):
    planner = usual_planner()
    plain = FlightVolume(site=planner.site, vehicle=planner.vehicle, maps=planner.maps, loss=PX4)
    return replace(plain, **changes)


def pose(x_m, z_m, speed_mps=0.0):
    return Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(speed_mps, 0.0, 0.0), yaw_rad=0.0)


def place_m(flight):
    return tuple(flight._reference.position_m.tolist())


def at_rest(flight, seconds=1.6):
    """Keeps the aircraft at rest at its setpoint."""
    here = replace(pose(0.0, 0.0), position_m=place_m(flight))
    for _ in range(round(seconds / STEP_S)):
        flight.advance(here, STEP_S, holds=True)
    return here


def blown_off(fence, **changes):
    flight = PathFollower(volume(fence=fence, **changes), pose(RIGHT_M - 6.0, 10.0))
    flight.advance(pose(RIGHT_M + 8.0, 10.0, 3.0), STEP_S, holds=True)
    here = at_rest(flight)
    assert flight.must_recover
    return flight, here


def acting(name, *, overridden=False):
    row = next(item for item in CONDITIONS if item.name == name)
    return Acting(condition=row, since_s=0.0, reason="", overridden=overridden, lasts=True)


@pytest.mark.parametrize("fence", [None, FENCE])
@pytest.mark.parametrize(
    ("conditions", "returns"),
    [
        ((), True),
        ((acting("autopilot_fence"), acting("outside_workspace")), True),
        ((acting("wind", overridden=True),), True),
        ((acting("wind"),), False),
    ],
)
def test_the_setpoint_returns_when_its_place_is_the_only_condition(fence, conditions, returns):
    flight, here = blown_off(fence)
    status = MissionStatus(state=MissionState.HOLDING)
    WindRecovery(Silent()).act(flight, here, status, Ruling(conditions=conditions), 0.0, 100.0)
    assert flight.recovers is returns


def test_a_condition_that_begins_on_the_recovery_path_ends_it_until_it_is_over():
    flight, here = blown_off(None)
    recovery, status = WindRecovery(Silent()), MissionStatus(state=MissionState.HOLDING)
    recovery.act(flight, here, status, Ruling(), 0.0, 100.0)
    recovery.act(flight, here, status, Ruling(conditions=(acting("off_path"),)), 0.0, 100.1)
    assert flight.recovers
    recovery.act(flight, here, status, Ruling(conditions=(acting("wind"),)), 0.0, 100.2)
    assert not flight.recovers
    at_rest(flight)
    assert flight.must_recover
    recovery.act(flight, here, status, Ruling(), 0.0, 106.0)
    assert flight.recovers


def test_after_a_hold_that_is_ordered_outside_the_aircraft_stays_until_another_order():
    flight, here = blown_off(None)
    recovery, status = WindRecovery(Silent()), MissionStatus(state=MissionState.HOLDING)
    recovery.act(flight, here, status, Ruling(), 0.0, 100.0)
    recovery.note_hold(flight)
    flight.brake()
    for now_s in (101.0, 110.0, 120.0):
        recovery.act(flight, at_rest(flight), status, Ruling(), 0.0, now_s)
        assert not flight.recovers
    flown = MissionStatus(state=MissionState.FLYING)
    recovery.act(flight, at_rest(flight), flown, Ruling(), 0.0, 130.0)
    recovery.act(flight, at_rest(flight), status, Ruling(), 0.0, 140.0)
    assert flight.recovers


def test_a_path_back_is_searched_every_five_seconds_and_an_operator_asked_every_ten_to_fly_back():
    vehicle = usual_planner().vehicle
    near = replace(vehicle, guidance=replace(vehicle.guidance, recovery_m=2.0))
    flight, here = blown_off(None, vehicle=near)
    sent = Sent()
    recovery, status = WindRecovery(sent), MissionStatus(state=MissionState.HOLDING)
    for now_s in (100.0, 104.9, 105.0, 109.9, 110.0):
        recovery.act(flight, here, status, Ruling(), 0.0, now_s)
    outside_m = place_m(flight)[0] - RIGHT_M
    assert sent.given_s == [100.0, 105.0, 110.0]
    assert sent.texts == [(f"{outside_m:.1f} m outside, no path back: take over", "")] * 2
    assert not flight.recovers


def test_each_time_the_drift_has_doubled_an_operator_gets_a_text_at_once():
    flight = PathFollower(volume(), pose(RIGHT_M - 6.0, 10.0))
    from_x_m = place_m(flight)[0]
    sent = Sent()
    recovery, status = WindRecovery(sent), MissionStatus(state=MissionState.FLYING)
    for now_s, drift_m in ((0.0, 4.0), (2.0, 8.0), (5.0, 15.0), (6.0, 16.0), (14.0, 32.0)):
        here = pose(from_x_m + drift_m, 10.0, 2.0)
        flight.advance(here, STEP_S, holds=True)
        recovery.act(flight, here, status, Ruling(), 0.0, now_s)
    expected = [f"wind too strong, drifting {drift_m} m" for drift_m in (8, 16, 32)]
    assert [reason for reason, _ in sent.texts] == expected


def test_the_recovery_path_enters_the_fence_and_the_gate_accepts_the_path():
    flight, here = blown_off(FENCE)
    assert flight.begin_recovery(0.0)
    assert flight.path.leaves_fence() is None
    for _ in range(round(90.0 / STEP_S)):
        flight.advance(here, STEP_S, holds=True)
        setpoint = flight._setpoint()
        assert flight.refusal(setpoint, 1.0, 0.0) is None
        here = replace(here, position_m=setpoint.position_m)
    assert FENCE.holds(np.array([place_m(flight)])[:, ::2]).all()


def test_a_recovery_path_from_above_is_flown_no_faster_than_the_vehicle_descends():
    over_m = usual_planner().site.workspace.upper_m[1] + 12.0
    flight = PathFollower(volume(), pose(RIGHT_M - 4.0, over_m))
    assert flight.begin_recovery(0.0)
    setpoints = []
    for _ in range(round(40.0 / STEP_S)):
        flight.advance(pose(*place_m(flight)[::2]), STEP_S, holds=True)
        setpoints.append(flight._setpoint())
    fastest_mps = max(-setpoint.velocity_mps[2] for setpoint in setpoints)
    assert fastest_mps == pytest.approx(usual_planner().vehicle.speed.down_mps, rel=0.01)


@pytest.mark.parametrize("x_m", [RIGHT_M - 4.0, RIGHT_M + 8.0])
@pytest.mark.parametrize(("blown_z_m", "carried_z_m"), [(4.5, 4.5), (3.0, 4.5), (6.0, 6.0)])
def test_below_the_least_altitude_the_setpoint_follows_the_aircraft_no_lower(
    x_m, blown_z_m, carried_z_m
):
    """As at the end of a landing leg."""
    flight = PathFollower(within(5.0), pose(x_m, 4.5))
    flight.advance(pose(x_m + 4.0, blown_z_m, 3.0), STEP_S, holds=True)
    for step in range(200):
        flight.advance(pose(x_m + 4.0 + 0.05 * step, blown_z_m, 3.0), STEP_S, holds=True)
        assert flight.refusal(flight._setpoint(), 1.0, 0.0) is None
    assert flight.error_m(pose(x_m + 13.95, blown_z_m)) <= 2.0
    assert place_m(flight)[2] == pytest.approx(carried_z_m, abs=0.5)
    assert place_m(flight)[2] >= 4.5
    at_rest(flight)
    assert flight.refusal(flight._setpoint(), 1.0, 0.0) is None


def test_a_setpoint_that_started_above_the_least_altitude_is_refused_below_it():
    flight = PathFollower(within(5.0), pose(RIGHT_M - 6.0, 8.0))
    flight.advance(pose(RIGHT_M + 8.0, 3.0, 3.0), STEP_S, holds=True)
    assert place_m(flight)[2] >= 5.0
    lower = replace(flight._setpoint(), position_m=(RIGHT_M + 8.0, 0.0, 4.5))
    assert flight.refusal(lower, 1.0, 0.0) is not None


WIRE_M = (2.0, 10.0)


def past_a_wire():
    planner = usual_planner()
    wire = conductor(*WIRE_M, radius=0.0175, keep_out=0.9, name="wire")
    site = replace(planner.site, obstacles=(wire,))
    return volume(site=site, maps=Planner(site, planner.vehicle).maps)


@pytest.mark.parametrize(
    ("aircraft_x_m", "carried_x_m"), [(8.0, 5.0), (5.0, 4.25), (-10.0, -7.0), (-1.0, -0.25)]
)
def test_the_recovery_path_passes_no_conductor(aircraft_x_m, carried_x_m):
    """Blown past the conductor by slightly more or less than the leash of 3 m."""
    space = past_a_wire()
    from_x_m = 2.0 * WIRE_M[0] - aircraft_x_m
    place = space.carried_m((from_x_m, 0.0, 10.0), (aircraft_x_m, 0.0, 10.0), 3.0)
    least_m = 0.9 + 0.0175 + space.vehicle.radius_m
    assert abs(place[0] - WIRE_M[0]) >= least_m
    assert place[0] == pytest.approx(carried_x_m, abs=1.0)
    assert (place[0] - WIRE_M[0]) * (aircraft_x_m - WIRE_M[0]) > 0.0


def test_out_of_a_keep_out_the_setpoint_moves_only_on_the_aircrafts_side():
    space = past_a_wire()
    inside = (WIRE_M[0] + 0.9, 0.0, 10.0)
    assert space.carried_m((12.0, 0.0, 10.0), inside, 3.0) == pytest.approx((5.9, 0.0, 10.0))
    assert space.carried_m((-8.0, 0.0, 10.0), inside, 3.0) is None


def test_a_setpoint_behind_a_seen_obstacle_returns_to_the_aircrafts_side_and_that_is_no_drift():
    flight = PathFollower(volume(), pose(WIRE_M[0] + 0.9, 10.0))
    flight.learn_maps(past_a_wire())
    here = pose(WIRE_M[0] - 1.6, 10.0)
    flight.advance(here, STEP_S, holds=True)
    assert place_m(flight)[0] <= here.position_m[0] + 0.3
    assert flight.drifted_m(here) is None
    assert flight.drifting_at_m == here.position_m
