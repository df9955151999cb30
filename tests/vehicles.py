"""Vehicles of tests by name: those in tests/data/vehicles, otherwise the shipped ones."""

from __future__ import annotations

from pathlib import Path

from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle

_OWN = Path(__file__).parent / "data" / "vehicles"


def vehicle_file(name: str) -> Path:
    """The file of a vehicle."""
    own = _OWN / f"{name}.yaml"
    return own if own.exists() else shipped_configs() / "vehicles" / f"{name}.yaml"


def named_vehicle(name: str) -> Vehicle:
    """The vehicle of this name."""
    return Vehicle.load(vehicle_file(name))
