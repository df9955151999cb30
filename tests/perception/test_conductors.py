"""Conductors found in made scenes: how many, where, and what is none."""

import numpy as np
import pytest

from moar_companion.perception.conductors import DetectorSettings
from moar_companion.perception.ground import ground_height_m
from moar_companion.perception.spans import PointClass, find_power_line
from tests.perception.scenes import DOUBLE_CIRCUIT, Scene, Wire

EARTH = tuple(Wire(lateral_m=each, lowest_m=34.0, per_m=1.5) for each in (-5.0, 5.0))


def conductors_of(line):
    return [each for span in line.spans for each in span.conductors]


def precision_and_recall(line, scene):
    found = np.isin(line.classes, (PointClass.CONDUCTOR, PointClass.EARTH_WIRE))
    wires = scene.label >= 0
    return (found & wires).sum() / found.sum(), (found & wires).sum() / wires.sum()


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 135.0, 290.0])
def test_every_conductor_of_a_line_at_any_angle(azimuth_deg):
    scene = Scene(1, azimuth_deg=azimuth_deg).with_wires(DOUBLE_CIRCUIT).with_ground()
    line = find_power_line(scene.cloud)
    assert len(conductors_of(line)) == 6
    precision, recall = precision_and_recall(line, scene)
    assert precision > 0.999
    assert recall > 0.97
    for wire in DOUBLE_CIRCUIT:
        at = scene.place(100.0, wire.lateral_m, wire.lowest_m)[None]
        distance = min(
            np.hypot(*each.curve.residuals(each.curve.coordinates(at))[0])
            for each in conductors_of(line)
        )
        assert distance < 0.03


def test_two_circuits_of_bundles_and_two_earth_wires():
    bundles = tuple(
        Wire(lateral_m=each.lateral_m, lowest_m=each.lowest_m, bundle_m=0.4)
        for each in DOUBLE_CIRCUIT
    )
    scene = Scene(2).with_wires((*bundles, *EARTH)).with_ground()
    (span,) = find_power_line(scene.cloud).spans
    assert [len(circuit) for circuit in span.circuits] == [3, 3]
    assert len(span.earth_wires) == 2
    assert all(len(each.wires) == 2 for circuit in span.circuits for each in circuit)
    for circuit in span.circuits:
        lateral = [span.conductors[0].curve.coordinates(c.curve.points_at(np.zeros(1)))[0, 1]
                   for c in circuit]  # fmt: skip
        heights = [c.curve.points_at(np.zeros(1))[0, 2] for c in circuit]
        assert np.ptp(lateral) < 3.0
        assert heights == sorted(heights)


def test_three_conductors_side_by_side_are_one_circuit():
    wires = [Wire(lateral_m=each, lowest_m=11.0) for each in (-8.0, 0.0, 8.0)]
    (span,) = find_power_line(Scene(3).with_wires(wires).with_ground().cloud).spans
    assert [len(circuit) for circuit in span.circuits] == [3]
    assert span.earth_wires == ()


def test_two_layers_are_split_by_height():
    wires = [Wire(lateral_m=x, lowest_m=z) for z in (12.0, 20.0) for x in (-7.0, 0.0, 7.0)]
    (span,) = find_power_line(Scene(4).with_wires(wires).with_ground().cloud).spans
    for circuit in span.circuits:
        heights = [each.curve.points_at(np.zeros(1))[0, 2] for each in circuit]
        assert np.ptp(heights) < 1.0


@pytest.mark.slow
def test_nothing_is_found_in_trees_hedges_and_roofs():
    scene = Scene(5).with_ground()
    for along in range(10, 200, 12):
        scene.with_tree(along, float(scene.random.uniform(-20, 20)), 12.0 + along % 7)
    hedge = np.linspace(0.0, 150.0, 3000)
    scene._add(hedge, np.full(3000, 22.0), scene.random.uniform(0.0, 6.0, 3000), -2, 0.3)
    roof = scene.random.uniform(0.0, 1.0, (4000, 2))
    height = 8.0 - abs(roof[:, 1] - 0.5) * 6.0
    scene._add(50.0 + roof[:, 0] * 30.0, -25.0 + roof[:, 1] * 8.0, height, -2, 0.02)
    assert conductors_of(find_power_line(scene.cloud)) == []


