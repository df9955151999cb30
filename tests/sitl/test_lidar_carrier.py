"""The lidar on the aircraft: its packets come when they are complete, with the true pose."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sitl.autopilot import FakeAutopilot, Options
from sitl.geodesy import Geodetic, TrueFrame
from sitl.lidar import PACKET_S, Box, LidarScene
from sitl.lidar_carrier import LidarCarrier
from sitl.lidar_scene import LidarMount, PlacedScene
from tests.sitl.test_lidar import ELEVATIONS_DEG, ranges_of

ORIGIN = Geodetic(latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0)
AZIMUTH_DEG = 60.0
WALL = Box(lower_m=(20.0, -400.0, -400.0), upper_m=(21.0, 400.0, 400.0))
"""20 m ahead along the plane."""
TRUTH = FakeAutopilot(Options(latitude_deg=ORIGIN.latitude_deg)).truth


def carrier(*boxes, **mount):
    scene = LidarScene(boxes=boxes, ground_m=None, noise_m=0.0, dropout=0.0)
    return LidarCarrier(
        PlacedScene(
            name="wall",
            origin=ORIGIN,
            azimuth_deg=AZIMUTH_DEG,
            scene=scene,
            mount=LidarMount(**mount),
        )
    )


def truth(time_s, ahead_m=0.0, up_m=10.0, roll=0.0, pitch=0.0, yaw_deg=AZIMUTH_DEG):
    azimuth = math.radians(AZIMUTH_DEG)
    place = TrueFrame(ORIGIN).geodetic(
        ahead_m * math.cos(azimuth), ahead_m * math.sin(azimuth), -up_m
    )
    return replace(
        TRUTH,
        time_s=time_s,
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        altitude_amsl_m=place.altitude_amsl_m,
        attitude_rad=(roll, pitch, math.radians(yaw_deg)),
    )


def measured(lidar, state, seconds=0.1):
    """(m, 24, 16) ranges and (m, 24) azimuths in degrees, of packets at rest in a state."""
    packets = [lidar.step(state(n * 0.01)) for n in range(round(seconds / 0.01) + 1)]
    found = [each for step in packets for each in step]
    ranges = np.array([ranges_of(packet) for _, packet in found])
    begins = np.array([int(time_s / PACKET_S + 0.5) - 1 for time_s, _ in found]) * PACKET_S
    sequences = begins[:, None] + np.arange(24) * 55.296e-6
    return ranges, np.degrees(2 * math.pi * 10.0 * sequences) % 360.0


def test_each_packet_is_sent_with_the_first_truth_after_its_end():
    lidar, ends = carrier(WALL), []
    for tick in range(101):
        now_s = tick * 0.01
        due = [time_s for time_s, _ in lidar.step(truth(now_s))]
        assert all(now_s - 0.01 - 1e-9 < time_s <= now_s + 1e-9 for time_s in due)
        ends += due
    assert ends == pytest.approx(PACKET_S * np.arange(1, len(ends) + 1))
    assert len(ends) == math.floor(1.0 / PACKET_S)


def test_a_lidar_that_starts_later_does_not_send_past_packets():
    lidar = carrier(WALL)
    assert lidar.step(truth(100.0)) == []
    ((first_s, _), *_) = lidar.step(truth(100.01))
    assert 100.0 < first_s <= 100.01


def test_the_scan_stands_in_the_plane_and_begins_ahead():
    ranges, azimuths = measured(carrier(WALL), truth)
    level = ranges[:, :, 1] * math.cos(math.radians(ELEVATIONS_DEG[1]))
    ahead = abs((azimuths + 180.0) % 360.0 - 180.0) < 60.0
    expected = 20.0 / np.cos(np.radians(azimuths))
    assert level[ahead] == pytest.approx(expected[ahead], rel=5e-4)
    assert (level[~ahead & (abs(azimuths - 180.0) < 60.0)] == 0.0).all()


def test_a_lidar_that_sits_elsewhere_measures_from_there():
    ranges, _ = measured(carrier(WALL, position_m=(1.5, 0.0, 0.0)), truth, 0.01)
    assert ranges[0, 0, 1] * math.cos(math.radians(1.0)) == pytest.approx(18.5, abs=0.01)


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_the_rays_turn_with_the_aircraft(axis):
    """Against rotations made by SciPy, one range at a time."""
    turned = {"roll": 0.2, "pitch": -0.3, "yaw": 0.25}[axis]

    def state(time_s):
        if axis == "yaw":
            return truth(time_s, yaw_deg=AZIMUTH_DEG + math.degrees(turned))
        return truth(time_s, **{axis: turned})

    ranges, azimuths = measured(carrier(WALL), state, 0.02)
    # Forward, right, down to forward, left, up of the plane, in which a yaw turns to the right.
    angles = {"roll": (turned, 0, 0), "pitch": (0, turned, 0), "yaw": (0, 0, turned)}[axis]
    to_plane = np.diag([1.0, -1.0, -1.0]) @ Rotation.from_euler("xyz", angles).as_matrix()
    mount = Rotation.from_euler("x", -90.0, degrees=True).as_matrix()
    for packet, sequence, laser in ((0, 0, 0), (2, 7, 15), (8, 20, 6)):
        azimuth = math.radians(azimuths[packet, sequence]) + 2 * math.pi * 10 * laser * 2.304e-6
        up = math.radians(ELEVATIONS_DEG[laser])
        direction = np.array(
            [math.cos(up) * math.cos(azimuth), -math.cos(up) * math.sin(azimuth), math.sin(up)]
        )
        turned_direction = to_plane @ np.diag([1.0, -1.0, -1.0]) @ mount @ direction
        assert ranges[packet, sequence, laser] == pytest.approx(
            20.0 / turned_direction[0], abs=0.01
        )


def test_the_pose_is_that_of_the_firing_between_two_truths():
    lidar = carrier(WALL)
    lidar.step(truth(0.0))
    packets = lidar.step(truth(0.02, ahead_m=2.0, yaw_deg=AZIMUTH_DEG - 360.0))
    ranges = np.array([ranges_of(packet) for _, packet in packets])[:, :, 1]
    sequences = np.arange(len(packets))[:, None] * PACKET_S + np.arange(24) * 55.296e-6
    ahead_m = ranges * math.cos(math.radians(1.0)) * np.cos(2 * math.pi * 10.0 * sequences)
    assert ahead_m == pytest.approx(20.0 - 100.0 * sequences, abs=0.01)


def test_the_same_truths_give_the_same_packets():
    def flown():
        lidar = LidarCarrier(
            PlacedScene(
                name="wall",
                origin=ORIGIN,
                azimuth_deg=0.0,
                scene=LidarScene(boxes=(WALL,), rain_per_m=0.01),
            ),
            seed=5,
        )
        return [lidar.step(truth(n * 0.02)) for n in range(20)]

    assert flown() == flown()


def test_another_scene_and_mount_are_shown_from_the_next_packet_on():
    lidar = carrier(WALL)
    before, _ = measured(lidar, truth)
    empty = PlacedScene(
        name="empty",
        origin=ORIGIN,
        azimuth_deg=AZIMUTH_DEG,
        scene=LidarScene(ground_m=None, noise_m=0.0, dropout=0.0),
    )
    lidar.show(empty)
    after, _ = measured(lidar, lambda time_s: truth(0.1 + time_s))
    assert before.any()
    assert not after.any()
