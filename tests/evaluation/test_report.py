"""Tables, figures and the report."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import image

from moar_companion.analysis.evaluation import adaptability, experiments, flight, sensitivity
from moar_companion.analysis.evaluation.experiments import Results
from moar_companion.analysis.evaluation.figures.drawing import Picture
from moar_companion.analysis.evaluation.report import text
from moar_companion.analysis.evaluation.scenes import SWEPT
from moar_companion.analysis.evaluation.tables import scene_table
from moar_companion.types import Mission

EVACUATIONS = [scene for scene in SWEPT if scene.mission is Mission.EVACUATION]
CLIMB = {"time_s": [0.0, 10.0, 40.0], "places_m": [[2.2, 2.2], [2.2, 6.2], [8.0, 16.6]]}


def made(weighed, risked):
    return Results(
        sensitivity=[sensitivity.sweep(scene, levels=2) for scene in weighed],
        adaptability=[adaptability.sweep(scene, levels=2, fine_levels=6) for scene in risked],
        flight=flight.of_flights({"px4": CLIMB}),
    )


@pytest.fixture(scope="module")
def results():
    return made(EVACUATIONS, EVACUATIONS[:1])


def test_a_table_of_scenes_ends_with_quartiles_of_the_defined_values():
    rows = [
        {"scene": name, "a": value} for name, value in (("x", 1.0), ("y", math.nan), ("z", 3.0))
    ]
    table = scene_table("t", "", rows)
    assert table.rows[3:] == (
        ("n", 2),
        ("first quartile", 1.5),
        ("median", 2.0),
        ("third quartile", 2.5),
    )


@pytest.mark.parametrize(
    ("value", "shown"),
    [("x", "x"), (9260, "9260"), (0.12345, "0.123"), (math.nan, "-"), (123.4, "123")],
)
def test_numbers_are_printed_with_three_digits_and_missing_ones_as_a_dash(value, shown):
    assert text(value) == shown


@pytest.mark.slow
def test_a_figure_is_a_png_and_an_svg_and_the_same_each_time(results):
    function, arguments = experiments.drawings("flight", results)[0]
    picture, again = function(*arguments), function(*arguments)
    assert picture == again
    assert np.ptp(image.imread(io.BytesIO(picture.png))[..., :3]) > 0.5
    assert b"<svg" in picture.svg[:1000]


@pytest.mark.slow
def test_every_figure_of_all_experiments_can_be_drawn():
    # Those of the maps: tests/commands/test_evaluate.
    whole = made(SWEPT, SWEPT[:1])
    drawn = [
        function(*arguments)
        for name in ("sensitivity", "adaptability", "tests", "flight")
        for function, arguments in experiments.drawings(name, whole)
    ]
    assert len({picture.name for picture in drawn}) == len(drawn) == 7
    for picture in drawn:
        assert np.ptp(image.imread(io.BytesIO(picture.png))[..., :3]) > 0.5


def test_the_report_is_self_contained_and_has_every_figure_table_and_scene(results):
    picture = Picture(name="p", title="A <b> title", caption="c & d", png=b"png", svg=b"")
    page = experiments.report(results, {"sensitivity": [picture], "adaptability": [], "flight": []})
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "A &lt;b&gt; title" in page
    assert page.count("<img") == 1
    assert all(f"<td>{scene.name}</td>" in page for scene in EVACUATIONS)
    assert "<td>paper, planned</td><td>16.8</td><td>38.3</td><td>1.7</td><td>3.8</td>" in page
    for name in ("n", "first quartile", "median", "third quartile"):
        assert f"<td>{name}</td>" in page


def test_the_columns_of_a_file_are_of_one_length_and_in_the_order_of_the_scenes(results):
    files = experiments.columns(results)
    assert {"sensitivity", "sensitivity_paths", "adaptability", "flight"} <= set(files)
    for columns in files.values():
        assert len({len(values) for values in columns.values()}) == 1
    swept = files["sensitivity"]
    assert len(swept["path"]) == 7 * len(EVACUATIONS)
    assert swept["environment"] == sorted(swept["environment"])


def test_the_papers_flight_is_planned_with_the_length_and_speed_of_the_paper():
    results = flight.of_flights({})
    length_m, duration_s, least_m, _ = flight.compared(results)["planned"]
    paper = flight.IN_PAPER["paper, planned"]
    assert (length_m, duration_s) == pytest.approx(paper[:2], rel=0.05)
    assert least_m == pytest.approx(paper[2], abs=0.1)


def test_an_experiment_without_results_is_not_in_the_overview(results):
    alone = replace(results, adaptability=(), flight=None)
    assert all(not str(row[0]).startswith("risks") for row in experiments.headline(alone).rows)
    assert EVACUATIONS[0].name in experiments.report(alone, {"sensitivity": []})
