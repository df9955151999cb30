"""A place that has to be left: the leg to the nearest one where a position error does no harm."""

from __future__ import annotations

import math

import pytest

from moar_companion.companion import refuge
from moar_companion.mavlink.autopilots.failsafe_actions import (
    NO_FAILSAFES,
    AutopilotAction,
    FailsafeAction,
    Trigger,
)
from moar_companion.settings.config import Authority, LossCheck, Supervision
from tests.copies import flown_once

from .desk import DENIED, EXIT, HOLD, INSPECTION, STEP_S, Desk


def at_target(**changes):
    return Desk(**changes).set(accuracy_m=0.3).come_to("at_target")


def grow(desk, rate_mps, seconds, most_m=99.0):
    """The reported accuracy grows."""
    for _ in range(round(seconds / STEP_S)):
        desk.set(accuracy_m=min(most_m, desk.accuracy_m + rate_mps * STEP_S)).step()
    return desk


@flown_once
def at_inner_target():
    """At the target between the circuits, with escape routes."""
    desk = Desk().set(accuracy_m=0.3)
    desk.contingencies = True
    desk.run(1.2).order(INSPECTION, 1.0).run(2.5)
    desk.send_heartbeat(desk.ours)
    return desk.run_until("at_target", 90.0)


def legs_begun(desk, seconds):
    """Number of legs to a refuge that begin within a time."""
    count, leaves = 0, False
    for _ in range(round(seconds / STEP_S)):
        if desk.state == "landing_leg":
            break
        desk.step()
        flight = desk.companion.state.routes.flight
        count += flight.leaves and not leaves
        leaves = flight.leaves
    return count


def east_m(desk):
    """Distance east of the setpoint, away from the line."""
    return desk.setpoints()[-1].y


def moves(desk):
    last = desk.setpoints()[-1]
    return any((last.vx, last.vy, last.vz))


def test_an_uncertainty_that_grows_is_left_before_the_limit_and_held_away_from_the_line():
    desk = at_target()
    began_m = east_m(desk)
    grow(desk, 0.3, 5.0)
    assert desk.accuracy_m < 2.0
    assert desk.said("m error would hit right-middle, leaving")
    grow(desk, 0.3, 20.0)
    assert east_m(desk) > began_m + 2.0
    assert desk.state == "holding"
    assert not moves(desk)


def test_a_mission_resumes_when_the_uncertainty_is_small_again():
    desk = at_target()
    grow(desk, 0.3, 8.0)
    assert desk.state == "holding"
    desk.set(accuracy_m=0.3).run_until("flying", 12.0)


@pytest.mark.uncounted
def test_an_uncertainty_that_grew_and_is_not_reported_any_more_is_taken_to_grow():
    desk = at_target()
    grow(desk, 0.2, 6.0)
    assert desk.state == "holding"
    desk.mute.add("ESTIMATOR_STATUS")
    for _ in range(15):
        desk.run(1.0)
        assert desk.state == "holding"


def test_an_uncertainty_that_is_large_but_steady_starts_no_leg_while_there_is_room():
    desk = at_target()
    began_m = east_m(desk)
    desk.set(accuracy_m=1.2).run(5.0)
    assert not desk.said("leaving")
    assert not desk.said("uncertainty")
    assert east_m(desk) - began_m < 1.0


@pytest.mark.uncounted
def test_an_operators_hold_stops_the_leg_and_the_next_order_is_not_refused_for_it():
    desk = at_target()
    grow(desk, 0.3, 5.6)
    assert moves(desk)
    desk.order(HOLD)
    grow(desk, 0.3, 3.0)
    assert not moves(desk)
    stopped_m = east_m(desk)
    grow(desk, 0.3, 3.0)
    assert east_m(desk) == pytest.approx(stopped_m, abs=0.01)


@pytest.mark.uncounted
def test_where_no_place_is_clear_the_pilot_is_told_to_take_over():
    desk = at_target()
    grow(desk, 1.0, 16.0)
    assert desk.said("m uncertain, no place is clear of it")
    assert desk.state == "holding"
    assert not moves(desk)


@pytest.mark.uncounted
def test_the_setpoint_of_a_leg_to_a_refuge_never_jumps():
    desk = at_target()
    grow(desk, 0.3, 10.0)
    places = [(item.x, item.y, item.z) for item in desk.setpoints(desk.now_s - 10.0)]
    assert max(map(math.dist, places, places[1:])) < 0.05


