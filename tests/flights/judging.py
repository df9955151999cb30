"""True course of a lockstep flight, and the sent setpoints: with independent geometry.

Independent of the companion on purpose: distances are Shapely's, the map between the world and an
autopilot's local frame is the simulator's.
"""

from __future__ import annotations

import enum
import functools
import itertools
import math

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from moar_companion.planner.site import Conductor
from moar_companion.settings.config import Supervision
from sitl.geodesy import FlatProjection, Geodetic, SphereProjection, TrueFrame

from .operator import Manner

PROJECTIONS = {Manner.PX4: SphereProjection, Manner.ARDUPILOT: FlatProjection}
"""Projection of each autopilot's local frame."""
OUTWARD_STATES = {"landing_leg"}
"""States in which the setpoint may be outside the workspace."""
_SECOND_S = 1.0
"""A setpoint that follows the aircraft is as far away as the aircraft flies in this time."""
_FORGIVEN_M = 2e-3
"""Rounding of conversions between the frames."""


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
    """(x, y, z) in the site's frame of a message's local x, y, z at an origin."""
    latitude_deg, longitude_deg, altitude_m = origin
    projection = PROJECTIONS[manner](latitude_deg, longitude_deg)
    place = projection.reproject(message.x, message.y)
    return in_plane(site, *place, altitude_m - message.z)


@functools.cache
def shape(obstacle):
    if isinstance(obstacle, Conductor):
        return Point(obstacle.position_m).buffer(obstacle.radius_m, quad_segs=32)
    return Polygon(obstacle.vertices_m)


def clearances_m(site, places, *, keep_out=False):
    """Distance of each place from the nearest obstacle, optionally less its keep-out."""
    points = shapely.points(np.reshape([(x, z) for x, _, z in places], (-1, 2)))
    return np.min(
        [
            shapely.distance(shape(obstacle), points) - (obstacle.keep_out_m if keep_out else 0.0)
            for obstacle in site.obstacles
        ],
        axis=0,
    )


def least_true_clearance_m(flight):
    """Least distance from the hull to the nearest obstacle, from take-off to landing."""
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
    """Between two setpoints lies no more than the speed allows; nor do speeds or headings jump.

    Except setpoints that follow an aircraft that the wind blows off.
    """
    speed, guidance = flight.vehicle.speed, flight.vehicle.guidance
    greatest_mps = max(
        speed.horizontal_mps,
        speed.up_mps,
        speed.down_mps,
        speed.diagonal_up_mps,
        speed.diagonal_down_mps,
    )
    blown = blown_setpoints(flight)
    for streak in streaks(flight):
        for before, after in itertools.pairwise(streak):
            step_s = after.time_s - before.time_s
            assert step_s < 0.05
            one, two = before.message, after.message
            turned = abs(math.remainder(two.yaw - one.yaw, math.tau))
            assert turned <= guidance.yaw_rate_radps * step_s + 1e-4
            if blown.get(after.time_s) is Blown.TAKEN:
                continue
            moved_m = math.dist((one.x, one.y, one.z), (two.x, two.y, two.z))
            assert moved_m <= (greatest_mps + 0.05) * step_s + 1e-4, before
            # The velocity in a setpoint is the velocity of the setpoint.
            sent_mps = math.dist((0.0, 0.0, 0.0), (two.vx, two.vy, two.vz))
            assert sent_mps <= greatest_mps + 0.05
            if before.state not in {"ready", "planning"}:
                changed_mps = math.dist((one.vx, one.vy, one.vz), (two.vx, two.vy, two.vz))
                # An offset begins and ends to fade at v_MIN; arcs are made of small corners.
                small_mps = max(speed.min_mps, 0.15 * greatest_mps)
                most_mps = 4.0 * guidance.acceleration_mps2 * step_s + small_mps
                assert changed_mps <= most_mps, before


def assert_setpoints_keep_to_free_space(flight, *, escape=False):
    """In the workspace, above the least altitude, in cells that are free by our own reckoning.

    At rest they may be within the margin. Exceptions: the landing leg; with `escape`, the leg out
    of an occupied cell; and the permitted effects of a wind, which stay out of the keep-outs.
    """
    site, radius_m = flight.site, flight.vehicle.radius_m
    space = site.workspace
    places = setpoint_places(flight)
    clearances = clearances_m(site, places)
    blown = blown_setpoints(flight)
    left = False
    free = {}
    for item, place, clearance in zip(flight.setpoints, places, clearances, strict=True):
        x, y, z = place
        assert clearance > radius_m
        if item.time_s in blown:
            continue
        assert abs(y) <= 2.0
        left = left or item.state in OUTWARD_STATES
        if left or (escape and z < (space.min_altitude_m or 0.0) + space.resolution_m):
            continue
        # On a border one of two free cells is enough; conversions have a tolerance of a millimetre.
        message = item.message
        moves = any((message.vx, message.vy, message.vz))
        near = {(cell, moves) for cell in cells_within(place, space, _FORGIVEN_M)}
        for cell, _ in near - free.keys():
            free[cell, moves] = is_free(flight.flown_site if moves else site, cell, radius_m)
        assert any(free[key] for key in near), (item.time_s, place)
        assert space.lower_m[0] - _FORGIVEN_M <= x <= space.upper_m[0] + _FORGIVEN_M
        assert z <= space.upper_m[1] + _FORGIVEN_M


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
    """True if the cell at a centre may be entered; widened_m: growth of every keep-out."""
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


class Blown(enum.Enum):
    """Effect of the wind on a setpoint."""

    TAKEN = "taken along by the aircraft"
    STANDS = "at rest where the aircraft has left it"
    RETURNS = "on its way back"


