"""A place marked by an aircraft at rest: its reported positions, averaged several times. Pure.

Inputs: positions with the receiver's fix, in the order of arrival. Outputs: the mean of several
means, each over some seconds, and their spread: what drift and noise of the position leave open.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...planner.site_frame import SiteFrame
from ...types import GeodeticPoint

RTK_FIXED = 6
"""GPS_FIX_TYPE_RTK_FIXED."""
MEANS = 5
MEAN_S = 3.0
"""Time of each mean; PX4 and ArduPilot report several positions a second."""
_FEWEST = 3
"""Positions of a mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkedPlace:
    """Mean of the means. horizontal_m, vertical_m: greatest distance of one of them from it."""

    point: GeodeticPoint
    positions: int
    horizontal_m: float
    vertical_m: float

    def __str__(self) -> str:
        return (
            f"{self.point.latitude_deg:.8f}, {self.point.longitude_deg:.8f}, "
            f"{self.point.altitude_amsl_m:.3f} m; {self.positions} positions, spread of the "
            f"{MEANS} means {self.horizontal_m:.3f} m level, {self.vertical_m:.3f} m in height"
        )


class PlaceMarker:
    """Collects positions until there are enough for all means. needs_rtk: others do not count."""

    def __init__(self, *, needs_rtk: bool = True) -> None:
        self._needs_rtk = needs_rtk
        self._groups: list[list[GeodeticPoint]] = [[]]
        self._began_s: float | None = None
        self._last_s = -math.inf
        self.fix_type: int | None = None
        """Last one reported: GPS_FIX_TYPE."""

    @property
    def share(self) -> float:
        """Share of the means that are complete."""
        return (len(self._groups) - 1) / MEANS

    @property
    def done(self) -> bool:
        """True once all means are complete."""
        return len(self._groups) > MEANS

    def add(self, point: GeodeticPoint, received_s: float, fix_type: int | None) -> None:
        """Takes a position; a repeat of the last one, and one without the fix, do not count.

        A lost fix begins the present mean anew.
        """
        self.fix_type = fix_type
        if self.done or received_s <= self._last_s:
            return
        self._last_s = received_s
        if self._needs_rtk and fix_type != RTK_FIXED:
            self._groups[-1].clear()
            self._began_s = None
            return
        if self._began_s is None:
            self._began_s = received_s
        self._groups[-1].append(point)
        if received_s - self._began_s >= MEAN_S and len(self._groups[-1]) >= _FEWEST:
            self._groups.append([])
            self._began_s = None

    def result(self) -> MarkedPlace:
        """The marked place, once `done`."""
        groups = self._groups[:MEANS]
        frame = SiteFrame(origin=groups[0][0], azimuth_deg=90.0)  # x east, y north
        means = np.array([_mean_m(frame, group) for group in groups])
        mean = means.mean(axis=0)
        off = means - mean
        x_m, y_m, z_m = mean.tolist()
        return MarkedPlace(
            point=frame.to_geodetic((x_m, y_m, z_m)),
            positions=sum(map(len, groups)),
            horizontal_m=float(np.hypot(off[:, 0], off[:, 1]).max()),
            vertical_m=float(np.abs(off[:, 2]).max()),
        )


def _mean_m(frame: SiteFrame, points: Sequence[GeodeticPoint]) -> tuple[float, float, float]:
    """Mean of points in metres east, north and up of the frame's origin."""
    level = [frame.place_of(point.latitude_deg, point.longitude_deg) for point in points]
    up = [point.altitude_amsl_m - frame.origin.altitude_amsl_m for point in points]
    x_m, y_m = np.array(level).mean(axis=0).tolist()
    return x_m, y_m, float(np.mean(up))
