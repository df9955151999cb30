"""Flights between the circuits whose position becomes bad: where the aircraft goes, and in time.

Site 315 kV double circuit, target splice-inner, 4 m beside left-middle.
"""

from __future__ import annotations

import math

import pytest

from sitl.conditions import GPS_NO_FIX
from sitl.wire import packets

from ..copies import flown_once
from ..flights.campaign.packets import ESTIMATOR_STATUS, GPS_RAW_INT, ODOMETRY, change
from ..flights.judging import clearances_m, in_plane
from ..flights.lockstep import Lockstep, Manner
from ..thorough import sampled

INSPECTION, INNER = 1, 1
MOST_M = 4.0
"""Drift at its end."""
REPORTED_M = 0.3
"""Accuracy that both autopilots report in calm, open sky."""


class BadPosition(Lockstep):
    """A flight whose estimate can drift, with or without the accuracy that it reports."""

    drifted_m = 0.0
    _drift = None

    def begin_drift(self, towards_deg: float, speed_mps: float, *, reported: bool = True) -> None:
        """The estimate drifts along the plane, 0 towards +x, to MOST_M; so does its accuracy."""
        self._drift = (math.radians(towards_deg), speed_mps, reported)

    def step(self) -> None:
        if self._drift is not None:
            towards_rad, speed_mps, _ = self._drift
            step_m = min(speed_mps * 0.02, MOST_M - self.drifted_m)
            self.drifted_m += step_m
            level_m, up_m = step_m * math.cos(towards_rad), step_m * math.sin(towards_rad)
            azimuth_rad = math.radians(self.site.frame.azimuth_deg)
            estimator = self.autopilot._world.estimator
            estimator._off_n += level_m * math.cos(azimuth_rad)
            estimator._off_e += level_m * math.sin(azimuth_rad)
            self._raise(up_m)
        super().step()

    def _raise(self, up_m: float) -> None:
        """The height's error is a process that returns to 0: it is held where the drift has it."""
        self._up_m = getattr(self, "_up_m", 0.0) + up_m
        if self._up_m:
            self.autopilot._world.estimator._err_d = -self._up_m

    def handle(self, data: bytes) -> None:
        if self._drift is not None and self._drift[2]:
            edit = change({ESTIMATOR_STATUS, GPS_RAW_INT, ODOMETRY}, self._report)
            data = b"".join(item for _, item in edit(0.0, [(0.0, item) for item in packets(data)]))
        super().handle(data)

    def _report(self, message) -> None:
        name = message.get_type()
        if name == "ESTIMATOR_STATUS":
            message.pos_horiz_accuracy += self.drifted_m
        elif name == "ODOMETRY":
            variance = 0.5 * (REPORTED_M + self.drifted_m) ** 2
            covariance = list(message.pose_covariance)
            covariance[0] = covariance[6] = variance
            message.pose_covariance = covariance
        elif self.operator.manner is Manner.ARDUPILOT:  # PX4's estimator counts, not its receiver
            message.h_acc += round(1e3 * self.drifted_m)

    @property
    def place_m(self) -> tuple[float, float, float]:
        """True place of the aircraft in the site's frame."""
        truth = self.truth
        return in_plane(self.site, truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)

    def hull_clearance_m(self, place_m) -> float:
        return float(clearances_m(self.site, [place_m])[0]) - self.vehicle.radius_m

    def estimated_m(self) -> tuple[float, float, float] | None:
        pose = self.companion.state.pose_tracker.pose
        return None if pose is None else pose.position_m


@flown_once
def at_inner_target(manner: Manner, **options) -> BadPosition:
    flight = BadPosition(vehicle="x500", manner=manner, **options)
    flight.start_in_the_air()
    flight.operator.mission(INSPECTION, INNER)
    flight.give_mode()
    flight.run_until(lambda: flight.operator.has_received("at target splice-inner"), 60.0)
    return flight


@pytest.mark.slow
@pytest.mark.parametrize("towards_deg", sampled([0, 135, 270], range(0, 360, 45)))
@pytest.mark.parametrize("manner", Manner)
def test_the_hull_stays_outside_what_a_growing_reported_error_covers(manner, towards_deg):
    flight = at_inner_target(manner=manner)
    flight.begin_drift(towards_deg, 0.4)
    until_s = flight.now_s + MOST_M / 0.4 + 8.0
    while flight.now_s < until_s:
        flight.step()
        assert flight.hull_clearance_m(flight.place_m) > 0.0
        assert flight.hull_clearance_m(flight.estimated_m()) > REPORTED_M + flight.drifted_m
    assert flight.operator.has_received("m error would hit")
    assert flight.state == "holding"


