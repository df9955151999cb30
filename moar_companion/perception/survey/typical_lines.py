"""Typical arrangements of conductors by voltage class and circuits, and sites made of them. Pure.

A site of a typical line is a beginning: its conductors have to be surveyed before a flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...planner.site import PlanePoint
from ...planner.site_frame import SiteFrame
from ...types import GeodeticPoint
from .site_document import MIN_ALTITUDE_M, Document, SiteOptions, place, site_document

_LANDING_BESIDE_M = 10.0
"""Distance of the landing points from the workspace, as on the shipped sites."""
_LANDING_HEIGHT_M = 2.5
"""Height of a landing point above the ground, where the landing leg ends higher still."""
_INSIDE_M = 2.0
"""Distance of the start from the workspace's edge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TypicalLine:
    """Conductors and earth wires across a line: (x, z) from its axis and its lowest conductor."""

    text: str
    """Description for people."""
    conductors_m: dict[str, PlanePoint]
    earth_wires_m: dict[str, PlanePoint]
    radius_m: float
    earth_radius_m: float
    source: str


def _levels(*halves_and_heights_m: PlanePoint) -> dict[str, PlanePoint]:
    """Conductors at both sides of the axis in levels: half their distance, and their height."""
    words = ("lower", "middle", "upper")
    return {
        f"{side}-{word}": (sign * half_m, height_m)
        for word, (half_m, height_m) in zip(words, halves_and_heights_m, strict=True)
        for side, sign in (("left", -1.0), ("right", 1.0))
    }


TYPICAL_LINES = {
    "120kv-single": TypicalLine(
        text="120 kV, one circuit at three heights, an earth wire",
        conductors_m={
            "left-lower": (-5.0, 0.0),
            "right-middle": (4.0, 3.0),
            "left-upper": (-3.8, 6.0),
        },
        earth_wires_m={"earth-wire": (0.0, 9.9)},
        radius_m=0.01575,
        earth_radius_m=0.0055,
        source="an Italian 132 kV line (modelica/PowerSystems)",
    ),
    "120kv-double": TypicalLine(
        text="120 kV, two circuits in three levels, an earth wire",
        conductors_m=_levels((4.0, 0.0), (4.0, 4.0), (4.0, 8.0)),
        earth_wires_m={"earth-wire": (0.0, 17.0)},
        radius_m=0.01575,
        earth_radius_m=0.00575,
        source="powerline_gazebo.py of alx87grd/catenary",
    ),
    "315kv-double": TypicalLine(
        text="315 kV, two circuits in three levels",
        conductors_m=_levels((5.83, 0.0), (7.68, 7.29), (5.83, 14.58)),
        earth_wires_m={},
        radius_m=0.0175,
        earth_radius_m=0.0,
        source="ligne315kv_test1 of alx87grd/catenary (arXiv 2506.20812); add the earth wires",
    ),
    "horizontal": TypicalLine(
        text="three conductors in one layer, 8 m apart (assumed)",
        conductors_m={"left": (-8.0, 0.0), "middle": (0.0, 0.0), "right": (8.0, 0.0)},
        earth_wires_m={},
        radius_m=0.0175,
        earth_radius_m=0.0,
        source="towers of Roussel et al. 2021 (PeerJ CS 7:e672); add the earth wires",
    ),
}
"""By the name on the command line."""


def frame_through(place_m: PlanePoint, at: GeodeticPoint, along_deg: float) -> SiteFrame:
    """Frame of the plane across a line, in which a geodetic point is at (x, z).

    along_deg: compass direction in which one looks along the line; +x is to the right.
    """
    there = SiteFrame(origin=at, azimuth_deg=(along_deg + 90.0) % 360.0)
    x_m, z_m = place_m
    origin = there.to_geodetic((-x_m, 0.0, -z_m))
    return SiteFrame(origin=origin, azimuth_deg=there.azimuth_deg)


def typical_site(
    line: TypicalLine, frame: SiteFrame, lowest_m: float, options: SiteOptions
) -> Document:
    """The document of a site with a typical line, z = 0 on level ground, x = 0 below its axis.

    lowest_m: height of the lowest conductor in the plane above that ground.
    """
    wires = [
        {
            "name": name,
            **place(x_m, lowest_m + z_m),
            "radius_m": radius_m,
            "keep_out_m": options.keep_out_m,
        }
        for group_m, radius_m in (
            (line.conductors_m, line.radius_m),
            (line.earth_wires_m, line.earth_radius_m),
        )
        for name, (x_m, z_m) in group_m.items()
    ]
    low_x = math.floor(min(wire["x_m"] for wire in wires) - options.margin_m)
    high_x = math.ceil(max(wire["x_m"] for wire in wires) + options.margin_m)
    high_z = math.ceil(max(wire["z_m"] for wire in wires) + options.headroom_m)
    targets = {}
    for side, sign in (("right", 1.0), ("left", -1.0)):
        # The outermost conductor on this side, the lowest of equal ones: seen from outside.
        name, _ = max(line.conductors_m.items(), key=lambda item: (sign * item[1][0], -item[1][1]))
        targets[f"at-{name}"] = {"conductor": name, "standoff_m": options.standoff_m, "side": side}
    points = [
        place(edge_m + sign * _LANDING_BESIDE_M, _LANDING_HEIGHT_M)
        for edge_m, sign in ((high_x, 1.0), (low_x, -1.0))
    ]
    return site_document(
        options,
        frame,
        x_m=(low_x, high_x),
        z_m=(0.0, high_z),
        obstacles=[{"conductor": wire} for wire in wires],
        start=place(high_x - _INSIDE_M, MIN_ALTITUDE_M + 0.5),
        targets=targets,
        landing={"exit": points[:1], "evacuation": points},
    )
