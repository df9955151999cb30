"""A receiver that becomes less accurate in flight: the path keeps away, or the mission holds.

ArduPilot's receiver reports its accuracy, which SIM_GPS_HDOP sets; the margin allows for 0.5 m.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import Supervision, shipped_configs

from ..copies import flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
    clearances_m,
    setpoint_places,
)
from ..flights.lockstep import hovering
from ..flights.operator import DENIED, INSPECTION, Manner

pytestmark = pytest.mark.slow

M_PER_HDOP = 0.3 / 1.21
"""Reported accuracy of the receiver, per HDOP."""
INNER = 1
ARDUPILOT_MARGIN_M = 1.4
BESIDE_M = 3.2
"""Distance of targets from their conductors: too near for a position error of 1.6 m."""


def narrow_site():
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    nearer_m = 4.0 - BESIDE_M
    targets = tuple(
        replace(target, position_m=(target.position_m[0] - nearer_m, target.position_m[1]))
        for target in site.targets
    )
    return replace(site, targets=targets)


def over_the_narrow_site():
    """All weights are equal: only distances count, not the receiver's effect on weights."""
    return hovering(
        site=narrow_site(),
        vehicle="linedrone",
        manner=Manner.ARDUPILOT,
        supervision=Supervision(localization_limit=1.0),
    )


@flown_once
def flight_to_the_far_circuit():
    """Just after the start from the near target to the far one, between the conductors."""
    flight = over_the_narrow_site()
    flight.begin(INSPECTION)
    flight.run_until_state("at_target", 60.0)
    flight.run_until_state("flying", 10.0)
    return flight


def know_to(flight, accuracy_m):
    flight.autopilot.conditions.hdop = accuracy_m / M_PER_HDOP


def least_room_m(flight, since):
    """Least distance from the hull at the setpoints since then to the nearest keep-out."""
    places = setpoint_places(flight, flight.setpoints[since:])
    return min(clearances_m(flight.site, places, keep_out=True)) - flight.vehicle.radius_m


def assert_it_was_sound(flight):
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


def test_the_path_moves_away_from_the_conductors_and_the_mission_continues():
    flight = flight_to_the_far_circuit()
    know_to(flight, 1.35)
    since = len(flight.setpoints)
    flight.run_until_state("at_target", 60.0)
    assert flight.companion.status.task.stops == ("splice-inner",)
    replans = [item.data["reason"] for item in flight.decisions if item.kind == "replan"]
    assert "obstacles wider by 0.0 -> 0.9 m" in replans
    # A cell is free if its centre is.
    assert least_room_m(flight, since) > ARDUPILOT_MARGIN_M + 0.85 - 0.15
    assert_it_was_sound(flight)


def test_the_mission_holds_with_the_value_reported_until_the_position_is_more_accurate():
    flight = flight_to_the_far_circuit()
    know_to(flight, 1.6)
    flight.run_until_state("holding", 3.0)
    flight.run(3.0)  # an escape leg exists, but no path to the target
    assert flight.operator.has_received("MOAR: no room here, uncertainty 1.6 m")
    assert flight.operator.has_received("no path, uncertainty 1.6 m, holding")
    asked = len([item for item in flight.decisions if item.kind == "replan"])
    flight.run(15.0)
    assert flight.state == "holding"
    assert len([item for item in flight.decisions if item.kind == "replan"]) == asked
    know_to(flight, 0.3)
    flight.run_until_state("flying", 6.0)
    flight.run_until_state("at_target", 30.0)
    assert_it_was_sound(flight)


def test_before_the_flight_the_mission_is_denied_with_the_value():
    flight = over_the_narrow_site()
    know_to(flight, 1.6)
    flight.run(1.0)
    flight.operator.mission(INSPECTION, INNER)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == DENIED
    assert flight.operator.has_received("MOAR: no path, uncertainty 1.6 m, denied")
    assert not flight.setpoints
