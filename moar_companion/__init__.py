"""moar-companion: risk-aware path planning and guidance for inspection next to power lines."""

from __future__ import annotations

import importlib

TYPE_CHECKING = False
"""True for type checkers; `typing` takes milliseconds to load, before Ctrl-C is caught."""
if TYPE_CHECKING:
    from .planner.plan_values import Plan, PlanStatus
    from .planner.planner import Planner
    from .planner.site import Site
    from .settings.vehicle import Vehicle
    from .types import Mission, RiskIndices, Weights

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

_HOMES = {
    "Mission": "types",
    "Plan": "planner.plan_values",
    "PlanStatus": "planner.plan_values",
    "Planner": "planner.planner",
    "RiskIndices": "types",
    "Site": "planner.site",
    "Vehicle": "settings.vehicle",
    "Weights": "types",
}
"""Modules by name, imported at first use: the command line's help needs no compiler."""


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
