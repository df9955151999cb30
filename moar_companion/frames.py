"""Frames of positions: WGS84, the site's vertical plane, and the autopilot's local NED frame.

Each frame has its own projection:

- The site is surveyed in true metres, so its plane stands on the WGS84 ellipsoid. Near the origin,
  metres per radian are the radii of curvature (within 1e-5 over 100 m).
- The autopilot's local frame has the projection of its kind (`autopilots`). Over 100 m it differs
  from true metres by up to 0.3 m, which matters next to a conductor.

`PlaneToLocal` composes the two as one affine map between the plane and local NED.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .autopilots import profile
from .types import AutopilotKind, GeodeticPoint, Vector

_WGS84_SEMI_MAJOR_M = 6_378_137.0
_WGS84_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3
_PROBE_M = 10.0
"""Length over which the local frame's scale is taken; any below a kilometre gives the same."""


def radii_of_curvature_m(latitude_deg: float) -> tuple[float, float]:
    """WGS84 radii of the meridian and of the prime vertical at a latitude."""
    sine_squared = math.sin(math.radians(latitude_deg)) ** 2
    denominator = 1.0 - _WGS84_ECCENTRICITY_SQUARED * sine_squared
    prime_vertical = _WGS84_SEMI_MAJOR_M / math.sqrt(denominator)
    meridian = prime_vertical * (1.0 - _WGS84_ECCENTRICITY_SQUARED) / denominator
    return meridian, prime_vertical


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteFrame:
    """The vertical plane of a site: x along the azimuth, y to the left of it, z up."""

    origin: GeodeticPoint
    azimuth_deg: float

    def to_geodetic(self, position_m: Vector) -> GeodeticPoint:
        """The geodetic point of (x, y, z) in the site's frame."""
        x_m, y_m, z_m = position_m
        azimuth = math.radians(self.azimuth_deg)
        north_m = x_m * math.cos(azimuth) + y_m * math.sin(azimuth)
        east_m = x_m * math.sin(azimuth) - y_m * math.cos(azimuth)
        meridian_m, prime_vertical_m = radii_of_curvature_m(self.origin.latitude_deg)
        latitude = math.radians(self.origin.latitude_deg)
        return GeodeticPoint(
            latitude_deg=self.origin.latitude_deg + math.degrees(north_m / meridian_m),
            longitude_deg=math.remainder(
                self.origin.longitude_deg
                + math.degrees(east_m / (prime_vertical_m * math.cos(latitude))),
                360.0,
            ),
            altitude_amsl_m=self.origin.altitude_amsl_m + z_m,
        )

    def place_of(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """(x, y) in the site's frame of a point on the map: `to_geodetic` the other way."""
        meridian_m, prime_vertical_m = radii_of_curvature_m(self.origin.latitude_deg)
        latitude = math.radians(self.origin.latitude_deg)
        turned_deg = self.origin.east_deg(longitude_deg)
        north_m = math.radians(latitude_deg - self.origin.latitude_deg) * meridian_m
        east_m = math.radians(turned_deg) * prime_vertical_m * math.cos(latitude)
        azimuth = math.radians(self.azimuth_deg)
        return (
            north_m * math.cos(azimuth) + east_m * math.sin(azimuth),
            north_m * math.sin(azimuth) - east_m * math.cos(azimuth),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaneToLocal:
    """The affine map between the site's frame (x, y, z) and the autopilot's local NED.

    matrix: (3, 3) local NED per metre of site frame; offset_ned_m: (3,) the site's origin.
    """

    matrix: npt.NDArray[np.floating[Any]]
    inverse: npt.NDArray[np.floating[Any]]
    offset_ned_m: npt.NDArray[np.floating[Any]]

    @classmethod
    def between(
        cls, site: SiteFrame, local_origin: GeodeticPoint, kind: AutopilotKind
    ) -> PlaneToLocal:
        """The map for an estimator origin as reported by GPS_GLOBAL_ORIGIN."""
        to_local_ned = profile(kind).to_local_ned

        def local(position_m: Vector) -> npt.NDArray[np.floating[Any]]:
            return np.array(to_local_ned(site.to_geodetic(position_m), local_origin))

        offset = local((0.0, 0.0, 0.0))
        columns = [
            (local(axis) - offset) / _PROBE_M
            for axis in ((_PROBE_M, 0.0, 0.0), (0.0, _PROBE_M, 0.0), (0.0, 0.0, _PROBE_M))
        ]
        matrix = np.column_stack(columns)
        return cls(matrix=matrix, inverse=np.linalg.inv(matrix), offset_ned_m=offset)

    def position_to_ned(self, position_m: Vector) -> Vector:
        """Local NED of a point of the site's frame."""
        return _vector(self.matrix @ np.asarray(position_m) + self.offset_ned_m)

    def velocity_to_ned(self, velocity_mps: Vector) -> Vector:
        """Local NED of a velocity in the site's frame."""
        return _vector(self.matrix @ np.asarray(velocity_mps))

    def position_from_ned(self, position_ned_m: Vector) -> Vector:
        """The point of the site's frame at a local NED position."""
        return _vector(self.inverse @ (np.asarray(position_ned_m) - self.offset_ned_m))

    def velocity_from_ned(self, velocity_ned_mps: Vector) -> Vector:
        """The velocity in the site's frame of a local NED velocity."""
        return _vector(self.inverse @ np.asarray(velocity_ned_mps))


def _vector(array: npt.NDArray[np.floating[Any]]) -> Vector:
    return float(array[0]), float(array[1]), float(array[2])
