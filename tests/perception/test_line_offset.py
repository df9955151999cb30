"""The offset between estimate and line, from sightings of wires whose places are known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.perception.line_offset import LineTracker
from moar_companion.perception.scan_conductors import ConductorSighting

SCAN_S = 0.1
STILL = (0.0, 0.0, 0.0)
CIRCUITS = ((-5.8, 12.0), (-7.7, 17.0), (-5.8, 22.0), (5.8, 12.0), (7.7, 17.0), (5.8, 22.0))
PLACE = np.array([0.0, 0.0, 12.0])


def sighting(place_m, sensor_m):
    """A wire straight across the plane."""
    x, z = place_m
    return ConductorSighting(
        point_m=np.array([x, sensor_m[1], z]),
        direction=np.array([0.0, 1.0, 0.0]),
        rings=12,
        range_m=math.hypot(x - sensor_m[0], z - sensor_m[2]),
    )


class Scans:
    """Scans of an aircraft at a true place, whose estimate is off, and whose attitude errs."""

    def __init__(self, wires=CIRCUITS, known=None, seed=0, noise_m=0.04):
        self.wires = [np.array(wire) for wire in wires]
        self.tracker = LineTracker(wires if known is None else known)
        self.random = np.random.default_rng(seed)
        self.noise_m = noise_m
        self.time_s = 0.0
        self.off = np.zeros(2)
        """Estimate less true place."""
        self.turn_rad = 0.0
        self.ghosts_m = []

    def scan(self, visible=None, place=PLACE):
        self.time_s += SCAN_S
        estimate = place + np.array([self.off[0], 0.0, self.off[1]])
        turn = np.array(
            [
                [math.cos(self.turn_rad), -math.sin(self.turn_rad)],
                [math.sin(self.turn_rad), math.cos(self.turn_rad)],
            ]
        )
        wires = self.wires if visible is None else [self.wires[index] for index in visible]
        places = [turn @ (wire - place[[0, 2]]) for wire in (*wires, *map(np.array, self.ghosts_m))]
        found = [
            sighting(estimate[[0, 2]] + each + self.random.normal(0.0, self.noise_m, 2), estimate)
            for each in places
        ]
        self.tracker.step(found, estimate, self.time_s)
        return self

    def seen(self):
        """Scans enough for an offset that was not known."""
        for _ in range(5):
            self.scan()
        return self

    def error_m(self):
        return math.dist(self.tracker.offset_m, -self.off)


def test_before_any_scan_nothing_is_known():
    tracker = LineTracker(CIRCUITS)
    assert not tracker.is_known
    assert tracker.offset_m == (0.0, 0.0)


def test_five_scans_of_the_whole_pattern_give_the_offset():
    scans = Scans(noise_m=0.0)
    scans.off = np.array([1.4, -0.8])
    for _ in range(4):
        assert not scans.scan().tracker.is_known
    report = scans.scan().tracker.report(scans.time_s, STILL)
    assert report.wires == 6
    assert report.offset_m == pytest.approx((-1.4, 0.8), abs=0.05)
    assert report.covariance_m2[0] < 0.1**2
    assert report.contradicted_s is None


def test_an_error_of_the_attitude_is_no_offset():
    """Half a degree moves a wire 12 m away by a decimetre, and all of them about the sensor."""
    scans = Scans(noise_m=0.0)
    scans.turn_rad = math.radians(0.5)
    for _ in range(10):
        scans.scan()
    assert scans.error_m() < 0.03


def test_what_is_seen_is_placed_without_the_attitudes_error():
    scans = Scans(noise_m=0.0)
    scans.turn_rad, scans.off = math.radians(2.0), np.array([0.5, -0.3])
    for _ in range(20):
        scans.scan()
    assert scans.error_m() < 0.1
    cos, sin = math.cos(scans.turn_rad), math.sin(scans.turn_rad)
    estimate = PLACE + np.array([0.5, 0.0, -0.3])
    for wire in scans.wires:
        x, z = wire - PLACE[[0, 2]]
        seen = estimate + np.array([cos * x - sin * z, 0.0, sin * x + cos * z])
        (place,) = scans.tracker.placed(seen[None], estimate)
        assert math.dist(place[[0, 2]], wire) < 0.12


@pytest.mark.parametrize("direction_deg", [0, 90, 180, 270, 45])
def test_a_drift_is_followed_in_every_direction(direction_deg):
    scans, errors = Scans(), []
    step = (
        0.3
        * SCAN_S
        * np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))])
    )
    for _ in range(150):  # 4.5 m
        scans.off = scans.off + step
        errors.append(scans.scan().error_m())
    assert np.hypot(*scans.off) == pytest.approx(4.5)
    errors = errors[5:]
    assert np.percentile(errors, 95) < 0.15
    assert max(errors) < 0.3


def test_ghosts_and_wires_that_the_site_lacks_move_nothing():
    scans = Scans()
    scans.ghosts_m = [(-2.0, 15.0), (3.0, 19.0), (9.5, 24.0)]
    errors = [scans.seen().error_m() for _ in range(10)]
    assert max(errors) < 0.2
    assert scans.tracker.report(scans.time_s, STILL).wires == 6


def test_one_wire_that_hangs_elsewhere_is_no_drift_of_all():
    moved = [CIRCUITS[0], *CIRCUITS[1:]]
    moved[2] = (moved[2][0] + 1.5, moved[2][1] - 1.0)
    scans = Scans(wires=moved, known=CIRCUITS)
    errors = [scans.scan().error_m() for _ in range(50)]
    assert max(errors) < 0.2
    assert scans.tracker.report(scans.time_s, STILL).wires == 5


def test_a_jump_of_the_estimate_is_taken_at_once():
    scans = Scans(noise_m=0.0).seen()
    scans.off = np.array([-1.9, 0.7])
    scans.tracker.shift((-1.9, 0.0, 0.7))
    assert scans.error_m() < 0.05
    assert scans.scan().error_m() < 0.05


def test_wires_in_a_row_at_equal_distances_decide_nothing_at_first():
    """Two of three that hang 3 m apart: which two they are, no scan shows."""
    row = ((-3.0, 18.0), (0.0, 18.0), (3.0, 18.0))
    scans = Scans(wires=row, noise_m=0.0)
    for _ in range(20):
        scans.scan(visible=(0, 1))
    assert not scans.tracker.is_known
    scans.seen()
    assert scans.error_m() < 0.05
    assert scans.tracker.report(scans.time_s, STILL).wires == 3


def test_once_known_one_wire_is_enough_and_the_neighbour_is_not_taken_for_it():
    scans = Scans(wires=((0.0, 18.0), (2.0, 18.0)))
    for _ in range(5):
        scans.scan()
    for _ in range(100):
        scans.off = scans.off + np.array([0.02, 0.0])
        error_m = scans.scan(visible=(1,)).error_m()
        report = scans.tracker.report(scans.time_s, STILL)
        assert error_m < 3.0 * math.sqrt(max(report.covariance_m2[0], report.covariance_m2[2]))
        assert error_m < 0.5


def test_one_sighting_alone_begins_nothing_on_a_line_of_several_wires():
    scans = Scans(noise_m=0.0)
    for _ in range(10):
        scans.scan(visible=(3,))
    assert not scans.tracker.is_known


def test_out_of_sight_the_uncertainty_grows_with_the_drift_until_nothing_is_known():
    scans = Scans().seen()
    seen_s = scans.time_s
    after = [
        scans.tracker.report(seen_s + wait_s, STILL).covariance_m2[0] for wait_s in (0.0, 2.0, 5.0)
    ]
    assert math.sqrt(after[1]) == pytest.approx(0.6, abs=0.05)
    assert math.sqrt(after[2]) == pytest.approx(1.5, abs=0.05)
    scans.time_s += 20.0
    scans.off = np.array([2.0, 0.0])
    scans.scan(visible=(0,))
    assert not scans.tracker.is_known
    assert scans.seen().error_m() < 0.2


def test_sightings_that_fit_no_place_are_reported_as_a_contradiction():
    scans = Scans().seen()
    scans.off = np.array([9.0, 5.0])  # no drift is that fast
    first_s = scans.time_s + SCAN_S
    for _ in range(20):
        scans.scan()
    report = scans.tracker.report(scans.time_s, STILL)
    assert report.contradicted_s == pytest.approx(first_s)
    assert report.seen_s < first_s


@pytest.mark.parametrize("seed", range(20))
def test_random_lines_with_drift_noise_ghosts_and_misses(seed):
    """Error at most 0.15 m in 95 of 100 scans, and never above 0.3 m."""
    random = np.random.default_rng(seed)
    wires: list = []
    while len(wires) < random.integers(2, 8):
        place = (random.uniform(-10.0, 10.0), random.uniform(9.0, 24.0))
        if all(math.dist(place, each) > 2.0 for each in wires) and abs(place[0]) > 1.5:
            wires.append(place)
    scans = Scans(wires=wires, seed=seed)
    scans.off = random.uniform(-0.7, 0.7, 2)
    velocity = random.normal(0.0, 1.0, 2)
    velocity *= random.uniform(0.05, 0.3) / np.hypot(*velocity)
    errors = []
    for number in range(300):
        if np.hypot(*(scans.off + velocity * SCAN_S)) < 5.0:
            scans.off = scans.off + velocity * SCAN_S
        scans.turn_rad = math.radians(0.5) * math.sin(0.2 * number)
        scans.ghosts_m = [tuple(random.uniform((-12.0, 8.0), (12.0, 26.0)))] * (
            random.random() < 0.1
        )
        visible = [index for index in range(len(wires)) if random.random() < 0.85]
        scans.scan(visible=visible)
        if scans.tracker.is_known:
            errors.append(scans.error_m())
    assert len(errors) > 200
    assert np.percentile(errors, 95) < 0.15
    assert max(errors) < 0.3


def test_a_wire_that_the_site_lacks_does_not_shift_the_pattern_by_one():
    """Wires at 11, 15 and 19, one more at 7 that no file has; 7, 11 and 15 are seen."""
    listed = ((11.0, 18.0), (15.0, 18.0), (19.0, 18.0))
    scans = Scans(wires=((7.0, 18.0), *listed), known=listed, noise_m=0.0)
    for _ in range(30):
        scans.scan(visible=(0, 1, 2))
        assert not scans.tracker.is_known or scans.error_m() < 0.3


def test_after_a_gap_a_wire_that_the_site_lacks_is_not_taken_for_its_neighbour():
    listed = ((0.0, 18.0), (4.0, 18.0))
    scans = Scans(wires=((0.0, 16.5), *listed), known=listed, noise_m=0.0)
    for _ in range(10):
        scans.scan(visible=(1, 2))
    scans.time_s += 1.6
    for _ in range(30):
        assert scans.scan(visible=(0,)).error_m() < 0.3


def test_far_from_the_one_wire_of_a_file_nothing_is_taken_for_it():
    scans = Scans(wires=((0.0, 14.5),), known=((0.0, 18.0),), noise_m=0.0)
    for _ in range(30):
        scans.scan()
    assert not scans.tracker.is_known


def test_scans_of_which_most_fit_no_wire_are_a_contradiction():
    scans = Scans().seen()
    scans.ghosts_m = [(-2.0, 15.0), (3.0, 19.0), (1.0, 8.0)]
    began_s = scans.time_s + SCAN_S
    for _ in range(30):
        scans.scan(visible=())
    assert scans.tracker.report(scans.time_s, STILL).contradicted_s == pytest.approx(began_s)


def test_an_offset_that_is_not_known_is_the_one_that_is_flown_with():
    tracker = LineTracker(CIRCUITS)
    tracker.place((3.0, -1.0))
    assert tracker.offset_m == (3.0, -1.0)
    scans = Scans().seen()
    scans.tracker.place((3.0, -1.0))
    assert scans.error_m() < 0.2


def test_a_silent_lidar_forgets_its_offset_by_time_alone():
    scans = Scans().seen()
    assert scans.tracker.report(scans.time_s + 5.0, STILL).seen_s is not None
    assert scans.tracker.report(scans.time_s + 11.0, STILL).seen_s is None
    assert scans.error_m() < 0.2  # it stays as it was


COLUMN = ((7.0, 10.0), (7.0, 13.5), (7.0, 17.0))


def row(place_m, turned_deg):
    """A wire at a place, turned about the vertical there."""
    angle, straight = math.radians(turned_deg), sighting(place_m, PLACE)
    direction = np.array([-math.sin(angle), math.cos(angle), 0.0])
    return replace(straight, direction=direction)


def shown_by(tracker, found, from_s, scans):
    """Report after scans of the same rows."""
    for number in range(1, scans + 1):
        tracker.step(found, PLACE, from_s + SCAN_S * number)
    return tracker.report(from_s + SCAN_S * scans, STILL)


@pytest.mark.parametrize("turned_deg", [8.0, 13.0, 16.0])
def test_a_line_beside_in_another_direction_turns_and_moves_nothing(turned_deg):
    """It has more wires than the site's."""
    other = [row((-9.0, z), turned_deg) for z in (10.0, 12.5, 15.0, 17.5)]
    found = [*(row(place, 0.0) for place in COLUMN), *other]
    report = shown_by(LineTracker(COLUMN), found, 0.0, 20)
    assert report.wires == 3
    assert math.degrees(report.turned_rad) == pytest.approx(0.0, abs=0.5)
    assert report.offset_m == pytest.approx((0.0, 0.0), abs=0.05)


