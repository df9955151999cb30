"""A mission that late or missing data have released: its rest is kept until the landing."""

from __future__ import annotations

import pytest

from moar_companion.companion.estimation.landed_state import airborne

from ..copies import flown_once
from ..flights.judging import clearances_m, true_places
from ..flights.lockstep import hovering
from ..flights.operator import (
    ACCEPTED,
    INSPECTION,
    MAV_CMD_DO_PAUSE_CONTINUE,
    TEMPORARILY_REJECTED,
)
from .marks import BOTH, PX4_FIRST

REST = "MOAR: order continue to fly the rest"


@flown_once
def released_by_a_stall(manner):
    """On the way to the second target the process stood still for 3 s; 8 s have passed since."""
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION, 1)
    flight.run(4.0)
    flight.stop_process(3.0)
    flight.run(8.0)
    assert flight.state == "released"
    assert flight.operator.has_received("MOAR: control loop stalled 3.0 s, released")
    assert flight.last_setpoint_s < flight.now_s - 10.0
    return flight


def last_text(flight):
    return flight.operator.texts()[-1]


def continued(flight):
    """Orders continue; returns the answer."""
    flight.operator.go_on()
    flight.run(1.0)
    return flight.operator.answers(MAV_CMD_DO_PAUSE_CONTINUE)[-1]


@PX4_FIRST
def test_continue_after_a_stall_of_the_process_flies_the_rest(manner):
    flight = released_by_a_stall(manner)
    assert flight.operator.has_received(REST)
    assert flight.companion.status.task.stops == ("splice-inner",)
    assert continued(flight) == ACCEPTED
    flight.give_mode()
    flight.run_until_state("at_target", 90.0)
    assert min(clearances_m(flight.site, true_places(flight))) > flight.vehicle.radius_m


@pytest.mark.slow
@BOTH
def test_continue_after_a_lost_link_that_is_back_flies_the_rest(manner):
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION, 1)
    flight.run(3.0)
    flight.cut = True
    flight.run(6.0)
    flight.cut = False
    flight.run(8.0)  # the receiver counts as silent until it has reported for 5 s
    assert flight.state == "released"
    assert continued(flight) == ACCEPTED
    flight.give_mode()
    flight.run_until_state("at_target", 90.0)


@pytest.mark.slow
@BOTH
def test_after_the_landing_the_text_says_that_it_ended_the_mission(manner):
    flight = released_by_a_stall(manner)
    flight.operator.mode("land")
    flight.run(2.0)
    assert not airborne(flight.companion.telemetry, flight.now_s)
    # In the landing an order is rejected for that.
    assert continued(flight) == TEMPORARILY_REJECTED
    assert last_text(flight) == "MOAR: landing, rejected"
    flight.run_until(lambda: flight.truth.on_ground and not flight.truth.armed, 60.0)
    flight.run(1.0)
    assert continued(flight) == TEMPORARILY_REJECTED
    assert last_text(flight) == "MOAR: the landing ended the mission, rejected"
