"""Distances of obstacles: directions by frame, invalid values, points of one instant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.telemetry import Attitude, Telemetry

from .messages import updated

UNKNOWN = 65535
BODY, HEADING = mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_FRAME_LOCAL_FRD
GLOBAL, NORTH = mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_LOCAL_NED
NOWHERE = 19


def attitude(roll=0.0, pitch=0.0, yaw=0.0, received_s=10.0):
    return Telemetry(
        attitude=Attitude(received_s=received_s, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    )


def sectors(telemetry=None, seen=None, **fields):
    """Obstacle distances by sector of 5°, in cm; the other sectors are unknown."""
    distances = [UNKNOWN] * 72
    for sector, distance_cm in (seen or {}).items():
        distances[sector] = distance_cm
    given_fields = {"increment": 5, "min_distance": 20, "max_distance": 2000, "frame": BODY}
    return updated(
        "OBSTACLE_DISTANCE", telemetry, **given_fields | {"distances": distances} | fields
    ).proximity


def points(proximity):
    return np.array(proximity.points_m)


def test_sectors_go_clockwise_from_ahead():
    seen = sectors(seen={0: 500, 18: 1000, 36: 200, 54: 300})
    assert points(seen) == pytest.approx(
        np.array([(5.0, 0.0, 0.0), (0.0, -10.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 3.0, 0.0)]), abs=1e-9
    )
    assert seen.received_s == 10.0


@pytest.mark.parametrize(
    ("fields", "direction_deg"),
    [
        ({"increment_f": 2.5}, 25.0),
        ({"increment_f": -2.5}, -25.0),
        ({"increment_f": 0.0}, 50.0),
        ({"angle_offset": -30.0}, 20.0),
        ({"angle_offset": 350.0, "increment_f": 10.0}, 90.0),
    ],
)
def test_the_message_gives_width_and_offset_of_the_sectors(fields, direction_deg):
    ((x, y, z),) = points(sectors(seen={10: 400}, **fields))
    assert math.degrees(math.atan2(-y, x)) == pytest.approx(direction_deg)
    assert (math.hypot(x, y), z) == pytest.approx((4.0, 0.0))


@pytest.mark.parametrize("distance_cm", [0, 19, 2001, 2002, UNKNOWN])
def test_an_invalid_distance_gives_no_point(distance_cm):
    seen = sectors(seen={0: distance_cm})
    assert seen.points_m == ()
    assert seen.received_s == 10.0


@pytest.mark.parametrize("distance_cm", [20, 2000])
def test_distances_at_both_ends_of_the_range_are_valid(distance_cm):
    assert len(sectors(seen={0: distance_cm}).points_m) == 1


def test_sectors_beyond_a_full_turn_are_ignored():
    assert len(sectors(seen=dict.fromkeys(range(72), 500), increment=10).points_m) == 36
    assert len(sectors(seen=dict.fromkeys(range(72), 500), increment_f=1e-40).points_m) == 72


@pytest.mark.parametrize(
    "fields",
    [
        {"increment": 0},
        {"increment_f": math.nan},
        {"increment_f": math.inf},
        {"angle_offset": math.nan},
        {"frame": NOWHERE},
    ],
)
def test_a_message_without_valid_directions_is_ignored(fields):
    assert sectors(attitude(), seen={0: 500}, **fields) is None


@pytest.mark.parametrize("frame", [GLOBAL, NORTH])
def test_sectors_from_north_are_turned_by_the_whole_attitude(frame):
    ((ahead_x, ahead_y, _),) = points(
        sectors(attitude(yaw=math.pi / 2), seen={18: 500}, frame=frame)
    )
    assert (ahead_x, ahead_y) == pytest.approx((5.0, 0.0), abs=1e-9)
    tilted = attitude(roll=0.2, pitch=-0.3, yaw=1.1)
    ((x, y, z),) = points(sectors(tilted, seen={4: 1000}, frame=frame))
    body_to_ned = Rotation.from_euler("ZYX", [1.1, -0.3, 0.2])
    north, east, down = body_to_ned.apply((x, -y, -z))
    angle = math.radians(20.0)
    expected = (10.0 * math.cos(angle), 10.0 * math.sin(angle), 0.0)
    assert (north, east, down) == pytest.approx(expected, abs=1e-9)


def test_sectors_from_the_heading_are_level():
    ((x, y, z),) = points(sectors(attitude(pitch=0.3, yaw=2.0), seen={0: 1000}, frame=HEADING))
    # The nose is up: a point level ahead is below the forward axis.
    assert (x, y, z) == pytest.approx((10 * math.cos(0.3), 0.0, -10 * math.sin(0.3)), abs=1e-9)


@pytest.mark.parametrize("frame", [GLOBAL, NORTH, HEADING])
def test_level_sectors_need_a_current_attitude(frame):
    seen = {0: 500}
    assert sectors(seen=seen, frame=frame) is None
    assert sectors(attitude(received_s=9.4), seen=seen, frame=frame) is None
    assert sectors(attitude(yaw=math.nan), seen=seen, frame=GLOBAL) is None
    assert sectors(attitude(received_s=9.6), seen=seen, frame=frame) is not None


# Single points


def seen_at(x, y, z, telemetry=None, now_s=10.0, **fields):
    given_fields = {
        "frame": BODY,
        "time_boot_ms": 7000,
        "obstacle_id": UNKNOWN,
        "min_distance": 0.2,
        "max_distance": 20.0,
    }
    named = given_fields | fields
    return updated("OBSTACLE_DISTANCE_3D", telemetry, now_s, x=x, y=y, z=z, **named)


def test_a_point_is_converted_to_left_and_up():
    assert seen_at(3.0, 1.0, -2.0).proximity.points_m == ((3.0, -1.0, 2.0),)


def test_points_with_one_time_stamp_are_merged():
    first = seen_at(3.0, 0.0, 0.0)
    second = seen_at(0.0, 4.0, 0.0, first, now_s=10.05)
    assert second.proximity.points_m == ((3.0, 0.0, 0.0), (0.0, -4.0, 0.0))
    assert second.proximity.received_s == 10.05
    next_instant = seen_at(5.0, 0.0, 0.0, second, now_s=10.1, time_boot_ms=7100)
    assert next_instant.proximity.points_m == ((5.0, 0.0, 0.0),)


@pytest.mark.parametrize(("stamp_ms", "later_s"), [(0, 0.01), (7000, 0.3)])
def test_points_without_a_time_stamp_or_much_later_replace_the_earlier_ones(stamp_ms, later_s):
    first = seen_at(3.0, 0.0, 0.0, time_boot_ms=stamp_ms)
    second = seen_at(0.0, 4.0, 0.0, first, now_s=10.0 + later_s, time_boot_ms=stamp_ms)
    assert len(second.proximity.points_m) == 1


def test_a_frozen_clock_does_not_fill_memory():
    telemetry = Telemetry()
    for step in range(600):
        telemetry = seen_at(3.0, 0.0, 0.0, telemetry, now_s=10.0 + 0.01 * step)
    assert len(telemetry.proximity.points_m) <= 501


@pytest.mark.parametrize(
    "point",
    [
        (math.nan, 0.0, 0.0),
        (math.inf, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (0.1, 0.0, 0.0),
        (21.0, 0.0, 0.0),
    ],
)
def test_an_invalid_point_shows_only_that_the_sensor_works(point):
    proximity = seen_at(*point).proximity
    assert (proximity.points_m, proximity.received_s) == ((), 10.0)


@pytest.mark.parametrize("fields", [{"max_distance": math.nan}, {"max_distance": 0.0}])
def test_an_invalid_maximum_range_does_not_limit_points(fields):
    assert len(seen_at(500.0, 0.0, 0.0, min_distance=math.nan, **fields).proximity.points_m) == 1


@pytest.mark.parametrize("frame", [GLOBAL, NORTH, HEADING, NOWHERE])
def test_points_in_other_frames_are_ignored(frame):
    assert seen_at(3.0, 0.0, 0.0, attitude(), frame=frame).proximity is None


floats = st.floats(width=32)


@given(
    floats,
    floats,
    st.integers(0, 255),
    st.integers(0, 22),
    st.lists(st.integers(0, 65535), min_size=72, max_size=72),
    st.tuples(floats, floats, floats),
)
def test_any_fields_give_finite_points(width, offset, increment, frame, distances, point):
    seen = sectors(
        attitude(0.1, 0.2, 0.3),
        increment_f=width,
        angle_offset=offset,
        increment=increment,
        frame=frame,
        distances=distances,
    )
    single = seen_at(*point, min_distance=width, max_distance=offset, frame=frame).proximity
    for proximity in filter(None, (seen, single)):
        assert np.isfinite(points(proximity)).all()
