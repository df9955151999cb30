"""Conductors in real airborne scans: our detector and open peers on the same points, in one run.

    python -m tests.benchmarks.conductors [--plot FOLDER]

The author of the scans has labelled them (wire 14, tower 15). The peers are sequential RANSAC with
the line or curve of each library, on the points 4 m above the ground:
- pyransac3d: Line (straight; 0.5 m)
- scikit-learn: RANSACRegressor of lateral position and height over the length, degree 2
- Open3D: segment_plane, as vertical planes (it has no line), then clusters of 2 m
Each removes the points of a found model, up to 60 times, until a model has less than 30 points.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit

from moar_companion.perception.ground import ground_height_m
from moar_companion.perception.spans import PointClass, find_power_line

DATA = Path(__file__).parents[3] / "shared/data/lidar_powerline"
WIRE, TOWER = 14, 15
ROUNDS, LEAST = 60, 30


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    for file in sorted(DATA.glob("*.laz")):
        points_m, labels = load(file)
        say(f"{file.name}: {len(points_m)} points, {(labels == WIRE).sum()} of wires")
        started = time.perf_counter()
        line = find_power_line(points_m)
        took_s = time.perf_counter() - started
        wires = np.isin(line.classes, (PointClass.CONDUCTOR, PointClass.EARTH_WIRE))
        report("moar-companion", took_s, wires, labels == WIRE)
        tower = line.classes == PointClass.TOWER
        report("  towers", 0.0, tower, labels == TOWER)
        heights(points_m, labels, line)
        high = np.flatnonzero(points_m[:, 2] - ground_height_m(points_m) >= 4.0)
        for name, peer in PEERS.items():
            try:
                started = time.perf_counter()
                found = peer(points_m[high] - points_m.mean(axis=0))
                took_s = time.perf_counter() - started
            except ImportError as error:
                say(f"  {name:16} not installed ({error})")
                continue
            marked = np.zeros(len(points_m), dtype=bool)
            marked[high[found]] = True
            report(name, took_s, marked, labels == WIRE)
        if options.plot:
            draw(points_m, labels, line, options.plot / f"{file.stem}.png")


def say(text: str) -> None:
    """Print one line."""
    sys.stdout.write(text + "\n")


def load(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points and their labels."""
    import laspy

    cloud = laspy.read(file)
    return np.column_stack((cloud.x, cloud.y, cloud.z)), np.asarray(cloud.classification)


def report(name: str, took_s: float, found: np.ndarray, labelled: np.ndarray) -> None:
    """Print one row."""
    good = (found & labelled).sum()
    say(
        f"  {name:16} {took_s:6.2f} s, precision {good / max(found.sum(), 1):.4f}, "
        f"recall {good / labelled.sum():.4f}"
    )


def heights(points_m: np.ndarray, labels: np.ndarray, line) -> None:
    """Print each conductor: its height against a catenary fitted to the labelled points near it."""
    wire_m = points_m[labels == WIRE]
    for number, span in enumerate(line.spans, 1):
        phases = [each for circuit in span.circuits for each in circuit]
        say(
            f"  span {number}: {len(span.circuits)} circuits of "
            f"{[len(circuit) for circuit in span.circuits]}, {len(span.earth_wires)} earth wires"
        )
        for kind, members in (("phase", phases), ("earth wire", span.earth_wires)):
            for conductor in members:
                curve = conductor.curve
                at = curve.coordinates(wire_m)
                inside = (at[:, 0] > curve.extent_m[0]) & (at[:, 0] < curve.extent_m[1])
                near = at[inside]
                near = near[np.hypot(*curve.residuals(near).T) < 0.6]
                middle = np.mean(curve.extent_m)
                start = (near[:, 2].min(), 0.0, 1700.0)
                best, _ = curve_fit(catenary, near[:, 0] - middle, near[:, 2], start)
                along = np.linspace(*curve.extent_m, 100)
                ours = curve.points_at(along)[:, 2] - curve.origin_m[2]
                error = ours - catenary(along - middle, *best)
                say(
                    f"    {kind:10} {curve.length_m:6.1f} m, {len(conductor.wires)} wires, "
                    f"{len(conductor.inliers):5} points, constant {curve.constant_m:6.0f} m, "
                    f"height error {np.sqrt(np.mean(error**2)):.3f} m rms, "
                    f"confidence {conductor.confidence:.2f}"
                )


