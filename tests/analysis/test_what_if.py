"""What-if: its answers are the planner's own, and what it refuses is one line."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.analysis.what_if import MOST_CELLS, WhatIf, corners
from moar_companion.errors import InputError
from moar_companion.planner.analysis.baselines import BaselineKind, baseline
from moar_companion.planner.plan_values import Waypoints
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Margin, Site
from moar_companion.planner.site_view import maps_view, site_view
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import RiskIndices, Weights

SITE_FILE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
MARGIN = Margin(position_m=1.0, tracking_m=0.5)


@pytest.fixture(scope="module")
def what_if():
    text = SITE_FILE.read_text(encoding="utf-8")
    return WhatIf(text=text, source="site.yaml", vehicle=VEHICLE, margin=MARGIN)


def moved_site(what_if):
    """The site with its first conductor a metre farther left."""
    document = copy.deepcopy(what_if.document()["site"])
    document["obstacles"][0]["conductor"]["x_m"] -= 1.0
    return document


def test_without_changes_the_answer_is_the_plan_of_the_site_as_flown(what_if):
    plan = Planner(Site.load(SITE_FILE).flown_with(MARGIN), VEHICLE).plan(
        mission="inspection", target="splice-inner", risk=RiskIndices()
    )
    answer = what_if.answer({"mission": "inspection", "target": "splice-inner"})["plan"]
    assert answer["status"] == "found"
    assert answer["cost"]["total"] == plan.cost.total
    assert answer["metrics"] == plan.metrics.to_dict()
    assert [point[:2] for point in answer["path"]] == pytest.approx(
        np.round(plan.waypoints.position_m, 3)
    )
    assert sum(answer["shares"].values()) == pytest.approx(1.0)
    assert answer["change"] is None


def test_everything_that_a_request_changes_reaches_the_planner(what_if):
    request = {
        "site": moved_site(what_if),
        "mission": "inspection",
        "target": "splice-outer",
        "start_m": [24, 3],
        "velocity_mps": [0.5, 0.0],
        "risk": {"wind": 0.4, "battery": 0.1},
        "weights": {"safety": 2, "time": 1, "energy": 1},
        "d_min_m": 1.0,
        "d_max_m": 4.0,
        "margin_m": 0.25,
    }
    site = Site.of_document(request["site"], "test").flown_with(Margin(position_m=0.25))
    vehicle = replace(VEHICLE, safety=replace(VEHICLE.safety, d_min_m=1.0, d_max_m=4.0))
    plan = Planner(site, vehicle).plan(
        mission="inspection",
        target="splice-outer",
        start=(24.0, 3.0),
        velocity=(0.5, 0.0),
        weights=Weights(0.5, 0.25, 0.25),
        risk=RiskIndices(wind=0.4, battery=0.1),
    )
    answer = what_if.answer(request)["plan"]
    assert answer["cost"]["total"] == plan.cost.total
    assert answer["weights"]["safety"] == plan.weights.safety
    assert answer["change"] is not None


def test_maps_are_those_of_the_changed_site(what_if):
    site = moved_site(what_if)
    shown = what_if.answer({"site": site, "parts": ["maps"]})["maps"]
    flown = Site.of_document(site, "test").flown_with(MARGIN)
    assert shown["site"] == site_view(flown)
    assert shown["maps"] == maps_view(Planner(flown, VEHICLE).maps)


def test_baselines_are_those_of_the_paper(what_if):
    planner = Planner(Site.load(SITE_FILE).flown_with(MARGIN), VEHICLE)
    plan = planner.plan(mission="inspection", target="splice-inner", risk=RiskIndices())
    shown = what_if.answer({"target": "splice-inner", "parts": ["baselines"]})["baselines"]
    for kind in BaselineKind:
        found = baseline(planner, kind, plan.request)
        assert shown[kind.value]["metrics"] == found.metrics.to_dict()


def test_each_path_of_the_front_is_the_optimum_for_the_weights_of_its_region(what_if):
    front = what_if.answer({"target": "splice-outer", "parts": ["front"]})["front"]
    assert len(front) > 3
    assert sum(area(point["region"]) for point in front) == pytest.approx(0.5, abs=1e-3)
    for point in front[:: max(1, len(front) // 8)]:
        middle = np.mean(point["region"], axis=0)
        weights = dict(zip(("safety", "time", "energy"), middle.tolist(), strict=True))
        answer = what_if.answer({"target": "splice-outer", "weights": weights})["plan"]
        sums = {name: answer["cost"][name] for name in weights}
        assert sums == pytest.approx(point["sums"], rel=1e-6)


def area(region):
    """The area of a polygon of weights over k_T and k_E."""
    x, z = np.array(region)[:, 1:].T
    return 0.5 * abs(float(x @ np.roll(z, -1) - z @ np.roll(x, -1)))


def test_alternatives_have_other_risks_and_both_escapes(what_if):
    shown = what_if.answer({"parts": ["alternatives"]})["alternatives"]
    assert {"no risk", "exit", "evacuation"} <= {item["name"] for item in shown}
    assert all(item["path"] for item in shown if item["status"] == "found")
    only = what_if.answer({"mission": "exit", "parts": ["alternatives"]})["alternatives"]
    assert [item["name"] for item in only if item["mission"] != "exit"] == ["evacuation"]


def test_a_site_whose_landing_points_no_cell_sees_has_no_escape(what_if):
    site = moved_site(what_if)
    wall = [[34.0, -5.0], [35.0, -5.0], [35.0, 40.0], [34.0, 40.0]]
    site["obstacles"].append({"polygon": {"name": "wall", "vertices_m": wall}})
    site["landing"]["evacuation"] = site["landing"]["exit"]
    shown = what_if.answer({"site": site, "parts": ["alternatives"]})["alternatives"]
    assert {item["mission"] for item in shown} == {"inspection"}


def test_a_problem_without_a_path_is_a_status_with_its_reason(what_if):
    answer = what_if.answer({"start_m": [-50, 3], "parts": ["baselines", "front", "alternatives"]})
    assert answer["plan"]["status"] == "out_of_bounds"
    assert "is outside the workspace" in answer["plan"]["reason"]
    assert answer["plan"]["path"] == []
    assert answer["front"] == []
    json.dumps(answer, allow_nan=False)


def test_a_site_without_obstacles_has_numbers_alone(what_if):
    site = {**moved_site(what_if), "obstacles": [], "targets": {"t": {"x_m": 5, "z_m": 15}}}
    answer = what_if.answer({"site": site, "parts": ["maps", "baselines", "alternatives"]})
    assert answer["plan"]["metrics"]["min_clearance_m"] is None
    json.dumps(answer, allow_nan=False)


def test_maps_are_made_again_only_for_another_site_or_vehicle(what_if):
    what_if.answer({})
    before = what_if._planner
    what_if.answer({"risk": {"wind": 1}, "start_m": [26, 3]})
    assert what_if._planner is before
    what_if.answer({"d_max_m": 5})
    assert what_if._planner is not before


@pytest.mark.parametrize(
    ("request_", "line"),
    [
        ({"mission": "survey"}, "what-if: mission: "),
        ({"target": "nowhere"}, "no target 'nowhere'"),
        ({"risk": {"wind": 1.5}}, "what-if: risk.wind: "),
        ({"weights": {"safety": 0, "time": 0, "energy": 0}}, "weights: are all 0"),
        ({"d_min_m": 5}, "d_min_m: is 5, must be less than d_max_m (3)"),
        ({"start_m": [math.nan, 0]}, "start_m[0]: "),
        ({"start_m": [1]}, "what-if: start_m: "),
        ({"site": {"name": "x"}}, "what-if: "),
        ({"surprise": 1}, "what-if: surprise: "),
        ({"parts": ["everything"]}, "what-if: parts[0]: "),
        ({"velocity_mps": [5000, 0]}, "velocity"),
        ([], "what-if"),
    ],
)
def test_a_request_that_cannot_be_understood_is_refused_in_one_line(what_if, request_, line):
    with pytest.raises(InputError, match=r"^[^\n]+$") as refused:
        what_if.answer(request_)
    assert line in str(refused.value)


def test_a_site_of_too_many_cells_is_refused(what_if):
    site = moved_site(what_if)
    site["workspace"] = {"x_m": [0, 600], "z_m": [0, 400], "resolution_m": 0.5}
    with pytest.raises(InputError, match=f"has 960000 cells, {MOST_CELLS} are allowed here"):
        what_if.answer({"site": site})


def test_corners_keep_turns_and_returns_on_the_same_line():
    place = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [2, 1], [2, 1]], dtype=float)
    nothing = np.zeros(len(place))
    path = Waypoints(position_m=place, speed_mps=nothing, time_s=nothing)
    assert corners(path)[:3] == [[0, 0], [2, 0], [2, 2]]
    assert corners(path)[-1] == [2, 1]
