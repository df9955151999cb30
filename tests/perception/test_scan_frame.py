"""Points of a scan in the site's frame: interpolation and motion compensation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from moar_companion.perception.scan_frame import PoseHistory, attitude_in_site, points_in_site
from moar_companion.settings.perception_config import SensorMount

AHEAD = SensorMount(roll_pitch_yaw_deg=(0.0, 0.0, 0.0))


def history(velocity=(0.0, 0.0, 0.0), turn_rad_s=0.0, until_s=1.0):
    poses = PoseHistory()
    for time_s in np.arange(0.0, until_s + 1e-9, 0.02):
        attitude = Rotation.from_euler("z", turn_rad_s * time_s)
        poses.note_position(time_s, np.array(velocity) * time_s)
        poses.note_attitude(time_s, attitude)
    return poses


@pytest.mark.parametrize("turn_rad_s", [0.0, 1.0])
def test_a_post_stays_where_it_is_while_the_aircraft_flies_and_turns(turn_rad_s):
    poses = history((8.0, 2.0, -1.0), turn_rad_s)
    times = np.linspace(0.3, 0.4, 500)
    post = np.array([12.0, 5.0, 3.0])
    at = np.outer(times, (8.0, 2.0, -1.0))
    seen = Rotation.from_rotvec(np.outer(times, (0.0, 0.0, turn_rad_s))).inv().apply(post - at)
    placed, sensor = points_in_site(seen, times, poses, AHEAD)
    assert placed == pytest.approx(np.tile(post, (500, 1)), abs=0.01)
    assert sensor == pytest.approx(at, abs=0.01)


def test_the_default_mount_scans_the_plane_of_the_aircraft():
    poses = history()
    times = np.array([0.3, 0.35, 0.4])
    axes = np.eye(3)
    placed, _ = points_in_site(axes, times, poses, SensorMount())
    assert abs(placed[2]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert placed[:2, 1] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_sensor_sits_beside_the_position():
    mount = SensorMount(position_m=(0.5, 0.0, -0.2), roll_pitch_yaw_deg=(0.0, 0.0, 0.0))
    poses = history(turn_rad_s=np.pi / 2.0)
    _, sensor = points_in_site(np.zeros((1, 3)), np.array([1.0]), poses, mount)
    assert sensor[0] == pytest.approx([0.0, 0.5, -0.2], abs=1e-6)


def test_without_poses_of_its_time_a_scan_has_no_place():
    point = np.ones((1, 3))
    assert points_in_site(point, np.array([0.0]), PoseHistory(), AHEAD) is None
    poses = history(until_s=1.0)
    assert points_in_site(point, np.array([1.009]), poses, AHEAD) is not None
    assert points_in_site(point, np.array([1.2]), poses, AHEAD) is None
    late = history(until_s=10.0)
    assert points_in_site(point, np.array([1.0]), late, AHEAD) is None


def test_a_pose_that_is_not_newer_is_left_out():
    poses = history(until_s=0.1)
    poses.note_position(0.05, np.full(3, 99.0))
    poses.note_attitude(0.05, Rotation.from_euler("z", 2.0))
    placed, sensor = points_in_site(np.eye(3)[:1], np.array([0.1]), poses, AHEAD)
    assert sensor[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert placed[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_after_a_pose_of_the_far_future_a_new_history_begins():
    poses = history(until_s=1.0)
    poses.note_position(4_294_968.3, np.full(3, 99.0))
    poses.note_attitude(4_294_968.3, Rotation.from_euler("z", 2.0))
    for time_s in (1.02, 1.04, 1.06):
        poses.note_position(time_s, (1.0, 2.0, 3.0))
        poses.note_attitude(time_s, Rotation.identity())
    assert poses.until_s == 1.06
    position, attitude = poses.at(np.array([1.05]), late_s=0.0)
    assert position[0] == pytest.approx([1.0, 2.0, 3.0])
    assert attitude.magnitude() == pytest.approx([0.0])


def test_position_and_attitude_come_at_times_of_their_own():
    poses = PoseHistory()
    for time_s in np.arange(0.0, 1.0, 0.03):
        poses.note_position(time_s, (4.0 * time_s, 0.0, 0.0))
    for time_s in np.arange(0.01, 0.9, 0.047):
        poses.note_attitude(time_s, Rotation.from_euler("z", time_s))
    times = np.linspace(0.4, 0.5, 20)
    position, attitude = poses.at(times, late_s=0.0)
    assert position[:, 0] == pytest.approx(4.0 * times)
    assert attitude.as_rotvec()[:, 2] == pytest.approx(times)
    assert poses.until_s == pytest.approx(0.01 + 0.047 * 18)


def test_poses_reach_no_farther_than_the_shorter_of_both():
    poses = PoseHistory()
    assert poses.until_s == -np.inf
    for time_s in (0.0, 0.1, 0.2):
        poses.note_position(time_s, (0.0, 0.0, 0.0))
        poses.note_attitude(time_s / 2.0, Rotation.identity())
    assert poses.until_s == pytest.approx(0.1)
    assert poses.at(np.array([0.05]), late_s=0.0) is not None
    assert poses.at(np.array([0.15]), late_s=0.0) is None


def test_over_a_long_gap_nothing_is_interpolated():
    poses = PoseHistory()
    for time_s in (0.0, 0.1, 0.9, 1.0):
        poses.note_position(time_s, (0.0, 0.0, 0.0))
        poses.note_attitude(time_s, Rotation.identity())
    assert poses.at(np.array([0.5]), late_s=0.0) is None
    assert poses.at(np.array([0.95]), late_s=0.0) is not None


def test_a_jump_of_the_estimate_moves_all_positions():
    poses = history()
    poses.shift((1.0, -2.0, 3.0))
    position, _ = poses.at(np.array([0.5]), late_s=0.0)
    assert position[0] == pytest.approx([1.0, -2.0, 3.0])


@pytest.mark.parametrize(
    ("angles_deg", "axis", "expected"),
    [
        ((0.0, 0.0, 70.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, 100.0), (1.0, 0.0, 0.0), (np.cos(np.pi / 6), -0.5, 0.0)),
        ((0.0, 10.0, 70.0), (1.0, 0.0, 0.0), (np.cos(np.pi / 18), 0.0, np.sin(np.pi / 18))),
        ((10.0, 0.0, 70.0), (0.0, 1.0, 0.0), (0.0, np.cos(np.pi / 18), np.sin(np.pi / 18))),
    ],
    ids=["along the plane", "nose to the right", "nose up", "right side down"],
)
def test_angles_of_the_body_to_a_rotation_into_the_site(angles_deg, axis, expected):
    attitude = attitude_in_site(*np.radians(angles_deg), azimuth_deg=70.0)
    assert attitude.apply(axis) == pytest.approx(expected)
