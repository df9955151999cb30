"""The service is stopped in flight: open orders get their final answer, a text reports the end."""

from __future__ import annotations

import pytest

from ..flights.lockstep import hovering
from ..flights.operator import FAILED, IN_PROGRESS, INSPECTION, MAV_CMD_DO_PAUSE_CONTINUE
from .marks import BOTH


def shut_down(flight):
    """The last cycle of the process; then the autopilot and the operator fly on."""
    flight.companion.shut_down(flight.now_s)
    for _, data in flight.companion.data_to_send():
        flight.report(data)
    flight.companion.decisions()
    flight.cut = True
    for _ in range(50):
        flight.move()
    return flight.operator.texts()


@BOTH
def test_an_order_whose_plan_is_awaited_fails_with_the_reason(manner):
    flight = hovering(manner=manner, vehicle="x500")
    flight.planning = False
    flight.operator.mission(INSPECTION)
    flight.run(1.0)
    assert flight.operator.answers() == [IN_PROGRESS]
    texts = shut_down(flight)
    assert flight.operator.answers() == [IN_PROGRESS, FAILED]
    assert "MOAR: the service ends, failed" in texts


@BOTH
def test_in_flight_a_text_reports_that_control_ends(manner):
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION)
    flight.run(2.0)
    assert "MOAR: the service ends, released" in shut_down(flight)
    # The next process can fly the rest.
    before = flight.companion.memory
    assert before.task.stops == ("splice-outer", "splice-inner")
    assert before.rest(flight.site) == before.task


@pytest.mark.parametrize("planner_ready", [True, False])
@BOTH
def test_an_order_of_the_last_moment_fails_too(manner, planner_ready):
    flight = hovering(manner=manner, vehicle="x500")
    if not planner_ready:
        flight.companion.await_planner()
    flight.operator.go_on()
    for data in flight.move():
        flight.handle(data)
    shut_down(flight)
    assert flight.operator.answers(MAV_CMD_DO_PAUSE_CONTINUE) == [FAILED]
