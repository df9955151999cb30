"""The catenary fit: against known curves, SciPy, outliers and its own covariance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from moar_companion.perception.catenary import fit, wires_of
from tests.perception.scenes import Scene, Wire


def points(seed=0, wire=Wire(lateral_m=2.0, lowest_m=15.0), **of_wires):  # noqa: B008
    scene = Scene(seed)
    return scene, scene.with_wires([wire], **of_wires).cloud


@given(
    azimuth_deg=st.floats(0.0, 360.0),
    constant_m=st.floats(400.0, 3000.0),
    along_m=st.floats(10.0, 190.0),
)
def test_without_noise_the_curve_is_the_wire(azimuth_deg, constant_m, along_m):
    scene = Scene(1, azimuth_deg=azimuth_deg)
    wire = Wire(lateral_m=-4.0, lowest_m=12.0, constant_m=constant_m)
    scene.with_wires([wire], noise_m=0.0)
    curve = fit(scene.cloud, -scene.along)
    at = scene.place(along_m, -4.0, scene.height(wire, along_m))
    assert np.hypot(*curve.residuals(curve.coordinates(at[None]))[0]) < 0.01
    assert curve.constant_m == pytest.approx(constant_m, rel=0.02)


def test_noise_moves_the_curve_by_its_standard_deviation():
    inside = []
    for seed in range(60):
        scene, cloud = points(seed, noise_m=0.05)
        curve = fit(cloud, scene.along)
        wire = Wire(lateral_m=2.0, lowest_m=15.0)
        at = scene.place(100.0, 2.0, scene.height(wire, 100.0))
        along, lateral, up = curve.coordinates(at[None])[0]
        deviation = np.sqrt(np.diag(curve.covariance_at(along)))
        fitted = curve.coordinates(curve.points_at(np.array([along])))[0, 1:]
        inside.append(abs(fitted - (lateral, up)) / deviation)
    assert 0.5 < np.mean(np.square(inside)) < 2.0


def test_agrees_with_an_ordinary_fit_of_scipy():
    scene, cloud = points(3, noise_m=0.05)
    curve = fit(cloud, scene.along)
    along, _, up = curve.coordinates(cloud).T

    def catenary(at, lowest, shift, constant):
        return lowest + constant * (np.cosh((at - shift) / constant) - 1.0)

    best, _ = curve_fit(catenary, along, up, (up.min(), 0.0, 1000.0))
    sample = np.linspace(*curve.extent_m, 50)
    ours = curve.points_at(sample)[:, 2] - curve.origin_m[2]
    assert abs(ours - catenary(sample, *best)).max() < 0.01


def test_a_third_of_outliers_does_not_move_the_curve():
    scene, cloud = points(4)
    far = cloud[::2] + scene.random.uniform(-3.0, 3.0, cloud[::2].shape)
    clean, dirty = fit(cloud, scene.along), fit(np.vstack((cloud, far)), scene.along)
    middle = clean.points_at(np.linspace(-80.0, 80.0, 9))
    assert abs(dirty.residuals(dirty.coordinates(middle))).max() < 0.05


def test_wind_swings_the_curve_out_of_the_vertical_plane():
    scene, cloud = points(5, swing_m=1.2)
    curve = fit(cloud, scene.along)
    middle = scene.place(100.0, 3.2, 15.0)
    assert abs(curve.residuals(curve.coordinates(middle[None]))).max() < 0.02


def test_a_short_piece_is_straight_rather_than_bent_by_noise():
    scene, cloud = points(6, start_m=60.0, end_m=66.0)
    curve = fit(cloud, scene.along)
    assert curve.length_m < 7.0
    assert abs(curve.vertical[2]) < 0.01


def test_crosses_a_vertical_plane_where_the_wire_does():
    scene, cloud = points(7)
    curve = fit(cloud, scene.along)
    along = curve.crossing(scene.place(50.0, 0.0, 0.0), scene.along)
    wire = Wire(lateral_m=2.0, lowest_m=15.0)
    expected = scene.place(50.0, 2.0, scene.height(wire, 50.0))
    assert curve.points_at(np.array([along]))[0] == pytest.approx(expected, abs=0.03)


@pytest.mark.parametrize("distance_m", [0.3, 0.4, 0.5])
def test_the_two_wires_of_a_bundle_are_separated(distance_m):
    scene, cloud = points(8, Wire(lateral_m=2.0, lowest_m=15.0, bundle_m=distance_m))
    _, wires, sigma = wires_of(cloud, fit(cloud, scene.along))
    middle = scene.place(100.0, 0.0, 0.0)
    places = [
        wire.points_at(np.array([wire.crossing(middle, scene.along)]))[0, :2] for wire in wires
    ]
    assert len(wires) == 2
    assert np.hypot(*(places[1] - places[0])) == pytest.approx(distance_m, abs=0.02)
    assert sigma == pytest.approx(0.03, abs=0.01)


def test_a_single_wire_stays_one():
    scene, cloud = points(9, noise_m=0.06)
    curve, wires, _ = wires_of(cloud, fit(cloud, scene.along))
    assert wires == (curve,)
