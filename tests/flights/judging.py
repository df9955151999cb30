"""What really happened in a lockstep flight, and what was sent: by geometry of its own.

Independent of the companion on purpose: distances are Shapely's, the map between the world and an
autopilot's local frame is the simulator's.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from moar_companion.site import Conductor
from sitl.geodesy import FlatProjection, Geodetic, SphereProjection, TrueFrame

from .operator import Manner

PROJECTIONS = {Manner.PX4: SphereProjection, Manner.ARDUPILOT: FlatProjection}
"""Of each autopilot's local frame."""
OUTWARD_STATES = {"landing_leg"}
"""In these the setpoint may be outside the workspace."""


def in_plane(site, latitude_deg, longitude_deg, altitude_amsl_m):
    """(x, y, z) in the site's frame of a place in the world."""
    origin = site.frame.origin
    north, east, _ = _frame_at(origin.latitude_deg, origin.longitude_deg).ned(
        Geodetic(
            latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_amsl_m
        )
    )
    azimuth = math.radians(site.frame.azimuth_deg)
    return (
        north * math.cos(azimuth) + east * math.sin(azimuth),
        north * math.sin(azimuth) - east * math.cos(azimuth),
        altitude_amsl_m - origin.altitude_amsl_m,
    )


@functools.cache
def _frame_at(latitude_deg, longitude_deg):
    return TrueFrame(
        Geodetic(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=0.0)
    )


def true_places(flight):
    """(x, y, z) of every instant in the air."""
    return [
        in_plane(flight.site, truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)
        for truth in flight.truths
        if not truth.on_ground
    ]


def setpoint_places(flight, setpoints=None):
    """(x, y, z) of the setpoints sent."""
    manner = flight.operator.manner
    return [
        local_place(flight.site, manner, item.origin, item.message)
        for item in (flight.setpoints if setpoints is None else setpoints)
    ]


def local_place(site, manner, origin, message):
    """(x, y, z) of what a message has as x, y, z of the local frame at an origin."""
    latitude_deg, longitude_deg, altitude_m = origin
    projection = PROJECTIONS[manner](latitude_deg, longitude_deg)
    place = projection.reproject(message.x, message.y)
    return in_plane(site, *place, altitude_m - message.z)


def shape(obstacle):
    if isinstance(obstacle, Conductor):
        return Point(obstacle.position_m).buffer(obstacle.radius_m, quad_segs=32)
    return Polygon(obstacle.vertices_m)


def clearances_m(site, places, *, keep_out=False):
    """Distance of each place from the nearest obstacle, less that one's keep-out if asked."""
    points = shapely.points(np.reshape([(x, z) for x, _, z in places], (-1, 2)))
    return np.min(
        [
            shapely.distance(shape(obstacle), points) - (obstacle.keep_out_m if keep_out else 0.0)
            for obstacle in site.obstacles
        ],
        axis=0,
    )


def least_true_clearance_m(flight):
    """Between the aircraft's hull and the nearest obstacle, from take-off to landing."""
    return min(clearances_m(flight.site, true_places(flight))) - flight.vehicle.radius_m


def assert_nothing_was_touched(flight):
    assert least_true_clearance_m(flight) > 0.0


def assert_the_stream_is_sound(flight):
    """Every setpoint is of the form both autopilots understand, finite, and for this autopilot."""
    assert flight.setpoints
    for item in flight.setpoints:
        message = item.message
        assert message.type_mask == 0x9C0
        assert message.coordinate_frame == 1
        assert (message.target_system, message.target_component) == (1, 1)
        numbers = (message.x, message.y, message.z, message.vx, message.vy, message.vz, message.yaw)
        assert all(math.isfinite(number) for number in numbers)
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 195)


def streaks(flight):
    """The setpoints, cut where the stream was interrupted."""
    streak = []
    for item in flight.setpoints:
        if streak and item.time_s - streak[-1].time_s > 0.1:
            yield streak
            streak = []
        streak.append(item)
    yield streak


