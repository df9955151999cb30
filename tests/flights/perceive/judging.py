"""Distances from true places to the objects of a scene: by NumPy, independent of the planner."""

from __future__ import annotations

import itertools

import numpy as np

from sitl.lidar import LidarScene


def clearance_m(scene: LidarScene, places_m) -> np.ndarray:
    """(n,) from places (n, 3) to the nearest wire, solid or tree; negative inside of one."""
    places_m = np.asarray(places_m, float).reshape(-1, 3)
    nearest_m = np.full(len(places_m), np.inf)
    for wire in scene.wires:
        for start, end in itertools.pairwise(wire.ends()):
            along = end - start
            share = np.clip((places_m - start) @ along / (along @ along), 0.0, 1.0)
            apart_m = np.linalg.norm(places_m - start - share[:, None] * along, axis=1)
            nearest_m = np.minimum(nearest_m, apart_m - wire.diameter_m / 2.0)
    for tree in scene.trees:
        apart_m = np.linalg.norm(places_m - tree.centre_m, axis=1)
        nearest_m = np.minimum(nearest_m, apart_m - tree.radius_m)
    for box in scene.boxes:
        beyond_m = np.maximum(box.lower_m - places_m, places_m - box.upper_m)
        outside_m = np.linalg.norm(np.maximum(beyond_m, 0.0), axis=1)
        nearest_m = np.minimum(nearest_m, outside_m + np.minimum(beyond_m.max(axis=1), 0.0))
    return nearest_m
