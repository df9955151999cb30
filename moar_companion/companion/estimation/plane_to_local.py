"""The map between the site's plane and the autopilot's local NED frame.

The local frame has the projection of its kind of autopilot (`autopilots`). Over 100 m it differs
from true metres by up to 0.3 m, which matters next to a conductor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...mavlink.autopilots import profile
from ...planner.site_frame import SiteFrame
from ...types import AutopilotKind, GeodeticPoint, Vector

_PROBE_M = 10.0
"""Length over which the local frame's scale is taken; any below a kilometre gives the same."""


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

    def moved(self, x_m: float, z_m: float) -> PlaneToLocal:
        """The map for a site's frame that is moved: places of the same point have this added."""
        step = self.matrix @ np.array([x_m, 0.0, z_m])
        return PlaneToLocal(
            matrix=self.matrix, inverse=self.inverse, offset_ned_m=self.offset_ned_m - step
        )

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
