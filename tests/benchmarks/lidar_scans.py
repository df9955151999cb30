"""Live perception on the simulated lidar: distances, errors, false alarms, outliers, cost.

    python -m tests.benchmarks.lidar_scans [--minutes 10]

A VLP-16 (600 rpm, noise 0.02 m, 2 % of echoes lost) on an aircraft that sways by 3°. The position
of the aircraft has noise of 0.05 m per report. Cost: processor time from the last packet of a scan
to the report.
"""

from __future__ import annotations

import argparse
import sys
from time import process_time

import numpy as np

from moar_companion.perception.scan_conductors import sightings
from sitl.lidar import Box, LidarScene, Wire
from tests.perception.live import Flight, Rig
from tests.perception.test_scan_conductors import LINE, TOWER, WOOD

DISTANCES_M = (40.0, 35.0, 30.0, 27.5, 25.0, 22.5, 20.0, 17.5, 15.0, 12.5, 10.0, 7.5, 5.0)
HEIGHT_M = 20.0
HOUSE = Box(lower_m=(-30.0, -8.0, 0.0), upper_m=(-20.0, 8.0, 9.0))


def flight(*at_m: float) -> Flight:
    return Flight(at_m=at_m, tilt_rad=0.05, position_noise_m=0.05)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    options = parser.parse_args()
    distances()
    outliers()
    say("\n| scene | scans | cost, ms: median | p99 | false conductors | changes of polygons |")
    say("|---|---|---|---|---|---|")
    wood = LidarScene(trees=WOOD, wires=TOWER, boxes=(HOUSE,), rain_per_m=0.001)
    watched("trees, tower, house, rain", wood, flight(0.0, 0.0, 8.0), 60.0 * options.minutes, 0)
    line = LidarScene(trees=WOOD, wires=LINE, boxes=(HOUSE,))
    watched("four conductors, trees, house", line, flight(0.0, 0.0, 12.0), 30.0, len(LINE))


def distances() -> None:
    """From where conductors are found, and how well they are placed."""
    say("| conductor, mm | can be seen up to, m | found from, m | greatest error at ≤ 15 m, m |")
    say("|---|---|---|---|")
    for diameter_m in (0.010, 0.015, 0.020, 0.030, 0.040):
        wire = Wire(
            start_m=(0.0, -100.0, HEIGHT_M), end_m=(0.0, 100.0, HEIGHT_M), diameter_m=diameter_m
        )
        found_m, errors_m = 0.0, [0.0]
        for distance_m in DISTANCES_M:
            rig = Rig(LidarScene(wires=(wire,)), flight(-distance_m, 0.0, HEIGHT_M - 1.0), seed=1)
            for report in rig.run(2.0):
                places = [each.position_m for each in report.conductors]
                if places:
                    found_m = max(found_m, distance_m)
                if distance_m <= 15.0:
                    errors_m += [float(np.hypot(x, z - HEIGHT_M)) for x, z in places]
        say(
            f"| {diameter_m * 1e3:.0f} | {wire.visible_m:.1f} | {found_m:.1f} | "
            f"{max(errors_m):.3f} |"
        )


def outliers() -> None:
    """Six conductors of 16 echoes among outliers: recall, false ones, cost of the lines."""
    say("\n| outliers per echo | found of 6 | false | cost, ms: median | p99 |")
    say("|---|---|---|---|---|")
    places = [(x, z) for x in (-6.0, 6.0) for z in (2.0, 6.0, 10.0)]
    for share in (0, 1, 2, 4):
        found, wrong, cost_ms = [], [], []
        for seed in range(100):
            random = np.random.default_rng(seed)
            slope = random.uniform(-0.2, 0.2)
            rings = np.arange(16)
            echoes, ring = [], []
            for x, z in places:
                y = np.hypot(x, z) * np.tan(np.radians(2.0 * rings - 15.0))
                wire = np.column_stack((x + slope * y, y, np.full(16, z)))
                echoes.append(wire + random.normal(0.0, 0.02, wire.shape))
                ring.append(rings)
            count = share * 16 * len(places)
            away = random.uniform((-10.0, 0.0), (10.0, 14.0), (count, 2))
            other = random.integers(0, 16, count)
            beside = np.hypot(*away.T) * np.tan(np.radians(2.0 * other - 15.0))
            echoes.append(np.column_stack((away[:, 0], beside, away[:, 1])))
            ring.append(other)
            begun_s = process_time()
            lines = sightings(
                np.concatenate(echoes), np.concatenate(ring), np.zeros(3),
                np.array([0.0, 1.0, 0.0]), random,
            )  # fmt: skip
            cost_ms.append((process_time() - begun_s) * 1e3)
            seen = [each.crossing_m() for each in lines]
            near = [[np.hypot(x - a, z - b) < 0.15 for x, z in places] for a, b in seen]
            found.append(np.any(near, axis=0).sum() if seen else 0)
            wrong.append(sum(not any(row) for row in near))
        say(
            f"| {share} | {np.mean(found):.2f} | {np.mean(wrong):.2f} | "
            f"{np.median(cost_ms):.1f} | {np.percentile(cost_ms, 99):.1f} |"
        )


def watched(name: str, scene: LidarScene, hover: Flight, seconds: float, expected: int) -> None:
    """One row of a scene that is looked at for long."""
    rig = Rig(scene, hover, seed=2)
    cost_ms, wrong, changes, solids = [], set(), 0, ()
    for report in rig.run(seconds):
        cost_ms.append(rig.cost_s * 1e3)
        wrong |= {each.name for each in report.conductors}
        changes += report.solids != solids
        solids = report.solids
    median_ms, most_ms = np.percentile(cost_ms, (50, 99))
    say(
        f"| {name} | {len(cost_ms)} | {median_ms:.1f} | {most_ms:.1f} | "
        f"{max(len(wrong) - expected, 0)} | {changes} |"
    )


def say(text: str) -> None:
    """Print one line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
