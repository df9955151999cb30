"""Time of maps, tables and plans: `.venv/bin/python -m tests.benchmarks.plans`.

Tables on stdout, and a picture `sizes.png` in the folder of `--out`: plans by number of states.
Every call has another start, velocity and weights; the extremes of the weights are among them.
Times are those of `Planner.plan` as a user calls it, in processor time of its thread: other load of
the machine does not count. Of three passes over all calls, the least time of each call counts.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from moar_companion import Mission, Planner, PlanStatus, Site, Vehicle, Weights
from moar_companion.settings.config import shipped_configs

CALLS, REPEATS, BUILDS = 2000, 3, 50
SITE, VEHICLE = "315kv_double_circuit.yaml", "linedrone.yaml"
SIZES_M = {"13.5 x 15 m": (8.25, 2.5, 21.75, 17.5), "30 x 20 m": (0.0, 0.0, 30.0, 20.0)}
SCALES_M = (0.98, 0.51, 0.3, 0.146, 0.073)
"""Cell sizes of 30 x 20 m with about 5k, 20k, 60k, 250k and a million states."""
SCALE_CALLS = 100
"""Number of calls of each mission and size."""
SWEEP = 21
"""Levels of each weight in the sweep of the paper (Section V-A)."""
EXTREMES = [Weights(*corner) for corner in np.eye(3).tolist()]
Call = dict[str, Any]


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


def problems(planner: Planner, mission: Mission, count: int) -> list[Call]:
    """Problems of a mission that have a path, each from another start and with other weights."""
    random = np.random.default_rng(1)
    lower, upper = np.array(planner.maps.grid.lower_m), np.array(planner.maps.grid.upper_m)
    found = []
    for number in range(count):
        weights = Weights.normalised(*random.dirichlet((1.0, 1.0, 1.0)))
        call = {
            "mission": mission,
            "target": goal_of(planner, mission),
            "start": tuple(random.uniform(lower, upper)),
            "velocity": tuple(random.normal(0.0, 2.0, 2)),
            "weights": EXTREMES[number // 20 % 3] if number % 20 == 0 else weights,
        }
        if planner.plan(**call).status is PlanStatus.FOUND:
            found.append(call)
    return found


def goal_of(planner: Planner, mission: Mission) -> str | None:
    """The first target in the workspace; any landing point."""
    if mission is not Mission.INSPECTION:
        return None
    in_sight = planner.maps.grid.cell_of
    return next(t.name for t in planner.site.targets if in_sight(t.position_m))


def least_ms(work: Callable[[], object], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        began = time.thread_time()
        work()
        times.append(time.thread_time() - began)
    return 1e3 * min(times)


def plan_times_ms(planner: Planner, calls: list[Call]) -> list[float]:
    runs = []
    for _ in range(REPEATS):
        times = []
        for call in calls:
            began = time.thread_time()
            planner.plan(**call)
            times.append(1e3 * (time.thread_time() - began))
        runs.append(times)
    return np.min(runs, axis=0).tolist()


def measure(name: str, site: Site, vehicle: Vehicle) -> list[str]:
    """Rows for one site: maps, and each mission without tables and with them."""
    planner = Planner(site, vehicle)
    states = planner.maps.occupied.size * len(planner.graph.offset)
    build = [least_ms(lambda: Planner(site, vehicle)) for _ in range(BUILDS)]
    first = site.obstacles[0]
    places = itertools.cycle([0.1 * step for step in range(7)])

    def move() -> None:
        x_m, z_m = first.position_m
        moved = dataclasses.replace(first, position_m=(x_m + next(places), z_m))
        planner.set_obstacles((moved, *site.obstacles[1:]))

    def look_up() -> None:
        for mission in site.landing_m:
            planner._goal((mission, None))

    moves = [least_ms(move) for _ in range(BUILDS)]
    regions = [least_ms(lambda: (move(), look_up()), 1) for _ in range(BUILDS)]
    planner.set_obstacles(site.obstacles)
    rows = [
        f"| {name}, {states // 1000}k states: maps and graph | {_spread(build)} |",
        f"| … one obstacle moved | {_spread(moves)} |",
        f"| … and both goal regions | {_spread(regions)} |",
    ]
    whole: dict[str, list[float]] = {"cold": [], "with tables": []}
    for mission in Mission:
        calls = problems(planner, mission, CALLS)
        cold = plan_times_ms(planner, calls)
        goal = {"mission": mission, "target": goal_of(planner, mission)}
        tables_ms = least_ms(partial(planner.prepare, **goal), 1)
        warm = plan_times_ms(planner, calls)
        rows += [
            f"| … {mission.value}, cold | {_spread(cold)} |",
            f"| … {mission.value}, tables made | {tables_ms:.0f} |",
            f"| … {mission.value}, with tables | {_spread(warm)} |",
        ]
        whole["cold"] += cold
        whole["with tables"] += warm
    rows += [f"| … all missions, {what} | {_spread(times)} |" for what, times in whole.items()]
    return rows


def scaling(site: Site, vehicle: Vehicle) -> dict[int, dict[str, list[float]]]:
    """Times (ms) by number of states: plans of all missions for cells of several sizes."""
    found = {}
    for resolution_m in SCALES_M:
        space = dataclasses.replace(site.workspace, resolution_m=resolution_m)
        planner = Planner(dataclasses.replace(site, workspace=space), vehicle)
        times: dict[str, list[float]] = {"cold": [], "with tables": []}
        for mission in Mission:
            calls = problems(planner, mission, SCALE_CALLS)
            times["cold"] += plan_times_ms(planner, calls)
            planner.prepare(mission=mission, target=goal_of(planner, mission))
            times["with tables"] += plan_times_ms(planner, calls)
        found[planner.maps.occupied.size * len(planner.graph.offset)] = times
    return found


def draw_sizes(found: dict[int, dict[str, list[float]]], path: Path) -> None:
    """Median and 99th percentile by number of states, and a line in proportion to it."""
    states = np.array(list(found))
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    for what, colour in (("cold", "tab:blue"), ("with tables", "tab:orange")):
        spreads = [np.percentile(times[what], [50, 99]) for times in found.values()]
        median, high = np.transpose(spreads)
        axes.plot(states, median, "o-", color=colour, label=f"{what}, median")
        axes.plot(states, high, "^--", color=colour, label=f"{what}, p99")
        if what == "cold":
            straight = median[0] * states / states[0]
            axes.plot(states, straight, color="grey", linewidth=0.8, label="in proportion")
    axes.set(xscale="log", yscale="log", xlabel="states", ylabel="processor time of a plan (ms)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=100)


def sweep(site: Site, vehicle: Vehicle) -> str:
    """All weights of the paper's sweep, but for 0, 0, 0, from the site's start."""
    planner = Planner(site, vehicle)
    levels = np.linspace(0.0, 1.0, SWEEP)
    chosen = [
        Weights.normalised(*each)
        for each in itertools.product(levels.tolist(), repeat=3)
        if sum(each) > 0.0
    ]
    began = time.thread_time()
    planner.prepare(mission=Mission.INSPECTION)
    for weights in chosen:
        planner.plan(mission=Mission.INSPECTION, weights=weights)
    return f"{len(chosen)} weights, tables included: {time.thread_time() - began:.2f} s"


def first_plan_s() -> list[float]:
    """From the start of the command line to its end, with a warm cache."""
    site = shipped_configs() / "sites" / SITE
    words = [sys.executable, "-m", "moar_companion", "plan", str(site), "--mission", "exit"]
    times = []
    for _ in range(5):
        began = time.perf_counter()
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - began)
    return times


def _spread(times_ms: list[float]) -> str:
    median, high = np.percentile(times_ms, [50, 99])
    return f"{median:.3f} / {high:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder of sizes.png")
    options = parser.parse_args()
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / VEHICLE)
    found = sites()
    whole = found["30 x 20 m"]
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n\n")
    sys.stdout.write("| what | ms, median / p99 |\n|---|---|\n")
    for name, site in found.items():
        sys.stdout.write("\n".join(measure(name, site, vehicle)) + "\n")
    sizes = scaling(whole, vehicle)
    sys.stdout.write(
        "\n| states | cold, ms, median / p99 | cold, ns per state | with tables, ms |\n"
    )
    sys.stdout.write("|---|---|---|---|\n")
    for states, times in sizes.items():
        cold, warm = times["cold"], times["with tables"]
        sys.stdout.write(
            f"| {states // 1000}k | {_spread(cold)} | {1e6 * np.mean(cold) / states:.1f} | "
            f"{_spread(warm)} |\n"
        )
    sys.stdout.write("\n")
    options.out.mkdir(parents=True, exist_ok=True)
    draw_sizes(sizes, options.out / "sizes.png")
    sys.stdout.write(sweep(whole, vehicle) + "\n")
    times = first_plan_s()
    sys.stdout.write(f"command line: {np.median(times):.2f} s (least {min(times):.2f} s)\n")


if __name__ == "__main__":
    main()
