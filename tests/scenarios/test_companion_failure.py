"""Companion failure in flight: the stream ends at once, without a collision.

At many instants of a flight a copy of the autopilot flies on alone, until it rests or has landed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest

from moar_companion.settings.config import LossCheck, Supervision
from tests.thorough import sampled

from ..copies import copy_of
from ..flights.judging import clearances_m, in_plane, true_places
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import DENIED, EVACUATION, EXIT, INSPECTION, RELEASE, Manner

IN_CONTROL = {"flying", "at_target", "landing_leg", "holding"}
FLOWN_ON_S = 15.0
LOOKED_AT_S = 0.1
STANDS_MPS = 0.1
STANDS_FOR_S = 1.5
PX4_HOLDS = {"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 0.5}
SETS = {
    "PX4 holds after 0.5 s": (Manner.PX4, PX4_HOLDS),
    "PX4 holds after 1 s": (Manner.PX4, {**PX4_HOLDS, "COM_OF_LOSS_T": 1.0}),
    "PX4 holds after 2 s": (Manner.PX4, {**PX4_HOLDS, "COM_OF_LOSS_T": 2.0}),
    "PX4 lands after 0.5 s": (Manner.PX4, {**PX4_HOLDS, "COM_OBL_RC_ACT": 4}),
    "PX4 returns after 1 s": (Manner.PX4, {"COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0}),
    "ArduPilot holds after 0.5 s": (Manner.ARDUPILOT, {"GUID_TIMEOUT": 0.5}),
    "ArduPilot holds after 3 s": (Manner.ARDUPILOT, {"GUID_TIMEOUT": 3.0}),
    "PX4 brakes softly at once": (
        Manner.PX4,
        {**PX4_HOLDS, "COM_OF_LOSS_T": 0.1, "MPC_ACC_HOR": 1.0},
    ),
    "ArduPilot brakes softly": (
        Manner.ARDUPILOT,
        {"GUID_TIMEOUT": 0.5, "WPNAV_ACCEL": 80.0, "WPNAV_ACCEL_Z": 80.0},
    ),
    "ArduPilot cannot follow": (
        Manner.ARDUPILOT,
        {"GUID_TIMEOUT": 0.5, "WPNAV_ACCEL": 50.0, "WPNAV_ACCEL_Z": 50.0},
    ),
}


@dataclass
class Failures:
    """Companion failures in one flight; least distance from hull to obstacle after each."""

    flight: Lockstep
    every_s: float
    least_m: float = math.inf
    count: int = 0
    _due_s: float = field(default=-math.inf)

    def fly(self, mission, index=-1, *, timeout_s=300.0):
        """Flies a mission to its end; returns True if it was accepted."""
        flight = self.flight
        answers = len(flight.operator.answers())
        flight.operator.mission(mission, index)
        flight.run_until(lambda: len(flight.operator.answers()) > answers, 3.0)
        flight.run(0.2)
        if flight.operator.answers()[-1] == DENIED:
            return False
        if flight.state not in IN_CONTROL:
            flight.give_mode()
        end_s = flight.now_s + timeout_s
        while flight.state != "holding" or self._moves():
            assert flight.now_s < end_s, flight.state
            flight.step()
            if flight.state in IN_CONTROL and flight.now_s >= self._due_s:
                self._due_s = flight.now_s + self.every_s
                self.die()
        return True

    def _moves(self):
        return math.hypot(*self.flight.truth.velocity_ned_mps) > STANDS_MPS

    def die(self):
        flight = self.flight
        clearance_m = min(clearances_m(flight.site, flown_on(flight))) - flight.vehicle.radius_m
        assert clearance_m > 0.0, (flight.now_s, flight.state)
        self.least_m = min(self.least_m, clearance_m)
        self.count += 1


def flown_on(flight):
    """Places of the aircraft without a companion from now on, ten times a second."""
    autopilot = copy_of(flight.autopilot)
    for schedule in dict(autopilot.manner._schedules).values():
        schedule._due.clear()  # messages have no receiver, and take half of the time
    now_s, stands_since_s, places = flight.now_s, math.inf, []
    while now_s < flight.now_s + FLOWN_ON_S and not autopilot.truth.on_ground:
        now_s += LOOKED_AT_S
        autopilot.step(now_s)
        autopilot.data_to_send()
        truth = autopilot.truth
        places.append(
            in_plane(flight.site, truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)
        )
        if math.hypot(*truth.velocity_ned_mps) > STANDS_MPS or _waits(truth):
            stands_since_s = math.inf
        stands_since_s = min(stands_since_s, now_s)
        if now_s - stands_since_s >= STANDS_FOR_S:
            break
    return places


def _waits(truth):
    """True if PX4 has not detected the loss yet, and may still land or return."""
    return truth.mode == "OFFBOARD"


def failures(name, *, every_s, site="315kv_double_circuit", wind_mps=0.0, **options):
    manner, parameters = SETS[name]
    flight = hovering(site=site, manner=manner, options={"parameters": parameters}, **options)
    flight.autopilot.conditions.wind_mps = wind_mps
    flight.autopilot.conditions.wind_from_deg = 300.0
    return Failures(flight, every_s)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["PX4 holds after 0.5 s", "ArduPilot holds after 3 s"])
def test_a_companion_failure_anywhere_on_an_inspection_causes_no_collision(name):
    sweep = failures(name, every_s=2.0, vehicle="x500")
    assert sweep.fly(INSPECTION, 0)
    assert sweep.count > 5


EVERY_S = sampled(1.0, 0.2)
FLOWN = [
    ("PX4 returns after 1 s", "120kv_single_circuit", 0.0),
    ("ArduPilot holds after 3 s", "315kv_double_circuit", 6.0),
]
MORE = [
    ("PX4 holds after 2 s", "120kv_single_circuit", 0.0),
    ("PX4 lands after 0.5 s", "315kv_double_circuit", 6.0),
    ("PX4 holds after 0.5 s", "315kv_double_circuit", 6.0),
    ("PX4 holds after 1 s", "120kv_single_circuit", 0.0),
    ("PX4 holds after 2 s", "315kv_double_circuit", 6.0),
    ("PX4 lands after 0.5 s", "120kv_single_circuit", 0.0),
    ("PX4 returns after 1 s", "315kv_double_circuit", 6.0),
    ("ArduPilot holds after 0.5 s", "315kv_double_circuit", 0.0),
    ("ArduPilot holds after 3 s", "120kv_single_circuit", 6.0),
]


SOFT = ["ArduPilot brakes softly", "PX4 brakes softly at once"]


@pytest.mark.slow
@pytest.mark.parametrize("name", sampled(SOFT[:1], SOFT))
def test_a_companion_failure_with_soft_braking_causes_no_collision(name):
    sweep = failures(name, every_s=EVERY_S, vehicle="x500")
    assert sweep.fly(INSPECTION, 0)
    assert sweep.fly(EXIT)
    assert sweep.count * EVERY_S > 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "site", "wind_mps"), sampled(FLOWN, FLOWN + MORE))
def test_a_companion_failure_anywhere_on_any_accepted_mission_causes_no_collision(
    name, site, wind_mps
):
    out = failures(name, every_s=EVERY_S, site=site, vehicle="x500", wind_mps=wind_mps)
    out.fly(INSPECTION, 0)
    away = copy_of(out)
    out.fly(INSPECTION, 1)
    assert out.fly(EXIT)
    begun = away.count
    assert away.fly(EVACUATION)
    count = out.count + away.count - begun
    assert count * EVERY_S > 30.0


# Refusals ---------------------------------------------------------------------------------------


def test_a_return_that_would_climb_through_a_conductor_is_denied_with_the_remedy():
    sweep = failures("PX4 returns after 1 s", every_s=math.inf)
    assert not sweep.fly(INSPECTION, 1)
    assert sweep.flight.operator.has_received("PX4 would hit left-upper")
    assert not sweep.flight.setpoints


def test_a_landing_on_a_conductor_is_denied_with_the_remedy():
    sweep = failures("PX4 lands after 0.5 s", every_s=math.inf)
    assert not sweep.fly(INSPECTION, 1)
    assert sweep.flight.operator.has_received("PX4 would hit right-lower")


def test_a_mission_for_an_autopilot_that_cannot_follow_is_denied():
    sweep = failures("ArduPilot cannot follow", every_s=math.inf, vehicle="x500")
    assert not sweep.fly(INSPECTION, 1)
    assert sweep.flight.operator.has_received("ArduPilot brakes ")


def test_with_the_warn_policy_the_same_missions_are_flown_with_a_warning():
    manner, parameters = SETS["PX4 returns after 1 s"]
    supervision = Supervision(loss_action=LossCheck.WARN)
    flight = hovering(options={"parameters": parameters}, manner=manner, supervision=supervision)
    flight.begin(INSPECTION, 1)
    assert flight.operator.has_received("PX4 would hit left-upper")
    assert flight.state == "flying"


# Orderly end ------------------------------------------------------------------------------------


def released(flight):
    flight.operator.mission(RELEASE)


def cut_off(flight):
    flight.deaf = True


@pytest.mark.parametrize(
    ("manner", "end"),
    [pytest.param(Manner.PX4, released, marks=pytest.mark.slow), (Manner.ARDUPILOT, cut_off)],
)
def test_the_last_setpoint_of_an_orderly_end_is_at_rest(manner, end):
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION)
    flight.run(3.0)
    moving = flight.setpoints[-1].message
    assert math.hypot(moving.vx, moving.vy, moving.vz) > 0.3
    end(flight)
    flight.run(5.0)
    assert flight.last_setpoint_s < flight.now_s - 3.0
    last = flight.setpoints[-1].message
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert min(clearances_m(flight.site, true_places(flight))) > flight.vehicle.radius_m
