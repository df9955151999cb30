"""Values shared by all packages: missions, risk indices, weights, points. All immutable."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NewType

Vector = tuple[float, float, float]


class Mission(str, enum.Enum):
    """The three navigation modes of the paper (Section IV-B)."""

    INSPECTION = "inspection"
    EXIT = "exit"
    EVACUATION = "evacuation"

    @property
    def visits_targets(self) -> bool:
        """True if its goals are targets; False for an escape, which ends at a landing point."""
        return self is Mission.INSPECTION


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskIndices:
    """The four mission failure risks of the paper (Section IV-C), each in [0, 1].

    Raises ValueError outside [0, 1]: an index is never clipped silently.
    """

    wind: float = 0.0
    communication: float = 0.0
    localization: float = 0.0
    battery: float = 0.0

    def __post_init__(self) -> None:
        for name, value in self.as_dict().items():
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} risk {value!r} is not in [0, 1]")

    def as_dict(self) -> dict[str, float]:
        """The indices by name, in the order of the paper."""
        return {
            "wind": self.wind,
            "communication": self.communication,
            "localization": self.localization,
            "battery": self.battery,
        }


@dataclass(frozen=True, slots=True)
class Weights:
    """The coefficients k_S, k_T, k_E of the cost function (Eq. 1): non-negative, sum 1.

    `Weights(...)` takes final weights; `Weights.normalised(...)` any non-negative numbers with a
    positive sum. Raises ValueError otherwise.
    """

    safety: float
    time: float
    energy: float

    def __post_init__(self) -> None:
        safety, time, energy = values = (self.safety, self.time, self.energy)
        if not (safety >= 0.0 and time >= 0.0 and energy >= 0.0 and max(values) < math.inf):
            raise ValueError(f"weights {values} must be finite and not negative")
        if abs(safety + time + energy - 1.0) > 1e-9:
            raise ValueError(f"weights {values} must sum to 1")

    @classmethod
    def normalised(cls, safety: float, time: float, energy: float) -> Weights:
        """Weights proportional to three non-negative numbers."""
        greatest = max(safety, time, energy)
        if not 0.0 < greatest < math.inf or not min(safety, time, energy) >= 0.0:
            raise ValueError(
                f"weights {(safety, time, energy)} must be finite, not negative, "
                "with a positive sum"
            )
        # By the greatest first: the sum of three huge numbers is infinite.
        parts = (safety / greatest, time / greatest, energy / greatest)
        total = parts[0] + parts[1] + parts[2]
        return cls(parts[0] / total, parts[1] / total, parts[2] / total)

    def adjusted(self, risk: RiskIndices) -> Weights:
        """Eq. 9 with these weights as k_{S,0}, k_{T,0}, k_{E,0}.

        The weights stay unchanged where all three terms vanish: k_{S,0} alone with a battery risk
        of 1; k_{T,0} alone with the other three at 1 and none from the battery.
        """
        wind, battery = risk.wind, risk.battery
        shift = 0.5 * wind + 0.25 * risk.communication + 0.25 * risk.localization - battery
        safety = self.safety * (1.0 + shift)
        time = self.time * (1.0 - shift)
        energy = self.energy * (1.0 + 0.5 * wind + 0.5 * battery)
        if safety + time + energy <= 0.0:
            return self
        return Weights.normalised(safety, time, energy)


AutopilotKind = NewType("AutopilotKind", str)
"""Kind of autopilot, by its name in vehicle files; `autopilots` has a profile of each."""
PX4, ARDUPILOT = AutopilotKind("px4"), AutopilotKind("ardupilot")
UNKNOWN = AutopilotKind("unknown")
AUTOPILOTS = (PX4, ARDUPILOT)
"""Kinds that can be flown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GeodeticPoint:
    """A point on WGS84; altitude above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float

    def east_deg(self, longitude_deg: float) -> float:
        """Degrees from this point east to a longitude, -180 to 180, across 180°, too."""
        return math.remainder(longitude_deg - self.longitude_deg, 360.0)
