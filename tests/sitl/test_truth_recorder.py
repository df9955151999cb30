"""The true state from a real autopilot's simulator: read, written and forwarded."""

from __future__ import annotations

import queue
import socket

import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from sitl.demonstration.processes import free_ports
from sitl.demonstration.truth_recorder import TruePose, TruthRecorder, true_pose

ATTITUDE_RAD = (0.1, -0.2, 2.5)


def px4s_state():
    x, y, z, w = Rotation.from_euler("ZYX", ATTITUDE_RAD[::-1]).as_quat()
    return mavlink.MAVLink_hil_state_quaternion_message(
        0, (w, x, y, z), 0, 0, 0, 453781000, -719295000, 221500, *[0] * 8
    )


def ardupilots_state():
    message = mavlink.MAVLink_sim_state_message(
        *[0.0] * 4, *ATTITUDE_RAD, *[0.0] * 8, 221.5, *[0.0] * 5
    )
    message.lat_int, message.lon_int = 453781000, -719295000
    return message


@pytest.mark.parametrize("state", [px4s_state, ardupilots_state])
def test_both_simulators_report_position_and_attitude(state):
    pose = true_pose(state(), 3.5)
    assert (pose.time_s, pose.altitude_amsl_m) == (3.5, pytest.approx(221.5))
    assert (pose.latitude_deg, pose.longitude_deg) == pytest.approx((45.3781, -71.9295), abs=1e-9)
    assert pose.attitude_rad == pytest.approx(ATTITUDE_RAD)


def test_each_state_is_written_and_then_forwarded(tmp_path):
    (port,) = free_ports(1)
    poses: queue.Queue[TruePose] = queue.Queue()
    path = tmp_path / "truth.csv"
    recorder = TruthRecorder(port, path, speed=2.0, ask=False, look=poses.put)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as simulator:
        for _ in range(2):
            packet = px4s_state().pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
            simulator.sendto(packet, ("127.0.0.1", port))
        seen = [poses.get(timeout=60.0) for _ in range(2)]
    recorder.close()
    _, *rows = path.read_text().splitlines()
    assert [float(row.split(",")[0]) for row in rows] == [
        pytest.approx(pose.time_s, abs=1e-3) for pose in seen
    ]
    assert rows[0].split(",")[1:] == ["45.3781000", "-71.9295000", "221.5000", "0", "1"]


def test_an_autopilot_that_sends_on_request_alone_is_asked(tmp_path):
    (port,) = free_ports(1)
    recorder = TruthRecorder(port, tmp_path / "truth.csv", speed=1.0, ask=True)
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as simulator:
        simulator.settimeout(60.0)
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
        simulator.sendto(heartbeat.pack(codec), ("127.0.0.1", port))
        data = b"".join(simulator.recv(1024) for _ in range(2))
    recorder.close()
    asked = {each.param1: each.param2 for each in mavlink.MAVLink(None).parse_buffer(data)}
    assert asked[mavlink.MAVLINK_MSG_ID_SIM_STATE] == 20_000
    assert mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE in asked
