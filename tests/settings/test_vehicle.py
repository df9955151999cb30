"""The vehicle file: the contract's example, what may not be in it, and the shipped vehicles."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from moar_companion.errors import InputError
from moar_companion.planner.adaptation import Adaptation
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.risk_model import Range, RiskModel
from moar_companion.settings.vehicle import (
    AdaptationKind,
    Guidance,
    SafetyShape,
    SpeedLimits,
    Vehicle,
    YawMode,
)
from moar_companion.types import PX4, Mission, Weights

EXAMPLE = """\
name: LineDrone
autopilot: px4                          # or ardupilot; default: taken from its heartbeat
geometry: {radius_m: 0.6}
safety: {d_min_m: 1.2, d_max_m: 3.0, weights: {collision: 0.3, insertion: 0.2, damage: 0.5}}
speed: {min_mps: 0.5, horizontal_mps: 10.0, up_mps: 1.5, down_mps: 1.5, diagonal_up_mps: 2.5, \
diagonal_down_mps: 2.5}
weights:                                # k_{S,0}, k_{T,0}, k_{E,0}, per mission
  inspection: {safety: 0.33, time: 0.33, energy: 0.33}
  exit: {safety: 0.33, time: 0.33, energy: 0.33}
  evacuation: {safety: 0.6, time: 0.2, energy: 0.2}
