"""Content of a plan: status, states, cost, metrics and JSON; plans do not disturb each other."""

from __future__ import annotations

import json
import math
import random

import numpy as np
import pytest

from moar_companion import Mission, Planner, PlanStatus, RiskIndices, Weights
from moar_companion.errors import InputError
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.planner import Planner as PlannerItself

from . import oracle
from .problems import CORNERS, conductor, make_site, make_vehicle, polygon, random_problem

EQUAL = Weights.normalised(1.0, 1.0, 1.0)
TIME = Weights(0.0, 1.0, 0.0)

# Status -----------------------------------------------------------------------------------------

WALL = polygon((4.2, -1.0), (4.8, -1.0), (4.8, 20.0), (4.2, 20.0), name="wall")


@pytest.mark.parametrize(
    ("case", "start", "target", "status"),
    [
        ("all is well", (0.5, 0.5), (2.5, 6.5), "found"),
        ("start outside, target outside", (-5.0, 0.5), (99.0, 0.5), "out_of_bounds"),
        ("start outside, target occupied", (-5.0, 0.5), (4.5, 4.5), "out_of_bounds"),
        ("start occupied, target outside", (4.5, 4.5), (99.0, 0.5), "start_occupied"),
        ("start occupied, target occupied", (4.5, 4.5), (4.5, 6.5), "start_occupied"),
        ("target outside, behind the wall", (0.5, 0.5), (99.0, 0.5), "out_of_bounds"),
        ("target occupied", (0.5, 0.5), (4.5, 6.5), "target_occupied"),
        ("target behind the wall", (0.5, 0.5), (8.5, 0.5), "unreachable"),
    ],
)
def test_the_status_is_the_first_that_applies(case, start, target, status):
    site = make_site(WALL, targets={"there": target})
    plan = Planner(site, make_vehicle()).plan(mission="inspection", start=start)
    assert plan.status is PlanStatus(status), case
    document = json.loads(plan.to_json())
    assert document["status"] == status
    if status != "found":
        assert plan.reason
        assert plan.states.shape == (0, 3)
        assert document["states"] == document["waypoints"] == []
        assert document["cost"] is None
        assert document["metrics"] is None


def test_the_reason_names_the_end_that_is_out_of_bounds_and_its_position():
    site = make_site(targets={"splice": (99.0, 0.5)})
    planner = Planner(site, make_vehicle())
    assert "start at (-5, 1)" in planner.plan(mission="inspection", start=(-5.0, 1.0)).reason
    assert "target splice at (99, 0.5)" in planner.plan(mission="inspection").reason


@pytest.mark.parametrize(
    ("start", "strip"),
    [((5.0, 19.9), "z 19.8 to 20"), ((9.95, 5.0), "x 9.9 to 10"), ((5.0, 20.1), None)],
)
def test_the_reason_names_a_point_that_lies_in_no_whole_cell(start, strip):
    site = make_site(size=(10.0, 20.0), resolution=0.3)
    plan = Planner(site, make_vehicle()).plan(mission="inspection", start=start)
    assert plan.status is PlanStatus.OUT_OF_BOUNDS
    uncovered = f"in the strip of the workspace that no whole cell of 0.3 m covers ({strip})"
    assert plan.reason.endswith(uncovered if strip else "is outside the workspace")


def test_an_exit_without_a_free_path_is_unreachable():
    walls = [
        polygon((x, -1.0), (x + 0.4, -1.0), (x + 0.4, 9.0), (x, 9.0), name=f"wall {x}")
        for x in (3.3, 6.3)
    ]
    site = make_site(*walls, start=(5.0, 4.0), exits=[(20.0, 4.0)])
    plan = Planner(site, make_vehicle()).plan(mission=Mission.EXIT)
    assert plan.status is PlanStatus.UNREACHABLE


def test_an_unknown_target_is_an_error_that_lists_the_names():
    site = make_site(targets={"splice-1": (8.5, 6.5), "splice-2": (2.5, 6.5)})
    planner = Planner(site, make_vehicle())
    for ask in (planner.plan, planner.prepare):
        with pytest.raises(InputError, match=r"'splice'.*splice-1, splice-2"):
            ask(mission="inspection", target="splice")


def test_a_site_without_targets_cannot_be_inspected():
    site = make_site(exits=[(20.0, 4.0)])
    site = type(site)(**{name: getattr(site, name) for name in site.__slots__} | {"targets": ()})
    with pytest.raises(InputError, match="none"):
        Planner(site, make_vehicle()).plan(mission="inspection")


