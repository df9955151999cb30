"""Files of point clouds, packet captures included, in metres around a place on the map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..planner.site_frame import radii_of_curvature_m
from ..types import GeodeticPoint
from .options import require
from .packet_captures import read_capture

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    FloatArray = npt.NDArray[np.float64]

_EXTRA = "lidar"
_REACH_M = 250.0
"""Points within this distance of the place are used: a span."""
_PROBE = 1e-4
_BESIDE_AREA_DEG = 2.0
"""Longitude beside a coordinate system's area: a country in two zones is mapped in one of them."""
_ORIGIN_REACH_DEG = 0.02
"""Two numbers this near to --origin's latitude and longitude are these, no metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """Points as in a file. crs: pyproj's, None where the file names none."""

    file: str
    points: FloatArray
    crs: Any


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalCloud:
    """Points in metres, x east, y north, z up, around a place: at is where x = y = z = 0."""

    points_m: FloatArray
    at: GeodeticPoint
    target_height_m: float | None


def read_cloud(
    file: str, crs: str | None, metadata: str | None = None, port: int | None = None
) -> Cloud:
    """The points of a file; raises InputError.

    metadata, port: of a packet capture, as `read_capture` takes them.
    """
    ending = Path(file).suffix.lower()
    readers: dict[str, Callable[[str], tuple[FloatArray, Any]]] = {
        ".las": _las,
        ".laz": _las,
        ".ply": _ply,
        ".pcd": _pcd,
        ".npz": _npz,
        ".xyz": _xyz,
        ".txt": _xyz,
        ".csv": _xyz,
    }
    captures = (".pcap", ".pcapng")
    for option, value in (("--metadata", metadata), ("--port", port)):
        if value is not None and ending not in captures:
            raise InputError(option, "", f"is for a packet capture: {' or '.join(captures)}")
    readers |= dict.fromkeys(captures, lambda name: (read_capture(name, metadata, port), None))
    if ending not in readers:
        raise InputError(file, "", f"ends in {ending!r}, must end in one of {', '.join(readers)}")
    if not Path(file).is_file():
        raise InputError(file, "", "is no file")
    points, named = readers[ending](file)
    import numpy as np  # noqa: PLC0415

    good = np.isfinite(points).all(axis=1)
    points = np.ascontiguousarray(points[good])
    if len(points) < 100:
        raise InputError(file, "", f"has {len(points)} points, must have 100 or more")
    return Cloud(file=file, points=points, crs=named if crs is None else _crs("--crs", crs))


def height_notes(cloud: Cloud) -> tuple[str, ...]:
    """Remarks on the heights; none where they are above mean sea level, or unnamed."""
    axes = cloud.crs.axis_info if cloud.crs is not None else []
    if len(axes) < 3 or "ellipsoid" not in axes[2].name.lower():
        return ()
    note = (
        f"heights of {cloud.crs.name} are above the ellipsoid, and are taken as above mean sea "
        "level: correct altitude_amsl_m by the geoid's height there"
    )
    return (note,)


def around(
    cloud: Cloud, at: tuple[float, ...], origin: tuple[float, ...] | None, reach_m: float = _REACH_M
) -> LocalCloud:
    """The points around a place: LAT,LON of the map, or X,Y[,Z] as the file has them.

    origin: latitude, longitude and height AMSL of the file's 0, 0, 0, where it has no coordinate
    system: x east, y north, in metres. With it, three numbers are always as in the file.
    """
    if cloud.crs is None and origin is None:
        raise InputError(
            cloud.file,
            "",
            "names no coordinate system: needs --crs EPSG:…, or --origin LAT,LON,ALT of its 0,0,0",
        )
    local = _around_crs(cloud, at) if origin is None else _around_origin(cloud, at, origin)
    import numpy as np  # noqa: PLC0415

    distance = np.hypot(*local.points_m[:, :2].T)
    near = distance <= reach_m
    if near.sum() < 100 or distance.min() > 50.0:
        raise InputError(
            "--at",
            ",".join(f"{each:g}" for each in at),
            f"is {distance.min():.0f} m from the nearest point; {_extent(cloud)}",
        )
    return LocalCloud(
        points_m=local.points_m[near], at=local.at, target_height_m=local.target_height_m
    )