def test_a_conductor_is_found_through_the_crown_of_a_tree():
    wire = [Wire(lateral_m=0.0, lowest_m=10.0)]
    scene = Scene(6).with_wires(wire).with_ground().with_tree(60.0, 0.0, 13.0)
    line = find_power_line(scene.cloud)
    (conductor,) = conductors_of(line)
    assert conductor.curve.length_m > 195.0
    assert precision_and_recall(line, scene)[0] > 0.95
    clean = find_power_line(Scene(6).with_wires(wire).with_ground().cloud)
    assert conductor.confidence < conductors_of(clean)[0].confidence


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_twice_as_many_outliers_as_points_of_conductors(seed):
    scene = Scene(seed).with_wires(DOUBLE_CIRCUIT).with_ground()
    scene.with_outliers(2 * int((scene.label >= 0).sum()))
    line = find_power_line(scene.cloud)
    assert len(conductors_of(line)) == 6
    precision, recall = precision_and_recall(line, scene)
    assert precision > 0.97
    assert recall > 0.97


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_no_line_of_lone_outliers_is_a_conductor(seed):
    wires = [
        Wire(lateral_m=each.lateral_m, lowest_m=each.lowest_m, per_m=1.5) for each in DOUBLE_CIRCUIT
    ]
    scene = Scene(seed, azimuth_deg=37.0).with_wires(wires).with_ground()
    scene.with_outliers(2 * int((scene.label >= 0).sum()))
    (span,) = find_power_line(scene.cloud).spans
    assert [len(circuit) for circuit in span.circuits] == [3, 3]
    assert span.earth_wires == ()


def test_a_sparse_wire_ends_where_the_wires_beside_it_end():
    sparse = Wire(lateral_m=-5.0, lowest_m=34.0, per_m=0.4)
    wires = (*DOUBLE_CIRCUIT, sparse)
    scene = Scene(1, azimuth_deg=37.0).with_wires(wires, start_m=60.0, end_m=130.0).with_ground()
    scene.with_wires([sparse], start_m=165.0, end_m=172.0)
    found = conductors_of(find_power_line(scene.cloud))
    assert len(found) == 7
    for each in found:
        ends = each.curve.points_at(np.array(each.curve.extent_m))[:, :2] @ scene.along
        assert sorted(ends) == pytest.approx([60.0, 130.0], abs=6.0)


def test_a_gap_is_bridged_and_a_partial_span_is_found_as_far_as_it_goes():
    wire = [Wire(lateral_m=0.0, lowest_m=14.0)]
    scene = Scene(7).with_ground().with_wires(wire, end_m=80.0)
    scene.with_wires(wire, start_m=92.0, end_m=150.0)
    (conductor,) = conductors_of(find_power_line(scene.cloud))
    assert conductor.curve.length_m == pytest.approx(150.0, abs=1.0)


def test_two_spans_meet_at_a_tower_that_is_named():
    scene = Scene(8, length_m=150.0).with_ground().with_wires(DOUBLE_CIRCUIT).with_tower(151.0)
    line = find_power_line(scene.cloud)
    tower = line.classes == PointClass.TOWER
    assert (scene.label[tower] == -3).mean() > 0.9
    high = (scene.label == -3) & (scene.cloud[:, 2] > 5.0)
    assert (tower & high).sum() / high.sum() > 0.8


def test_an_earth_wire_of_a_point_every_five_metres_is_found_beside_the_others():
    sparse = Wire(lateral_m=0.0, lowest_m=33.0, per_m=0.2)
    scene = Scene(9, length_m=300.0).with_ground().with_wires((*DOUBLE_CIRCUIT, sparse))
    (span,) = find_power_line(scene.cloud).spans
    assert len(span.earth_wires) == 1


@pytest.mark.slow
def test_the_same_seed_finds_the_same():
    scene = Scene(10).with_wires(DOUBLE_CIRCUIT).with_ground().with_outliers(3000)
    first, second = (find_power_line(scene.cloud, DetectorSettings(seed=4)) for _ in range(2))
    assert (first.classes == second.classes).all()
    assert [each.curve.vertical.tolist() for each in conductors_of(first)] == [
        each.curve.vertical.tolist() for each in conductors_of(second)
    ]


def test_the_order_of_the_points_and_their_origin_hardly_matter():
    scene = Scene(11).with_wires(DOUBLE_CIRCUIT).with_ground()
    order = scene.random.permutation(len(scene.cloud))
    moved = find_power_line(scene.cloud[order] + (228_000.0, 578_000.0, 100.0))
    still = find_power_line(scene.cloud)
    assert len(conductors_of(moved)) == 6
    assert (moved.classes == still.classes[order]).mean() > 0.999


@pytest.mark.parametrize("count", [0, 3, 50])
def test_few_points_give_no_line(count):
    cloud = np.random.default_rng(0).uniform(0.0, 30.0, (count, 3))
    if count == 0:
        cloud = np.array([[0.0, 0.0, 0.0]])
    assert find_power_line(cloud).spans == ()


def test_the_ground_follows_a_slope_and_ignores_a_roof():
    random = np.random.default_rng(12)
    flat = random.uniform(0.0, 100.0, (20_000, 2))
    slope = np.column_stack((flat, 0.1 * flat[:, 0]))
    roof = (abs(flat - 50.0) < 5.0).all(axis=1)
    slope[roof, 2] += 6.0
    height = slope[:, 2] - ground_height_m(slope)
    assert np.median(height[roof]) == pytest.approx(6.0, abs=1.0)
    assert np.percentile(abs(height[~roof]), 99) < 1.0
