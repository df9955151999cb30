"""The best order of visits: J and time against the file's, and the processor time of an order.

.venv/bin/python -m tests.benchmarks.tours
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import replace

import numpy as np

from moar_companion.companion.error_margin import flown_site
from moar_companion.planner.plan_values import Plan, PlanRequest
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.planner.tour import best_order, least_order, leg_plans, order_cost
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission, RiskIndices

VEHICLES = ("linedrone_flight", "x500")
STOPS = (2, 4, 6, 8, 10, 12, 16, 24, 36)
RANDOM = 30
"""Random orders of places of each number of stops."""


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")


def first_request(planner: Planner) -> PlanRequest:
    return PlanRequest(
        mission=Mission.INSPECTION,
        target=None,
        start_m=planner.site.start_m,
        velocity_mps=(0.0, 0.0),
        weights=planner.vehicle.weights[Mission.INSPECTION],
        risk=RiskIndices(),
    )


def totals(plans: tuple[Plan, ...]) -> tuple[float, float]:
    """J and time of all legs."""
    costs = [plan.cost for plan in plans if plan.cost is not None]
    assert len(costs) == len(plans)
    return sum(cost.total for cost in costs), sum(cost.time for cost in costs)


def shipped() -> None:
    """Prints J and time of both orders on the shipped sites, as flown."""
    configs = shipped_configs()
    _say("| site | vehicle | J, file's order | best | time, file's order | best |")
    _say("|---|---|---|---|---|---|")
    for file in sorted((configs / "sites").glob("*.yaml")):
        for name in VEHICLES:
            vehicle = Vehicle.load(configs / "vehicles" / f"{name}.yaml")
            planner = Planner(flown_site(Site.load(file), vehicle, Supervision()), vehicle)
            request = first_request(planner)
            stops = tuple(target.name for target in planner.site.targets)
            kept = totals(leg_plans(planner, request, stops))
            best = totals(leg_plans(planner, request, best_order(planner, request, stops)))
            _say(
                f"| {file.stem} | {name} | {kept[0]:.3f} | {best[0]:.3f} | {kept[1]:.1f} s | "
                f"{best[1]:.1f} s |"
            )


def random_stops() -> None:
    """Prints what orders of random places of the 315 kV site save, and their processor time."""
    configs = shipped_configs()
    vehicle = Vehicle.load(configs / "vehicles" / "linedrone_flight.yaml")
    site = Site.load(configs / "sites" / "315kv_double_circuit.yaml")
    planner = Planner(flown_site(site, vehicle, Supervision()), vehicle)
    free = np.argwhere(~planner.maps.occupied)
    rng = np.random.default_rng(1)
    _say("| stops | J saved against a random order | time saved | processor time of the order |")
    _say("|---|---|---|---|")
    for count in STOPS:
        saved, saved_s, took_s = [], [], []
        for _ in range(RANDOM if count <= 12 else 3):
            cells = free[rng.choice(len(free), count, replace=False)]
            targets = tuple(
                replace(
                    site.targets[0], name=str(index), position_m=planner.maps.grid.centre_m(cell)
                )
                for index, cell in enumerate(map(tuple, cells.tolist()))
            )
            planner.set_site(replace(planner.site, targets=targets))
            request, stops = first_request(planner), tuple(item.name for item in targets)
            begun_s = time.process_time()
            order = best_order(planner, request, stops)
            took_s.append(time.process_time() - begun_s)
            kept, best = (totals(leg_plans(planner, request, each)) for each in (stops, order))
            saved.append(1.0 - best[0] / kept[0])
            saved_s.append(1.0 - best[1] / kept[1])
        _say(
            f"| {count} | {statistics.mean(saved):.0%} | {statistics.mean(saved_s):.0%} | "
            f"{1e3 * statistics.median(took_s):.0f} ms |"
        )


def heuristic() -> None:
    """Prints the excess of the heuristic over the exact order, for 12 random places."""
    from moar_companion.planner import tour

    excess = []
    for seed in range(200):
        places = np.random.default_rng(seed).uniform(0.0, 10.0, (14, 2))
        costs = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))
        exact = order_cost(costs, least_order(costs))
        excess.append(order_cost(costs, tour._improved_order(costs)) / exact - 1.0)
    _say(
        f"heuristic against exact, 12 places, 200 times: {np.mean(np.array(excess) < 1e-9):.0%} "
        f"equal, mean excess {np.mean(excess):.2%}, greatest {max(excess):.1%}"
    )


if __name__ == "__main__":
    shipped()
    random_stops()
    heuristic()
