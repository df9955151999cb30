"""The simulated lidar: its packets, and its ranges against independent geometry."""

import math
import struct
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sitl.lidar import PACKET_BYTES, PACKET_S, Box, LidarScene, Prism, SimulatedLidar, Tree, Wire
from sitl.lidar_rays import APERTURE_M, DIVERGENCE_RAD, FIRING_S, LEAST_SHARE, SEQUENCE_S

ELEVATIONS_DEG = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
CLEAR = {"noise_m": 0.0, "dropout": 0.0, "ground_m": None}
ACROSS = Rotation.from_euler("xyz", (-90.0, 4.0, 7.0), degrees=True)


def pose_at(times_s):
    """Flies at 5 m/s and turns by a radian a second."""
    places = np.array((1.0, 0.5, 12.0)) + np.outer(times_s, (3.0, 0.0, 4.0))
    turns = Rotation.from_euler("x", np.asarray(times_s)[:, None]) * ACROSS
    return places, turns.as_matrix()


def at_rest(times_s):
    return np.zeros((len(times_s), 3)), np.tile(np.eye(3), (len(times_s), 1, 1))


def ranges_of(packet):
    """(24, 16) ranges of a packet, by the manual."""
    steps = np.frombuffer(packet, np.uint8)[:1200].reshape(12, 100)[:, 4:].reshape(384, 3)
    return (steps[:, 0] + 256.0 * steps[:, 1]).reshape(24, 16) * 0.002


def rays(time_s, pose):
    """Places and directions (384, 3) of a packet's firings."""
    firings = np.arange(24)[:, None] * SEQUENCE_S + np.arange(16) * FIRING_S
    azimuth = 2.0 * math.pi * 10.0 * (time_s + firings)
    elevation = np.broadcast_to(np.radians(ELEVATIONS_DEG), azimuth.shape)
    directions = np.stack(
        (
            np.cos(elevation) * np.cos(azimuth),
            -np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ),
        axis=-1,
    )
    places, turns = pose(time_s + np.arange(24) * SEQUENCE_S)
    turned = np.einsum("nij,nlj->nli", turns, directions)
    return np.repeat(places, 16, axis=0), turned.reshape(-1, 3)


def to_wire(wire, places, directions):
    """Ranges to the straight pieces of a wire, without leaving any out."""
    nearest = np.full(len(directions), np.inf)
    ends = wire.ends()
    for start, end in pairwise(ends):
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        offset = places - start
        across = directions - (directions @ along)[:, None] * along
        beside = offset - (offset @ along)[:, None] * along
        reach = -(across * beside).sum(axis=1) / (across**2).sum(axis=1)
        miss = np.linalg.norm(beside + reach[:, None] * across, axis=1)
        place = (offset + reach[:, None] * directions) @ along
        half_beam = (APERTURE_M + DIVERGENCE_RAD * np.maximum(reach, 0.0)) / 2.0
        half = wire.diameter_m / 2.0
        met = np.minimum(miss + half, half_beam) - np.maximum(miss - half, -half_beam)
        hit = (reach > 0.0) & (place >= 0.0) & (place < length)
        hit &= met / (2.0 * half_beam) >= LEAST_SHARE
        nearest = np.where(hit, np.minimum(nearest, reach), nearest)
    return nearest


def test_a_wedge_leaves_out_no_piece_of_a_wire_that_a_ray_meets():
    wires = tuple(
        Wire(start_m=(x, -60.0, z + 3.0), end_m=(x + 9.0, 60.0, z + 3.0), sag_m=sag,
             diameter_m=diameter)
        for x, z, sag, diameter in ((-6.0, 12.0, 3.0, 0.03), (5.0, 14.0, 0.0, 0.02),
                                    (0.0, 25.0, 5.0, 0.3))
    )  # fmt: skip
    lidar, met = SimulatedLidar(LidarScene(wires=wires, **CLEAR)), 0
    times_s = np.arange(150) * PACKET_S
    for time_s, packet in zip(times_s, lidar.packets(times_s, pose_at), strict=True):
        expected = np.min([to_wire(wire, *rays(time_s, pose_at)) for wire in wires], axis=0)
        expected[~((expected > 0.5) & (expected < 100.0))] = 0.0
        assert abs(ranges_of(packet).reshape(-1) - expected).max() < 0.0011
        met += np.count_nonzero(expected)
    assert met > 400


