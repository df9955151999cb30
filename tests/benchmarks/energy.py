"""Energy: forecast against consumption: `.venv/bin/python -m tests.benchmarks.energy [N]`.

N lockstep flights (200) of all sites, missions and vehicles, by both autopilots, in winds of up to
8 m/s with gusts. The fake battery has no model of hovering or climbing: its power follows the
thrust, and differs by up to 15 % from the vehicle file. After a minute in the air, hovering or on
an inspection, a mission is ordered. The companion then forecasts the energy of the rest of the
flight. The benchmark compares that with the charge that the pack has lost when the motors stop.
No flight waits for less wind: the forecast has no waits, and a wait would end the flight before
its landing point.
"""

from __future__ import annotations

import random
import sys
from dataclasses import dataclass, replace
from functools import cache
from unittest.mock import patch

import numpy as np

from moar_companion.companion.safety import energy_checks
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Power, Vehicle
from moar_companion.types import Mission, Weights
from sitl.manners import KINDS
from tests.flights.lockstep import Lockstep
from tests.flights.operator import EVACUATION, EXIT, INSPECTION, Manner

SITES = ("315kv_double_circuit", "120kv_single_circuit", "horizontal_three_conductors")
VEHICLES = ("linedrone_flight", "x500", "linedrone")
ORDERS = {Mission.INSPECTION: INSPECTION, Mission.EXIT: EXIT, Mission.EVACUATION: EVACUATION}
MEASURED_S = 60.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """A flight. efficiency: of the battery; what is used is more by its inverse."""

    site: str
    vehicle: str
    manner: Manner
    mission: Mission
    weights: Weights
    wind_mps: float
    gust_mps: float
    wind_from_deg: float
    efficiency: float


@dataclass(frozen=True, kw_only=True)
class Result:
    """Forecast after a minute, forecast of the vehicle file alone, and the true values."""

    case: Case
    source: str
    forecast_wh: float
    file_wh: float
    used_wh: float

    @property
    def error(self) -> float:
        return self.forecast_wh / self.used_wh - 1.0

    @property
    def file_error(self) -> float:
        return self.file_wh / self.used_wh - 1.0


def cases(count: int, seed: int = 1) -> list[Case]:
    generator = random.Random(seed)
    return [
        Case(
            site=SITES[number % 3],
            vehicle=VEHICLES[number // 3 % 3],
            manner=list(Manner)[number % 2],
            mission=generator.choice(list(Mission)),
            weights=Weights.normalised(*(generator.random() for _ in range(3))),
            wind_mps=generator.uniform(0.0, 8.0),
            gust_mps=generator.uniform(0.0, 1.0),
            wind_from_deg=generator.uniform(0.0, 360.0),
            efficiency=generator.uniform(0.85, 1.15),
        )
        for number in range(count)
    ]


@cache
def _on_flat_ground(name: str) -> Site:
    """A site with its landing points on the ground of the fake autopilot."""
    site = Site.load(shipped_configs() / "sites" / f"{name}.yaml")
    landing_m = {
        mission: tuple((x_m, 0.0) for x_m, _ in points)
        for mission, points in site.landing_m.items()
    }
    return replace(site, landing_m=landing_m)


@cache
def _file(name: str) -> Vehicle:
    return Vehicle.load(shipped_configs() / "vehicles" / f"{name}.yaml")


@patch.object(energy_checks, "lowered_limit_mps", lambda limit_mps, _held_mps: limit_mps)
def fly(case: Case) -> Result:
    kind = KINDS[case.manner.value]
    capacity_wh, airframe = kind.battery.capacity_wh, kind.airframe
    vehicle = _file(case.vehicle)
    hover_w = airframe.hover_power_w + airframe.idle_power_w
    vehicle = replace(
        vehicle,
        power=Power(hover_w=hover_w, capacity_wh=capacity_wh),
        weights=vehicle.weights | {case.mission: case.weights},
    )
    flight = Lockstep(site=_on_flat_ground(case.site), vehicle=vehicle, manner=case.manner)
    conditions = flight.autopilot.conditions
    conditions.drain_factor = 1.0 / case.efficiency
    conditions.wind_from_deg = case.wind_from_deg
    flight.take_off()
    began_s = flight.now_s
    conditions.wind_mps, conditions.gust_mps = case.wind_mps, case.gust_mps
    if case.mission is not Mission.INSPECTION:
        flight.operator.mission(INSPECTION)
        flight.give_mode()
        flight.run_until_state("holding", 400.0)
    flight.run(max(0.0, began_s + MEASURED_S - flight.now_s))
    flight.operator.mission(ORDERS[case.mission])
    if case.mission is Mission.INSPECTION:
        flight.give_mode()
    flight.run_until_state("flying", 5.0)
    flight.run_until(lambda: _forecast(flight).finish is not None, 10.0)
    forecast, before = _forecast(flight), flight.truth.battery_fraction
    flight.run_until_state("holding", 400.0)
    if case.mission is Mission.INSPECTION:
        flight.operator.mission(ORDERS[_forecast(flight).better])
        flight.run_until_state("landing_leg", 400.0)
        flight.run_until_state("holding", 400.0)
    assert flight.companion.status.task.done
    flight.land()
    # PX4's simulated battery is full again once it is disarmed.
    after = next(truth.battery_fraction for truth in reversed(flight.truths) if truth.armed)
    assert forecast.finish is not None
    return Result(
        case=case,
        source=forecast.source,
        forecast_wh=forecast.finish.energy_wh,
        file_wh=forecast.finish.energy_wh / forecast.factor,
        used_wh=(before - after) * capacity_wh,
    )


def _forecast(flight: Lockstep):
    forecast = flight.companion.state.risk_monitor.energy_forecast
    assert forecast is not None
    return forecast


def row(name: str, results: list[Result], *, by_file: bool = False) -> str:
    errors = [abs(item.file_error if by_file else item.error) for item in results]
    median, p95 = np.percentile(errors, [50, 95])
    bias = np.mean([item.file_error if by_file else item.error for item in results])
    within = np.mean([error <= 0.1 for error in errors])
    return f"| {name} | {len(results)} | {median:.1%} | {p95:.1%} | {bias:+.1%} | {within:.0%} |"


def table(results: list[Result]) -> list[str]:
    lines = [
        "| forecast after a minute | flights | median error | p95 | mean | within 10 % |",
        "|---|---|---|---|---|---|",
        row("all", results),
    ]
    parts = {f"by {item.source}": [] for item in results}
    parts |= {mission.value: [] for mission in Mission} | {name: [] for name in VEHICLES}
    for item in results:
        for name in (f"by {item.source}", item.case.mission.value, item.case.vehicle):
            parts[name].append(item)
    lines += [row(name, part) for name, part in parts.items() if part]
    return [*lines, row("by the vehicle file alone", results, by_file=True)]


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    results = []
    for case in cases(count):
        results.append(fly(case))
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{len(results)}/{count}")
    sys.stdout.write("\n".join(table(results)) + "\n")


if __name__ == "__main__":
    main()