def catenary(along: np.ndarray, lowest: float, shift: float, constant: float) -> np.ndarray:
    """Height of a catenary."""
    return lowest + constant * (np.cosh((along - shift) / constant) - 1.0)


def lines_of_pyransac3d(points_m: np.ndarray) -> np.ndarray:
    """Points on straight lines."""
    import pyransac3d

    def once(rest: np.ndarray) -> np.ndarray:
        return np.asarray(pyransac3d.Line().fit(rest, thresh=0.5, maxIteration=500)[2])

    return sequential(points_m, once)


def curves_of_scikit_learn(points_m: np.ndarray) -> np.ndarray:
    """Points on parabolas over the main direction."""
    from sklearn.linear_model import LinearRegression, RANSACRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures

    flat = points_m[:, :2] - points_m[:, :2].mean(axis=0)
    turned = flat @ np.linalg.svd(flat, full_matrices=False)[2].T
    given = np.column_stack((turned, points_m[:, 2]))

    def once(rest: np.ndarray) -> np.ndarray:
        model = RANSACRegressor(
            make_pipeline(PolynomialFeatures(2), LinearRegression()),
            min_samples=4,
            residual_threshold=0.5,
            max_trials=500,
            loss=lambda true, reported: np.hypot(*(true - reported).T),
            random_state=0,
        )
        model.fit(rest[:, :1], rest[:, 1:])
        return np.flatnonzero(model.inlier_mask_)

    return sequential(given, once)


def planes_of_open3d(points_m: np.ndarray) -> np.ndarray:
    """Points in vertical planes, in clusters longer than high."""
    import open3d

    open3d.utility.random.seed(0)

    def once(rest: np.ndarray) -> np.ndarray:
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(rest))
        model, inside = cloud.segment_plane(0.5, 3, 1000)
        inside = np.asarray(inside)
        if abs(model[2]) > 0.2:
            return inside[:0]
        groups = np.asarray(cloud.select_by_index(inside).cluster_dbscan(2.0, 3))
        good = [
            inside[groups == group]
            for group in range(groups.max() + 1)
            if np.hypot(*np.ptp(rest[inside[groups == group], :2], axis=0)) > 10.0
        ]
        return np.concatenate(good) if good else inside[:0]

    return sequential(points_m, once)


def sequential(points_m: np.ndarray, once: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Indices of what one model after the other takes out."""
    free = np.arange(len(points_m))
    found = []
    for _ in range(ROUNDS):
        inside = once(points_m[free])
        if len(inside) < LEAST:
            break
        found.append(free[inside])
        free = np.delete(free, inside)
    return np.concatenate(found) if found else free[:0]


PEERS = {
    "pyransac3d": lines_of_pyransac3d,
    "scikit-learn": curves_of_scikit_learn,
    "Open3D": planes_of_open3d,
}


def draw(points_m: np.ndarray, labels: np.ndarray, line, file: Path) -> None:
    """Side view and plan view: what was found, what was missed, what was wrongly taken."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    axis = max(
        (each for span in line.spans for each in span.conductors),
        key=lambda each: len(each.inliers),
    ).curve
    at = axis.coordinates(points_m)
    figure, axes = plt.subplots(2, 1, figsize=(16, 10))
    colours = {2: "0.85", 5: "tab:green", 13: "tab:orange", 14: "tab:blue", 15: "0.3"}
    found = np.isin(line.classes, (13, 14))
    for which, column in zip(axes, (2, 1), strict=True):
        for kind, colour in colours.items():
            part = line.classes == kind
            which.scatter(at[part, 0], at[part, column], s=0.3, c=colour)
        missed, wrong = (labels == WIRE) & ~found, (labels != WIRE) & found
        which.scatter(at[missed, 0], at[missed, column], s=9, c="red", marker="x", lw=0.5)
        which.scatter(at[wrong, 0], at[wrong, column], s=9, c="magenta", marker="+", lw=0.5)
    figure.tight_layout()
    figure.savefig(file, dpi=65)


if __name__ == "__main__":
    main()
