"""The scenes of the evaluation: environments, missions and variations (paper, Section V-A).

Inputs: the committed files in `environments`, whose README defines what the paper leaves open.
Outputs: `Scene` values, each one planning problem without its weights.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

from ...planner.plan_values import PlanRequest
from ...planner.planner import Planner
from ...planner.site import Conductor, PlanePoint, Site
from ...settings.config import shipped_configs
from ...settings.vehicle import Vehicle
from ...types import Mission, RiskIndices, Weights

_FOLDER = Path(__file__).parent / "environments"
ENVIRONMENTS = (
    "env1_120kv_single_circuit",
    "env2_315kv_double_circuit",
    "env3_120kv_double_circuit",
)
FLIGHT_SITE = _FOLDER / "flight_120kv_line_model.yaml"
FLIGHT_VEHICLE = shipped_configs() / "vehicles" / "linedrone_flight.yaml"
SIMULATED_VEHICLE = shipped_configs() / "vehicles" / "linedrone.yaml"

SPLICES = ("splice-upper", "splice-lower")
DISPLACED_M: PlanePoint = (0.75, -0.9)
"""Displacement of the conductors in every other variation: aside by wind, and lower by sag."""
BASES = {
    "middle": Weights.normalised(1.0, 1.0, 1.0),
    "fast": Weights.normalised(0.05, 0.9, 0.05),
}
"""Weights k_{S,0}, k_{T,0}, k_{E,0} from which the sweeps of risks begin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One planning problem without its weights.

    environment: 1 to 3. displaced: the conductors hang aside and lower than surveyed.
    """

    environment: int
    mission: Mission
    splice: str
    displaced: bool

    @property
    def name(self) -> str:
        """The scene in a few words, as tables and figures have it."""
        moved = ", displaced" if self.displaced else ""
        return f"Env. {self.environment} {self.mission.value}, {self.splice}{moved}"

    @property
    def key(self) -> dict[str, int | str | bool]:
        """The scene in columns of a table."""
        return {
            "environment": self.environment,
            "mission": self.mission.value,
            "splice": self.splice,
            "displaced": self.displaced,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A scene's planner, its request without weights, and the initial weights."""

    scene: Scene
    planner: Planner
    request: PlanRequest

    def with_weights(self, weights: Weights) -> PlanRequest:
        """The request with final weights."""
        return replace(self.request, weights=weights)


SCENES = tuple(
    Scene(environment=number, mission=mission, splice=splice, displaced=displaced)
    for number, mission, splice, displaced in itertools.product(
        range(1, len(ENVIRONMENTS) + 1), Mission, SPLICES, (False, True)
    )
)
"""The 36 tests of the paper: three environments, three missions, four variations."""

SWEPT = tuple(scene for scene in SCENES if scene.splice == SPLICES[0] and not scene.displaced)
"""The nine scenes of the sensitivity: upper splice, conductors as surveyed."""


def problem(scene: Scene) -> Problem:
    """The planning problem of a scene."""
    site = environment_site(scene.environment, displaced=scene.displaced)
    target = site.target(scene.splice)
    inspects = scene.mission.visits_targets
    return Problem(
        scene=scene,
        planner=Planner(site, Vehicle.load(SIMULATED_VEHICLE)),
        request=PlanRequest(
            mission=scene.mission,
            target=target.name if inspects else None,
            start_m=site.start_m if inspects else target.position_m,
            velocity_mps=(0.0, 0.0),
            weights=BASES["middle"],
            risk=RiskIndices(),
        ),
    )


def environment_site(number: int, *, displaced: bool = False) -> Site:
    """The site of an environment, 1 to 3."""
    site = Site.load(_FOLDER / f"{ENVIRONMENTS[number - 1]}.yaml")
    return _displaced(site) if displaced else site


def _displaced(site: Site) -> Site:
    """The site with all conductors displaced, and their targets with them."""
    x_m, z_m = DISPLACED_M

    def moved(point: PlanePoint) -> PlanePoint:
        return point[0] + x_m, point[1] + z_m

    obstacles = tuple(
        item.moved(x_m, z_m) if isinstance(item, Conductor) else item for item in site.obstacles
    )
    targets = tuple(
        replace(
            item,
            position_m=moved(item.position_m),
            look_at_m=None if item.look_at_m is None else moved(item.look_at_m),
        )
        for item in site.targets
    )
    return replace(site, obstacles=obstacles, targets=targets)
