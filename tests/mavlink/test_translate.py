from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink import translate
from moar_companion.mavlink.codec import Codec, checksum
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.telemetry import Telemetry
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

from .messages import message_of, updated


def heartbeat(**fields):
    return {"type": 2, "autopilot": 12, "base_mode": 0, "custom_mode": 0, **fields}


def test_a_heartbeat_gives_mode_arming_and_failsafe():
    telemetry = updated(
        "HEARTBEAT", **heartbeat(base_mode=129, custom_mode=0x00060000, system_status=5)
    )
    status = telemetry.autopilot
    assert status.kind is PX4
    assert (status.mode, status.ours, status.armed, status.failsafe) == (
        "OFFBOARD",
        True,
        True,
        True,
    )
    assert status.received_s == 10.0


def test_heartbeats_give_the_start_of_the_mode_and_of_a_failsafe():
    telemetry, since = Telemetry(), []
    for now_s, mode, status in ((1, 4, 5), (2, 4, 4), (3, 4, 5), (4, 9, 5), (5, 9, 5), (6, 9, 4)):
        received = heartbeat(autopilot=3, custom_mode=mode, system_status=status)
        telemetry = updated("HEARTBEAT", telemetry, now_s=float(now_s), **received)
        autopilot = telemetry.autopilot
        since.append((autopilot.mode_since_s, autopilot.failsafe_since_s))
    assert since == [(None, None), (None, None), (None, 3.0), (4.0, 3.0), (4.0, 3.0), (4.0, None)]


def test_a_heartbeat_of_a_ground_station_is_not_an_autopilots():
    telemetry = updated("HEARTBEAT", **heartbeat(type=6, autopilot=8))
    assert telemetry.autopilot is None
    assert telemetry.ground_station.received_s == 10.0


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "kind"),
    [
        (2, 12, PX4),
        (13, 3, ARDUPILOT),
        (2, 4, UNKNOWN),
        (2, 8, None),
        (18, 12, None),
        (26, 0, None),
        (6, 3, None),
    ],
)
def test_only_an_aircrafts_heartbeat_is_an_autopilots(vehicle, autopilot, kind):
    message = message_of("HEARTBEAT", **heartbeat(type=vehicle, autopilot=autopilot))
    assert translate.autopilot_kind(message) is kind
    if kind is None:
        assert translate.update(Telemetry(), message, 1.0).autopilot is None


def test_an_unused_message_changes_nothing():
    telemetry = Telemetry()
    assert updated("HIGHRES_IMU", telemetry) is telemetry


@given(st.sampled_from(sorted(translate.MESSAGE_IDS)), st.binary(max_size=120))
def test_no_payload_raises_and_nothing_in_telemetry_is_nan(message_id, payload):
    header = bytes([len(payload), 0, 0, 5, 1, 1]) + message_id.to_bytes(3, "little")
    value = checksum(header + payload + bytes([mavlink.mavlink_map[message_id].crc_extra]))
    (message,) = Codec(system_id=9, component_id=9).receive(
        b"\xfd" + header + payload + value.to_bytes(2, "little")
    )
    telemetry = translate.update(Telemetry(), message, 1.0)
    text = str(telemetry)
    assert "nan" not in text
    assert "inf" not in text


def replay(packets, *, source=(1, 1)):
    codec = Codec(system_id=9, component_id=9, wanted=translate.MESSAGE_IDS)
    telemetry = Telemetry()
    for time_s, packet in packets:
        for message in codec.receive(packet):
            if (message.get_srcSystem(), message.get_srcComponent()) == source:
                telemetry = translate.update(telemetry, message, time_s)
                yield telemetry


@pytest.mark.recordings
def test_a_recorded_ardupilot_gives_a_wind_only_with_drag_fusion(recording):
    with_fusion = [
        t.wind for t in replay(recording("ardupilot/c3_wind_const.companion.tlog")) if t.wind
    ]
    assert max(math.hypot(*w.velocity_ned_mps) for w in with_fusion) == pytest.approx(12.6, abs=1)
    without = list(replay(recording("ardupilot/c1_wind.companion.tlog")))
    assert {t.wind for t in without} == {None}


@pytest.mark.recordings
def test_a_silent_receiver_of_px4_gives_no_values(recording):
    last = None
    silent = []
    lost = False
    for telemetry in replay(recording("px4/d3_gps_silent_v117.companion.tlog")):
        if telemetry.gnss is not last:
            last = telemetry.gnss
            if last.satellites is None:
                silent.append(last)
        if telemetry.estimator is not None and silent:
            lost |= not telemetry.estimator.horizontal_position_ok
    assert len(silent) == 14
    assert {(g.hdop, g.horizontal_accuracy_m, g.fix_type) for g in silent} == {(None, None, 0)}
    assert lost


@pytest.mark.recordings
def test_px4s_failing_battery_is_followed_to_the_emergency(recording):
    charge = []
    for telemetry in replay(recording("px4/b1_battery_drain.companion.tlog")):
        known = telemetry.batteries.get(0)
        if known is not None and known.charge_state not in charge:
            charge.append(known.charge_state)
    # SYS_STATUS, which has no charge state, is received first.
    assert charge == [None, 1, 2, 3, 4]
    assert telemetry.autopilot.failsafe
    assert telemetry.autopilot.mode == "LAND"


@pytest.mark.recordings
def test_ardupilot_without_a_monitor_has_no_battery(recording):
    for telemetry in replay(recording("ardupilot/b2_nobatt.companion.tlog")):
        assert telemetry.batteries == {}
