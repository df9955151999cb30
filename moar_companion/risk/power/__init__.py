"""Power model: energy of flying, and energy left in the batteries. Pure.

The vehicle file has the power of hovering, cruising, climbing and descending; `model` integrates it
along a path. In flight a `Meter` measures the one factor between the real power and the file's.
Energies are in Wh of the file; `Meter` applies the factor.
"""

from __future__ import annotations

from .cells import cell_v, is_powered
from .meter import BATTERY_MAX_AGE_S, Meter, in_the_air, metered, on_the_ground
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
