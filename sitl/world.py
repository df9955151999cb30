"""The simulated world and aircraft, for any autopilot.

An autopilot's manner reads `estimator`, `battery` and `quad`, and writes `quad.demand`.
"""

import math
import random
from dataclasses import dataclass, field
from typing import Final

from sitl.battery import Battery, BatteryOptions
from sitl.conditions import Conditions, Wind
from sitl.geodesy import Geodetic, TrueFrame
from sitl.position_estimate import Estimator
from sitl.quadrotor import Airframe, Quadrotor

TICK_US: Final = 10_000
"""One step of physics and control: 100 Hz."""
TICK_S: Final = TICK_US / 1e6
_BATTERY_TICKS: Final = 10
EPOCH_US: Final = 1_795_212_000_000_000
"""Time of day at the start of every simulation, so that runs repeat exactly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOptions:
    """Place and equipment at the start; the default home is PX4's, in Zurich."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_amsl_m: float = 489.4
    yaw_deg: float = 0.0
    airframe: Airframe = field(default_factory=Airframe)
    battery: BatteryOptions = field(default_factory=BatteryOptions)
    estimate_noise: float = 1.0
    seed: int = 1


class World:
    """Truth and sensors, advanced one tick at a time."""

    def __init__(self, options: WorldOptions) -> None:
        """Place the aircraft on the ground at home."""
        self.options = options
        self.random = random.Random(options.seed)
        self.frame = TrueFrame(
            Geodetic(
                latitude_deg=options.latitude_deg,
                longitude_deg=options.longitude_deg,
                altitude_amsl_m=options.altitude_amsl_m,
            )
        )
        self.conditions = Conditions()
        self.wind = Wind(random.Random(options.seed + 1))
        self.quad = Quadrotor(options.airframe, math.radians(options.yaw_deg))
        self.battery = Battery(options.battery)
        self.estimator = Estimator(
            self.frame, random.Random(options.seed + 2), options.estimate_noise
        )
        self.now_us = 0
        self.took_off_s: float | None = None
        self._ticks = 0

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.now_us / 1e6

    def tick(self, *, armed: bool) -> None:
        """Advance everything by one tick."""
        self.now_us += TICK_US
        now_s = self.now_us / 1e6
        conditions = self.conditions
        self.wind.step(now_s, conditions)
        error_rad = math.radians(conditions.heading_error_deg)
        if error_rad != self.quad.heading_error_rad:
            self.quad.mislead(error_rad)
        self.quad.step(TICK_S, *self.wind.ned_mps, conditions.drag_per_s)
        if self.took_off_s is None and not self.quad.on_ground and self.quad.d < -0.2:
            self.took_off_s = now_s
        self.estimator.step(now_s, self.quad, conditions)
        self._ticks += 1
        if conditions.battery_percent is not None:
            self.battery.replace(max(0.0, min(1.0, conditions.battery_percent / 100.0)))
            conditions.battery_percent = None
        self.battery.forced_voltage_v = conditions.battery_voltage_v
        if self._ticks % _BATTERY_TICKS == 0:
            self.battery.step(
                TICK_S * _BATTERY_TICKS, self.quad.power_w(), conditions.drain_factor, armed=armed
            )
