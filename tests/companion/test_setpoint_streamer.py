"""The stream: a forbidden setpoint is not sent, and the mission holds."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from moar_companion.companion import cycle_stages
from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.companion.estimation.pose import Jump, Setpoint
from moar_companion.companion.guidance.path_follower import PathFollower
from moar_companion.companion.safety.setpoint_gate import Refusal
from moar_companion.companion.setpoint_streamer import SetpointStreamer
from moar_companion.planner.site import Margin
from moar_companion.settings.config import Supervision
from moar_companion.types import PX4, Mission

from .desk import INSPECTION, Desk, usual_planner


def jumped(setpoint):
    x_m, y_m, z_m = setpoint.position_m
    return replace(setpoint, position_m=(x_m, y_m + 0.3, z_m))


def turned_back(setpoint):
    x_mps, y_mps, z_mps = setpoint.velocity_mps
    return replace(setpoint, velocity_mps=(-x_mps, -y_mps, -z_mps))


def hurried(setpoint):
    x_mps, y_mps, z_mps = setpoint.velocity_mps
    return replace(setpoint, velocity_mps=(2.0 * x_mps, 2.0 * y_mps, 2.0 * z_mps))


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (jumped, "setpoint jumps by 0.3 m"),
        (turned_back, "setpoint speed jump 1.4 m/s"),
        (hurried, "setpoint at 1.4 m/s > 1.1"),
    ],
)
def test_a_setpoint_with_a_forbidden_motion_is_replaced_by_the_previous_one_at_rest(
    wrong, reason, monkeypatch
):
    desk = Desk().come_to("flying", then_s=5.0)
    before, of_now = desk.setpoints()[-1], PathFollower.setpoint
    with monkeypatch.context() as once:
        once.setattr(PathFollower, "setpoint", lambda *arguments: wrong(of_now(*arguments)))
        desk.step()
    last = desk.setpoints()[-1]
    assert (last.x, last.y, last.z) == (before.x, before.y, before.z)
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    desk.run(1.0)
    assert desk.state == "holding"
    assert desk.said(reason)
    assert {(m.x, m.y, m.z) for m in desk.setpoints(desk.now_s - 0.5)} == {(last.x, last.y, last.z)}
    desk.order(INSPECTION).run(1.0)
    assert desk.state == "flying"


def test_a_frame_shift_without_a_jump_moves_no_setpoint_in_the_autopilots_frame(monkeypatch):
    """In the site's frame the setpoint moves correctly."""
    desk = Desk().come_to("flying", then_s=5.0)
    began = desk.now_s
    monkeypatch.setattr(cycle_stages, "_shift", lambda *_: None)
    latitude, longitude, altitude = desk.origin
    desk.origin = (latitude, longitude + 0.4 / 78_000.0, altitude)
    desk.run(1.5)
    assert desk.state == "holding"
    assert desk.said("NED setpoint jumps by 0.4")
    places = [(m.x, m.y, m.z) for m in desk.setpoints(began)]
    assert max(math.dist(*pair) for pair in itertools.pairwise(places)) < 0.05


def test_a_stopped_flight_searches_its_escape_route_from_its_place(monkeypatch):
    desk = Desk().come_to("flying", then_s=3.0).set(plan_delay_s=None, battery_percent=15)
    desk.run_until_requested("exit")
    of_now = PathFollower.setpoint
    with monkeypatch.context() as once:
        once.setattr(PathFollower, "setpoint", lambda *arguments: jumped(of_now(*arguments)))
        desk.step()
    assert desk.set(plan_delay_s=0.04).answer_plan().run(0.5).state == "flying"
    assert desk.companion.status.task.mission is Mission.EXIT


class Anywhere:
    """A flight that permits every setpoint, or refuses every one as `refused` tells."""

    drifting_at_m, refused, seen_late = None, None, False
    path = SimpleNamespace(
        volume=SimpleNamespace(
            site=SimpleNamespace(margin=Margin(position_m=0.9)),
            keeps_clear=lambda _place_m: True,
        )
    )

    def refusal(self, *_):
        return self.refused


class Sent:
    """A session that stores the places and velocities of its setpoints."""

    def __init__(self):
        self.places_ned_m, self.velocities_mps = [], []

    def send_setpoint(self, place_ned_m, velocity_mps, *_):
        self.places_ned_m.append(place_ned_m)
        self.velocities_mps.append(velocity_mps)


def streamed():
    """A streamer of the usual planner's vehicle, its session, a flight and its plane."""
    planner, session = usual_planner(), Sent()
    frame = planner.site.frame
    plane = PlaneToLocal.between(frame, frame.to_geodetic((0.0, 0.0, 0.0)), PX4)
    margin = Margin(position_m=0.9, tracking_m=0.0)
    stream = SetpointStreamer(session, planner.vehicle, Supervision(), margin, 0.5)
    return stream, session, Anywhere(), plane


def test_where_even_the_rest_is_refused_the_stream_ends_at_rest_at_the_last_place():
    """The autopilot would go on with the last velocity until its offboard loss."""
    stream, session, flight, plane = streamed()
    moving = Setpoint(position_m=(5.0, 0.0, 5.0), velocity_mps=(0.5, 0.0, 0.0), yaw_rad=0.0)
    assert stream.send(moving, flight, plane, 1.0) is None
    flight.refused = Refusal("sp outside GF_MAX_HOR_DIST 100 m")
    refused = stream.send(replace(moving, position_m=(5.01, 0.0, 5.0)), flight, plane, 1.02)
    assert refused.rest is None
    assert stream.last_refusal is refused
    first, last = session.places_ned_m
    assert last == first
    assert math.hypot(*session.velocities_mps[-1]) == 0.0


@pytest.mark.parametrize(("ends", "sent"), [(False, 2), (True, 1)])
def test_the_exception_for_a_setpoint_at_rest_after_a_jump_ends_with_the_stream(ends, sent):
    """A place outside the workspace, not caused by a jump in this flight."""
    stream, session, flight, plane = streamed()
    rest = Setpoint(position_m=(5.0, 0.0, 5.0), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
    assert stream.send(rest, flight, plane, 1.0) is None
    jump = Jump(step_m=(0.0, 0.0, 0.6), origin_step_m=(0.0, 0.0, 0.0), turn_rad=0.0)
    stream.shift(jump, plane)
    if ends:
        stream.end()
    flight.refused = Refusal("setpoint outside the workspace")
    refused = stream.send(replace(rest, position_m=(5.0, 0.0, 5.6)), flight, plane, 1.02)
    assert (refused is not None) is ends
    assert len(session.places_ned_m) == sent
