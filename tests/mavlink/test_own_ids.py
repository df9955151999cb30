"""A second companion on the link, and copies of the companion's own packets."""

from __future__ import annotations

from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.own_ids import ComponentConflict

from .peer import Peer


def companion(peer):
    """A heartbeat as a companion sends it."""
    return peer.heartbeat(
        autopilot=mavlink.MAV_AUTOPILOT_INVALID, vehicle=mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    )


def test_a_second_companion_is_reported_once_a_minute(story, autopilot):
    story.meet(autopilot)
    second = Peer(1, 195)
    for _ in range(50):
        story.handle(autopilot.heartbeat())
        story.handle(companion(second))
        story.run(1.0)
    assert story.events() == [ComponentConflict(system_id=1, component_id=195)]


def test_a_single_foreign_heartbeat_is_of_the_process_before(story, autopilot):
    story.meet(autopilot)
    story.handle(companion(Peer(1, 195)))
    story.run(30.0)
    assert story.events() == []


def test_the_own_packets_that_a_router_returns_are_of_no_other(story, autopilot):
    story.meet(autopilot)
    returned = 0
    for _ in range(200):
        story.now_s += 0.1
        story.session.tick(story.now_s, mavlink.MAV_STATE_STANDBY)
        for _, data in story.session.data_to_send():
            returned += 1
            story.session.receive("serial", data, story.now_s + 0.05)
    assert returned >= 20
    assert story.events() == []
