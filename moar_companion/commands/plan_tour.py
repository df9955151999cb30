"""`moar-companion plan --target all`: the tour of all targets and views, exit included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from ..companion.preflight.tour_energy import TourEnergy, tour_energy
from ..planner.adaptation import Adaptation
from ..planner.plan_values import Cost, Plan, PlanRequest
from ..planner.planner import Planner
from ..planner.tour import EXACT_STOPS, best_order, leg_plans
from ..settings.config import Supervision
from ..settings.vehicle import AdaptationKind
from ..types import Mission, RiskIndices, Weights


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedTour:
    """A tour, with its energy, beside the file's order.

    plans: of the legs in the order of the visits, the exit last. energy, file_cost: None where a
    leg has no path.
    """

    planner: Planner
    stops: tuple[str, ...]
    plans: tuple[Plan, ...]
    file_plans: tuple[Plan, ...]
    energy: TourEnergy | None

    @property
    def missing(self) -> Plan | None:
        """The first leg without a path; None if all have one."""
        return next((plan for plan in self.plans if plan.reason), None)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The last stops, which do not fit into a full battery."""
        return () if self.energy is None else self.stops[self.energy.fitting :]

    def document(self) -> dict[str, Any]:
        """The plan JSON of the whole tour, and `tour` with its order, energy and legs.

        Times and metrics are those of the flight, without the stays.
        """
        document, missing, plans = self.plans[0].to_dict(), self.missing, self.plans
        document["target"] = "all"
        if missing is None:
            metrics = [plan.metrics for plan in plans if plan.metrics is not None]
            begun_s = np.cumsum([0.0, *(item.duration_s for item in metrics)])
            whole_s = float(begun_s[-1])
            document["cost"] = _cost_dict(_total(plans))
            document["states"] = [state for plan in plans for state in plan.states.tolist()]
            document["waypoints"] = [
                {**point, "time_s": point["time_s"] + float(at_s)}
                for plan, at_s in zip(plans, begun_s, strict=False)
                for point in plan.waypoints.to_list()
            ]
            mean_m = sum(item.mean_clearance_m * item.duration_s for item in metrics)
            document["metrics"] = {
                "length_m": sum(item.length_m for item in metrics),
                "duration_s": whole_s,
                "mean_clearance_m": _finite(mean_m / whole_s if whole_s else mean_m),
                "min_clearance_m": _finite(min(item.min_clearance_m for item in metrics)),
                "velocity_change_mps": sum(item.velocity_change_mps for item in metrics),
            }
        else:
            document |= {"status": missing.status.value, "reason": missing.reason}
            document |= {"cost": None, "states": [], "waypoints": [], "metrics": None}
        document["tour"] = {
            "order": list(self.stops),
            "exact": len(self.stops) <= EXACT_STOPS,
            "file_order": [target.name for target in self.planner.site.targets],
            "file_cost": _cost_dict(_total(self.file_plans)),
            "energy": None if self.energy is None else _energy_dict(self.energy),
            "left_out": list(self.left_out),
            "legs": [plan.to_dict() for plan in plans],
        }
        return document

    def summary(self, margin: str) -> str:
        """The tour in a few lines. margin: of the distances from obstacles."""
        missing, cost, file_cost = self.missing, _total(self.plans), _total(self.file_plans)
        status = "found" if missing is None else missing.status.value
        count = f"{len(self.stops)} stop{'s' if len(self.stops) > 1 else ''}"
        lines = [f"{self.planner.site.name}: inspection of all, {count}: {status}"]
        way_out = [] if self.plans[-1].mission.visits_targets else ["exit"]
        lines.append(_row("order", ", ".join((*self.stops, *way_out))))
        if cost is not None:
            terms = f"safety {cost.safety:.3f}, time {cost.time:.3f} s, energy {cost.energy:.3f}"
            lines.append(_row("cost", f"J = {cost.total:.3f} ({terms})"))
            lines.append(_row("", _saved_words(cost, file_cost)))
        for index, plan in enumerate(self.plans):
            lines.append(_row("" if index else "legs", _leg_words(plan)))
        if self.energy is not None:
            lines.append(_row("energy", _energy_words(self.energy)))
        if self.left_out:
            names = ", ".join(self.left_out)
            lines.append(_row("left out", f"{names}: a full battery does not suffice"))
        weights = self.plans[0].weights
        lines += [
            _row("margin", margin),
            _row(
                "weights",
                f"safety {weights.safety:.3f}, time {weights.time:.3f}, energy "
                f"{weights.energy:.3f}",
            ),
        ]
        return "\n".join(lines) + "\n"

    def draw(self, file_format: str, stream: IO[bytes]) -> None:
        """Draws the legs into a picture."""
        from ..analysis.pictures.plan_picture import draw_tour  # noqa: PLC0415

        planner, cost = self.planner, _total(self.plans)
        what = f"Tour: {', '.join(self.stops)}" + ("" if cost is None else f"; J {cost.total:.3f}")
        draw_tour(
            self.plans, planner.site, planner.vehicle, planner.maps, what, stream, file_format
        )


