"""Conductors from scan to scan: confirmed, named, kept, dropped."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.perception.conductor_tracks import ConductorTracks
from moar_companion.perception.plane_rays import PlaneRays
from moar_companion.perception.scan_conductors import ConductorSighting

SENSOR = np.array([0.0, 0.0, 10.0])


def sighting(x, z, slope=0.0):
    way = np.array([slope, 1.0, 0.0]) / np.hypot(1.0, slope)
    return ConductorSighting(
        point_m=np.array([x, 0.0, z]), direction=way, rings=12, range_m=np.hypot(x, z - 10.0)
    )


def rays_to(*places, rings=(), beside_m=0.0, turned_deg=(-8.0, 8.0, 0.2), sensor_m=SENSOR):
    """A scan that measured these places (x, z), and by `rings` a wall behind (5, 12).

    beside_m: distance of the wall's echoes from the plane, beyond those of the sensor's fan.
    turned_deg: first, last and step of the directions of its beams, from that of (5, 12).
    """
    way_rad = np.arctan2(2.0, 5.0) + np.radians(np.arange(*turned_deg))
    way_rad, ring = (each.ravel() for each in np.meshgrid(way_rad, np.array(rings, int)))
    aside_m = 10.0 * np.tan(np.radians(2.0 * ring - 15.0)) + beside_m
    wall = np.column_stack((10.0 * np.cos(way_rad), aside_m, 10.0 + 10.0 * np.sin(way_rad)))
    points = np.array([(x, 0.0, z) for x, z in places]).reshape(-1, 3)
    rays = PlaneRays.of(np.concatenate((points, wall)), sensor_m, 720)
    return rays, np.concatenate((np.zeros(len(points), int), ring))


NOTHING = rays_to()
RINGS = range(16)


def confirmed(*seen):
    tracks = ConductorTracks()
    for number in range(5):
        tracks.step(seen, 0.1 * number, *NOTHING)
    return tracks


def test_a_conductor_is_confirmed_by_five_sightings():
    tracks = ConductorTracks()
    for number in range(4):
        tracks.step([sighting(5.0, 12.0)], 0.1 * number, *NOTHING)
        assert tracks.conductors == ()
    tracks.step([sighting(5.1, 12.0)], 0.4, *NOTHING)
    (conductor,) = tracks.conductors
    assert conductor.name == "seen-1"
    assert conductor.sightings == 5
    assert conductor.seen_s == 0.4
    assert 5.0 < conductor.position_m[0] < 5.1
    assert conductor.deviation_m < 0.05


def test_a_name_stays_with_its_conductor():
    tracks = confirmed(sighting(5.0, 12.0), sighting(-5.0, 12.0))
    for number in range(5, 12):
        seen = [sighting(-5.0, 12.0), sighting(8.0, 9.0), sighting(5.0, 12.0)]
        tracks.step(seen, 0.1 * number, *NOTHING)
    found = [(each.name, round(each.position_m[0])) for each in tracks.conductors]
    assert found == [("seen-1", 5), ("seen-2", -5), ("seen-3", 8)]


def test_a_wire_that_is_seen_again_beside_its_place_takes_its_name_again():
    """Its estimate had drifted by 1.5 m in a gap, in which nothing showed that."""
    tracks = confirmed(sighting(5.0, 12.0), sighting(-5.0, 12.0), sighting(9.0, 12.0))
    for number in range(50, 56):
        tracks.step([sighting(6.5, 12.0), sighting(0.0, 12.0)], 0.1 * number, *NOTHING)
    tracks.shift((-1.5, 0.0, 0.0), after_s=0.4)
    tracks.join(until_s=0.4)
    found = [(each.name, round(each.position_m[0], 1)) for each in tracks.conductors]
    assert found == [("seen-1", 5.0), ("seen-2", -5.0), ("seen-3", 9.0), ("seen-5", -1.5)]
    assert tracks.conductors[0].seen_s == 5.5
    assert tracks.conductors[0].sightings == 11


def test_two_wires_that_were_both_seen_before_a_gap_stay_two():
    tracks = confirmed(sighting(5.0, 12.0), sighting(5.4, 12.0))
    tracks.join(until_s=0.4)
    assert len(tracks.conductors) == 2
    tracks.join(until_s=0.0)
    assert len(tracks.conductors) == 2


def test_a_wire_that_was_not_confirmed_before_a_gap_keeps_its_name_after_it():
    tracks = ConductorTracks()
    tracks.step([sighting(5.0, 12.0)], 0.0, *NOTHING)
    for number in range(1, 6):
        tracks.step([sighting(5.8, 12.0)], 0.1 * number, *NOTHING)
    tracks.shift((-0.8, 0.0, 0.0), after_s=0.0)
    tracks.join(until_s=0.0)
    (conductor,) = tracks.conductors
    assert conductor.name == "seen-1"


def test_too_few_sightings_before_and_after_a_gap_are_not_joined_to_enough():
    tracks, wires = ConductorTracks(), (5.0, -5.0)
    for number in range(3):
        tracks.step([sighting(x, 12.0) for x in wires], 0.1 * number, *NOTHING)
    for number in range(3, 6):
        tracks.step([sighting(x + 0.7, 12.0) for x in wires], 0.1 * number, *NOTHING)
    tracks.shift((-0.7, 0.0, 0.0), after_s=0.25)
    tracks.join(until_s=0.25)
    assert tracks.conductors == ()
    for number in range(6, 10):
        tracks.step([sighting(x, 12.0) for x in wires], 0.1 * number, *NOTHING)
    assert [each.name for each in tracks.conductors] == ["seen-1", "seen-2"]


def test_one_sighting_after_a_gap_moves_a_wire_as_little_as_one_before():
    tracks = confirmed(sighting(5.0, 12.0))
    tracks.step([sighting(5.6, 12.0)], 5.0, *NOTHING)
    tracks.shift((-0.2, 0.0, 0.0), after_s=0.4)
    tracks.join(until_s=0.4)
    (conductor,) = tracks.conductors
    assert conductor.name == "seen-1"
    assert 5.05 < conductor.position_m[0] < 5.2
    assert conductor.deviation_m < 0.05


def test_sightings_at_another_place_are_another_conductor():
    assert len(confirmed(sighting(5.0, 12.0), sighting(5.8, 12.0)).conductors) == 2


def test_two_sightings_of_one_wire_in_a_scan_are_one_conductor():
    assert len(confirmed(sighting(5.0, 12.0), sighting(5.2, 12.0)).conductors) == 1


def test_the_wires_of_a_bundle_are_two():
    assert len(confirmed(sighting(5.0, 12.0), sighting(5.4, 12.0)).conductors) == 2


def test_a_single_sighting_is_dropped():
    tracks = ConductorTracks()
    tracks.step([sighting(5.0, 12.0)], 0.0, *NOTHING)
    for number in range(4):
        tracks.step([sighting(5.0, 12.0)], 2.0 + 0.1 * number, *NOTHING)
    assert tracks.conductors == ()


def test_a_conductor_in_view_that_is_not_seen_is_dropped_within_seconds():
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 24):
        tracks.step([], 0.1 * number, *rays_to(rings=RINGS))
        assert len(tracks.conductors) == 1
    tracks.step([], 2.5, *rays_to(rings=RINGS))
    assert tracks.conductors == ()


def test_beams_farther_apart_than_directions_show_that_a_conductor_is_gone():
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 25):
        tracks.step([], 0.1 * number, *rays_to(rings=RINGS, turned_deg=(-8.0, 8.0, 0.7)))
    assert tracks.conductors == ()


@pytest.mark.parametrize(
    "scan",
    [
        NOTHING,
        rays_to(rings=RINGS, turned_deg=(0.5, 8.0, 0.2)),
        rays_to(rings=RINGS, turned_deg=(-8.0, -0.5, 0.2)),
        rays_to(rings=RINGS[:5]),
        rays_to(rings=RINGS, beside_m=8.0),
    ],
    ids=[
        "sky, or a covered window",
        "a window covered below",
        "a window covered above",
        "beams of fewer rings than a sighting has",
        "beams beside the plane of an aircraft that is turned",
    ],
)
def test_a_conductor_beyond_which_the_scan_does_not_measure_is_kept(scan):
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 200):
        tracks.step([], 0.1 * number, *scan)
    assert len(tracks.conductors) == 1


@pytest.mark.parametrize("place", [(2.5, 11.0), (5.0, 12.0), (0.5, 10.2)], ids=[
    "hidden", "something is there", "the sensor is covered"])  # fmt: skip
def test_a_hidden_conductor_is_kept(place):
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 200):
        tracks.step([], 0.1 * number, *rays_to(place, rings=RINGS))
    assert len(tracks.conductors) == 1


def test_a_conductor_farther_away_than_it_was_ever_seen_is_kept():
    tracks = confirmed(sighting(5.0, 12.0))
    away = rays_to(rings=RINGS, sensor_m=np.array([-2.0, 0.0, 10.0]))
    for number in range(5, 200):
        tracks.step([], 0.1 * number, *away)
    assert len(tracks.conductors) == 1


def test_a_wire_beside_its_old_place_replaces_it_after_an_estimate_has_wandered():
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 35):
        tracks.step([sighting(5.0, 12.8)], 0.1 * number, *rays_to((5.0, 12.8)))
    assert [each.name for each in tracks.conductors] == ["seen-2"]


def test_a_hidden_wire_farther_from_one_that_is_seen_is_kept():
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 35):
        in_front = [(4.0, 11.6 + off_m) for off_m in np.arange(-0.4, 0.4, 0.02)]
        tracks.step(
            [sighting(5.0, 13.5)], 0.1 * number, *rays_to((5.0, 13.5), *in_front, rings=RINGS)
        )
    assert [each.name for each in tracks.conductors] == ["seen-1", "seen-2"]


def test_one_sighting_ends_a_row_of_missed_ones():
    tracks = confirmed(sighting(5.0, 12.0))
    for number in range(5, 60):
        seen = [sighting(5.0, 12.0)] if number % 15 == 0 else []
        tracks.step(seen, 0.1 * number, *rays_to(rings=RINGS))
    assert len(tracks.conductors) == 1


def test_points_on_a_confirmed_conductor_are_its_own():
    tracks = confirmed(sighting(5.0, 12.0, slope=0.2))
    points = np.array([(5.0, 0.0, 12.1), (5.4, 2.0, 12.0), (5.0, 2.0, 12.0), (5.0, 0.0, 13.0)])
    assert tracks.own(points, 9.0).tolist() == [True, True, False, False]


def test_points_of_a_sighting_are_its_own_in_its_scan():
    tracks = ConductorTracks()
    tracks.step([sighting(5.0, 12.0)], 0.1, *NOTHING)
    points = np.array([(5.0, 0.0, 12.0)])
    assert tracks.own(points, 0.1).tolist() == [True]
    tracks.step([], 0.2, *NOTHING)
    assert tracks.own(points, 0.2).tolist() == [False]


def test_a_jump_of_the_estimate_moves_the_conductors():
    tracks = confirmed(sighting(5.0, 12.0, slope=0.2))
    tracks.shift((1.0, 5.0, -2.0))
    assert tracks.conductors[0].position_m == pytest.approx((5.0, 10.0))
