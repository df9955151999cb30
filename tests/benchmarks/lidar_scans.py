"""The simulated lidar: how far conductors are seen, how well placed, and how often falsely.

    python -m tests.benchmarks.lidar_scans [--minutes 10]

A VLP-16 (600 rpm, noise 0.02 m, 2 % of echoes lost) on an aircraft that sways by 3°, whose position
has noise of 0.05 m per pose.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from sitl.lidar import Box, LidarScene, Wire
from tests.perception.live import watch
from tests.perception.test_scan_conductors import TOWER, WOOD

DISTANCES_M = (40.0, 35.0, 30.0, 27.5, 25.0, 22.5, 20.0, 17.5, 15.0, 12.5, 10.0, 7.5, 5.0)
HEIGHT_M = 20.0
FLIGHT = {"tilt_rad": 0.05, "position_noise_m": 0.05}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    options = parser.parse_args()
    say("| conductor, mm | can be seen up to, m | found from, m | greatest error at ≤ 15 m, m |")
    say("|---|---|---|---|")
    for diameter_m in (0.010, 0.015, 0.020, 0.030, 0.040):
        wire = Wire(
            start_m=(0.0, -100.0, HEIGHT_M), end_m=(0.0, 100.0, HEIGHT_M), diameter_m=diameter_m
        )
        found_m, errors_m = 0.0, [0.0]
        for distance_m in DISTANCES_M:
            place = (-distance_m, 0.0, HEIGHT_M - 1.0)
            for seen in watch(LidarScene(wires=(wire,)), place, 2.0, seed=1, **FLIGHT):
                if seen.tracks:
                    found_m = max(found_m, distance_m)
                if distance_m <= 15.0:
                    errors_m += [np.hypot(t.x_m, t.z_m - HEIGHT_M) for t in seen.tracks]
        say(
            f"| {diameter_m * 1e3:.0f} | {wire.visible_m:.1f} | {found_m:.1f} | "
            f"{max(errors_m):.3f} |"
        )
    house = Box(lower_m=(-30.0, -8.0, 0.0), upper_m=(-20.0, 8.0, 9.0))
    scene = LidarScene(trees=WOOD, wires=TOWER, boxes=(house,), rain_per_m=0.001)
    seen = list(watch(scene, (0.0, 0.0, 8.0), 60.0 * options.minutes, seed=2, **FLIGHT))
    cost_ms = [each.cost_s * 1e3 for each in seen]
    say(
        f"\nTrees, a tower, a house, rain: {len(seen)} scans of {seen[0].points} points, "
        f"{sum(len(each.sightings) for each in seen)} false sightings, "
        f"{sum(bool(each.tracks) for each in seen)} scans with a false conductor; "
        f"scan to conductors {np.median(cost_ms):.1f} ms, p99 {np.percentile(cost_ms, 99):.1f} ms"
    )


def say(text: str) -> None:
    """Print one line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
