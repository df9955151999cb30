from __future__ import annotations

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.identity import (
    AutopilotConflict,
    AutopilotFound,
    AutopilotRestarted,
    Identity,
)
from moar_companion.types import PX4


def handle(identity, data, *, link="serial", now_s=0.0):
    (message,) = Codec(system_id=9, component_id=9).receive(data)
    return identity.handle(message, link=link, now_s=now_s)


def test_the_first_autopilot_received_is_latched(peer):
    identity = Identity()
    event = handle(identity, peer(7, 1).heartbeat())
    assert isinstance(event, AutopilotFound)
    assert (event.autopilot.system_id, event.autopilot.kind) == (7, PX4)
    assert handle(identity, peer(7, 1).heartbeat()) is None


@pytest.mark.parametrize(
    ("component", "vehicle", "autopilot"),
    [
        (191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID),
        (190, mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID),
        (154, mavlink.MAV_TYPE_GIMBAL, mavlink.MAV_AUTOPILOT_GENERIC),
        (1, mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_INVALID),
        (2, mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4),
    ],
)
def test_other_components_are_not_taken_for_an_autopilot(peer, component, vehicle, autopilot):
    identity = Identity()
    data = peer(1, component).heartbeat(vehicle=vehicle, autopilot=autopilot)
    assert handle(identity, data) is None
    assert identity.autopilot is None


def test_a_second_autopilot_is_a_conflict_until_it_falls_silent(peer):
    identity = Identity()
    handle(identity, peer(1, 1).heartbeat(), now_s=0.0)
    event = handle(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=1.0)
    assert isinstance(event, AutopilotConflict)
    assert str(event.autopilot) == "px4 with system id 1 on serial"
    assert str(event.other) == "ardupilot with system id 2 on udp"
    assert event.reason == "two autopilots, ids 1 and 2"
    assert identity.conflict == "two autopilots are received"
    assert handle(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=2.0) is None
    identity.forget_silent(11.9)
    assert identity.conflict
    identity.forget_silent(12.1)
    assert not identity.conflict
    handle(identity, peer(1, 1).heartbeat(), now_s=19.0)
    event = handle(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=20.0)
    assert isinstance(event, AutopilotConflict)


def test_an_autopilot_that_falls_silent_is_replaced_by_the_only_other_one(peer):
    """Otherwise a simulator received once would block control until a restart."""
    identity = Identity()
    handle(identity, peer(7, 1).heartbeat(), now_s=0.0)
    assert isinstance(handle(identity, peer(1, 1).heartbeat(), now_s=9.9), AutopilotConflict)
    event = handle(identity, peer(1, 1).heartbeat(), now_s=10.1)
    assert isinstance(event, AutopilotFound)
    assert identity.autopilot is not None
    assert identity.autopilot.system_id == 1
    assert not identity.conflict


def test_a_silent_autopilot_is_not_replaced_where_two_others_are_received(peer):
    identity = Identity()
    handle(identity, peer(7, 1).heartbeat(), now_s=0.0)
    for second in range(1, 30):
        handle(identity, peer(1, 1).heartbeat(), now_s=second)
        handle(identity, peer(2, 1).heartbeat(), now_s=second)
    assert identity.autopilot is not None
    assert identity.autopilot.system_id == 7
    assert identity.conflict


def test_invented_ids_are_reported_every_ten_seconds_and_eight_are_kept(peer):
    identity = Identity()
    handle(identity, peer(1, 1).heartbeat(), now_s=0.0)
    reported_s = []
    for step in range(759):
        now_s = 1.0 + 0.04 * step
        data = peer(2 + step % 254, 1).heartbeat(autopilot=3 if step % 2 else 12)
        if isinstance(handle(identity, data, now_s=now_s), AutopilotConflict):
            reported_s.append(now_s)
        assert identity.conflict
        assert len(identity._others) <= 8
    assert reported_s == pytest.approx([1.0, 11.0, 21.0, 31.0])
    identity.forget_silent(now_s + 10.1)
    assert not identity.conflict


def test_of_many_other_autopilots_the_one_still_received_is_kept(peer):
    identity, other = Identity(), peer(77, 1)
    handle(identity, peer(1, 1).heartbeat(), now_s=0.0)
    for step in range(100):
        handle(identity, peer(2 + step % 70, 1).heartbeat(), now_s=0.1 * step)
        if step % 5 == 0:
            handle(identity, other.heartbeat(), now_s=0.1 * step)
        assert step == 0 or (77, PX4) in identity._others


def test_a_conflict_within_the_report_interval_is_reported_after_it(peer):
    identity = Identity()
    handle(identity, peer(1, 1).heartbeat(), now_s=0.0)
    assert handle(identity, peer(2, 1).heartbeat(), now_s=1.0) is not None
    assert identity.note_other_clock(2.0) is None
    assert identity.note_other_clock(11.0).reason == "two clocks, autopilot id 1"
    assert identity.note_other_clock(21.0) is None


def test_two_kinds_of_autopilot_under_one_id_are_a_conflict(peer):
    identity = Identity()
    handle(identity, peer(1, 1).heartbeat())
    assert isinstance(handle(identity, peer(1, 1).heartbeat(autopilot=3)), AutopilotConflict)


def test_another_clock_under_the_same_ids_is_a_conflict_until_it_falls_silent(peer):
    identity = Identity()
    assert identity.note_other_clock(0.0) is None
    handle(identity, peer(1, 1).heartbeat(), now_s=0.0)
    event = identity.note_other_clock(1.0)
    assert event.reason == identity.conflict == "two clocks, autopilot id 1"
    assert identity.note_other_clock(2.0) is None
    identity.forget_silent(11.9)
    assert identity.conflict
    identity.forget_silent(12.1)
    assert identity.conflict is None


def test_another_link_is_used_when_the_first_falls_silent(peer):
    identity = Identity()
    sender = peer(1, 1)
    handle(identity, sender.heartbeat(), link="serial", now_s=0.0)
    handle(identity, sender.heartbeat(), link="udp", now_s=1.0)
    assert identity.autopilot.link == "serial"
    assert identity.is_present(3.0)
    assert not identity.is_present(3.1)
    handle(identity, sender.heartbeat(), link="udp", now_s=4.0)
    assert identity.autopilot.link == "udp"
    assert identity.is_present(4.0)


def test_a_boot_status_after_another_status_is_a_restart(peer):
    identity = Identity()
    sender = peer(1, 1)
    booting = {"system_status": mavlink.MAV_STATE_BOOT}
    assert isinstance(handle(identity, sender.heartbeat(**booting)), AutopilotFound)
    assert handle(identity, sender.heartbeat(**booting)) is None
    assert handle(identity, sender.heartbeat()) is None
    assert isinstance(handle(identity, sender.heartbeat(**booting)), AutopilotRestarted)
    assert handle(identity, sender.heartbeat(**booting)) is None