@pytest.mark.slow
@pytest.mark.parametrize("speed_mps", sampled([0.1], [0.1, 0.2, 0.3]))
def test_a_slower_growth_is_left_in_time_too(speed_mps):
    flight = at_inner_target(manner=Manner.PX4)
    flight.begin_drift(0.0, speed_mps)
    least_m = math.inf
    until_s = flight.now_s + MOST_M / speed_mps + 5.0
    while flight.now_s < until_s:
        flight.step()
        reported_m = REPORTED_M + flight.drifted_m
        least_m = min(least_m, flight.hull_clearance_m(flight.estimated_m()) - reported_m)
    assert least_m > 0.5


@pytest.mark.slow
def test_an_operators_hold_ends_the_leg_to_a_refuge():
    flight = at_inner_target(manner=Manner.PX4)
    flight.begin_drift(0.0, 0.4)
    flight.run_until(lambda: flight.operator.has_received("leaving"), 10.0)
    flight.run(1.0)
    flight.operator.pause()
    flight.run(4.0)
    place_m = flight.setpoints[-1].message
    flight.run(1.0)
    later_m = flight.setpoints[-1].message
    assert math.dist((place_m.x, place_m.y, place_m.z), (later_m.x, later_m.y, later_m.z)) < 0.05
    assert not any((later_m.vx, later_m.vy, later_m.vz))


@pytest.mark.slow
def test_an_accuracy_that_gets_worse_in_one_step_below_the_limit_starts_no_leg():
    flight = at_inner_target(manner=Manner.ARDUPILOT)
    flight.autopilot.conditions.hdop = 5.0
    flight.run(8.0)
    assert not flight.operator.has_received("leaving")
    assert not flight.operator.has_received("uncertainty")


@pytest.mark.slow
@pytest.mark.parametrize(("manner", "least_x_m"), [(Manner.PX4, 14.0), (Manner.ARDUPILOT, 14.5)])
def test_at_the_loss_of_the_fix_the_aircraft_leaves_before_the_autopilot_lands(manner, least_x_m):
    flight = at_inner_target(manner=manner)
    flight.autopilot.conditions.gps_mode = GPS_NO_FIX
    flight.run_until(lambda: flight.operator.has_received("failsafe chose LAND"), 12.0)
    assert flight.operator.has_received("no fix: descent hits left-lower, leaving")
    assert flight.estimated_m()[0] > least_x_m
    until_s = flight.now_s + 20.0
    while flight.now_s < until_s and not flight.truth.on_ground:
        flight.step()
        assert flight.hull_clearance_m(flight.place_m) > 0.3


@pytest.mark.slow
def test_before_a_battery_that_falls_fast_lands_the_aircraft_is_where_that_hits_nothing():
    options = {"parameters": {"COM_LOW_BAT_ACT": 2}}
    flight = at_inner_target(manner=Manner.PX4, options=options)
    began_s = flight.now_s
    while not flight.truth.on_ground and flight.now_s - began_s < 40.0:
        flight.autopilot.conditions.battery_percent = max(
            6.0, 40.0 - 3.0 * (flight.now_s - began_s)
        )
        flight.step()
        assert flight.hull_clearance_m(flight.place_m) > 2.5
    assert flight.operator.has_received("to leave, leaving")
    assert flight.operator.has_received("failsafe chose HOLD")


@pytest.mark.slow
def test_a_voltage_that_sags_below_the_reported_charge_does_not_hold_up_the_exit():
    """ArduPilot acts by the charge in mAh: its landing comes in 24 s, not in 3."""
    parameters = {"BATT_FS_CRT_ACT": 1, "BATT_LOW_MAH": 429, "BATT_CRT_MAH": 198}
    flight = at_inner_target(manner=Manner.ARDUPILOT, options={"parameters": parameters})
    flight.autopilot.conditions.battery_percent = 13.0
    began_s = flight.now_s
    while not flight.truth.on_ground and flight.now_s - began_s < 60.0:
        flight.step()
        assert flight.hull_clearance_m(flight.place_m) > 2.0
    assert flight.operator.has_received("above the landing point, holding")
