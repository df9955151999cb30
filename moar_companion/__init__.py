"""moar-companion: risk-aware path planning and guidance for inspection next to power lines."""

from .planner.plan import Plan, PlanStatus
from .planner.planner import Planner
from .site import Site
from .types import Mission, RiskIndices, Weights
from .vehicle import Vehicle

__all__ = [
    "Mission",
    "Plan",
    "PlanStatus",
    "Planner",
    "RiskIndices",
    "Site",
    "Vehicle",
    "Weights",
]
