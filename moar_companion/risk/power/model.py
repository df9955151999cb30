"""Power of the flight phases, and energy of a path, of hovering and of a landing.

Inputs: the vehicle file; paths with their times. Outputs: W, and Wh of the file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...mavlink.autopilots import profile
from ...settings.risk_model import Range, RiskModel
from ...settings.vehicle import Power, Vehicle
from ...types import AutopilotKind

FloatArray = npt.NDArray[np.floating[Any]]

_INDUCED_MPS = 6.0
"""Speed of the air through the rotors in hover at some 90 N per square metre of rotor. Momentum
theory gives from it the additional power of a climb. A descent saves none: the rotors sink into
their own downwash."""
S_PER_H = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerModel:
    """Powers of a vehicle, each with the speed at which it applies; linear in between."""

    hover_w: float
    cruise_w: float
    climb_w: float
    descent_w: float
    cruise_mps: float
    climb_mps: float
    descent_mps: float
    capacity_wh: float
    capacity_known: bool
    """True if the Wh are real; otherwise only ratios are, and a current has no meaning."""
    reserve_s: float
    cells: int | None
    cell_voltage_v: Range
    cell_resistance_ohm: float

    @classmethod
    def of(cls, vehicle: Vehicle) -> PowerModel:
        """Model of a vehicle file, with defaults for missing values."""
        speed = vehicle.speed
        return cls.made(
            vehicle.power, vehicle.risk, speed.horizontal_mps, speed.up_mps, speed.down_mps
        )

    @classmethod
    def made(
        cls, power: Power, risk: RiskModel, cruise_mps: float, climb_mps: float, descent_mps: float
    ) -> PowerModel:
        """Model of the file's sections and the speeds of its powers."""
        hover_w, known_wh = power.hover_w, power.capacity_wh
        faster = 0.5 * climb_mps / _INDUCED_MPS
        return cls(
            hover_w=hover_w,
            cruise_w=hover_w if power.cruise_w is None else power.cruise_w,
            climb_w=hover_w * (faster + math.hypot(1.0, faster))
            if power.climb_w is None
            else power.climb_w,
            descent_w=hover_w if power.descent_w is None else power.descent_w,
            cruise_mps=cruise_mps,
            climb_mps=climb_mps,
            descent_mps=descent_mps,
            capacity_wh=hover_w * risk.endurance_s / S_PER_H if known_wh is None else known_wh,
            capacity_known=known_wh is not None,
            reserve_s=power.reserve_s,
            cells=risk.cells,
            cell_voltage_v=risk.cell_voltage_v,
            cell_resistance_ohm=power.cell_resistance_ohm,
        )

    def power_w(self, level_mps: float, up_mps: float) -> float:
        """Power at a level and an upward speed."""
        return float(self._power_w(level_mps, up_mps, min, max))

    def powers_w(self, level_mps: FloatArray, up_mps: FloatArray) -> FloatArray:
        """Powers at level and upward speeds, arrays of one shape."""
        powers: FloatArray = self._power_w(level_mps, up_mps, np.minimum, np.maximum)
        return powers

    def _power_w(self, level_mps: Any, up_mps: Any, least: Any, most: Any) -> Any:
        """Power at level and upward speeds (n,). least, most: elementwise minimum and maximum."""
        level, up = level_mps / self.cruise_mps, up_mps / self.climb_mps
        down = -up_mps / self.descent_mps
        return (
            self.hover_w
            + (self.cruise_w - self.hover_w) * least(level, 1.0)
            + (self.climb_w - self.hover_w) * least(most(up, 0.0), 1.0)
            + (self.descent_w - self.hover_w) * least(most(down, 0.0), 1.0)
        )

    def path_wh(self, position_m: FloatArray, duration_s: FloatArray) -> float:
        """Energy of a path through points (n, d), up last, with durations (n - 1,) between them."""
        moves = duration_s > 0.0
        velocity = np.diff(position_m, axis=0)[moves] / duration_s[moves, None]
        level_mps = np.sqrt((velocity[:, :-1] ** 2).sum(axis=1))
        power_w = self.powers_w(level_mps, velocity[:, -1])
        return float(power_w @ duration_s[moves]) / S_PER_H

    def hover_wh(self, seconds: float) -> float:
        """Energy of hovering."""
        return self.hover_w * seconds / S_PER_H

    def landing_wh(self, height_m: float, kind: AutopilotKind) -> float:
        """Energy of the autopilot's landing from a height, until the motors stop."""
        return self.hover_wh(landing_s(height_m, kind))


def landing_s(height_m: float, kind: AutopilotKind) -> float:
    """Duration of the autopilot's landing from a height, with the ground phase as hover time."""
    landing = profile(kind)
    return height_m / landing.landing_mps + landing.landed_hover_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Demands:
    """Energy still to be flown, in Wh of the vehicle file; None if unknown.

    flown: True if there is a mission to finish. finish_wh: of it and the better escape route after.
    """

    flown: bool = False
    finish_wh: float | None = None
    exit_wh: float | None = None
    evacuation_wh: float | None = None
