"""Adaptability to risks (paper, Section V-B, Fig. 8).

Input: a scene. Output: its paths over all combinations of risk indices, and on two fine grids, and
the measures that compare them with the baselines. One fine grid is over wind alone, the other over
all risks that ask for safety, for each way of adaptation and each base weights.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...planner.adaptation import Adaptation
from ...planner.analysis.baselines import BaselineKind
from ...planner.grid import FloatArray, IntArray
from ...settings.vehicle import AdaptationKind
from ...types import RiskIndices, Weights
from . import measures
from .paths import METRICS, Baselines, PathCollector, Paths, baselines
from .scenes import BASES, Problem, Scene, problem
from .sensitivity import exact_front

LEVELS = 6
"""Values of each risk index, from 0 to 1."""
FINE_LEVELS = 101
"""Values of the fine grids."""
COMPARED = {
    "length": "length_m",
    "clearance": "mean_clearance_m",
    "clearance over length": "length_mean_clearance_m",
}
"""Metrics that are compared with the baselines, by their names in tables."""

Adapted = Callable[[RiskIndices], Weights]


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A way of adaptation, and the name of its base weights."""

    adaptation: AdaptationKind
    base: str

    @property
    def name(self) -> str:
        """The way in a few words."""
        rule = "Eq. 9" if self.adaptation is AdaptationKind.PAPER else self.adaptation.value
        return f"{rule} from {self.base}"


WAYS = tuple(Way(adaptation=kind, base=base) for kind in AdaptationKind for base in BASES)
SHOWN = Way(adaptation=AdaptationKind.PAPER, base="middle")
"""The way of the paper's Fig. 8."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """The paths of one way. risks: (n, 3) wind, battery, localization; path: (n,).

    fine: (m,) grid of wind alone, wind_path: (m,), and of wind, communication and localization
    together, together_path: (m,).
    """

    risks: FloatArray
    path: IntArray
    fine: FloatArray
    wind_path: IntArray
    together_path: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Adaptability:
    """The risk sweep of one scene. front: the paths of the exact front.

    corners: (3,) the paths for safety, time and energy alone, the limits of every adaptation.
    """

    scene: Scene
    responses: dict[Way, Response]
    corners: IntArray
    paths: Paths
    front: Paths
    baselines: Baselines


def risk_combinations(levels: int = LEVELS) -> FloatArray:
    """All combinations of wind, battery and localization risk, (n, 3)."""
    return np.array(list(itertools.product(np.linspace(0.0, 1.0, levels).tolist(), repeat=3)))


def sweep(scene: Scene, levels: int = LEVELS, fine_levels: int = FINE_LEVELS) -> Adaptability:
    """The risk sweep of a scene.

    In the combinations the communication risk is 0, as in the paper: it has the effect of
    localization's.
    """
    posed = problem(scene)
    posed.planner.prepare(mission=scene.mission, target=posed.request.target)
    collector = PathCollector(posed)
    risks, fine = risk_combinations(levels), np.linspace(0.0, 1.0, fine_levels)
    responses = {}
    for way in WAYS:
        weights_under = _adapted(way, posed)

        def paths(each: Sequence[RiskIndices], under: Adapted = weights_under) -> IntArray:
            return np.array([collector.solve(under(risk)) for risk in each])

        responses[way] = Response(
            risks=risks,
            path=paths(
                [
                    RiskIndices(wind=wind, battery=battery, localization=place)
                    for wind, battery, place in risks.tolist()
                ]
            ),
            fine=fine,
            wind_path=paths([RiskIndices(wind=wind) for wind in fine.tolist()]),
            together_path=paths(
                [
                    RiskIndices(wind=index, communication=index, localization=index)
                    for index in fine.tolist()
                ]
            ),
        )
    return Adaptability(
        scene=scene,
        responses=responses,
        corners=np.array([collector.solve(Weights(*alone)) for alone in np.eye(3).tolist()]),
        paths=collector.paths(),
        front=exact_front(posed),
        baselines=baselines(posed),
    )


def _adapted(way: Way, posed: Problem) -> Adapted:
    """The final weights under risks; calibrated from the scene's start."""
    adaptation = Adaptation(base=BASES[way.base], kind=way.adaptation)
    request = posed.planner.calibrated(posed.request.adapted(adaptation), posed.request.start_m)
    assert request.adaptation is not None
    return request.adaptation.weights


def summary(result: Adaptability, way: Way) -> dict[str, Any]:
    """The measures of one scene and way: a row of the report's table."""
    response = result.responses[way]
    row: dict[str, Any] = {"way": way.name, "scene": result.scene.name}
    row["paths"] = len(np.unique(response.path))
    row["paths over wind"] = len(np.unique(response.wind_path))
    for label, metric in COMPARED.items():
        values = result.paths.metric(metric)
        ends = [
            result.baselines.value(kind, metric)
            for kind in (BaselineKind.SHORTEST, BaselineKind.VORONOI)
        ]
        over_wind = values[response.wind_path]
        row[f"{label}: coverage"] = measures.coverage(values[response.path], *ends)
        row[f"{label}: over wind"] = measures.coverage(over_wind, *ends)
        row[f"{label}: together"] = measures.coverage(values[response.together_path], *ends)
        row[f"{label}: corners"] = measures.coverage(values[result.corners], *ends)
        row[f"{label}: front"] = measures.coverage(result.front.metric(metric), *ends)
        row[f"{label}: nearer to Voronoi at"] = measures.first_nearer(
            response.fine, over_wind, *ends
        )
        row[f"{label}: half passed at"] = measures.half_passed(response.fine, over_wind)
        row[f"{label}: greatest step"] = measures.greatest_step(over_wind)
        row[f"{label}: front's gap"] = measures.greatest_gap(result.front.metric(metric), over_wind)
    return row


def rows(result: Adaptability) -> dict[str, Any]:
    """One row for each point of each way's sweeps: columns of the Parquet file."""
    columns: dict[str, list[Any]] = {}
    for way, response in result.responses.items():
        none, fine = np.zeros_like(response.fine), response.fine
        # Wind, battery, localization, communication.
        sweeps = {
            "combinations": (np.pad(response.risks, ((0, 0), (0, 1))), response.path),
            "wind": (np.stack([fine, none, none, none], axis=1), response.wind_path),
            "together": (np.stack([fine, none, fine, fine], axis=1), response.together_path),
        }
        for name, (risks, path) in sweeps.items():
            count = len(path)
            part: dict[str, Any] = {
                **{key: [value] * count for key, value in result.scene.key.items()},
                "adaptation": [way.adaptation.value] * count,
                "base": [way.base] * count,
                "sweep": [name] * count,
                "wind": risks[:, 0].tolist(),
                "battery": risks[:, 1].tolist(),
                "localization": risks[:, 2].tolist(),
                "communication": risks[:, 3].tolist(),
                "path": path.tolist(),
                **{metric: result.paths.metric(metric)[path].tolist() for metric in METRICS},
            }
            for key, values in part.items():
                columns.setdefault(key, []).extend(values)
    return columns
