"""Conductors in scans of the simulated lidar: found, placed, tracked; none where none is."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.perception.scan_conductors import ConductorSighting, ConductorTracks
from sitl.lidar import Box, LidarScene, Tree, Wire
from tests.perception.live import watch

pytest.importorskip("velodyne_decoder")

LINE = tuple(
    Wire(start_m=(x, -150.0, z + 8.0), end_m=(x, 150.0, z + 8.0), sag_m=8.0)
    for x, z in ((-5.8, 12.0), (5.8, 12.0), (-7.7, 19.0), (7.7, 19.0))
)
WOOD = tuple(
    Tree(centre_m=(x, y, z), radius_m=radius)
    for x, y, z, radius in ((-14, 0, 5, 4.0), (13, 2, 6, 4.5), (16, -6, 4, 3.0), (-15, 6, 7, 5.0))
)
TOWER = tuple(
    Wire(start_m=(a, 4.0, 0.0), end_m=(b, 4.0, 30.0), diameter_m=0.12)
    for a, b in ((18.0, 20.0), (24.0, 22.0), (18.0, 22.0), (24.0, 20.0))
) + tuple(
    Wire(start_m=(18.0, 4.0, float(z)), end_m=(24.0, 4.0, float(z)), diameter_m=0.1)
    for z in range(4, 30, 4)
)


def sighting(x, z, y=0.0):
    return ConductorSighting(
        point_m=np.array([x, y, z]), direction=np.array([0.0, 1.0, 0.0]), rings=12, range_m=8.0
    )


@pytest.mark.parametrize(
    "flight",
    [{}, {"velocity_mps": (1.5, 0.0, 0.5), "tilt_rad": 0.08}],
    ids=["hovering", "flying and swaying"],
)
def test_every_conductor_within_reach_and_nothing_else(flight):
    *_, last = watch(LidarScene(wires=LINE, trees=WOOD), (0.0, 0.0, 12.0), 0.8, **flight)
    found = sorted((round(each.x_m, 1), round(each.z_m, 1)) for each in last.tracks)
    assert found == [(-7.7, 19.0), (-5.8, 12.0), (5.8, 12.0), (7.7, 19.0)]
    for track in last.tracks:
        error = min(np.hypot(track.x_m - x, track.z_m - z) for x, z in
                    ((-5.8, 12.0), (5.8, 12.0), (-7.7, 19.0), (7.7, 19.0)))  # fmt: skip
        assert error < 0.05


def test_a_turned_line_is_placed_where_it_crosses_the_plane():
    turned = Wire(start_m=(-20.0, -100.0, 14.0), end_m=(20.0, 100.0, 14.0))
    *_, last = watch(LidarScene(wires=(turned,)), (-6.0, 0.0, 10.0), 0.8)
    (track,) = last.tracks
    assert (track.x_m, track.z_m) == pytest.approx((0.0, 14.0), abs=0.05)


def test_a_thin_conductor_is_seen_only_near():
    thin = Wire(start_m=(0.0, -100.0, 15.0), end_m=(0.0, 100.0, 15.0), diameter_m=0.015)
    assert thin.visible_m == pytest.approx(11.1, abs=0.1)
    *_, far = watch(LidarScene(wires=(thin,)), (-14.0, 0.0, 14.0), 0.8)
    assert far.tracks == ()
    *_, near = watch(LidarScene(wires=(thin,)), (-8.0, 0.0, 14.0), 0.8)
    assert len(near.tracks) == 1


def test_trees_a_tower_a_house_and_rain_are_no_conductors():
    house = Box(lower_m=(-30.0, -8.0, 0.0), upper_m=(-20.0, 8.0, 9.0))
    scene = LidarScene(trees=WOOD, wires=TOWER, boxes=(house,), rain_per_m=0.002)
    seen = list(watch(scene, (0.0, 0.0, 8.0), 1.5, tilt_rad=0.05))
    assert len(seen) > 10
    assert all(each.tracks == () for each in seen)


def test_rain_hides_no_conductor():
    scene = LidarScene(wires=LINE, rain_per_m=0.002)
    *_, last = watch(scene, (0.0, 0.0, 12.0), 0.8)
    assert len(last.tracks) == 4


def test_a_conductor_is_confirmed_by_five_sightings_and_remembered():
    tracks = ConductorTracks()
    for number in range(4):
        assert tracks.step([sighting(5.0, 12.0)], 0.1 * number) == ()
    (track,) = tracks.step([sighting(5.1, 12.0)], 0.4)
    assert track.sightings == 5
    assert 5.0 < track.x_m < 5.1
    assert tracks.step([], 20.0) == (track,)
    assert tracks.step([], 40.0) == ()


def test_sightings_at_another_place_are_another_conductor():
    tracks = ConductorTracks()
    for number in range(5):
        confirmed = tracks.step([sighting(5.0, 12.0), sighting(5.8, 12.0)], 0.1 * number)
    assert len(confirmed) == 2


def test_a_single_sighting_is_forgotten():
    tracks = ConductorTracks()
    tracks.step([sighting(5.0, 12.0)], 0.0)
    for number in range(4):
        assert tracks.step([sighting(5.0, 12.0)], 2.0 + 0.1 * number) == ()