def _around_origin(cloud: Cloud, at: tuple[float, ...], origin: tuple[float, ...]) -> LocalCloud:
    import numpy as np  # noqa: PLC0415

    from ..planner.site_frame import SiteFrame  # noqa: PLC0415

    if abs(origin[0]) > 90.0 or abs(origin[1]) > 180.0:
        raise InputError(
            "--origin", ",".join(f"{each:g}" for each in origin), "is no latitude and longitude"
        )
    place = GeodeticPoint(
        latitude_deg=origin[0], longitude_deg=origin[1], altitude_amsl_m=origin[2]
    )
    frame = SiteFrame(origin=place, azimuth_deg=90.0)
    x, y = at[:2]
    near_origin = max(abs(x - origin[0]), abs(place.east_deg(y))) <= _ORIGIN_REACH_DEG
    if len(at) == 2 and (near_origin or not _inside(cloud, x, y)):
        x, y = frame.place_of(at[0], at[1])
    offset = np.array([x, y, 0.0])
    return LocalCloud(
        points_m=cloud.points - offset,
        at=frame.to_geodetic((x, y, 0.0)),
        target_height_m=at[2] if len(at) > 2 else None,
    )


def _around_crs(cloud: Cloud, at: tuple[float, ...]) -> LocalCloud:
    require(cloud.file, "pyproj", _EXTRA)
    import numpy as np  # noqa: PLC0415
    import pyproj  # noqa: PLC0415

    horizontal = cloud.crs.sub_crs_list[0] if cloud.crs.is_compound else cloud.crs
    to_map = pyproj.Transformer.from_crs(horizontal, "EPSG:4326", always_xy=True)
    if horizontal.is_geographic or not _inside(cloud, *at[:2]):
        if abs(at[0]) > 90.0 or abs(at[1]) > 180.0:
            raise InputError(
                "--at", ",".join(f"{each:g}" for each in at), f"is not there; {_extent(cloud)}"
            )
        x, y = to_map.transform(at[1], at[0], direction="INVERSE")
    else:
        x, y = at[:2]
    # Metres east and north per unit of the file's coordinates, here.
    step = _PROBE if horizontal.is_geographic else 1.0
    longitude, latitude = to_map.transform(
        np.array([x, x + step, x - step, x, x]), np.array([y, y, y, y + step, y - step])
    )
    if not np.isfinite(latitude).all():
        raise InputError(cloud.file, "", f"has points outside of {cloud.crs.name}: is --crs right?")
    _refuse_outside(cloud, horizontal, float(latitude[0]), float(longitude[0]))
    meridian_m, prime_vertical_m = radii_of_curvature_m(float(latitude[0]))
    longitude = longitude[0] + (longitude - longitude[0] + 180.0) % 360.0 - 180.0
    east = np.radians(longitude) * prime_vertical_m * math.cos(math.radians(latitude[0]))
    north = np.radians(latitude) * meridian_m
    to_metres = np.array(
        [[east[1] - east[2], east[3] - east[4]], [north[1] - north[2], north[3] - north[4]]]
    ) / (2.0 * step)
    height = _height_unit_m(cloud.crs)
    offset = cloud.points[:, :2] - (x, y)
    if horizontal.is_geographic:
        offset[:, 0] = (offset[:, 0] + 180.0) % 360.0 - 180.0
    return LocalCloud(
        points_m=np.column_stack((offset @ to_metres.T, cloud.points[:, 2] * height)),
        at=GeodeticPoint(
            latitude_deg=float(latitude[0]), longitude_deg=float(longitude[0]), altitude_amsl_m=0.0
        ),
        target_height_m=at[2] * height if len(at) > 2 else None,
    )


def _refuse_outside(cloud: Cloud, horizontal: Any, latitude: float, longitude: float) -> None:
    """Raises InputError for a place that a projected coordinate system is not made for."""
    import pyproj  # noqa: PLC0415

    area = horizontal.area_of_use
    if area is None and (code := horizontal.to_epsg()) is not None:  # a file's has none
        area = pyproj.CRS.from_epsg(code).area_of_use
    if area is None or not horizontal.is_projected:
        return
    width_deg = (area.east - area.west) % 360.0 or 360.0  # it may reach over 180°
    beside_deg = (longitude - area.west + _BESIDE_AREA_DEG) % 360.0
    if not area.south <= latitude <= area.north or beside_deg > width_deg + 2.0 * _BESIDE_AREA_DEG:
        raise InputError(
            cloud.file,
            "",
            f"would be at {latitude:.2f}, {longitude:.2f}, outside of the area of "
            f"{horizontal.name} (latitude {area.south:g} to {area.north:g}, longitude "
            f"{area.west:g} to {area.east:g}): is --crs right?",
        )


