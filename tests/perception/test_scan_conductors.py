"""Conductors in scans of the simulated lidar: found, placed, tracked; none where none is."""

from __future__ import annotations

import numpy as np
import pytest

from sitl.lidar import Box, LidarScene, Tree, Wire
from tests.perception.live import Flight, Rig, last

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


def places(report):
    return sorted(each.position_m for each in report.conductors)


def observed(scene, at_m, seconds=0.85, **flight):
    """The last report of a flight."""
    return last(Rig(scene, Flight(at_m=at_m, **flight)), seconds)


@pytest.mark.parametrize(
    "flight",
    [{}, {"velocity_mps": (1.5, 0.0, 0.5), "tilt_rad": 0.08}],
    ids=["hovering", "flying and swaying"],
)
def test_every_conductor_within_reach_and_nothing_else(flight):
    report = observed(LidarScene(wires=LINE, trees=WOOD), (0.0, 0.0, 12.0), **flight)
    expected = [(-7.7, 19.0), (-5.8, 12.0), (5.8, 12.0), (7.7, 19.0)]
    assert len(report.conductors) == 4
    assert np.array(places(report)) == pytest.approx(np.array(expected), abs=0.05)


def test_a_turned_line_is_placed_where_it_crosses_the_plane():
    across = 100.0 * np.tan(np.radians(15.0))
    turned = Wire(start_m=(-across, -100.0, 14.0), end_m=(across, 100.0, 14.0))
    (place,) = places(observed(LidarScene(wires=(turned,)), (-6.0, 0.0, 10.0)))
    assert place == pytest.approx((0.0, 14.0), abs=0.05)


def test_the_wires_of_a_bundle_do_not_hide_each_other():
    bundle = tuple(Wire(start_m=(x, -100.0, 14.0), end_m=(x, 100.0, 14.0)) for x in (5.0, 5.4))
    found = places(observed(LidarScene(wires=bundle), (-3.0, 0.0, 9.0), tilt_rad=0.05))
    assert np.array(found) == pytest.approx(np.array([(5.0, 14.0), (5.4, 14.0)]), abs=0.05)


@pytest.mark.slow
def test_a_swaying_aircraft_sees_each_conductor_once():
    noisy = {"velocity_mps": (1.5, 0.0, 0.0), "tilt_rad": 0.08, "position_noise_m": 0.08}
    rig = Rig(LidarScene(wires=LINE), Flight(at_m=(-5.0, 0.3, 15.0), **noisy))
    assert max(len(report.conductors) for report in rig.run(3.0)) == 4


def test_a_thin_conductor_is_seen_only_near():
    thin = Wire(start_m=(0.0, -100.0, 15.0), end_m=(0.0, 100.0, 15.0), diameter_m=0.015)
    assert thin.visible_m == pytest.approx(11.1, abs=0.1)
    assert places(observed(LidarScene(wires=(thin,)), (-14.0, 0.0, 14.0))) == []
    assert len(places(observed(LidarScene(wires=(thin,)), (-8.0, 0.0, 14.0)))) == 1


def test_trees_a_tower_a_house_and_rain_are_no_conductors():
    house = Box(lower_m=(-30.0, -8.0, 0.0), upper_m=(-20.0, 8.0, 9.0))
    scene = LidarScene(trees=WOOD, wires=TOWER, boxes=(house,), rain_per_m=0.002)
    reports = list(Rig(scene, Flight(at_m=(0.0, 0.0, 8.0), tilt_rad=0.05)).run(1.5))
    assert len(reports) > 10
    assert all(each.conductors == () for each in reports)


def test_rain_hides_no_conductor():
    report = observed(LidarScene(wires=LINE, rain_per_m=0.002), (0.0, 0.0, 12.0))
    assert len(report.conductors) == 4
    assert report.solids == ()