# Starts and ends --------------------------------------------------------------------------------


def test_a_start_at_rest_in_the_targets_cell_is_a_plan_of_one_state():
    plan = Planner(make_site(), make_vehicle()).plan(mission="inspection", start=(8.1, 6.9))
    assert plan.states.tolist() == [[8, 6, 0]]
    assert plan.cost.total == 0.0
    assert plan.metrics.length_m == plan.metrics.duration_s == 0.0
    assert plan.metrics.velocity_change_mps == 0.0


def test_a_start_in_the_targets_cell_that_moves_is_a_plan_of_two_states():
    planner = Planner(make_site(conductor(5.0, 4.0)), make_vehicle())
    plan = planner.plan(mission="inspection", start=(8.1, 6.9), velocity=(3.0, -4.0))
    assert plan.states.tolist() == [[8, 6, 0], [8, 6, 0]]
    assert plan.cost.energy == pytest.approx(5.0 / 20.0)
    assert plan.cost.time == plan.cost.safety == 0.0
    assert plan.metrics.velocity_change_mps == pytest.approx(5.0)
    clearance = math.hypot(3.5, 2.5) - 0.03
    assert plan.metrics.mean_clearance_m == pytest.approx(clearance)
    assert plan.metrics.min_clearance_m == pytest.approx(clearance)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (-4.0, 3.0)])
def test_an_exit_that_starts_inside_its_region_is_a_plan_of_one_state(velocity):
    planner = Planner(make_site(exits=[(20.0, 4.5)]), make_vehicle())
    plan = planner.plan(mission="exit", start=(9.5, 4.5), velocity=velocity)
    assert plan.states.tolist() == [[9, 4, 0]]
    assert plan.cost.total == 0.0
    assert plan.landing_leg is not None
    assert plan.metrics.length_m == pytest.approx(plan.landing_leg.length_m)


def test_the_sites_start_first_target_and_the_vehicles_weights_are_the_defaults():
    site = make_site(start=(1.5, 1.5), targets={"first": (8.5, 6.5), "second": (2.5, 6.5)})
    plan = Planner(site, make_vehicle()).plan(mission="inspection")
    assert plan.states[0].tolist() == [1, 1, 0]
    assert plan.states[-1].tolist() == [8, 6, 0]
    assert plan.weights == EQUAL
    assert plan.request.target == "first"


@pytest.mark.parametrize("name", ["start", "velocity"])
@pytest.mark.parametrize("values", [(math.nan, 0.5), (0.5, math.inf)])
def test_a_start_or_velocity_that_is_not_finite_is_one_error_of_the_same_kind(name, values):
    planner = Planner(make_site(), make_vehicle())
    with pytest.raises(InputError, match=f"plan: {name}: is .*, must be finite"):
        planner.plan(mission="inspection", **{name: values})


# Metrics and waypoints --------------------------------------------------------------------------


def test_the_metrics_of_a_straight_flight_by_hand():
    # Nine cells east at 1 m, under a conductor that limits nothing: d_obs is at least 5 m.
    site = make_site(conductor(5.5, 6.0, 0.5), start=(0.5, 0.5), targets={"t": (9.5, 0.5)})
    plan = Planner(site, make_vehicle()).plan(mission="inspection", weights=TIME)
    assert plan.states.tolist() == [
        [0, 0, 0],
        *([column, 0, 3] for column in range(1, 10)),
        [9, 0, 0],
    ]
    assert plan.cost.time == pytest.approx(0.9)
    assert plan.cost.energy == pytest.approx(1.0), "10 m/s up and down again, over 2 v_MAX"
    assert plan.cost.safety == 0.0
    assert plan.cost.total == pytest.approx(0.9)
    metrics = plan.metrics
    assert metrics.length_m == pytest.approx(9.0)
    assert metrics.duration_s == pytest.approx(0.9)
    assert metrics.velocity_change_mps == pytest.approx(20.0)
    clearances = [math.hypot(column - 5.0, 5.5) - 0.5 for column in range(10)]
    assert metrics.mean_clearance_m == pytest.approx(sum(clearances[1:]) / 9.0)
    assert metrics.min_clearance_m == pytest.approx(5.0)
    waypoints = plan.waypoints
    assert waypoints.position_m[:, 0] == pytest.approx([*np.arange(0.5, 10.0), 9.5])
    assert waypoints.speed_mps == pytest.approx([0.0, *[10.0] * 9, 0.0])
    assert waypoints.time_s == pytest.approx([*np.arange(10) * 0.1, 0.9])


