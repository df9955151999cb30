"""Flights by sight, a different line for each seed: flown, judged, and summarised."""

import json
import math

import numpy as np
import pytest

from moar_companion.settings.perception_config import Perception
from sitl.lidar import Box, LidarScene, Tree, Wire
from tests.thorough import sampled

from .operator import Manner
from .perceive import command
from .perceive.drawing import DIAMETERS_M, HALF_SPAN_M, START_M, TURNED_DEG, draw
from .perceive.flying import fly
from .perceive.judging import clearance_m

pytest.importorskip("velodyne_decoder")
DRAWS = [draw(seed) for seed in range(1, 60)]


def test_a_seed_is_always_the_same_flight():
    assert draw(7) == draw(7)
    assert draw(7) != draw(8)


def test_the_companions_site_has_no_obstacle_and_a_rough_target():
    for drawn in DRAWS:
        (target,) = drawn.site.targets
        assert drawn.site.obstacles == ()
        assert math.dist(target.position_m, drawn.true_target_m) < 0.36
        assert all(2.0 * each == round(2.0 * each) for each in target.position_m)


def test_lines_differ_within_their_bounds():
    wires = [wire for drawn in DRAWS for wire in drawn.scene.scene.wires]
    diameters = [wire.diameter_m for wire in wires]
    assert DIAMETERS_M[0] <= min(diameters) < 0.018
    assert 0.037 < max(diameters) <= DIAMETERS_M[1]
    turned = [abs(wire.end_m[0] - wire.start_m[0]) / (2.0 * HALF_SPAN_M) for wire in wires]
    assert 9.0 < math.degrees(math.atan(max(turned))) <= TURNED_DEG + 1e-9
    assert {len(drawn.scene.scene.wires) for drawn in DRAWS} >= {2, 3, 4, 6}
    assert {drawn.added for drawn in DRAWS} == {"nothing", "solid", "wire"}
    assert any(drawn.scene.scene.boxes for drawn in DRAWS)
    assert {drawn.manner for drawn in DRAWS} == set(Manner)
    assert max(drawn.wind_mps for drawn in DRAWS) > 7.0


def test_start_and_target_are_free():
    for drawn in DRAWS:
        places = [(START_M[0], 0.0, z) for z in np.arange(0.5, 3.5, 0.5)]
        assert clearance_m(drawn.scene.scene, places).min() > 1.5
        x_m, z_m = drawn.true_target_m
        if (x_m, z_m) != (START_M[0], 9.0):
            assert clearance_m(drawn.scene.scene, [(x_m, 0.0, z_m)])[0] > 2.6


def test_distances_to_wires_solids_and_trees():
    wire = Wire(start_m=(0.0, -100.0, 12.0), end_m=(0.0, 100.0, 12.0), sag_m=2.0, diameter_m=0.04)
    box = Box(lower_m=(10.0, -1.0, 0.0), upper_m=(12.0, 1.0, 4.0))
    tree = Tree(centre_m=(-20.0, 0.0, 3.0), radius_m=2.0)
    scene = LidarScene(wires=(wire,), boxes=(box,), trees=(tree,))
    places = [(3.0, 0.0, 10.0), (13.0, 2.0, 2.0), (11.0, 0.0, 1.5), (-20.0, 4.0, 3.0)]
    assert clearance_m(scene, places) == pytest.approx([2.98, math.sqrt(2.0), -1.0, 2.0])


@pytest.mark.slow
def test_a_wire_on_the_straight_path_is_seen_and_passed():
    flight = fly(2)
    assert flight.draw.added == "wire"
    assert flight.why == ""
    assert flight.least_clearance_m > 1.0
    assert len(flight.sights) == len(flight.draw.scene.scene.wires)
    for sight in flight.sights:
        assert sight.off_m < 1.0
        assert sight.from_m > Perception().sight_m


@pytest.mark.slow
def test_random_flights_have_no_collision_and_are_written_as_rows(tmp_path, capsys):
    seeds = sampled(range(7, 8), range(1, 8))
    given = f"{seeds.start}:{seeds.stop}"
    assert command.main(["--seeds", given, "--out", str(tmp_path)]) == 0
    rows = [json.loads(line) for line in (tmp_path / "flights.jsonl").read_text().splitlines()]
    assert [row["seed"] for row in rows] == list(seeds)
    assert {row["verdict"] for row in rows} == {"kept"}
    summary = (tmp_path / "summary.md").read_text()
    count = len(seeds)
    assert f"{count} flights: 0 collisions, 0 errors; {count} reached the target." in summary
    assert capsys.readouterr().out == summary


def row(seed, clearance_m, why=""):
    return {
        "seed": seed, "verdict": "kept" if clearance_m > 0.0 else "collision", "manner": "px4",
        "added": "wire", "least_clearance_m": clearance_m, "reached": not why, "why": why,
        "cpu_s": 2.0, "sights": [[0.016, 11.0, 0.1], [0.016, 20.0, 4.0]],
    }  # fmt: skip


def test_the_summary_names_collisions_misses_and_false_conductors():
    rows = [row(1, 2.0), row(2, -0.3), row(3, 1.5, "holding: MOAR: no path"),
            {"seed": 4, "verdict": "error", "error": "ValueError: x", "cpu_s": 4.0}]  # fmt: skip
    summary = command.summary(rows)
    assert "4 flights: 1 collisions, 1 errors; 2 reached the target." in summary
    assert "Least clearance of a hull: -0.3 m (seed 2)" in summary
    assert "- seed 2 (px4, added wire): collision, -0.3 m; reached" in summary
    assert "- seed 3 (px4, added wire): kept, 1.5 m; holding: MOAR: no path" in summary
    assert "- seed 4: ValueError: x" in summary
    assert "Conductors that were reported: 6, of which false 3." in summary
    assert "| 15 to 20 | 3 | 11.0 | 11.0 | 0.10 |" in summary
