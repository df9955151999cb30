"""The weights under risks: by Eq. 9 as printed, or calibrated on the exact Pareto front.

Inputs: base weights k_{S,0}, k_{T,0}, k_{E,0}, and risk indices. Calibrated adaptation also needs
the planner's measurements for one start and goal (`Calibration`). Output: final weights.

Calibrated adaptation. Eq. 9 weighs the risks by the demand for safety

    s = WR/2 + CR/4 + LR/4 - BR,  from -1 to 1.

Here s moves the weights along one line: from time and energy alone, through the base weights, to
safety alone. k_S is a function of s, and k_T : k_E stays that of the base. Along such a line the
safety cost of the optimum never rises with k_S, and its k_T TC + k_E EC never falls. Reason: each
of two optima is the cheaper one for its own weights. That holds for any start and velocity.

    s = 0   the base weights, for any calibration
    s > 0   k_S for which the optimum from the calibrated start has gained the part s of the safety
            cost between that of the base weights and the least one
    s = 1   k_S = 1: the safest point of the front; of equal ones that with the least TC + EC
    s < 0   the same for the part -s of k_T TC + k_E EC, down to k_S = 0

The front has finitely many points. A path switches to the next where s is midway between the parts
that the two have gained. No path is then farther from the proportion than half a gap of the front.

Properties, each tested for any weights, risks and front:

- Monotone: with the wind, communication and localization risk k_S never falls, and k_T and k_E
  never rise; with the battery risk it is the other way round. So is the safety cost monotone.
- The directions are those of Eq. 9, except that of k_E under wind. Eq. 9 raises it; therefore the
  safety cost may rise with the wind risk there.
- Unknown never lowers: an index that is raised because its inputs are unknown moves the weights as
  a measured one. Without a calibration k_S is linear in s, and for s >= 0 never below the base.
- Continuous in every index, as the calibration is a broken line without steps.
- Where the front is a single point, k_S is linear in s.

Over 36 scenes the safety saved deviates from the proportion by 0.38 of its range at the median,
half the front's widest gap. With Eq. 9 the deviation is 0.73, and the safety cost rises with the
risks in 13 scenes. Neither covers more of the paths between A* and Voronoi from the shipped
weights: Eq. 9 stays the default. configs/guides/vehicle.md has the figures.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

from ..settings.vehicle import AdaptationKind, Vehicle
from ..types import Mission, RiskIndices, Weights


@dataclass(frozen=True, slots=True)
class Calibration:
    """A broken line of k_S over the demand for safety; between its corners it is linear.

    demand: (n,) increasing from -1 to 1. safety: (n,) k_S there, from 0 to 1, never falling.
    """

    demand: tuple[float, ...]
    safety: tuple[float, ...]

    @classmethod
    def linear(cls, base: Weights) -> Calibration:
        """The line without a front: from k_S = 0 through the base weights to k_S = 1."""
        return cls((-1.0, 0.0, 1.0), (0.0, base.safety, 1.0))

    def at(self, demand: float) -> float:
        """k_S for a demand for safety in [-1, 1]."""
        after = min(bisect_right(self.demand, demand), len(self.demand) - 1)
        low, high = self.demand[after - 1], self.demand[after]
        share = (demand - low) / (high - low)
        return self.safety[after - 1] * (1.0 - share) + self.safety[after] * share


@dataclass(frozen=True, slots=True, kw_only=True)
class Adaptation:
    """Base weights and the rule by which risks shift them.

    calibration: for one start and goal; None while there is none, and for Eq. 9.
    """

    base: Weights
    kind: AdaptationKind = AdaptationKind.PAPER
    calibration: Calibration | None = None

    def weights(self, risk: RiskIndices) -> Weights:
        """The final weights under risks."""
        if self.kind is AdaptationKind.PAPER:
            return self.base.adjusted(risk)
        demand = safety_demand(risk)
        if demand == 0.0:
            return self.base
        calibration = self.calibration or Calibration.linear(self.base)
        return on_line(self.base, calibration.at(demand))

    @classmethod
    def of(cls, vehicle: Vehicle, mission: Mission) -> Adaptation:
        """That of a vehicle in a mission, not calibrated."""
        return cls(base=vehicle.weights[mission], kind=vehicle.adaptation)

    @property
    def words(self) -> str:
        """The kind as a text."""
        if self.kind is AdaptationKind.PAPER:
            return "Eq. 9"
        return "calibrated" if self.calibration is not None else "calibrated, front not known yet"

    def to_dict(self) -> dict[str, Any]:
        """Its kind and calibration state, for JSON."""
        return {"kind": self.kind.value, "calibrated": self.calibration is not None}


def safety_demand(risk: RiskIndices) -> float:
    """Demand for safety by Eq. 9, from the risks, in [-1, 1]."""
    return 0.5 * risk.wind + 0.25 * risk.communication + 0.25 * risk.localization - risk.battery


def on_line(base: Weights, safety: float) -> Weights:
    """Weights with this k_S, and with k_T : k_E of the base; 1 : 1 where the base has neither."""
    rest = base.time + base.energy
    time = base.time / rest if rest > 0.0 else 0.5
    return Weights.normalised(safety, (1.0 - safety) * time, (1.0 - safety) * (1.0 - time))