def test_the_least_clearance_includes_the_start():
    # The start is next to the conductor, all else is farther.
    site = make_site(conductor(0.5, 2.0, 0.1), start=(0.5, 0.5), targets={"t": (9.5, 0.5)})
    plan = Planner(site, make_vehicle()).plan(mission="inspection", weights=TIME)
    assert plan.metrics.min_clearance_m == pytest.approx(1.4)


@pytest.mark.parametrize(
    ("velocity", "change"),
    [((0.0, 0.0), 20.0), ((10.0, 0.0), 10.0), ((-10.0, 0.0), 30.0), ((10.0, 5.0), 15.0)],
)
def test_velocity_change_counts_from_the_velocity_at_the_start(velocity, change):
    site = make_site(targets={"t": (9.5, 0.5)})
    plan = Planner(site, make_vehicle()).plan(mission="inspection", velocity=velocity, weights=TIME)
    assert plan.metrics.velocity_change_mps == pytest.approx(change)
    assert plan.cost.energy == pytest.approx(change / 20.0)
    assert plan.waypoints.speed_mps[0] == pytest.approx(math.hypot(*velocity))


# Equal costs ------------------------------------------------------------------------------------


@pytest.mark.parametrize("weights", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.5, 0.0)])
def test_in_the_open_paths_go_straight(weights):
    # With k_S = 1 every path costs nothing: time and energy choose. (With k_E = 1 slow diagonals
    # are cheaper than the fast straight line.)
    site = make_site(size=(30.0, 20.0), start=(2.5, 10.5), targets={"t": (27.5, 10.5)})
    plan = Planner(site, make_vehicle()).plan(mission="inspection", weights=Weights(*weights))
    assert plan.states[1:-1, 2].tolist() == [3] * 25
    assert plan.metrics.length_m == pytest.approx(25.0)


def test_a_vehicle_that_flies_away_from_its_target_turns_without_a_needless_stop():
    # At a reversal, an intermediate stop costs neither energy nor time.
    site = make_site(start=(5.5, 0.5), targets={"t": (1.5, 0.5)})
    for weights in CORNERS[:2]:
        plan = Planner(site, make_vehicle()).plan(
            mission="inspection", velocity=(4.0, 0.0), weights=Weights(*weights)
        )
        assert plan.states[:, 2].tolist() == [0, 7, 7, 7, 7, 0]


def test_on_a_plateau_of_the_safety_cost_time_and_energy_are_least():
    rng = random.Random("plateau")
    compared = 0
    while compared < 15:
        problem = random_problem(rng)
        maps = oracle.build_maps(problem.site, problem.vehicle)
        problem = type(problem)(
            **{name: getattr(problem, name) for name in problem.__dataclass_fields__}
            | {"weights": Weights(1.0, 0.0, 0.0)}
        )
        try:
            plan = problem.ask(Planner(problem.site, problem.vehicle))
        except InputError:
            continue
        if plan.cost is None or len(plan.states) < 4:
            continue
        compared += 1
        j, least, actions = oracle.shortest(problem, maps, oracle.goal_of(problem, maps))
        assert plan.cost.total == pytest.approx(j, rel=0.0, abs=1e-9 * max(1.0, j))
        assert plan.cost.time + plan.cost.energy == pytest.approx(least, rel=1e-9)
        assert len(plan.states) - 1 == actions


@pytest.mark.parametrize("prepared", [False, True])
def test_of_equal_costs_an_action_more_does_not_outweigh_a_fraction_of_a_millisecond(prepared):
    # The diagonal, one action less, takes 0.4 ms more time and energy than up and across.
    speeds = (3.0, 2.0, 2.0, 0.8310801747487039, 2.5)
    vehicle = make_vehicle(speeds=speeds, max_speed=4.0)
    planner = Planner(make_site(targets={"t": (1.5, 1.5)}), vehicle)
    if prepared:
        planner.prepare(mission="inspection")
    plan = planner.plan(mission="inspection", weights=Weights(1.0, 0.0, 0.0))
    assert plan.cost.total == 0.0
    assert plan.cost.time + plan.cost.energy == pytest.approx(1.909027242766332, abs=1e-12)


