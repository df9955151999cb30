from __future__ import annotations

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.identity import (
    AutopilotConflict,
    AutopilotFound,
    AutopilotRestarted,
    BootClock,
    Identity,
)
from moar_companion.types import AutopilotKind


def hear(identity, data, *, link="serial", now_s=0.0):
    (message,) = Codec(system_id=9, component_id=9).receive(data)
    return identity.hear(message, link=link, now_s=now_s)


def test_the_first_autopilot_heard_is_ours(peer):
    identity = Identity()
    event = hear(identity, peer(7, 1).heartbeat())
    assert isinstance(event, AutopilotFound)
    assert (event.autopilot.system_id, event.autopilot.kind) == (7, AutopilotKind.PX4)
    assert hear(identity, peer(7, 1).heartbeat()) is None


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
def test_nobody_else_is_taken_for_an_autopilot(peer, component, vehicle, autopilot):
    identity = Identity()
    data = peer(1, component).heartbeat(vehicle=vehicle, autopilot=autopilot)
    assert hear(identity, data) is None
    assert identity.autopilot is None


def test_a_second_autopilot_is_a_conflict_until_it_falls_silent(peer):
    identity = Identity()
    hear(identity, peer(1, 1).heartbeat(), now_s=0.0)
    event = hear(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=1.0)
    assert isinstance(event, AutopilotConflict)
    assert str(event.autopilot) == "px4 with system id 1 on serial"
    assert str(event.other) == "ardupilot with system id 2 on udp"
    assert identity.conflict
    assert hear(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=2.0) is None
    identity.forget_silent(11.9)
    assert identity.conflict
    identity.forget_silent(12.1)
    assert not identity.conflict
    hear(identity, peer(1, 1).heartbeat(), now_s=19.0)
    event = hear(identity, peer(2, 1).heartbeat(autopilot=3), link="udp", now_s=20.0)
    assert isinstance(event, AutopilotConflict)


def test_an_autopilot_that_is_gone_makes_room_for_the_only_other_one(peer):
    """Else a simulator that was heard once would have to be forgotten by a restart."""
    identity = Identity()
    hear(identity, peer(7, 1).heartbeat(), now_s=0.0)
    assert isinstance(hear(identity, peer(1, 1).heartbeat(), now_s=9.9), AutopilotConflict)
    event = hear(identity, peer(1, 1).heartbeat(), now_s=10.1)
    assert isinstance(event, AutopilotFound)
    assert identity.autopilot is not None
    assert identity.autopilot.system_id == 1
    assert not identity.conflict


def test_of_two_others_none_takes_its_place(peer):
    identity = Identity()
    hear(identity, peer(7, 1).heartbeat(), now_s=0.0)
    for second in range(1, 30):
        hear(identity, peer(1, 1).heartbeat(), now_s=second)
        hear(identity, peer(2, 1).heartbeat(), now_s=second)
    assert identity.autopilot is not None
    assert identity.autopilot.system_id == 7
    assert identity.conflict


def test_two_kinds_of_autopilot_under_one_id_are_a_conflict(peer):
    identity = Identity()
    hear(identity, peer(1, 1).heartbeat())
    assert isinstance(hear(identity, peer(1, 1).heartbeat(autopilot=3)), AutopilotConflict)


def test_another_link_is_used_when_the_first_falls_silent(peer):
    identity = Identity()
    sender = peer(1, 1)
    hear(identity, sender.heartbeat(), link="serial", now_s=0.0)
    hear(identity, sender.heartbeat(), link="udp", now_s=1.0)
    assert identity.autopilot.link == "serial"
    assert identity.alive(3.0)
    assert not identity.alive(3.1)
    hear(identity, sender.heartbeat(), link="udp", now_s=4.0)
    assert identity.autopilot.link == "udp"
    assert identity.alive(4.0)


def test_a_boot_after_anything_else_is_a_restart(peer):
    identity = Identity()
    sender = peer(1, 1)
    booting = {"system_status": mavlink.MAV_STATE_BOOT}
    assert isinstance(hear(identity, sender.heartbeat(**booting)), AutopilotFound)
    assert hear(identity, sender.heartbeat(**booting)) is None
    assert hear(identity, sender.heartbeat()) is None
    assert isinstance(hear(identity, sender.heartbeat(**booting)), AutopilotRestarted)
    assert hear(identity, sender.heartbeat(**booting)) is None


def test_a_clock_that_goes_back_is_a_restart():
    clock = BootClock()
    assert [clock.hear(t) for t in (99.0, 100.0, 0.3, 0.4, 0.5)] == [
        False,
        False,
        False,
        True,
        False,
    ]


def test_one_late_message_is_no_restart():
    clock = BootClock()
    times = (100.0, 99.5, 100.1, 97.0, 100.2, 97.0, 100.3)
    assert not any(clock.hear(t) for t in times)


def test_a_clock_that_was_reset_starts_anywhere():
    clock = BootClock()
    clock.hear(100.0)
    clock.reset()
    assert not any(clock.hear(t) for t in (1.0, 1.1, 1.2))


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "restarts"),
    [
        ("px4/k1_nogcs_autopilot_restart.companion.tlog", 1),
        ("px4/b1_battery_drain.companion.tlog", 0),
        ("px4/h1_msg_intervals.companion.tlog", 0),
        ("ardupilot/a1_boot.companion.tlog", 0),
        ("ardupilot/d2_gps_loss.companion.tlog", 0),
        ("ardupilot/h2_signing.companion.tlog", 1),
    ],
)
def test_recorded_clocks_go_back_only_where_the_autopilot_restarted(recording, name, restarts):
    from moar_companion.mavlink.translate import boot_time_s

    codec = Codec(system_id=9, component_id=9)
    clock = BootClock()
    seen = 0
    for _, packet in recording(name):
        for message in codec.receive(packet):
            boot_s = boot_time_s(message)
            if (message.get_srcSystem(), message.get_srcComponent()) == (1, 1) and boot_s:
                seen += clock.hear(boot_s)
    assert seen == restarts