@pytest.mark.parametrize("gap_s", [0.3, 0.8, 1.5, 2.5])
@pytest.mark.parametrize("turned_deg", [10.0, 18.0, 22.0])
def test_one_row_near_a_wire_after_a_gap_does_not_turn_the_heading(gap_s, turned_deg):
    tracker, wires = LineTracker(COLUMN), [row(place, 0.0) for place in COLUMN]
    shown_by(tracker, wires, 0.0, 10)
    report = shown_by(tracker, [row((6.6, 13.2), turned_deg)], 1.0 + gap_s, 10)
    assert math.degrees(report.turned_rad) == pytest.approx(0.0, abs=0.5)
    assert report.offset_m == pytest.approx((0.0, 0.0), abs=0.05)
    assert report.seen_s == pytest.approx(1.0)


def test_two_wires_of_the_line_show_a_heading_that_has_jumped():
    tracker = LineTracker(COLUMN)
    shown_by(tracker, [row(place, 0.0) for place in COLUMN], 0.0, 10)
    crossing_m = 7.0 / math.cos(math.radians(20.0))
    turned = [row((crossing_m, z), 20.0) for _, z in COLUMN[:2]]
    report = shown_by(tracker, turned, 1.0, 3)
    assert math.degrees(report.turned_rad) == pytest.approx(20.0, abs=0.5)
    assert report.contradicted_s is None


def test_without_a_site_file_one_row_turns_nothing():
    report = shown_by(LineTracker(()), [row((-8.0, 10.0), 16.0)], 0.0, 20)
    assert report.turned_rad == 0.0
