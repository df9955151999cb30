"""Position of the aircraft on its site."""

from __future__ import annotations

import pytest

from moar_companion.companion.estimation.pose_tracker import PoseTracker
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.telemetry import LocalPosition, Telemetry
from moar_companion.mavlink.translate import update
from tests.mavlink.conftest import SHARED, packets

ATTITUDE = int(mavlink.MAVLINK_MSG_ID_ATTITUDE)


def recorded_resets_rad(path):
    """Heading resets detected in an autopilot's recording."""
    codec = Codec(system_id=9, component_id=9, wanted={ATTITUDE})
    pose_tracker, telemetry, resets_rad = PoseTracker(None, None), Telemetry(), []
    for now_s, packet in packets(path):
        for message in codec.receive(packet):
            if message.get_srcComponent() == 1:
                telemetry = update(telemetry, message, now_s)
                jump = pose_tracker.update(telemetry)
                resets_rad += [] if jump is None else [jump.turn_rad]
    return resets_rad


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "resets_rad"),
    [
        ("px4/d1_gps_degradation", [0.427]),  # when the receiver returned
        ("px4/e1_pilot_override", []),
        ("px4/c1_wind_v118", []),
        ("ardupilot/a2_square", []),  # turning
        ("ardupilot/c3_wind_const", []),  # leaning by up to 30 degrees, and turning
    ],
)
def test_heading_resets_in_recordings_are_detected_and_turns_are_none(name, resets_rad):
    path = SHARED / "traces" / f"{name}.companion.tlog"
    if not path.exists():
        pytest.skip(f"the recording {path} is not here")
    assert recorded_resets_rad(path) == pytest.approx(resets_rad, abs=1e-3)


def telemetry_at(received_s, boot_s):
    return Telemetry(
        local_position=LocalPosition(
            received_s=received_s,
            boot_s=boot_s,
            position_ned_m=(0.0, 0.0, 0.0),
            velocity_ned_mps=(0.0, 0.0, 0.0),
        )
    )


def test_times_follow_a_drifting_autopilot_clock_for_hours_without_the_link_delay():
    tracker = PoseTracker(None, None)
    for number in range(7_200):
        late_s = 0.15 if number % 3 else 0.004
        tracker.update(telemetry_at(100.0 + number + late_s, number * (1.0 - 50e-6)))
        if number:
            received_s = tracker.received_s(number * (1.0 - 50e-6))
            assert received_s == pytest.approx(100.0 + number, abs=0.01)


def test_times_restart_with_a_restarted_autopilot():
    tracker = PoseTracker(None, None)
    assert tracker.received_s(1.0) is None
    tracker.update(telemetry_at(100.0, 50.0))
    assert tracker.received_s(51.0) == 101.0
    tracker.update(telemetry_at(120.0, 2.0))
    assert tracker.received_s(3.0) == 121.0
