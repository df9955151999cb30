"""Landing legs and obstacles that a sensor sees: no leg is flown through one."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.companion.desk import EXIT, HOLD, PAUSE_CONTINUE, STEP_S, USER_1
from tests.companion.scripted_autopilot import OFFBOARD, POSCTL
from tests.companion.watched import SETTINGS, Watched, ahead, conductor, copied, nearest_m

LONG_S = 12.0
"""Time in which the aircraft would have passed the obstacle on its leg."""


def exits(**options):
    """An exit that is ordered."""
    desk = Watched(**options).run(1.0)
    desk.handle(desk.operator.command(USER_1, EXIT, -1))
    return desk


@pytest.fixture(scope="module")
def on_leg():
    """An exit on its landing leg."""
    desk = exits().run_until("ready")
    desk.set(mode=OFFBOARD)
    return desk.run_until("landing_leg", 60.0).run(0.5)


def assert_is_not_hit(desk, spot_m, seconds=LONG_S, end=None):
    assert nearest_m(desk, spot_m, seconds, end) > desk.vehicle.radius_m + 0.3


@pytest.mark.slow
@pytest.mark.parametrize("by_m", [2.0, 5.0])
def test_a_landing_leg_is_not_flown_through_an_obstacle_seen_on_it(on_leg, by_m):
    desk = copied(on_leg)
    spot_m = ahead(desk, by_m)
    desk.conductors = (conductor(*spot_m),)
    assert_is_not_hit(desk, spot_m)


@pytest.mark.slow
def test_an_obstacle_beside_the_passed_part_of_a_landing_leg_does_not_end_it(on_leg):
    desk = copied(on_leg)
    while desk.place_m[0] < 36.0:
        desk.step()
    desk.conductors = (conductor(31.8, 3.9),)
    desk.run_until("holding", LONG_S)
    assert desk.texts()[-1] == "MOAR: above the landing point, holding"


@pytest.mark.slow
def test_on_a_landing_leg_whose_rest_a_seen_keep_out_touches_the_aircraft_brakes(on_leg):
    """The hull would keep a tenth of a metre less than the keep-out."""
    desk = copied(on_leg)
    while desk.place_m[0] < 32.0:
        desk.step()
    desk.conductors = (conductor(35.8, 4.7),)
    desk.run(2.0)
    assert not any("setpoint" in text for text in desk.texts())
    assert desk.companion.state.routes.flight.barred_by is None
    assert_is_not_hit(desk, (35.8, 4.7))


@pytest.mark.slow
def test_a_held_landing_leg_is_not_resumed_through_an_obstacle_seen_meanwhile(on_leg):
    desk = copied(on_leg)
    spot_m = ahead(desk, 4.0)
    desk.handle(desk.operator.command(PAUSE_CONTINUE, 0))
    desk.run(2.0)
    desk.conductors = (conductor(*spot_m),)
    desk.run(1.0)
    desk.handle(desk.operator.command(PAUSE_CONTINUE, 1))
    assert_is_not_hit(desk, spot_m)


@pytest.mark.slow
@pytest.mark.parametrize("order", [EXIT, None])
def test_a_leg_that_a_pilot_took_is_not_resumed_through_an_obstacle_seen_meanwhile(on_leg, order):
    """By the same order, or by `continue`."""
    desk = copied(on_leg)
    while not desk.site.workspace.outside_m(desk.place_m[::2]):
        desk.step()
    spot_m = ahead(desk, 4.0)
    desk.send_heartbeat(POSCTL)
    desk.run(0.7)
    desk.conductors = (conductor(*spot_m),)
    desk.run(1.0)
    if order is None:
        desk.go_on()
    else:
        desk.handle(desk.operator.command(USER_1, order, -1))
    desk.run(0.3)
    desk.send_heartbeat(OFFBOARD)
    assert_is_not_hit(desk, spot_m)


def first_leg_m():
    """A place on the landing leg of the exit's first plan, outside the workspace."""
    desk = exits().run_until("ready")
    x_m, _, z_m = desk.companion.state.routes.flight.path.legs[-1].points_m[16]
    return x_m, z_m


@pytest.fixture(scope="module")
def spot_m():
    return first_leg_m()


def test_a_plan_is_not_adopted_whose_leg_an_obstacle_bars_that_was_seen_since_its_request(spot_m):
    desk = exits(plan_delay_s=0.2)
    while not desk.jobs:
        desk.step()
    desk.conductors = (conductor(*spot_m),)
    desk.run_until("ready", 5.0)
    desk.set(mode=OFFBOARD)
    assert_is_not_hit(desk, spot_m, 60.0, "holding")
    assert desk.texts()[-1] == "MOAR: above the landing point, holding"


