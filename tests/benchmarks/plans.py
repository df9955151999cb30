"""Time of maps and plans at the paper's two sizes: `.venv/bin/python -m tests.benchmarks.plans`.

Every call has another start, velocity and weights; the field of the goal is therefore made anew in
each. Times are of `Planner.plan` as a user calls it (whole) and of its search alone.
"""

from __future__ import annotations

import dataclasses
import sys
import time

import numpy as np

from moar_companion import Mission, Planner, PlanStatus, Site, Vehicle, Weights
from moar_companion.config import shipped_configs

CALLS = 2000
SITE, VEHICLE = "315kv_double_circuit.yaml", "linedrone.yaml"
SIZES_M = {"13.5 x 15 m": (8.25, 2.5, 21.75, 17.5), "30 x 20 m": (0.0, 0.0, 30.0, 20.0)}


def sites() -> dict[str, Site]:
    """The shipped double circuit, whole and as a window of the paper's smaller size."""
    whole = Site.load(shipped_configs() / "sites" / SITE)
    found = {}
    for name, (left, bottom, right, top) in SIZES_M.items():
        space = dataclasses.replace(
            whole.workspace, lower_m=(left, bottom), upper_m=(right, top), min_altitude_m=None
        )
        found[name] = dataclasses.replace(whole, workspace=space)
    return found


def measure(site: Site, vehicle: Vehicle) -> list[str]:
    """Rows of a table for one site."""
    random = np.random.default_rng(1)
    builds = []
    for _ in range(50):
        began = time.perf_counter()
        planner = Planner(site, vehicle)
        builds.append(1e3 * (time.perf_counter() - began))
    lower, upper = np.array(planner.maps.grid.lower_m), np.array(planner.maps.grid.upper_m)
    states = planner.maps.occupied.size * len(planner.graph.offset)
    rows = [f"| maps and graph, {states // 1000}k states | {_spread(builds)} | |"]
    target = next(t.name for t in site.targets if planner.maps.grid.cell_of(t.position_m))
    for mission in Mission:
        whole, search = [], []
        for _ in range(CALLS):
            start = tuple(random.uniform(lower, upper))
            weights = Weights.normalised(*random.dirichlet((1.0, 1.0, 1.0)))
            began = time.perf_counter()
            plan = planner.plan(
                mission=mission,
                target=target if mission is Mission.INSPECTION else None,
                start=start,
                velocity=tuple(random.normal(0.0, 2.0, 2)),
                weights=weights,
            )
            took = 1e3 * (time.perf_counter() - began)
            if plan.status is PlanStatus.FOUND:
                whole.append(took)
                search.append(plan.compute.search_ms)
        rows.append(f"| {mission.value} | {_spread(whole)} | {_spread(search)} |")
    return rows


def _spread(times_ms: list[float]) -> str:
    median, high = np.percentile(times_ms, [50, 99])
    return f"{median:.2f} / {high:.2f}"


def main() -> None:
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / VEHICLE)
    for name, site in sites().items():
        sys.stdout.write(
            f"\n{name}: ms, median / p99\n\n| what | whole call | search |\n|---|---|---|\n"
        )
        sys.stdout.write("\n".join(measure(site, vehicle)) + "\n")


if __name__ == "__main__":
    main()
