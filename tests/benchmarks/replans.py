"""Rate of path changes by noise on the risks: `.venv/bin/python -m tests.benchmarks.replans`.

Flights in lockstep over the shipped sites, in calm air, an inspection of all targets and then an
exit. Each risk index is replaced by noise of its own about a mean: a first-order process, slow
enough that plans follow it. A change is a new path that is adopted in flight, other than for an
order; without the policy every better plan is, as often as one may be made.
"""

from __future__ import annotations

import math
import random
import sys
from dataclasses import replace
from unittest import mock

from moar_companion.risk import RiskEstimate, update
from moar_companion.settings.config import Replanning
from moar_companion.types import RiskIndices
from tests.flights.lockstep import Lockstep
from tests.flights.operator import EXIT, INSPECTION

SITES = ("315kv_double_circuit", "120kv_single_circuit", "horizontal_three_conductors")
SEEDS = range(3)
MEAN, SIGMA, CORRELATED_S = 0.35, 0.15, 2.0
EAGER = Replanning(risk_change=1e-6, improvement=0.0)
POLICIES = {
    "none: every better plan, 3 times a second": EAGER,
    "dead band of 0.1 alone": replace(EAGER, risk_change=0.1),
    "margin of 0.5 % alone": replace(EAGER, improvement=Replanning().improvement),
    "both, the default": Replanning(),
}


class Noise:
    """In the place of `update`: the estimate, with other indices."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._values = dict.fromkeys(RiskIndices().as_dict(), MEAN)
        self._time_s = 0.0

    def __call__(self, estimate: RiskEstimate, telemetry, now_s: float, **others) -> RiskEstimate:
        kept = math.exp(-(now_s - self._time_s) / CORRELATED_S)
        self._time_s = now_s
        for name, value in self._values.items():
            kick = self._random.gauss(0.0, SIGMA * math.sqrt(1.0 - kept * kept))
            self._values[name] = MEAN + kept * (value - MEAN) + kick
        indices = {name: min(1.0, max(0.0, value)) for name, value in self._values.items()}
        judged = update(estimate, telemetry, now_s, **others)
        return replace(judged, indices=RiskIndices(**indices))


def fly(site: str, seed: int, policy: Replanning) -> tuple[int, float]:
    """Changes of path, and the seconds in which there could be some."""
    with mock.patch("moar_companion.companion.risk_monitor.update", Noise(seed)):
        flight = Lockstep(site=site, replanning=policy)
        flight.begin(INSPECTION)
        flight.run_until_state("holding", 600.0)
        flight.operator.mission(EXIT)
        flight.run_until_state("landing_leg", 300.0)
    changes = [
        decision
        for decision in flight.decisions
        if decision.kind == "plan" and not decision.data["first"]
    ]
    flown = sum(1 for _, state in flight.states if state == "flying")
    return len(changes), 0.02 * flown


def main() -> None:
    sys.stdout.write("| policy | changes per minute | flown |\n|---|---|---|\n")
    for name, policy in POLICIES.items():
        flights = [fly(site, seed, policy) for site in SITES for seed in SEEDS]
        changes, seconds = (sum(column) for column in zip(*flights, strict=True))
        row = f"| {name} | {60.0 * changes / seconds:.2f} | {seconds / 60.0:.0f} min |"
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
