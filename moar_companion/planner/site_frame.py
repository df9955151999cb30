"""The frame of a site: its vertical plane on WGS84.

The site is surveyed in true metres, so its plane stands on the WGS84 ellipsoid. Near the origin,
metres per radian are the radii of curvature (within 1e-5 over 100 m).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..types import GeodeticPoint, Vector

_WGS84_SEMI_MAJOR_M = 6_378_137.0
_WGS84_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3


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

    def bearing_rad(self, x_m: float, y_m: float) -> float:
        """Direction from north of a displacement (x, y) in the site's frame."""
        return math.radians(self.azimuth_deg) - math.atan2(y_m, x_m)

    def moved(self, north_m: float, east_m: float, up_m: float) -> SiteFrame:
        """The frame with its origin moved by a displacement in the world."""
        northwards = SiteFrame(origin=self.origin, azimuth_deg=0.0)
        origin = northwards.to_geodetic((north_m, -east_m, up_m))
        return SiteFrame(origin=origin, azimuth_deg=self.azimuth_deg)