def test_packets_are_the_same_however_many_are_asked_for_at_once():
    scene = LidarScene(
        wires=(Wire(start_m=(-5.0, -60.0, 15.0), end_m=(-5.0, 60.0, 15.0)),),
        trees=(Tree(centre_m=(8.0, 0.0, 4.0), radius_m=3.0),), rain_per_m=0.01,
    )  # fmt: skip
    times_s = np.arange(75) * PACKET_S
    together = SimulatedLidar(scene, seed=3).packets(times_s, pose_at)
    alone = SimulatedLidar(scene, seed=3)
    assert [alone.packet(time_s, pose_at) for time_s in times_s] == together
    assert SimulatedLidar(scene, seed=4).packets(times_s, pose_at) != together


def test_a_packet_is_as_in_the_manual():
    scene = LidarScene(boxes=(Box(lower_m=(5.0, -9.0, -9.0), upper_m=(6.0, 9.0, 9.0)),), **CLEAR)
    packet = SimulatedLidar(scene).packet(0.5, at_rest)
    assert len(packet) == PACKET_BYTES
    blocks = [packet[start : start + 4] for start in range(0, 1200, 100)]
    assert {block[:2] for block in blocks} == {b"\xff\xee"}
    turned = [struct.unpack("<H", block[2:])[0] for block in blocks]
    assert turned[0] == 0
    assert np.diff(turned) == pytest.approx(np.full(11, 36_000 * 10 * 2 * SEQUENCE_S), abs=1.0)
    assert struct.unpack("<IBB", packet[1200:]) == (500_000, 0x37, 0x22)
    assert ranges_of(packet)[0] == pytest.approx(
        5.0 / np.cos(np.radians(ELEVATIONS_DEG)), abs=0.0011
    )


@pytest.mark.parametrize("x_m", [7.0, 9.0])
def test_a_solid_of_any_outline_is_met_at_its_face(x_m):
    """A U, open away from the sensor: its floor is met between its legs, from behind."""
    u = ((7.0, -9.0), (9.0, -9.0), (9.0, -1.0), (8.0, -1.0), (8.0, 1.0), (9.0, 1.0), (9.0, 9.0),
         (7.0, 9.0))  # fmt: skip
    scene = LidarScene(prisms=(Prism(vertices_m=u, lower_y_m=-9.0, upper_y_m=9.0),), **CLEAR)
    behind = x_m == 9.0

    def pose(times_s):
        turn = Rotation.from_euler("z", 180.0 if behind else 0.0, degrees=True).as_matrix()
        places = np.tile((20.0 if behind else 0.0, 0.0, 0.0), (len(times_s), 1))
        return places, np.tile(turn, (len(times_s), 1, 1))

    level = ranges_of(SimulatedLidar(scene).packet(0.0, pose))[0, 1]
    assert level == pytest.approx((12.0 if behind else 7.0) / math.cos(math.radians(1.0)), abs=0.01)


def test_the_end_of_a_solid_is_met_too():
    scene = LidarScene(boxes=(Box(lower_m=(-2.0, 6.0, -2.0), upper_m=(2.0, 9.0, 2.0)),), **CLEAR)

    def along(times_s):
        turn = Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
        return np.zeros((len(times_s), 3)), np.tile(turn, (len(times_s), 1, 1))

    level = ranges_of(SimulatedLidar(scene).packet(0.0, along))[0, 1]
    assert level == pytest.approx(6.0 / math.cos(math.radians(1.0)), abs=0.0011)


def test_noise_dropouts_and_rain_are_those_of_the_scene():
    wall = Box(lower_m=(12.0, -99.0, -99.0), upper_m=(13.0, 99.0, 99.0))

    def measured(**air):
        lidar = SimulatedLidar(LidarScene(boxes=(wall,), **{**CLEAR, **air}))
        return np.stack([ranges_of(packet) for packet in lidar.packets(np.zeros(60), at_rest)])

    assert measured(noise_m=0.05).std(axis=0).mean() == pytest.approx(0.05, rel=0.05)
    assert (measured(dropout=0.1) == 0.0).mean() == pytest.approx(0.1, abs=0.01)
    early = measured(rain_per_m=0.02) < 10.0
    assert early.mean() == pytest.approx(1.0 - math.exp(-0.2), abs=0.01)


def test_the_share_of_rays_that_pass_leaves_is_given_by_their_density():
    tree = Tree(centre_m=(10.0, 0.0, 0.0), radius_m=2.0, density_per_m=0.25)
    lidar = SimulatedLidar(LidarScene(trees=(tree,), **CLEAR))
    level = np.array([ranges_of(each)[0, 1] for each in lidar.packets(np.zeros(2000), at_rest)])
    assert (level == 0.0).mean() == pytest.approx(math.exp(-1.0), abs=0.04)
    assert level[level > 0.0].min() >= 8.0 - 0.01
    assert level.max() <= 12.0 + 0.01