def assert_setpoints_never_jump(flight):
    """Between two setpoints lies no more than the speed allows; nor do speeds or headings jump."""
    speed, guidance = flight.vehicle.speed, flight.vehicle.guidance
    greatest_mps = max(
        speed.horizontal_mps,
        speed.up_mps,
        speed.down_mps,
        speed.diagonal_up_mps,
        speed.diagonal_down_mps,
    )
    for streak in streaks(flight):
        for before, after in itertools.pairwise(streak):
            step_s = after.time_s - before.time_s
            assert step_s < 0.05
            one, two = before.message, after.message
            moved_m = math.dist((one.x, one.y, one.z), (two.x, two.y, two.z))
            assert moved_m <= (greatest_mps + 0.05) * step_s + 1e-4, before
            # What the setpoints say of their speed is how they move.
            told_mps = math.dist((0.0, 0.0, 0.0), (two.vx, two.vy, two.vz))
            assert told_mps <= greatest_mps + 0.05
            if before.state not in {"ready", "planning"}:
                changed_mps = math.dist((one.vx, one.vy, one.vz), (two.vx, two.vy, two.vz))
                # An offset begins and ends to fade at v_MIN; arcs are made of small corners.
                small_mps = max(speed.min_mps, 0.15 * greatest_mps)
                most_mps = 4.0 * guidance.acceleration_mps2 * step_s + small_mps
                assert changed_mps <= most_mps, before
            turned = abs(math.remainder(two.yaw - one.yaw, math.tau))
            assert turned <= guidance.yaw_rate_radps * step_s + 1e-4


def assert_setpoints_keep_to_free_space(flight, *, escape=False):
    """In the workspace, above the least altitude, in cells that are free by our own reckoning.

    But for the landing leg, and, with `escape`, the leg that leads out of an occupied cell.
    """
    site, radius_m = flight.site, flight.vehicle.radius_m
    space = site.workspace
    places = setpoint_places(flight)
    clearances = clearances_m(site, places)
    left = False
    free = {}
    for item, place, clearance in zip(flight.setpoints, places, clearances, strict=True):
        x, y, z = place
        assert abs(y) <= 2.0
        assert clearance > radius_m
        left = left or item.state in OUTWARD_STATES
        if left or (escape and z < (space.min_altitude_m or 0.0) + space.resolution_m):
            continue
        # On a border two cells will do: of conversions to and fro a millimetre is forgiven.
        near = cells_within(place, space, 2e-3)
        for cell in near - free.keys():
            free[cell] = is_free(site, cell, radius_m)
        assert any(free[cell] for cell in near), (item.time_s, place)
        assert space.lower_m[0] - 2e-3 <= x <= space.upper_m[0] + 2e-3
        assert z <= space.upper_m[1] + 2e-3


def cells_within(place, space, tolerance_m):
    """The centres of the cells that hold a place or touch it within a tolerance."""
    x, _, z = place
    found = set()
    for dx in (-tolerance_m, tolerance_m):
        for dz in (-tolerance_m, tolerance_m):
            found.add(
                tuple(
                    lower
                    + (math.floor((value - lower) / space.resolution_m) + 0.5) * space.resolution_m
                    for value, lower in (
                        (x + dx, space.lower_m[0]),
                        (z + dz, space.lower_m[1]),
                    )
                )
            )
    return found


def is_free(site, centre, radius_m, widened_m=0.0):
    """Whether the cell at a centre may be entered; widened_m: what every keep-out grows by."""
    space = site.workspace
    low = space.min_altitude_m
    if low is not None and centre[1] < low - 1e-6:
        return False
    if any(
        not lower < value < upper
        for value, lower, upper in zip(centre, space.lower_m, space.upper_m, strict=True)
    ):
        return False
    place = (centre[0], 0.0, centre[1])
    return clearances_m(site, [place], keep_out=True)[0] >= radius_m + widened_m - 1e-6