def test_at_a_lost_fix_a_place_is_left_where_a_blind_landing_would_hit_a_conductor():
    desk = at_target()
    desk.set(fix_type=1).run(3.0)
    assert desk.state == "holding"
    assert desk.said("MOAR: no fix: descent hits right-")
    assert desk.said("leaving")
    assert moves(desk)


def test_a_plan_without_a_refuge_from_a_blind_landing_is_refused_where_that_is_configured():
    desk = Desk(supervision=Supervision(failsafe_action=LossCheck.REFUSE))
    desk.run(1.2).order(INSPECTION, 1.0).run(0.5)
    assert desk.answers() == [DENIED]
    assert desk.said("GPS loss: descent hits")


def test_at_a_lost_fix_one_leg_is_flown_and_then_a_critical_battery_evacuates():
    desk = at_inner_target()
    desk.set(fix_type=1)
    assert legs_begun(desk, 15.0) == 1
    assert desk.state == "holding"
    assert not moves(desk)
    desk.set(charge_state=3, battery_percent=6).run_until("flying", 5.0)
    assert desk.said("is critical, evacuating")


def test_a_critical_battery_evacuates_where_a_blind_landing_has_no_refuge(monkeypatch):
    desk = at_inner_target()
    monkeypatch.setattr(refuge, "refuge_leg", lambda *_: None)
    desk.set(fix_type=1).run(5.0)
    assert desk.said("no fix: no place near is clear to land")
    desk.set(charge_state=3, battery_percent=6).run_until("flying", 5.0)


@pytest.mark.parametrize("accuracy_m", [2.3, pytest.param(2.6, marks=pytest.mark.slow)])
def test_an_evacuation_with_an_uncertain_position_reaches_its_landing_leg(accuracy_m):
    desk = at_inner_target()
    desk.set(charge_state=3, battery_percent=12).run(2.0)
    desk.set(accuracy_m=accuracy_m)
    assert legs_begun(desk, 35.0) <= 1
    assert desk.state == "landing_leg"


def test_a_threat_is_looked_at_twice_a_second(monkeypatch):
    calls = []

    def counted(*args, **kwargs):
        calls.append(1)
        return spare_at_m(*args, **kwargs)

    spare_at_m = refuge.spare_at_m
    desk = at_target()
    monkeypatch.setattr(refuge, "spare_at_m", counted)
    desk.set(fix_type=1).run(4.0)
    assert len(calls) <= 12


@pytest.mark.uncounted
def test_no_leg_begins_above_the_landing_point_while_the_landing_is_requested():
    desk = Desk(authority=Authority.ENGAGE).set(accuracy_m=0.3)
    desk.come_to("holding", EXIT, then_s=1.1)
    assert len(desk.mode_requests()) == 1
    above_m = east_m(desk)
    grow(desk, 3.0, 6.0)
    assert desk.said("m error would hit")
    assert east_m(desk) == pytest.approx(above_m, abs=0.01)
    assert len(desk.mode_requests()) > 1


def test_a_landing_that_was_forecast_and_does_not_come_holds_an_evacuation_for_a_limited_time(
    monkeypatch,
):
    desk = at_inner_target()
    monkeypatch.setattr(refuge.Refuge, "_refuge_s", lambda *_: 1.0)
    state = desk.companion.state
    volume, watch = state.routes.flight.path.volume, state.refuge
    land = FailsafeAction(trigger=Trigger.CRITICAL_BATTERY, action=AutopilotAction.LAND, setting="")

    def threatens(now_s, left_s):
        here_m = (11.0, 0.0, 11.0)
        watch.look(
            volume, NO_FAILSAFES, here_m, (land, left_s), 13.0, now_s, blind=False, leaves=True
        )
        return watch.battery_landing is not None

    begin_s = desk.now_s + 10.0
    assert all(threatens(begin_s + t, 11.0) for t in range(42))
    assert not any(threatens(begin_s + t, 20.0 if t == 45 else 11.0) for t in range(42, 60))
    assert not any(threatens(begin_s + t, 20.0) for t in range(60, 67))
    assert threatens(begin_s + 67.0, 11.0)
