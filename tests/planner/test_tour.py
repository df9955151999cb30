"""The order of visits: against all permutations, on random costs and on random sites."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.planner import tour
from moar_companion.planner.plan_values import PlanRequest, PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.planner.tour import best_order, least_order, leg_plans, order_cost
from moar_companion.settings.config import shipped_configs
from moar_companion.types import Mission, RiskIndices, Weights

from .problems import conductor, make_site, make_vehicle


def least_of_all(costs):
    """The least cost of all permutations."""
    stops = range(len(costs) - 2)
    return min(order_cost(costs, order) for order in itertools.permutations(stops))


def random_costs(rng, count):
    return rng.uniform(1.0, 10.0, (count + 2, count + 2))


def places_costs(rng, count):
    """Distances of random places: what the heuristic meets."""
    places = rng.uniform(0.0, 10.0, (count + 2, 2))
    return np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))


@pytest.mark.parametrize("count", range(8))
def test_the_order_is_the_least_of_all_permutations(count):
    rng = np.random.default_rng(count)
    for _ in range(3 if count < 7 else 1):
        costs = random_costs(rng, count)
        order = least_order(costs)
        assert sorted(order) == list(range(count))
        assert order_cost(costs, order) == pytest.approx(least_of_all(costs), abs=1e-12)


def test_more_stops_are_near_the_least_order(monkeypatch):
    """The heuristic beside Held and Karp, where both can be had."""
    excess = []
    for seed in range(8):
        costs = places_costs(np.random.default_rng(seed), 9)
        exact = order_cost(costs, least_order(costs))
        with monkeypatch.context() as patch:
            patch.setattr(tour, "EXACT_STOPS", 4)
            found = order_cost(costs, least_order(costs))
        excess.append(found / exact - 1.0)
    assert min(excess) >= -1e-12
    assert max(excess) < 0.03


def test_no_reversal_and_no_move_gains_on_a_long_order():
    costs = places_costs(np.random.default_rng(1), 20)
    costs += np.random.default_rng(2).uniform(0.0, 1.0, costs.shape)  # which differ by direction
    order = least_order(costs)
    assert sorted(order) == list(range(20))
    least = order_cost(costs, order)
    for first, last in itertools.combinations(range(21), 2):
        part, rest = order[first:last], order[:first] + order[last:]
        turned = order[:first] + part[::-1] + order[last:]
        assert order_cost(costs, turned) >= least - 1e-6
        for place in range(len(rest) + 1) if len(part) <= 3 else ():
            moved = rest[:place] + part + rest[place:]
            assert order_cost(costs, moved) >= least - 1e-6


# On sites


def request(site, **changes):
    first = PlanRequest(
        mission=Mission.INSPECTION,
        target=None,
        start_m=site.start_m,
        velocity_mps=(0.0, 0.0),
        weights=Weights.normalised(1.0, 1.0, 1.0),
        risk=RiskIndices(),
    )
    return replace(first, **changes)


def total(plans):
    assert all(plan.status is PlanStatus.FOUND for plan in plans)
    return sum(plan.cost.total for plan in plans)


@pytest.mark.parametrize("seed", range(4))
def test_the_tour_of_a_random_site_costs_no_more_than_any_other(seed):
    rng = np.random.default_rng(seed)
    wires = [conductor(*rng.uniform(3.0, 9.0, 2), 0.1) for _ in range(3)]
    planner = Planner(make_site(*wires), make_vehicle())
    free = np.argwhere(~planner.maps.occupied)
    chosen = free[rng.choice(len(free), 8, replace=False)]
    places = [planner.maps.grid.centre_m(tuple(cell)) for cell in chosen.tolist()]
    names = {f"t{index}": place for index, place in enumerate(places[1:])}
    site = make_site(*wires, start=places[0], targets=names, exits=[(20.0, 0.0)])
    planner = Planner(site, make_vehicle())
    asked = request(site, velocity_mps=(1.0, 0.0))
    best = best_order(planner, asked, tuple(names))
    assert sorted(best) == sorted(names)
    cost = {}
    for name, place in {"start": places[0], **names}.items():
        at = {"start": place, "velocity": (1.0, 0.0) if name == "start" else (0.0, 0.0)}
        for other in names.keys() - {name}:
            cost[name, other] = planner.plan(mission="inspection", target=other, **at).cost.total
        cost[name, "out"] = planner.plan(mission="exit", **at).cost.total
    least = min(
        sum(cost[leg] for leg in itertools.pairwise(("start", *order, "out")))
        for order in itertools.permutations(names)
    )
    assert total(leg_plans(planner, asked, best)) == pytest.approx(least, rel=1e-9)


def test_legs_follow_the_order_and_end_outside():
    site = make_site(targets={"near": (2.5, 0.5), "far": (8.5, 0.5)}, exits=[(20.0, 0.0)])
    planner = Planner(site, make_vehicle())
    risk = RiskIndices(wind=1.0)
    plans = leg_plans(planner, request(site, risk=risk), ("far", "near"))
    assert [plan.request.target for plan in plans] == ["far", "near", None]
    assert plans[1].request.start_m == (8.5, 0.5)
    assert plans[2].mission is Mission.EXIT
    base = planner.vehicle.weights[Mission.EXIT]
    assert plans[2].weights == base.adjusted(risk)


def test_a_stop_without_a_path_is_last_and_its_leg_has_the_reason():
    targets = {"inside": (5.5, 5.5), "b": (8.5, 0.5), "a": (2.5, 0.5)}
    site = make_site(conductor(5.5, 5.5, 1.0), targets=targets, start=(1.5, 0.5), exits=[(20.0, 0)])
    planner = Planner(site, make_vehicle())
    assert best_order(planner, request(site), tuple(targets)) == ("a", "b", "inside")
    plans = leg_plans(planner, request(site), ("inside", "a"))
    assert [plan.status for plan in plans] == [
        PlanStatus.TARGET_OCCUPIED,
        PlanStatus.FOUND,
        PlanStatus.FOUND,
    ]
    assert plans[1].request.start_m == site.start_m


@pytest.mark.parametrize("exits", [[], [(5.0, 4.0)]])
def test_without_a_way_out_the_visits_alone_count(exits):
    """No exit on the site, or one that no cell sees."""
    targets = {"b": (8.5, 0.5), "a": (4.5, 0.5)}
    site = make_site(conductor(5.0, 4.0, 0.4), targets=targets, start=(1.5, 0.5), exits=exits)
    assert best_order(Planner(site, make_vehicle()), request(site), ("b", "a")) == ("a", "b")


def test_an_order_that_takes_too_many_plans_is_by_lengths(monkeypatch):
    targets = {"b": (8.5, 0.5), "a": (4.5, 0.5)}
    site = make_site(targets=targets, start=(1.5, 0.5), exits=[(20.0, 0.0)])
    planner = Planner(site, make_vehicle())
    monkeypatch.setattr(tour, "_MOST_WORK", 0)
    monkeypatch.setattr(planner, "solve", None)
    assert best_order(planner, request(site), ("b", "a")) == ("a", "b")


@pytest.mark.parametrize("path", sorted((shipped_configs() / "sites").glob("*.yaml")))
def test_no_tour_of_a_shipped_site_costs_more_than_the_files_order(path):
    site = Site.load(path)
    planner = Planner(site, make_vehicle())
    stops = tuple(target.name for target in site.targets)
    best = best_order(planner, request(site), stops)
    costs = [total(leg_plans(planner, request(site), order)) for order in (best, stops)]
    assert costs[0] <= costs[1]
