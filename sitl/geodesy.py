"""The true world on WGS84, and the flat maps of autopilots.

Two frames that must not be confused. The truth is metres north, east, down of home on the WGS84
ellipsoid. An autopilot's local position is its own projection of its estimated latitude and
longitude. They differ by up to 0.5 % of the distance, which a companion has to respect.
"""

import math
from dataclasses import dataclass

WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)
SPHERE_RADIUS_M = 6371000.0
"""Radius that PX4's map projection uses (CONSTANTS_RADIUS_OF_EARTH)."""
FLAT_RADIUS_M = 6378100.0
"""Radius by which ArduPilot scales degrees (LOCATION_SCALING_FACTOR)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Geodetic:
    """A place: WGS84 degrees, and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


def around_deg(angle_deg: float) -> float:
    """Return the angle, -180 to 180: a longitude, or the difference of two."""
    return math.remainder(angle_deg, 360.0)


class TrueFrame:
    """Metres north, east, down of home, by the radii of curvature at home (WGS84)."""

    def __init__(self, home: Geodetic) -> None:
        """Take the radii at home; good to a millimetre a kilometre away."""
        self.home = home
        sin_lat = math.sin(math.radians(home.latitude_deg))
        w2 = 1.0 - WGS84_E2 * sin_lat * sin_lat
        meridian_m = WGS84_A_M * (1.0 - WGS84_E2) / (w2 * math.sqrt(w2))
        normal_m = WGS84_A_M / math.sqrt(w2)
        height_m = home.altitude_amsl_m
        self.deg_per_m_north = math.degrees(1.0 / (meridian_m + height_m))
        self.deg_per_m_east = math.degrees(
            1.0 / ((normal_m + height_m) * math.cos(math.radians(home.latitude_deg)))
        )

    def geodetic(self, north_m: float, east_m: float, down_m: float) -> Geodetic:
        """Return the place of a point given in metres from home."""
        return Geodetic(
            latitude_deg=self.home.latitude_deg + north_m * self.deg_per_m_north,
            longitude_deg=around_deg(self.home.longitude_deg + east_m * self.deg_per_m_east),
            altitude_amsl_m=self.home.altitude_amsl_m - down_m,
        )

    def ned(self, place: Geodetic) -> tuple[float, float, float]:
        """Return metres north, east, down of home."""
        return (
            (place.latitude_deg - self.home.latitude_deg) / self.deg_per_m_north,
            around_deg(place.longitude_deg - self.home.longitude_deg) / self.deg_per_m_east,
            self.home.altitude_amsl_m - place.altitude_amsl_m,
        )


class SphereProjection:
    """PX4's MapProjection: azimuthal equidistant on a sphere of 6371 km, about an origin."""

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        """Set the origin."""
        self.latitude_deg = latitude_deg
        self.longitude_deg = longitude_deg
        self._lat = math.radians(latitude_deg)
        self._lon = math.radians(longitude_deg)
        self._sin = math.sin(self._lat)
        self._cos = math.cos(self._lat)

    def project(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres north and east of the origin on the map."""
        lat = math.radians(latitude_deg)
        d_lon = math.radians(longitude_deg) - self._lon
        sin_lat, cos_lat, cos_d_lon = math.sin(lat), math.cos(lat), math.cos(d_lon)
        c = math.acos(max(-1.0, min(1.0, self._sin * sin_lat + self._cos * cos_lat * cos_d_lon)))
        k = c / math.sin(c) if c > 0.0 else 1.0
        k *= SPHERE_RADIUS_M
        return (
            k * (self._cos * sin_lat - self._sin * cos_lat * cos_d_lon),
            k * cos_lat * math.sin(d_lon),
        )

    def reproject(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude (degrees) of a point on the map."""
        x, y = north_m / SPHERE_RADIUS_M, east_m / SPHERE_RADIUS_M
        c = math.hypot(x, y)
        if c == 0.0:
            return self.latitude_deg, self.longitude_deg
        sin_c, cos_c = math.sin(c), math.cos(c)
        lat = math.asin(cos_c * self._sin + x * sin_c * self._cos / c)
        lon = self._lon + math.atan2(y * sin_c, c * self._cos * cos_c - x * self._sin * sin_c)
        return math.degrees(lat), around_deg(math.degrees(lon))


class FlatProjection:
    """ArduPilot's local frame: degrees times one radius, longitude by the middle latitude's cosine.

    As its Location::get_distance_NE does it.
    """

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        """Set the origin."""
        self.latitude_deg = latitude_deg
        self.longitude_deg = longitude_deg

    def project(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres north and east of the origin."""
        middle_rad = math.radians((latitude_deg + self.latitude_deg) / 2.0)
        east_rad = math.radians(around_deg(longitude_deg - self.longitude_deg))
        return (
            math.radians(latitude_deg - self.latitude_deg) * FLAT_RADIUS_M,
            east_rad * FLAT_RADIUS_M * math.cos(middle_rad),
        )

    def reproject(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude (degrees) of a place in the frame."""
        latitude_deg = self.latitude_deg + math.degrees(north_m / FLAT_RADIUS_M)
        middle_rad = math.radians((latitude_deg + self.latitude_deg) / 2.0)
        east_rad = east_m / (FLAT_RADIUS_M * math.cos(middle_rad))
        return latitude_deg, around_deg(self.longitude_deg + math.degrees(east_rad))
