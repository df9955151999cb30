"""Occupancy of the plane: evidence, clearing, memory, polygons that stay the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from moar_companion.perception.occupancy import Occupancy
from moar_companion.perception.plane_rays import PlaneRays
from tests.perception.live import SITE

SENSOR = np.array([0.0, 0.0, 10.0])
RINGS = np.radians(np.arange(-15, 16, 2))
TURNS = np.radians(np.arange(0.0, 360.0, 0.2))
BEAMS = len(TURNS) * len(RINGS)


def scan(distance_of, noise_m=0.02, seed=0, sensor=SENSOR, beams=TURNS):
    """Points of a lidar that measures `distance_of(angle)` in the plane, at every y."""
    random = np.random.default_rng(seed)
    angle, ring = (each.ravel() for each in np.meshgrid(beams, RINGS))
    distance = np.asarray([distance_of(each) for each in beams] * len(RINGS), float)
    seen = np.isfinite(distance)
    angle, ring, distance = angle[seen], ring[seen], distance[seen]
    distance = distance + random.normal(0.0, noise_m, len(distance))
    return sensor + np.column_stack(
        (distance * np.cos(angle), distance * np.tan(ring), distance * np.sin(angle))
    )


def wall(at_m, far_m=np.inf, half_rad=0.2):
    """A wall at x = `at_m` ahead, and what is behind it everywhere."""

    def distance(angle):
        turned = (angle + np.pi) % (2.0 * np.pi) - np.pi
        return at_m / np.cos(turned) if abs(turned) < half_rad else far_m

    return distance


def everywhere(distance_m):
    return lambda _: distance_m


class Watch:
    def __init__(self, site=SITE):
        self.occupancy = Occupancy(site)
        self.time_s = 0.0

    def see(self, points, scans=1, solid=None, sensor=SENSOR, every_s=0.1):
        for _ in range(scans):
            self.time_s += every_s
            rays = PlaneRays.of(points, sensor, 720)
            mask = np.ones(len(points), dtype=bool) if solid is None else solid
            self.occupancy.add(rays, points, mask, self.time_s, beams=BEAMS, echoes=2)
        return self.occupancy.polygons


def covers(polygons, x, z):
    return any(shapely.Polygon(each.vertices_m).covers(shapely.Point(x, z)) for each in polygons)


def test_a_wall_is_occupied_within_half_a_second_and_covered_within_a_cell():
    watch = Watch()
    assert watch.see(scan(wall(6.0))) == ()
    (shape,) = watch.see(scan(wall(6.0)), 3)
    assert shape.name == "seen-solid-1"
    assert all(covers([shape], 6.0, z) for z in np.arange(8.9, 11.1, 0.1))
    low, high = np.min(shape.vertices_m, axis=0), np.max(shape.vertices_m, axis=0)
    assert low == pytest.approx((6.0, 8.8), abs=0.6)
    assert high == pytest.approx((6.0, 11.2), abs=0.6)


def test_an_obstacle_that_has_gone_is_cleared_within_seconds_where_something_is_behind():
    watch = Watch()
    watch.see(scan(wall(6.0, 12.0)), 10)
    assert covers(watch.occupancy.polygons, 6.0, 10.0)
    gone = watch.see(scan(everywhere(12.0)), 25)
    assert not covers(gone, 6.0, 10.0)
    assert covers(gone, 12.0, 10.0)


def test_free_space_that_is_enclosed_stays_free():
    found = Watch().see(scan(everywhere(8.0)), 10)
    assert covers(found, 8.0, 10.0)
    assert not covers(found, 0.0, 10.0)
    assert not covers(found, 5.0, 12.0)


def test_cells_without_measurements_are_not_cleared_until_they_expire():
    watch = Watch()
    watch.see(scan(wall(6.0)), 10)
    sky = np.zeros((0, 3))
    assert covers(watch.see(sky, 50, every_s=1.0), 6.0, 10.0)
    assert watch.see(sky, 12, every_s=1.0) == ()


def test_nothing_behind_a_return_is_cleared():
    watch = Watch()
    watch.see(scan(wall(12.0)), 10)
    both = watch.see(scan(wall(6.0)), 60)
    assert covers(both, 12.0, 10.0)
    assert covers(both, 6.0, 10.0)


def test_a_cell_that_some_rays_pass_and_others_hit_stays_occupied():
    watch = Watch()
    pole, behind = scan(wall(6.0, half_rad=0.003)), scan(wall(14.0))
    found = watch.see(np.concatenate((pole, behind)), 20)
    assert covers(found, 6.0, 10.0)


def test_rays_clear_only_as_far_as_they_stay_near_the_plane():
    watch = Watch()
    watch.see(scan(wall(12.0, half_rad=0.02)), 10)
    outer = scan(wall(20.0, half_rad=0.3))
    aside = outer[abs(outer[:, 1]) > 4.5]
    assert covers(watch.see(aside, 50), 12.0, 10.0)
    assert not covers(watch.see(outer, 50), 12.0, 10.0)


@pytest.mark.parametrize("resolution_m", [0.1, 0.3])
def test_rain_and_single_wrong_echoes_are_no_obstacle(resolution_m):
    workspace = replace(SITE.workspace, resolution_m=resolution_m)
    watch = Watch(replace(SITE, workspace=workspace))
    random = np.random.default_rng(3)
    sky = scan(everywhere(1.0), noise_m=0.0) - SENSOR
    for _ in range(60):
        drop = random.exponential(1.0 / 0.005, len(sky))
        some = (drop > 0.8) & (drop < 10.0)
        assert watch.see(SENSOR + sky[some] * drop[some, None]) == ()


def test_an_occasional_wrong_echo_at_one_place_is_no_obstacle():
    watch = Watch()
    wrong = scan(wall(6.0, half_rad=0.05))
    for _ in range(30):
        watch.see(wrong)
        assert watch.see(np.zeros((0, 3)), every_s=1.2) == ()


def test_points_marked_as_no_obstacle_occupy_no_cell():
    watch = Watch()
    points = scan(wall(6.0))
    assert watch.see(points, 10, solid=np.zeros(len(points), dtype=bool)) == ()


def test_points_beside_the_plane_are_no_obstacle_in_it():
    points = scan(wall(6.0)) + np.array([0.0, 6.0, 0.0])
    assert Watch().see(points, 10) == ()


def test_polygons_stay_the_same_while_nothing_changes():
    watch = Watch()
    watch.see(scan(wall(6.1)), 30)
    settled = None
    for seed in range(100):
        found = watch.see(scan(wall(6.1), noise_m=0.05, seed=seed))
        if seed == 60:
            settled = found
        if seed > 60:
            assert found == settled


def test_a_polygon_keeps_its_name_while_it_grows_and_another_gets_its_own():
    watch = Watch()
    watch.see(scan(wall(6.0, half_rad=0.1)), 10)
    watch.see(scan(wall(6.0, half_rad=0.3)), 20)
    behind = scan(lambda angle: wall(6.0, half_rad=0.3)(np.pi - angle))
    names = [each.name for each in watch.see(np.concatenate((scan(wall(6.0)), behind)), 10)]
    assert names == ["seen-solid-1", "seen-solid-2"]


def test_a_jump_of_the_estimate_moves_the_seen_obstacles_by_its_exact_step():
    watch = Watch()
    before = np.array(watch.see(scan(wall(6.0)), 10)[0].vertices_m)
    for _ in range(3):
        watch.occupancy.shift(0.47, -1.13)
    after = np.array(watch.occupancy.polygons[0].vertices_m)
    assert after == pytest.approx(before + np.array([1.41, -3.39]))
    step = np.array([1.41, 0.0, -3.39])
    watch.see(scan(wall(6.0)) + step, 20, sensor=SENSOR + step)
    assert np.array(watch.occupancy.polygons[0].vertices_m) == pytest.approx(after, abs=0.31)


def test_an_obstacle_that_a_jump_moves_out_of_the_plane_is_removed():
    watch = Watch()
    watch.see(scan(wall(6.0)), 10)
    watch.occupancy.shift(500.0, 0.0)
    assert watch.occupancy.polygons == ()


def test_cells_about_a_new_conductor_are_released():
    watch = Watch()
    watch.see(scan(wall(6.0, half_rad=0.02)), 10)
    watch.occupancy.release([(6.0, 10.0)], 0.3)
    assert watch.see(np.zeros((0, 3)), 12) == ()


def test_a_large_plane_has_larger_cells():
    workspace = replace(SITE.workspace, upper_m=(2000.0, 300.0), resolution_m=0.4)
    watch = Watch(replace(SITE, workspace=workspace))
    (shape,) = watch.see(scan(wall(6.0)), 5)
    assert covers([shape], 6.0, 10.0)