@pytest.mark.parametrize(("landing_z", "row"), [(1.5, 2), (6.5, 6)])
@pytest.mark.parametrize("prepared", [False, True])
def test_of_equal_exit_paths_the_one_with_the_shortest_landing_leg_is_flown(
    landing_z, row, prepared
):
    # Up and down to the border cost the same energy and time.
    site = make_site(start=(7.5, 4.5), exits=[(20.0, landing_z)])
    planner = Planner(site, make_vehicle())
    if prepared:
        planner.prepare(mission="exit")
    plan = planner.plan(mission="exit", weights=Weights(0.0, 0.0, 1.0))
    assert plan.states[-1, :2].tolist() == [9, row]


@pytest.mark.parametrize("weights", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.5, 0.5)])
@pytest.mark.parametrize("prepared", [False, True])
def test_where_safety_has_no_weight_safety_decides_between_equal_costs(weights, prepared):
    # Over and under the conductor cost the same time and energy; what falls on it does damage.
    site = make_site(conductor(5.5, 4.5), start=(1.5, 4.5), targets={"t": (9.5, 4.5)})
    planner = Planner(site, make_vehicle())
    if prepared:
        planner.prepare(mission="inspection")
    plan = planner.plan(mission="inspection", weights=Weights(*weights))
    assert plan.states[:, 1].min() < 4


# JSON -------------------------------------------------------------------------------------------


def test_the_json_has_every_key_of_the_contract():
    planner = Planner(make_site(conductor(5.0, 4.0)), make_vehicle())
    document = json.loads(planner.plan(mission="inspection").to_json())
    assert set(document) >= {
        "site", "mission", "target", "status", "resolution_m", "v_max_mps", "heading_speed_mps",
        "headings", "risk", "weights", "cost", "start_velocity_mps", "states", "waypoints",
        "metrics", "compute",
    }  # fmt: skip
    assert document["mission"] == "inspection"
    assert document["target"] == "target"
    assert document["headings"] == [list(step) for step in oracle.DIRECTIONS]
    assert document["heading_speed_mps"] == [0.0, 1.5, 2.5, 10.0, 2.5, 1.5, 2.5, 10.0, 2.5]
    assert document["v_max_mps"] == 10.0
    assert set(document["risk"]) == {"wind", "communication", "localization", "battery"}
    assert set(document["weights"]) == {"safety", "time", "energy"}
    assert set(document["cost"]) == {"total", "safety", "time", "energy"}
    assert document["start_velocity_mps"] == [0.0, 0.0]
    assert set(document["waypoints"][0]) == {"x_m", "z_m", "speed_mps", "time_s"}
    assert len(document["waypoints"]) == len(document["states"])
    assert set(document["metrics"]) == {
        "length_m", "duration_s", "mean_clearance_m", "min_clearance_m", "velocity_change_mps",
    }  # fmt: skip
    assert set(document["compute"]) == {"map_ms", "search_ms", "expanded"}
    assert document["compute"]["search_ms"] is None  # the planner has no clock of its own
    assert all(isinstance(value, int) for state in document["states"] for value in state)


def test_risks_shift_the_weights_of_the_vehicle_or_those_given():
    """Eq. 9, as `plan --risk` applies it."""
    vehicle, risk = make_vehicle(), RiskIndices(wind=0.7)
    site, given = make_site(exits=[(20.0, 4.5)], evacuations=[(-20.0, 4.5)]), Weights(0.2, 0.5, 0.3)
    planner = Planner(site, vehicle)
    for mission in Mission:
        plan = planner.plan(mission=mission, risk=risk)
        assert plan.weights == vehicle.weights[mission].adjusted(risk)
    assert planner.plan(mission="exit", weights=given, risk=risk).weights == given.adjusted(risk)


def test_the_json_repeats_the_given_risk_and_the_weights_shifted_by_the_risk():
    weights, risk = Weights(0.43, 0.14, 0.43), RiskIndices(wind=0.25, battery=1.0)
    shifted = weights.adjusted(risk)
    planner = Planner(make_site(), make_vehicle())
    document = planner.plan(mission="inspection", weights=weights, risk=risk).to_dict()
    assert document["weights"] == pytest.approx(
        {"safety": shifted.safety, "time": shifted.time, "energy": shifted.energy}
    )
    assert document["risk"]["wind"] == 0.25
    assert document["risk"]["battery"] == 1.0


