"""The document of a site file, in the same form for all surveys, and its text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from ...planner.site_frame import SiteFrame

Document = dict[str, Any]

MIN_ALTITUDE_M = 2.0
POLYGON_KEEP_OUT_M = 0.3


class SurveyError(Exception):
    """A survey without a usable site; the text has the reason."""


@dataclass(frozen=True, kw_only=True)
class SiteOptions:
    """Options of the site's layout."""

    name: str = "surveyed site"
    standoff_m: float = 4.0
    resolution_m: float = 0.3
    slab_m: float = 3.0
    """Greatest distance from the plane of points that stand in it."""
    margin_m: float = 12.0
    """Workspace beside the outer conductors."""
    headroom_m: float = 8.0
    """Workspace above the highest conductor."""
    radius_m: float = 0.02
    """Radius of a wire, which no scan shows."""
    keep_out_m: float = 0.5
    """Keep-out beyond three standard deviations of a conductor's place. Sag changes with current
    and temperature, and the survey's own position has an error of decimetres."""
    reach_m: float = 500.0
    """Greatest distance of points on a map from the target, and between points of a conductor:
    farther ones are mistakes, such as latitude and longitude in the wrong order."""


def site_document(
    options: SiteOptions,
    frame: SiteFrame,
    *,
    x_m: tuple[float, float],
    z_m: tuple[float, float],
    obstacles: list[Document],
    start: Document,
    targets: Document,
    landing: Mapping[str, list[Document]],
    ground_m: Iterable[tuple[float, float]] = (),
) -> Document:
    """The document of a site file; x_m, z_m: the workspace. ground_m: profile; empty: level."""
    ground = [[round(x, 2), round(z, 2)] for x, z in ground_m]
    return {
        "name": options.name,
        "frame": {
            "origin": {
                "latitude_deg": round(frame.origin.latitude_deg, 8),
                "longitude_deg": round(frame.origin.longitude_deg, 8),
                "altitude_amsl_m": round(frame.origin.altitude_amsl_m, 3),
            },
            "azimuth_deg": round(frame.azimuth_deg, 4),
        },
        "workspace": {
            "x_m": [float(each) for each in x_m],
            "z_m": [float(each) for each in z_m],
            "resolution_m": options.resolution_m,
            "min_altitude_m": MIN_ALTITUDE_M,
        },
        **({"ground": ground} if ground else {}),
        "obstacles": obstacles,
        "start": start,
        "targets": targets,
        "landing": dict(landing),
    }


def place(x_m: float, z_m: float) -> Document:
    """A point of the plane, as in the file."""
    return {"x_m": round(float(x_m), 2), "z_m": round(float(z_m), 2)}


def polygon(
    name: str, vertices: Iterable[tuple[float, float]], keep_out_m: float | None = None
) -> Document:
    """An obstacle of this outline; without a keep-out of its own it takes that of all outlines."""
    rounded = [[round(float(x), 2), round(float(z), 2)] for x, z in vertices]
    kept_m = POLYGON_KEEP_OUT_M if keep_out_m is None else keep_out_m
    return {"polygon": {"name": name, "vertices_m": rounded, "keep_out_m": kept_m}}


def site_text(document: Mapping[str, Any], remarks: Iterable[str]) -> str:
    """YAML of a site, its remarks as comments at the head."""
    lines = [f"# {remark}" for remark in remarks]
    for key, value in document.items():
        if isinstance(value, list):
            lines += ["", f"{key}:", *(f"  - {_flow(item)}" for item in value)]
        elif key in ("frame", "targets", "landing"):
            lines += [
                "",
                f"{key}:",
                *(f"  {_flow(name)}: {_flow(each)}" for name, each in value.items()),
            ]
        else:
            lines += ["", f"{key}: {_flow(value)}"] if lines else [f"{key}: {_flow(value)}"]
    return "\n".join(lines) + "\n"


def _flow(value: object) -> str:
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=1_000_000, allow_unicode=True
    )
    return str(text).removesuffix("\n").removesuffix("...").strip()