def planned_tour(
    planner: Planner,
    *,
    start_m: tuple[float, ...] | None,
    velocity_mps: tuple[float, ...],
    weights: Weights | None,
    risk: RiskIndices,
    adaptation: AdaptationKind | None,
) -> PlannedTour:
    """The tour of all targets from a start, by default the site's; options as of `Planner.plan`."""
    vehicle, site = planner.vehicle, planner.site
    base = vehicle.weights[Mission.INSPECTION] if weights is None else weights
    request = PlanRequest(
        mission=Mission.INSPECTION,
        target=None,
        start_m=site.start_m if start_m is None else start_m,
        velocity_mps=velocity_mps,
        weights=base,
        risk=risk,
    ).adapted(Adaptation(base=base, kind=adaptation or vehicle.adaptation))
    request = planner.calibrated(request, request.start_m)
    in_file = tuple(target.name for target in site.targets)
    stops = best_order(planner, request, in_file)
    plans = leg_plans(planner, request, stops)
    energy = None
    if not any(plan.reason for plan in plans):
        energy = tour_energy(planner, plans, Supervision().battery_reserve)
    return PlannedTour(
        planner=planner,
        stops=stops,
        plans=plans,
        file_plans=plans if stops == in_file else leg_plans(planner, request, in_file),
        energy=energy,
    )


def _total(plans: tuple[Plan, ...]) -> Cost | None:
    """Costs of all legs; None where one has no path."""
    costs = [plan.cost for plan in plans if plan.cost is not None]
    if len(costs) < len(plans):
        return None
    return Cost(
        total=sum(cost.total for cost in costs),
        safety=sum(cost.safety for cost in costs),
        time=sum(cost.time for cost in costs),
        energy=sum(cost.energy for cost in costs),
    )


def _cost_dict(cost: Cost | None) -> dict[str, float] | None:
    if cost is None:
        return None
    return {name: getattr(cost, name) for name in ("total", "safety", "time", "energy")}


def _energy_dict(energy: TourEnergy) -> dict[str, float]:
    return {name: getattr(energy, name) for name in TourEnergy.__slots__}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _row(label: str, words: str) -> str:
    return f"  {label:9}  {words}"


def _saved_words(cost: Cost, file_cost: Cost | None) -> str:
    """Comparison with the file's order."""
    if file_cost is None:
        return "the file's order has no path"
    saved, saved_s = file_cost.total - cost.total, file_cost.time - cost.time
    if abs(saved) < 5e-4:
        return "the file's order costs the same"
    time = f"{abs(saved_s):.1f} s {'more' if saved_s >= 0.0 else 'less'}"
    return f"the file's order: J = {file_cost.total:.3f}, {saved / cost.total:.1%} more, {time}"


def _leg_words(plan: Plan) -> str:
    goal = plan.request.target or plan.mission.value
    if plan.cost is None or plan.metrics is None:
        return f"{goal}: {plan.reason}"
    metrics = plan.metrics
    return (
        f"{goal}: J {plan.cost.total:.3f}, {metrics.length_m:.1f} m in {metrics.duration_s:.1f} s, "
        + (
            "no obstacles"
            if np.isinf(metrics.min_clearance_m)
            else f"{metrics.min_clearance_m:.2f} m clear at least"
        )
    )


def _energy_words(energy: TourEnergy) -> str:
    return (
        f"{energy.energy_wh:.1f} Wh of {energy.capacity_wh:.1f} in {energy.flown_s:.0f} s of "
        f"flight and {energy.held_s:.0f} s at stops; {energy.left_s:.0f} s left "
        f"(reserve {energy.reserve_s:.0f} s)"
    )