class Leash:
    """Permitted effects of a wind on a stream's setpoints, by `configs/guides/flight.md` ("Wind").

    Places are in the site's frame. Only setpoints with such an effect may be off the plane or
    outside the workspace.
    """

    def __init__(self, site, vehicle):
        guidance = vehicle.guidance
        self._site, self._radius_m = site, vehicle.radius_m
        self._longest_m = max(guidance.leash_m, guidance.off_path_m)
        self._drawn_m = min(self._longest_m, vehicle.speed.horizontal_mps * _SECOND_S)
        self._drifts = False
        self._at_m = None
        """Where the last setpoint was, since one was taken along."""
        self._least_m = None
        """Least distance beside the plane and outside the workspace so far, in the recovery."""
        self._jumped_m = 0.0
        """Offset of the setpoint from its recovery path after a jump; fades to 0."""

    def look(self, before_m, after_m, aircraft_m, *, moves, jumped_m=0.0):
        """Permitted effect of the wind that explains a setpoint; None if there is none.

        before_m: previous setpoint; None at the start of a stream. aircraft_m: last reported
        position. moves: True if the setpoint has a velocity. jumped_m: size of a jump of the
        estimate just before, which moves the setpoint.
        """
        found = None
        if before_m is not None:
            found = self._judged(before_m, after_m, aircraft_m, moves, jumped_m)
        self._drifts = found is Blown.TAKEN or (self._drifts and found is Blown.STANDS)
        self._at_m = None if found is None else after_m
        if found in {None, Blown.TAKEN}:
            self._least_m = None if found is None else self._away_m(after_m)
            self._jumped_m = 0.0
        return found

    def _judged(self, before_m, after_m, aircraft_m, moves, jumped_m):
        if not moves and self._is_taken(before_m, after_m, aircraft_m):
            return Blown.TAKEN
        if self._at_m is None or (jumped_m and not self._keeps(after_m)):
            return None
        if not moves:
            stands = math.dist(after_m, self._at_m) <= _FORGIVEN_M + jumped_m
            return Blown.STANDS if stands else None
        return Blown.RETURNS if self._comes_back(after_m, jumped_m) else None

    def _is_taken(self, before_m, after_m, aircraft_m):
        """True for a motion towards an aircraft that is too far away, not fully to it."""
        was_m, is_m = math.dist(before_m, aircraft_m), math.dist(after_m, aircraft_m)
        leash_m = self._drawn_m if self._drifts else self._longest_m
        return (
            was_m > leash_m - _FORGIVEN_M
            and self._drawn_m - _FORGIVEN_M <= is_m < was_m
            and self._is_between(before_m, after_m, aircraft_m)
            and self._keeps(after_m)
        )

    def _is_between(self, before_m, after_m, aircraft_m):
        """True on the line from setpoint to aircraft, or above the line if that is too low."""
        low_m = self._site.workspace.min_altitude_m
        for axes in (slice(3), slice(2)):
            line, come = np.subtract(before_m, aircraft_m), np.subtract(after_m, aircraft_m)
            square = float(line[axes] @ line[axes])
            part = float(line[axes] @ come[axes]) / square if square else 0.0
            x_m, y_m, z_m = aircraft_m + part * line
            raised_m = z_m if low_m is None else max(z_m, low_m)
            if 0.0 <= part <= 1.0 and math.dist(after_m, (x_m, y_m, raised_m)) <= _FORGIVEN_M:
                return True
        return False

    def _comes_back(self, place_m, jumped_m):
        """True while the setpoint returns: never farther from plane and workspace than so far."""
        if self._is_back(place_m) or not self._keeps(place_m):
            return False
        away_m, least_m = self._away_m(place_m), self._least_m
        self._jumped_m = forgiven_m = max(jumped_m, self._jumped_m)
        self._least_m = tuple(map(min, away_m, least_m))
        forgiven_m += _FORGIVEN_M
        return all(now <= least + forgiven_m for now, least in zip(away_m, least_m, strict=True))

    def _away_m(self, place_m):
        """Distance beside the plane, and outside the workspace."""
        x_m, y_m, z_m = place_m
        space = self._site.workspace
        limits = zip((x_m, z_m), space.lower_m, space.upper_m, strict=True)
        return abs(y_m), math.hypot(*(max(low - at, at - high, 0.0) for at, low, high in limits))

    def _is_back(self, place_m):
        return abs(place_m[1]) <= Supervision().plane_tolerance_m and any(
            is_free(self._site, cell, self._radius_m)
            for cell in cells_within(place_m, self._site.workspace, _FORGIVEN_M)
        )

    def _keeps(self, place_m):
        """True outside every keep-out, also beyond the workspace, and above the least altitude."""
        low_m = self._site.workspace.min_altitude_m
        high = low_m is None or place_m[2] >= low_m - _FORGIVEN_M
        room_m = clearances_m(self._site, [place_m], keep_out=True)[0]
        return high and room_m >= self._radius_m - _FORGIVEN_M


def blown_setpoints(flight):
    """Setpoints with a permitted effect of the wind, by their time."""
    leash, manner = Leash(flight.site, flight.vehicle), flight.operator.manner
    blown, before_m, before_s = {}, None, -math.inf
    for item, place_m in zip(flight.setpoints, setpoint_places(flight), strict=True):
        message = item.message
        found = leash.look(
            before_m if item.time_s - before_s <= 0.1 else None,
            place_m,
            local_place(flight.site, manner, item.origin, item.aircraft),
            moves=any((message.vx, message.vy, message.vz)),
        )
        if found is not None:
            blown[item.time_s] = found
        before_m, before_s = place_m, item.time_s
    return blown