def test_a_free_path_is_taken_at_once_where_an_obstacle_bars_the_leg_of_the_active_path(spot_m):
    """Although the active path, without its leg, costs less."""
    desk = exits().run_until("ready")
    desk.set(mode=OFFBOARD)
    desk.run_until("flying")
    desk.conductors = (conductor(*spot_m),)
    desk.run(1.0)
    assert desk.companion.state.routes.flight.barred_by is None


@pytest.mark.slow
def test_a_fence_about_an_unknown_home_does_not_hide_seen_obstacles_from_a_flight():
    """ArduPilot has not reported home, and its fence is enabled in flight."""
    desk = exits(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA).run_until("ready")
    desk.send_heartbeat(desk.ours)
    desk.run_until("landing_leg", 60.0).set_parameters(FENCE_ENABLE=1.0)
    desk.run(0.5)
    spot_m = ahead(desk, 4.0)
    desk.conductors = (conductor(*spot_m),)
    assert_is_not_hit(desk, spot_m)


class Pushed(Watched):
    """An aircraft that follows its setpoint, and that wind pushes at a constant speed."""

    push_mps = (0.0, 0.0, 0.0)

    def take_what_is_sent(self):
        before_m = self.position_ned_m
        super().take_what_is_sent()
        if self.mode != self.ours or before_m == self.position_ned_m:
            return
        self.velocity_ned_mps = tuple(
            max(-3.0, min(3.0, 0.95 * (wanted_m - at_m))) + push_mps
            for at_m, wanted_m, push_mps in zip(
                before_m, self.position_ned_m, self.push_mps, strict=True
            )
        )
        self.position_ned_m = tuple(
            at_m + speed_mps * STEP_S
            for at_m, speed_mps in zip(before_m, self.velocity_ned_mps, strict=True)
        )


@pytest.mark.parametrize("held", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_aircraft_beside_its_setpoint_does_not_return_through_an_obstacle_seen_between(held):
    """Steady wind holds it 2.5 m away, and then abates."""
    desk = Pushed().set(accuracy_m=0.3).fly(1.0)
    if held:
        desk.order(HOLD)
    desk.push_mps = (0.0, 2.4, 0.0)
    desk.run(6.0)
    setpoint_m = desk.companion.state.routes.flight.progress(
        desk.companion.pose
    ).setpoint.position_m
    spot_m = tuple((a + b) / 2.0 for a, b in zip(setpoint_m[::2], desk.place_m[::2], strict=True))
    assert 2.0 < math.dist(setpoint_m, desk.place_m) < desk.vehicle.guidance.leash_m
    desk.conductors = (conductor(*spot_m),)
    desk.run(5.0)
    desk.push_mps = (0.0, 0.0, 0.0)
    assert nearest_m(desk, spot_m, 10.0) > desk.vehicle.radius_m


def test_a_resumed_leg_has_the_speed_limits_of_the_present_maps():
    """Before the takeover obstacles were inflated by the position's uncertainty."""
    desk = Watched().set(accuracy_m=1.4).run(2.0).order(EXIT).run_until("ready").run(1.0)
    desk.send_heartbeat(OFFBOARD)
    desk.run_until("landing_leg", 60.0).run(1.5)
    assert desk.companion.state.routes.flight.path.volume.reach is not None
    x_m, z_m = ahead(desk, 2.0)
    desk.send_heartbeat(POSCTL)
    desk.run(0.7)
    desk.conductors = (conductor(x_m, z_m + 2.6),)
    desk.run(1.0).order(EXIT).run(0.3)
    desk.send_heartbeat(OFFBOARD)
    desk.run(0.1)
    volume = desk.companion.state.routes.flight.path.volume
    assert (desk.state, volume.reach) == ("landing_leg", None)


def test_a_plan_is_not_adopted_whose_leg_touches_a_keep_out_that_was_seen_since_its_request():
    desk = exits(plan_delay_s=0.2)
    while not desk.jobs:
        desk.step()
    desk.conductors = (conductor(35.8, 4.7),)
    desk.run_until("ready", 5.0)
    desk.set(mode=OFFBOARD)
    least_m = desk.vehicle.radius_m + SETTINGS.keep_out_m
    assert nearest_m(desk, (35.8, 4.7), 60.0, "holding") >= least_m
    assert desk.texts()[-1] == "MOAR: above the landing point, holding"
