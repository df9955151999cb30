"""The power model: what flying takes of the batteries, and what is left in them. Pure.

The vehicle file has the power of hovering, cruising, climbing and descending; a path takes what
these say along it (`model`). In flight a `Meter` finds the one factor by which the aircraft takes
more or less than that. Energies are in Wh as the file has it; `Meter` puts the factor to them.
"""

from __future__ import annotations

from .meter import BATTERY_MAX_AGE_S, Meter, cell_v, in_the_air, is_powered, metered, on_the_ground
from .model import Demands, PowerModel, landing_s

__all__ = [
    "BATTERY_MAX_AGE_S",
    "Demands",
    "Meter",
    "PowerModel",
    "cell_v",
    "in_the_air",
    "is_powered",
    "landing_s",
    "metered",
    "on_the_ground",
]