def _height_unit_m(crs: Any) -> float:
    """Metres per unit of height: that of the third axis, else of the plane's axes."""
    axes = crs.axis_info
    if len(axes) > 2:
        return float(axes[2].unit_conversion_factor)
    return 1.0 if crs.is_geographic else float(axes[0].unit_conversion_factor)


def _inside(cloud: Cloud, x: float, y: float) -> bool:
    low, high = cloud.points[:, :2].min(axis=0), cloud.points[:, :2].max(axis=0)
    margin = 0.2 * float((high - low).max())
    return bool(
        (low[0] - margin <= x <= high[0] + margin) and (low[1] - margin <= y <= high[1] + margin)
    )


def _extent(cloud: Cloud) -> str:
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    return (
        f"the file has x {low[0]:.0f} to {high[0]:.0f}, y {low[1]:.0f} to {high[1]:.0f}, "
        f"z {low[2]:.0f} to {high[2]:.0f}"
    )


def _crs(source: str, text: str) -> Any:
    require(source, "pyproj", _EXTRA)
    import pyproj  # noqa: PLC0415

    allowed = "must be a coordinate system such as EPSG:28992"
    try:
        crs = pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.CRSError:
        raise InputError(source, "", f"is {text!r}, {allowed}") from None
    if not (crs.is_projected or crs.is_geographic):
        raise InputError(
            source, "", f"is {text!r} ({crs.name}), neither projected nor geographic: {allowed}"
        )
    return crs


def _las(file: str) -> tuple[FloatArray, Any]:
    require(file, "laspy", _EXTRA)
    import laspy  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    try:
        cloud = laspy.read(file)
        crs = cloud.header.parse_crs()
    except Exception as error:  # noqa: BLE001 -- whatever a damaged file makes of its reader
        raise InputError(file, "", f"cannot be read as LAS: {error}") from None
    return np.column_stack((cloud.x, cloud.y, cloud.z)), crs


def _ply(file: str) -> tuple[FloatArray, Any]:
    require(file, "plyfile", _EXTRA)
    import numpy as np  # noqa: PLC0415
    import plyfile  # noqa: PLC0415

    try:
        vertices = plyfile.PlyData.read(file)["vertex"]
        columns = [np.asarray(vertices[axis], dtype=float) for axis in "xyz"]
    except Exception as error:  # noqa: BLE001
        raise InputError(file, "", f"cannot be read as PLY: {error}") from None
    return np.column_stack(columns), None


def _pcd(file: str) -> tuple[FloatArray, Any]:
    require(file, "pypcd4", _EXTRA)
    import pypcd4  # noqa: PLC0415

    try:
        points = pypcd4.PointCloud.from_path(file).numpy(("x", "y", "z"))
    except Exception as error:  # noqa: BLE001
        reason = str(error).partition("\n")[0]  # its header's validator lists every field
        raise InputError(file, "", f"cannot be read as PCD: {reason}") from None
    return points.astype(float), None


def _npz(file: str) -> tuple[FloatArray, Any]:
    import zipfile  # noqa: PLC0415

    import numpy as np  # noqa: PLC0415

    if not zipfile.is_zipfile(file):
        raise InputError(file, "", "cannot be read as NPZ: is no zip archive")
    try:
        with np.load(file, allow_pickle=False) as content:
            named = {"points", "xyz"} & set(content.files)
            name = (sorted(named) or content.files or ["points"])[0]
            points = np.asarray(content[name], dtype=float)
    except Exception as error:  # noqa: BLE001
        raise InputError(file, "", f"cannot be read as NPZ: {error}") from None
    if points.ndim != 2 or points.shape[1] < 3:
        raise InputError(file, name, f"has the shape {points.shape}, must be (n, 3)")
    return points[:, :3], None


def _xyz(file: str) -> tuple[FloatArray, Any]:
    import numpy as np  # noqa: PLC0415

    try:
        text = Path(file).read_text()
        if not text.strip():
            raise InputError(file, "", "is empty")
        head = text.splitlines()[0]
        comma = "," if "," in head else None
        header = 0 if all(_is_number(word) for word in head.split(comma)) else 1
        points = np.loadtxt(
            file, delimiter=comma, skiprows=header, usecols=(0, 1, 2), ndmin=2, comments=("#", "//")
        )
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        raise InputError(file, "", f"cannot be read as x y z per line: {error}") from None
    return points, None


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
