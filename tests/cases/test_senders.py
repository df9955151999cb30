"""Packets of gimbals, of old and of narrow links, of winds, and texts with control codes."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from .flown import ARDUPILOT, AUTOPILOT, PX4, Packets, heartbeat, hover


def _of_kind(replay, kind):
    return [event.text for event in replay.events if event.kind == kind]


def test_gimbals_and_receivers_on_board_are_no_autopilots():
    def also(packets, time_s):
        packets.put(time_s, heartbeat(m.MAV_AUTOPILOT_INVALID, m.MAV_TYPE_GIMBAL), by=(1, 154))
        packets.put(time_s, heartbeat(ARDUPILOT, m.MAV_TYPE_ADSB), by=(1, 156))
        packets.put(
            time_s, heartbeat(m.MAV_AUTOPILOT_INVALID, m.MAV_TYPE_ONBOARD_CONTROLLER), by=(1, 191)
        )
        packets.put(time_s, heartbeat(ARDUPILOT, m.MAV_TYPE_GIMBAL))

    replay, _ = hover(duration_s=6.0, autopilot=ARDUPILOT, also=also).played()
    assert (replay.autopilot, replay.vehicle_type) == ("ardupilot", "quadrotor")
    assert _of_kind(replay, "autopilot") == ["ardupilot, system 1"]
    assert _of_kind(replay, "mode") == ["LOITER"]


def test_a_flight_in_mavlink_1_is_the_same():
    old, listener = hover(duration_s=6.0, autopilot=ARDUPILOT, mavlink1=True).played()
    new, _ = hover(duration_s=6.0, autopilot=ARDUPILOT).played()
    assert old.samples == new.samples
    assert listener.sources[AUTOPILOT].lost == 0


def test_a_wind_from_the_west_blows_to_the_east():
    def also(packets, time_s):
        packets.put(time_s, m.MAVLink_wind_message(-90.0, 8.0, 0.0))

    replay, listener = hover(duration_s=6.0, autopilot=ARDUPILOT, also=also).played()
    assert listener.telemetry.wind.velocity_ned_mps == pytest.approx((0.0, 8.0, 0.0), abs=1e-6)
    assert replay.measures["wind"]["wind reported"].greatest_risk == pytest.approx(5.0 / 9.0)


def test_control_codes_of_a_text_reach_no_terminal():
    def also(packets, time_s):
        text = b"\x1b[2J\x1b[31mALL OK\x1b[0m\x07"
        packets.put(time_s, m.MAVLink_statustext_message(4, text, 0, 0))

    replay, _ = hover(duration_s=2.0, also=also).played()
    (text, *_) = _of_kind(replay, "text")
    assert text.isprintable()
    assert "ALL OK" in text


def test_a_satellite_link_alone_leaves_what_it_lacks_unknown():
    packets = Packets()
    for step in range(6):
        time_s = step * 5.0
        status = m.MAVLink_high_latency2_message(
            int(time_s * 1000), 2, PX4, 0, 453781000, -719295000, 220, 230, 0, 0, 0, 50, 0, 0, 0,
            40, 8, 12, 15, 0, 0, 20, 81, 0, 0, 0, 0,
        )  # fmt: skip
        packets.put(time_s, heartbeat(), status)
    replay, listener = packets.played()
    risk = replay.samples[-1].risk
    assert (risk["wind"], risk["localization"], risk["battery"]) == (None, None, None)
    assert risk["communication"] >= 0.5
    assert listener.sources[AUTOPILOT].lost == 0