@pytest.mark.parametrize("mission", list(Mission))
@pytest.mark.parametrize("start", [(0.5, 0.5), (8.5, 6.5), (9.5, 4.5)])
def test_without_obstacles_clearances_are_infinite_and_null_in_json(mission, start):
    site = make_site(exits=[(20.0, 4.5)], evacuations=[(-20.0, 4.5)])
    plan = Planner(site, make_vehicle()).plan(mission=mission, start=start)
    assert math.isinf(plan.metrics.min_clearance_m)
    assert math.isinf(plan.metrics.mean_clearance_m)
    text = plan.to_json()
    assert "Infinity" not in text
    assert "NaN" not in text
    metrics = json.loads(text)["metrics"]
    assert metrics["min_clearance_m"] is None
    assert metrics["mean_clearance_m"] is None
    assert metrics["length_m"] is not None


# One planner, many plans ------------------------------------------------------------------------


def test_a_plan_does_not_depend_on_earlier_plans():
    rng = random.Random("caching")
    for _ in range(6):
        base = random_problem(rng)
        shared = Planner(base.site, base.vehicle)
        for _ in range(12):
            other = random_problem(rng)
            mission = rng.choice(list(Mission))
            question = {
                "mission": mission,
                "target": rng.choice(["near", "far"]) if mission is Mission.INSPECTION else None,
                "start": tuple(
                    low + rng.random() * (high - low)
                    for low, high in zip(
                        base.site.workspace.lower_m, base.site.workspace.upper_m, strict=True
                    )
                ),
                "velocity": other.velocity_mps,
                "weights": other.weights,
            }
            answers = []
            for planner in (shared, Planner(base.site, base.vehicle)):
                try:
                    document = planner.plan(**question).to_dict()
                except InputError as error:
                    document = {"error": str(error)}
                document.pop("compute", None)
                answers.append(document)
            assert answers[0] == answers[1]


def test_later_plans_do_not_change_earlier_ones():
    site = make_site(conductor(5.0, 4.0), exits=[(20.0, 4.0)])
    planner = Planner(site, make_vehicle())
    first = {mission: planner.plan(mission=mission) for mission in ("inspection", "exit")}
    before = {mission: plan.to_json() for mission, plan in first.items()}
    for weights in CORNERS:
        for mission in ("inspection", "exit"):
            planner.plan(
                mission=mission, start=(9.0, 1.0), velocity=(1.0, 2.0), weights=Weights(*weights)
            )
    for mission, plan in first.items():
        assert plan.to_json() == before[mission]


def test_preparing_changes_no_plan():
    site = make_site(conductor(5.0, 4.0), exits=[(20.0, 4.0)])
    prepared, plain = Planner(site, make_vehicle()), Planner(site, make_vehicle())
    for mission in ("inspection", "exit"):
        prepared.prepare(mission=mission)
        one, other = prepared.plan(mission=mission), plain.plan(mission=mission)
        assert one.states.tolist() == other.states.tolist()
        assert one.cost == other.cost


def test_preparing_a_target_that_is_occupied_or_outside_is_no_error():
    site = make_site(conductor(5.5, 4.5), targets={"in": (5.5, 4.5), "out": (50.0, 4.0)})
    planner = Planner(site, make_vehicle())
    for target, status in (("in", "target_occupied"), ("out", "out_of_bounds")):
        planner.prepare(mission="inspection", target=target)
        assert planner.plan(mission="inspection", target=target).status.value == status


def test_the_package_offers_the_planner_itself():
    assert Planner is PlannerItself


# Requests ---------------------------------------------------------------------------------------


def request(start_m, velocity_mps):
    return PlanRequest(
        mission=Mission.INSPECTION,
        target=None,
        start_m=start_m,
        velocity_mps=velocity_mps,
        weights=EQUAL,
        risk=RiskIndices(),
    )


def test_a_start_and_a_velocity_of_different_dimensions_are_refused():
    with pytest.raises(ValueError, match="do not agree"):
        request((1.0, 2.0), (0.0, 0.0, 0.0))


def test_a_start_or_velocity_that_is_not_finite_is_refused_by_name():
    with pytest.raises(InputError, match=r"start.*must be finite"):
        request((1.0, math.inf), (0.0, 0.0))
    with pytest.raises(InputError, match=r"velocity.*must be finite"):
        request((1.0, 2.0), (math.nan, 0.0))


def test_a_velocity_without_a_finite_square_is_refused():
    with pytest.raises(InputError, match=r"velocity.*must be within"):
        request((1.0, 2.0), (1e200, 0.0))
