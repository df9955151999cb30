"""The trajectory: ends kept, corners rounded, never faster than moves, arcs and brakes allow."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.guidance.trajectory import PathPoints, make_trajectory

from .paths import (
    CELL_M,
    ROUNDING_M,
    accelerations,
    curvatures_per_m,
    distance_to_polyline_m,
    grid_walks,
    length_m,
    path,
    trajectory,
)

properties = settings(deadline=None, max_examples=80, derandomize=True, database=None)
SHARP_MPS = 0.1
"""At a turn back the reference all but stands."""


def made(walk, acceleration=1.0, lead_in=None):
    return make_trajectory(
        walk, lead_in=lead_in, acceleration_mps2=acceleration, rounding_m=ROUNDING_M
    )


# By hand ----------------------------------------------------------------------------------------


def test_a_straight_is_flown_at_its_speed_and_braked_to_rest_at_its_end():
    straight = trajectory((0.0, 0.0), (3.0, 0.0), speed=1.0, acceleration=1.0)
    assert straight.length_m == pytest.approx(3.0)
    assert straight.at(0.0)[2] == pytest.approx(1.0)
    assert straight.at(2.4)[2] == pytest.approx(1.0)
    # v^2 = 2 a s: a metre per second is braked from within half a metre.
    assert straight.at(2.75)[2] == pytest.approx(math.sqrt(0.5), abs=1e-6)
    assert straight.at(3.0)[2] == 0.0
    assert straight.at(99.0)[2] == 0.0


def test_the_time_left_is_that_of_cruising_and_braking():
    straight = trajectory((0.0, 0.0), (10.0, 0.0), speed=2.0, acceleration=1.0)
    # 8 m at 2 m/s, then 2 m of braking at 1 m/s^2.
    assert straight.duration_s(0.0) == pytest.approx(4.0 + 2.0, rel=1e-3)
    assert straight.duration_s(9.5) == pytest.approx(1.0, rel=1e-3)
    assert straight.duration_s(10.0) == straight.duration_s(99.0) == 0.0


def test_the_rest_of_a_trajectory_accelerates_from_the_present_speed():
    straight = trajectory((0.0, 0.0), (10.0, 0.0), speed=2.0, acceleration=1.0)
    # From rest 2 m in 2 s, then 6 m at 2 m/s, then 2 s of braking.
    points, seconds = straight.rest(0.0, 0.0, 1.0)
    assert seconds.sum() == pytest.approx(2.0 + 3.0 + 2.0, rel=1e-3)
    assert len(points) == len(seconds) + 1
    assert points[[0, -1], 0] == pytest.approx([0.0, 10.0])
    _, seconds = straight.rest(4.0, 2.0, 1.0)
    assert seconds.sum() == pytest.approx(2.0 + 2.0, rel=1e-3)
    assert straight.rest(99.0, 2.0, 1.0)[1].sum() == 0.0


def test_the_speed_is_reduced_before_a_slower_move():
    slow = trajectory((0.0, 0.0), (3.0, 0.0), (6.0, 0.0), speed=(2.0, 0.5))
    assert slow.at(3.0)[2] == pytest.approx(0.5)
    assert slow.at(2.0)[2] == pytest.approx(math.sqrt(0.25 + 2.0), rel=1e-6)
    assert slow.at(0.5)[2] == pytest.approx(2.0)


def test_a_right_angle_is_an_arc_of_the_rounding_distance():
    corner = trajectory((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), speed=0.7, acceleration=1.0)
    # r tan(45 deg) = rounding: the radius of a right angle is the rounding distance itself.
    middle = corner.corner_m[1] + 0.5 * (ROUNDING_M * math.pi / 2.0)
    position, direction, speed = corner.at(middle)
    centre = np.array([3.0 - ROUNDING_M, 0.0, ROUNDING_M])
    assert np.linalg.norm(position - centre) == pytest.approx(ROUNDING_M, rel=0.01)
    assert direction == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5)], abs=1e-2)
    assert speed == pytest.approx(math.sqrt(1.0 * ROUNDING_M), rel=1e-6)
    shorter = 2.0 * ROUNDING_M - ROUNDING_M * math.pi / 2.0
    assert corner.length_m == pytest.approx(6.0 - shorter, abs=0.005)


def test_a_turn_back_reaches_its_corner_nearly_at_rest():
    back = trajectory((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), speed=0.7)
    assert back.length_m == pytest.approx(2.0)
    position, _, speed = back.at(float(back.corner_m[1]))
    assert position == pytest.approx([1.0, 0.0, 0.0])
    assert speed <= SHARP_MPS + 1e-9
    assert back.at(0.9)[1] == pytest.approx([1.0, 0.0, 0.0])
    assert back.at(1.1)[1] == pytest.approx([-1.0, 0.0, 0.0])


def test_the_direction_reverses_exactly_at_a_turn_back():
    back = trajectory((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), speed=0.7)
    for before in (0.91, 0.96, 0.99, 0.999):
        assert back.at(before)[1] == pytest.approx([1.0, 0.0, 0.0])
        assert back.at(2.0 - before)[1] == pytest.approx([-1.0, 0.0, 0.0])


@properties
@given(walk=grid_walks(1), acceleration=accelerations, part=st.floats(0.0, 1.0))
def test_the_direction_is_that_of_the_motion(walk, acceleration, part):
    result = made(walk, acceleration)
    if result.length_m < 0.01:
        return
    at_m = part * (result.length_m - 0.002)
    position, direction, _ = result.at(at_m)
    onward = result.at(at_m + 0.001)[0] - position
    if np.linalg.norm(onward) > 0.0009:  # not over a turn back
        assert float(direction @ onward) / np.linalg.norm(onward) > math.cos(math.radians(24.0))


def test_a_trajectory_of_one_point_is_at_rest():
    one = trajectory((1.0, 2.0))
    assert one.length_m == 0.0
    for distance in (0.0, 1.0):
        position, direction, speed = one.at(distance)
        assert position == pytest.approx([1.0, 0.0, 2.0])
        assert (speed, list(direction)) == (0.0, [0.0, 0.0, 0.0])
    assert one.corner_after(0.0) == 0
    assert len(one.corner_m) == 1


def test_a_trajectory_of_equal_points_has_no_length():
    same = trajectory((1.0, 2.0), (1.0, 2.0), (1.0, 2.0))
    assert same.length_m == 0.0
    assert list(same.corner_m) == [0.0, 0.0, 0.0]
    assert len(same.points_m) == 3


def test_a_repeated_point_changes_nothing_but_the_number_of_corners():
    once = trajectory((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    twice = trajectory((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    assert twice.position_m == pytest.approx(once.position_m)
    assert twice.speed_mps == pytest.approx(once.speed_mps)
    first, second, third = once.corner_m
    assert list(twice.corner_m) == [first, second, second, third]


def test_two_corners_close_together_share_the_straight_between_them():
    stair = trajectory((0.0, 0.0), (0.3, 0.0), (0.3, 0.3), (0.6, 0.3), rounding=1.0)
    assert (np.diff(stair.distance_m) > 0.0).all()
    polyline = path((0.0, 0.0), (0.3, 0.0), (0.3, 0.3), (0.6, 0.3)).position_m
    worst = max(distance_to_polyline_m(point, polyline) for point in stair.position_m)
    assert worst < 0.15


def test_the_next_corner_is_the_first_one_ahead_and_finally_the_end():
    line = trajectory((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))
    assert line.corner_after(0.0) == 0
    assert line.corner_after(0.01) == 1
    assert line.corner_after(1.0) == 1
    assert line.corner_after(1.01) == 2
    assert line.corner_after(99.0) == 2


# Any path ---------------------------------------------------------------------------------------


@properties
@given(walk=grid_walks(), acceleration=accelerations)
def test_a_trajectory_keeps_both_ends_of_its_path(walk, acceleration):
    result = made(walk, acceleration)
    assert result.position_m[0] == pytest.approx(walk.position_m[0])
    assert result.position_m[-1] == pytest.approx(walk.position_m[-1])
    assert result.speed_mps[-1] == 0.0
    assert len(result.corner_m) == len(walk.position_m)
    assert result.corner_m[0] == 0.0
    assert result.corner_m[-1] == pytest.approx(result.length_m)


@properties
@given(walk=grid_walks(1), acceleration=accelerations)
def test_distances_increase_and_are_those_between_the_samples(walk, acceleration):
    result = made(walk, acceleration)
    steps = np.sqrt((np.diff(result.position_m, axis=0) ** 2).sum(axis=1))
    assert (steps > 0.0).all()
    assert np.diff(result.distance_m) == pytest.approx(steps)
    assert result.length_m <= length_m(walk.position_m) + 1e-9
    norms = np.linalg.norm(result.direction, axis=1)
    assert norms == pytest.approx(np.ones(len(norms)) if result.length_m > 0.0 else norms)
    assert (np.diff(result.corner_m) >= 0.0).all()


@properties
@given(walk=grid_walks(1), acceleration=accelerations)
def test_every_speed_allows_braking_in_time(walk, acceleration):
    result = made(walk, acceleration)
    assert (result.speed_mps >= 0.0).all()
    assert (result.speed_mps <= result.limit_mps + 1e-9).all()
    squared = result.speed_mps**2
    room = 2.0 * acceleration * np.diff(result.distance_m)
    assert (squared[:-1] <= squared[1:] + room + 1e-9).all()


@properties
@given(walk=grid_walks(1), acceleration=accelerations)
def test_no_speed_is_lower_than_necessary(walk, acceleration):
    """Each sample is at its limit, or braking to the next sample needs the full acceleration."""
    result = made(walk, acceleration)
    at_limit = result.limit_mps[:-1] - result.speed_mps[:-1] < 1e-6
    squared = result.speed_mps**2
    room = 2.0 * acceleration * np.diff(result.distance_m)
    assert (at_limit | (squared[:-1] > squared[1:] + room - 1e-6)).all()


@properties
@given(walk=grid_walks(1), acceleration=accelerations)
def test_no_arc_needs_more_than_the_acceleration(walk, acceleration):
    result = made(walk, acceleration)
    if len(result.position_m) < 3:
        return
    lateral = result.speed_mps[1:-1] ** 2 * curvatures_per_m(result.position_m)
    standing = result.speed_mps[1:-1] <= SHARP_MPS + 1e-9
    assert (standing | (lateral <= acceleration * 1.001)).all()


@properties
@given(walk=grid_walks(1), acceleration=accelerations)
def test_the_speed_limit_of_a_sample_is_that_of_a_near_move(walk, acceleration):
    result = made(walk, acceleration)
    moves = list(itertools.pairwise(walk.position_m))
    for position, limit in zip(result.position_m, result.limit_mps, strict=True):
        near = [
            speed
            for (start, end), speed in zip(moves, walk.speed_mps, strict=True)
            if distance_to_polyline_m(position, np.array([start, end])) <= ROUNDING_M
        ]
        assert limit <= max(near) + 1e-9


@properties
@given(walk=grid_walks(1))
def test_the_trajectory_stays_within_the_rounding_of_the_path_and_its_points(walk):
    result = made(walk)
    for position in result.position_m:
        assert distance_to_polyline_m(position, walk.position_m) <= ROUNDING_M
    for point, corner in zip(walk.position_m, result.corner_m, strict=True):
        assert distance_to_polyline_m(point, result.position_m) <= ROUNDING_M
        # The corner begins where its rounding does.
        assert math.dist(result.at(float(corner))[0], point) <= ROUNDING_M + 1e-6


@properties
@given(walk=grid_walks(1), acceleration=accelerations, mps=st.sampled_from([0.05, 0.3, 1.0]))
def test_a_speed_cap_is_kept_and_the_speed_is_reduced_before_it(walk, acceleration, mps):
    """The cap applies on one side of the middle of the path."""

    def cap(position, _):
        return np.where(position[:, 0] > 0.5, mps, math.inf)

    free = made(walk, acceleration)
    capped = make_trajectory(walk, acceleration_mps2=acceleration, rounding_m=ROUNDING_M, cap=cap)
    assert capped.position_m == pytest.approx(free.position_m)
    assert (capped.speed_mps <= cap(capped.position_m, None) + 1e-9).all()
    assert (capped.speed_mps <= free.speed_mps + 1e-9).all()
    squared, room = capped.speed_mps**2, 2.0 * acceleration * np.diff(capped.distance_m)
    assert (squared[:-1] <= squared[1:] + room + 1e-9).all()


def test_a_speed_cap_may_depend_on_the_direction():
    def cap(_, direction):
        return np.where(direction[:, 2] > 0.9, 0.2, math.inf)

    there = path((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), speed=2.0)
    climbs = make_trajectory(there, acceleration_mps2=1.0, rounding_m=ROUNDING_M, cap=cap)
    assert climbs.at(4.5)[2] == pytest.approx(0.2)
    assert climbs.at(1.5)[2] > 1.0


# Short ends -------------------------------------------------------------------------------------


@pytest.mark.parametrize("last_m", [1e-4, 0.05, 0.1, ROUNDING_M, 0.2, 0.3])
def test_a_corner_whose_arc_ends_on_the_last_point_is_reached_by_the_end(last_m):
    corner = trajectory((0.0, 0.0), (1.0, 0.0), (1.0, last_m))
    assert len(corner.corner_m) == 3
    assert corner.corner_m[-1] == pytest.approx(corner.length_m)
    assert corner.position_m[-1] == pytest.approx([1.0, 0.0, last_m])


@properties
@given(
    turns_deg=st.lists(st.floats(-180.0, 180.0), min_size=1, max_size=4),
    lengths_m=st.lists(st.floats(1e-3, 0.4), min_size=5, max_size=5),
    acceleration=accelerations,
)
def test_all_points_are_reached_for_any_short_last_segments_after_turns(
    turns_deg, lengths_m, acceleration
):
    heading_rad, points = 0.0, [(0.0, 0.0), (1.0, 0.0)]
    for turn_deg, step_m in zip(turns_deg, lengths_m, strict=False):
        heading_rad += math.radians(turn_deg)
        x, z = points[-1]
        points.append((x + step_m * math.cos(heading_rad), z + step_m * math.sin(heading_rad)))
    result = trajectory(*points, acceleration=acceleration)
    assert len(result.corner_m) == len(points)
    assert (np.diff(result.corner_m) >= 0.0).all()
    assert result.corner_m[-1] == pytest.approx(result.length_m)
    assert result.position_m[-1] == pytest.approx([points[-1][0], 0.0, points[-1][1]])


@properties
@given(walk=grid_walks(1), acceleration=accelerations, part=st.floats(0.0, 1.0))
def test_a_stop_from_any_point_of_a_trajectory_is_a_trajectory(walk, acceleration, part):
    old = made(walk, acceleration)
    from_m = part * old.length_m
    position, _, speed = old.at(from_m)
    stop_m = min(from_m + speed**2 / (2.0 * acceleration), old.length_m)
    braking = made(old.between(from_m, stop_m), acceleration)
    assert braking.position_m[0] == pytest.approx(position, abs=1e-9)
    assert braking.position_m[-1] == pytest.approx(old.at(stop_m)[0], abs=1e-5)
    assert braking.speed_mps[-1] == 0.0
    assert braking.length_m <= stop_m - from_m + 1e-9


# Splices ----------------------------------------------------------------------------------------


def test_the_rest_of_a_trajectory_is_the_lead_in_of_the_next_one():
    old = trajectory((0.0, 0.0), (2.0, 0.0), (4.0, 0.0))
    lead_in = old.between(0.5, 2.0)
    new = trajectory((2.0, 0.0), (2.0, 2.0), lead_in=lead_in)
    assert new.position_m[0] == pytest.approx([0.5, 0.0, 0.0])
    assert new.direction[0] == pytest.approx([1.0, 0.0, 0.0])
    assert new.position_m[-1] == pytest.approx([2.0, 0.0, 2.0])
    # The points and corners are those of the plan, which begins at the joint.
    assert len(new.points_m) == len(new.corner_m) == 2
    # Its corner is rounded within the last sample before it.
    assert 1.5 - ROUNDING_M <= new.corner_m[0] < 1.5


def test_a_lead_in_without_length_has_no_effect():
    old = trajectory((0.0, 0.0), (2.0, 0.0))
    joined = trajectory((2.0, 0.0), (2.0, 2.0), lead_in=old.between(2.0, 2.0))
    alone = trajectory((2.0, 0.0), (2.0, 2.0))
    assert joined.position_m == pytest.approx(alone.position_m)
    assert joined.speed_mps == pytest.approx(alone.speed_mps)


@properties
@given(
    walk=grid_walks(3),
    onward=grid_walks(1),
    acceleration=accelerations,
    part=st.floats(0.0, 1.0),
    joint=st.floats(0.0, 1.0),
)
def test_a_splice_keeps_position_and_direction(walk, onward, acceleration, part, joint):
    old = made(walk, acceleration)
    corner = round(joint * (len(old.corner_m) - 1))
    joined_m = float(old.corner_m[corner])
    from_m = part * joined_m
    moved = PathPoints(
        position_m=onward.position_m + old.points_m[corner], speed_mps=onward.speed_mps
    )
    new = made(moved, acceleration, old.between(from_m, joined_m))
    position, direction, _ = old.at(from_m)
    assert new.position_m[0] == pytest.approx(position, abs=1e-9)
    assert new.position_m[-1] == pytest.approx(moved.position_m[-1], abs=1e-5)
    # Between two samples of an arc of 135 degrees in six pieces lie 22.5 degrees. Where the old
    # path stood or turned back there is no direction to keep.
    if joined_m - from_m > CELL_M and not _turns_back(old, from_m):
        assert float(new.direction[0] @ direction) >= math.cos(math.radians(23.0))
    # The lead-in follows the old path.
    for fraction in (0.25, 0.5, 0.75):
        ahead = from_m + fraction * (joined_m - from_m)
        nearest = distance_to_polyline_m(old.at(ahead)[0], new.position_m)
        assert nearest <= ROUNDING_M


@properties
@given(
    walk=grid_walks(4),
    acceleration=accelerations,
    part=st.floats(0.0, 1.0),
    joint=st.floats(0.0, 1.0),
)
def test_a_splice_onto_the_same_path_is_the_same_path(walk, acceleration, part, joint):
    """A new plan on the same path changes little for the aircraft."""
    old = made(walk, acceleration)
    corner = round(joint * (len(old.corner_m) - 1))
    from_m = part * float(old.corner_m[corner])
    rest = PathPoints(position_m=walk.position_m[corner:], speed_mps=walk.speed_mps[corner:])
    new = made(rest, acceleration, old.between(from_m, float(old.corner_m[corner])))
    # Arcs are made again from their own chords, and the corner at the joint may be tighter.
    slack_m = 0.05 + 0.03 * len(walk.speed_mps)
    assert new.length_m == pytest.approx(old.length_m - from_m, abs=slack_m)
    for position in new.position_m:
        assert distance_to_polyline_m(position, walk.position_m) <= ROUNDING_M
    assert (new.speed_mps <= max(walk.speed_mps) + 1e-9).all()


@properties
@given(walk=grid_walks(4), acceleration=accelerations, part=st.floats(0.0, 1.0))
def test_the_time_left_is_finite_and_at_least_that_at_the_greatest_speed(walk, acceleration, part):
    flown = made(walk, acceleration)
    from_m = part * flown.length_m
    left_s = flown.duration_s(from_m)
    assert (flown.length_m - from_m) / max(walk.speed_mps, default=1.0) - 1e-9 <= left_s
    assert left_s <= flown.duration_s(0.0) < math.inf
    points, seconds = flown.rest(from_m, 0.0, acceleration)
    assert left_s - 1e-6 <= seconds.sum() < math.inf
    assert length_m(points) == pytest.approx(flown.length_m - from_m, abs=0.01)


def _turns_back(old, at_m):
    """True if the path turns sharply within a sample of a distance along it."""
    near = np.abs(old.distance_m - at_m) < 0.11
    directions = old.direction[near]
    return bool((directions @ directions.T < 0.0).any())


def test_another_speed_cap_slows_the_trajectory_and_moves_no_point():
    trajectory = make_trajectory(
        PathPoints(
            position_m=np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]),
            speed_mps=np.array([3.0, 3.0]),
        ),
        acceleration_mps2=1.0,
        rounding_m=0.5,
    )

    def near_the_corner(position_m, direction):
        return np.where(position_m[:, 0] > 8.0, 1.0, 5.0)

    capped = trajectory.capped(near_the_corner, 1.0)
    assert (capped.position_m == trajectory.position_m).all()
    assert (capped.corner_m == trajectory.corner_m).all()
    assert (capped.speed_mps <= trajectory.speed_mps).all()
    assert capped.at(9.0)[2] == pytest.approx(1.0)
    # The speed is reduced before: v^2 = 1 + 2 * 1 m/s^2 * 2 m.
    assert capped.at(6.0)[2] == pytest.approx(math.sqrt(5.0), abs=0.05)
    assert capped.capped(lambda position_m, _: np.full(len(position_m), 9.0), 1.0).speed_mps == (
        pytest.approx(capped.speed_mps)
    )