"""
"""The example of the contract."""

VEHICLES = sorted((shipped_configs() / "vehicles").glob("*.yaml"))


def load(text: str, folder: Path) -> Vehicle:
    path = folder / "vehicle.yaml"
    path.write_text(text)
    return Vehicle.load(path)


def refusal(text: str, folder: Path) -> str:
    with pytest.raises(InputError) as raised:
        load(text, folder)
    return str(raised.value).removeprefix(f"{folder / 'vehicle.yaml'}: ")


def changed(old: str, new: str) -> str:
    assert EXAMPLE.count(old) == 1
    return EXAMPLE.replace(old, new)


def test_the_example_of_the_contract(tmp_path: Path) -> None:
    vehicle = load(EXAMPLE, tmp_path)
    third = 1.0 / 3.0
    weights = vehicle.weights[Mission.INSPECTION]
    assert (weights.safety, weights.time, weights.energy) == pytest.approx((third, third, third))
    assert vehicle == Vehicle(
        name="LineDrone",
        autopilot=PX4,
        radius_m=0.6,
        safety=SafetyShape(d_min_m=1.2, d_max_m=3.0, collision=0.3, insertion=0.2, damage=0.5),
        speed=SpeedLimits(
            min_mps=0.5,
            horizontal_mps=10.0,
            up_mps=1.5,
            down_mps=1.5,
            diagonal_up_mps=2.5,
            diagonal_down_mps=2.5,
            max_mps=10.0,
        ),
        weights={
            Mission.INSPECTION: weights,
            Mission.EXIT: weights,
            Mission.EVACUATION: Weights.normalised(0.6, 0.2, 0.2),
        },
        guidance=Guidance(),
        risk=RiskModel(),
    )


def test_without_a_configured_autopilot_its_heartbeat_decides(tmp_path: Path) -> None:
    for written in ("", "autopilot:\n"):
        vehicle = load(EXAMPLE.replace("autopilot: px4  ", f"{written}#"), tmp_path)
        assert vehicle.autopilot is None


def test_weights_are_normalised(tmp_path: Path) -> None:
    text = changed("{collision: 0.3, insertion: 0.2, damage: 0.5}",
                   "{collision: 1, insertion: 0, damage: 3}")  # fmt: skip
    text = text.replace("{safety: 0.6, time: 0.2, energy: 0.2}", "{safety: 4, time: 1, energy: 0}")
    vehicle = load(text, tmp_path)
    safety = vehicle.safety
    assert (safety.collision, safety.insertion, safety.damage) == (0.25, 0.0, 0.75)
    assert vehicle.weights[Mission.EVACUATION] == Weights(0.8, 0.2, 0.0)


def test_the_adaptation_is_that_of_the_paper_unless_configured(tmp_path: Path) -> None:
    assert load(EXAMPLE, tmp_path).adaptation is AdaptationKind.PAPER
    vehicle = load(EXAMPLE + "adaptation: calibrated\n", tmp_path)
    adaptation = Adaptation.of(vehicle, Mission.EXIT)
    assert (adaptation.kind, adaptation.base) == (
        AdaptationKind.CALIBRATED,
        vehicle.weights[Mission.EXIT],
    )


def test_v_max_may_be_configured(tmp_path: Path) -> None:
    speed = load(changed("min_mps: 0.5", "min_mps: 0.5, max_mps: 4"), tmp_path).speed
    assert speed.max_mps == 4.0


def test_optional_sections_in_the_units_of_the_file(tmp_path: Path) -> None:
    vehicle = load(
        EXAMPLE
        + "guidance: {yaw_mode: fixed, fixed_yaw_deg: 90, yaw_rate_deg_per_s: 30, off_path_m: 3}\n"
        + "risk: {tilt_deg: [10, 30], satellites: [12, 6], cells: 6, unknown: 1}\n",
        tmp_path,
    )
    guidance, risk = vehicle.guidance, vehicle.risk
    assert guidance.yaw_mode is YawMode.FIXED
    assert guidance.fixed_yaw_rad == pytest.approx(math.pi / 2.0)
    assert guidance.yaw_rate_radps == pytest.approx(math.pi / 6.0)
    assert guidance.off_path_m == 3.0
    assert guidance.tracking_slow_m == Guidance().tracking_slow_m
    assert (risk.tilt_rad.low, risk.tilt_rad.high) == pytest.approx((math.pi / 18.0, math.pi / 6.0))
    assert risk.satellites == Range(low=12.0, high=6.0)
    assert risk.cells == 6
    assert risk.unknown == 1.0
    assert risk.wind_mps == RiskModel().wind_mps


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("d_min_m: 1.2", "d_min_m: 0", "safety.d_min_m: is 0, must be at least 0.01"),
        ("d_min_m: 1.2", "d_min_m: 3", "safety.d_min_m: is 3, must be less than d_max_m (3)"),
        (
            "{collision: 0.3, insertion: 0.2, damage: 0.5}",
            "{collision: 0, insertion: 0, damage: 0.0}",
            "safety.weights: are all 0, must have a positive sum",
        ),
        (
            "{safety: 0.6, time: 0.2, energy: 0.2}",
            "{safety: 0, time: 0, energy: 0}",
            "weights.evacuation: are all 0, must have a positive sum",
        ),
        (
            "{safety: 0.6,",
            "{safety: -0.6,",
            "weights.evacuation.safety: is -0.6, must be at least 0",
        ),
        ("min_mps: 0.5", "min_mps: 2", "speed.up_mps: is 1.5, must be at least min_mps (2)"),
        (
            "min_mps: 0.5",
            "min_mps: 0.5, max_mps: 0.4",
            "speed.max_mps: is 0.4, must be at least min_mps (0.5)",
        ),
        (" up_mps: 1.5", " up_mps: 0", "speed.up_mps: is 0, must be at least 0.05"),
        ("autopilot: px4", "autopilot: unknown", "autopilot: is 'unknown', must be 'px4' or"),
        (
            "geometry:",
            "guidance: {tracking_slow_m: 1.5}\ngeometry:",
            "guidance.tracking_slow_m: is 1.5, must be less than tracking_hold_m (1.5)",
        ),
        (
            "geometry:",
            "guidance: {tracking_hold_m: 2.5}\ngeometry:",
            "guidance.tracking_hold_m: is 2.5, must be at most off_path_m (2)",
        ),
        (
            "geometry:",
            "guidance: {yaw_mode: sideways}\ngeometry:",
            "guidance.yaw_mode: is 'sideways', must be 'target', 'path' or 'fixed'",
        ),
        (
            "geometry:",
            "guidance: {yaw_rate_rad: 1}\ngeometry:",
            "guidance.yaw_rate_rad: is not a known key, did you mean yaw_rate_deg_per_s?",
        ),
        (
            "geometry:",
            "risk: {tilt_deg: [10, 10]}\ngeometry:",
            "risk.tilt_deg: has two equal values, must differ",
        ),
        (
            "geometry:",
            "risk: {wind_mps: [12, 3]}\ngeometry:",
            "risk.wind_mps: has its values the wrong way round, must have the lesser first",
        ),
        (
            "geometry:",
            "risk: {satellites: [5, 10]}\ngeometry:",
            "risk.satellites: has its values the wrong way round, must have the greater first",
        ),
        (
            "geometry:",
            "risk: {motor_pulse_us: [1999, 1]}\ngeometry:",
            "risk.motor_pulse_us: has its values the wrong way round, must have the lesser first",
        ),
        (
            "geometry:",
            "risk: {battery_remaining: [70, 20]}\ngeometry:",
            "risk.battery_remaining[0]: is 70, must be at most 1 (and 1 more)",
        ),
        (
            "geometry:",
            "risk: {tilt_deg: [1, 2, 3]}\ngeometry:",
            "risk.tilt_deg: has a length of 3, must be at most 2",
        ),
        ("geometry:", "risk: {cells: 4.0}\ngeometry:", "risk.cells: is 4.0, must be a whole"),
        ("geometry:", "adaptation: none\ngeometry:", "adaptation: is 'none', must be"),
    ],
)
def test_an_invalid_vehicle_file_is_refused(
    old: str, new: str, problem: str, tmp_path: Path
) -> None:
    assert refusal(changed(old, new), tmp_path).startswith(problem)


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
def test_a_shipped_vehicle(path: Path) -> None:
    vehicle = Vehicle.load(path)
    assert (vehicle.safety.d_min_m, vehicle.safety.d_max_m) == (1.2, 3.0)
    evacuation, leaving = vehicle.weights[Mission.EVACUATION], vehicle.weights[Mission.EXIT]
    assert evacuation.safety > leaving.safety


def test_the_shipped_vehicles_are_those_of_the_paper_and_an_x500() -> None:
    assert [path.stem for path in VEHICLES] == ["linedrone", "linedrone_flight", "x500"]
    simulated, flown, _ = (Vehicle.load(path) for path in VEHICLES)
    assert (simulated.speed.horizontal_mps, simulated.speed.up_mps) == (10.0, 1.5)
    assert (flown.speed.min_mps, flown.speed.max_mps) == (0.4, 0.7)
    assert flown.weights[Mission.INSPECTION] == Weights.normalised(0.43, 0.14, 0.43)


def test_the_shipped_linedrone_is_the_example_of_the_contract(tmp_path: Path) -> None:
    example = load(EXAMPLE.replace("autopilot: px4", "autopilot:"), tmp_path)
    assert Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml") == example
