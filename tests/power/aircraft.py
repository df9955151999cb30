"""An aircraft whose batteries are drained by the vehicle file's powers, for tests of the meter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from moar_companion.mavlink.telemetry import Battery, Landed, LandedState, LocalPosition, Telemetry
from moar_companion.risk.power import Meter, PowerModel, metered
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Power, Vehicle

X500 = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
"""5 m/s level, 3 m/s up, 1.5 m/s down; four cells, 900 s of flight."""
POWER = Power(hover_w=300.0, cruise_w=240.0, climb_w=390.0, descent_w=270.0, capacity_wh=100.0)
STEP_S = 0.1


def model_of(power=POWER, **risk):
    return PowerModel.of(replace(X500, power=power, risk=replace(X500.risk, **risk)))


class Aircraft:
    """Batteries that are drained and report once a second, with the given fields."""

    def __init__(self, model, *, takes=1.0, tells=("remaining", "current_a"), charges=(0.95,)):
        self.model, self.takes, self.tells = model, takes, tells
        self.charges, self.voltage_v = list(charges), 15.2
        self.velocity_ned_mps = (0.0, 0.0, 0.0)
        self.landed = LandedState.IN_AIR
        self.silent, self.sensor = False, 1.0
        self.now_s, self.meter, self.telemetry = 100.0, Meter(), Telemetry()

    @property
    def power_w(self):
        north, east, down = self.velocity_ned_mps
        power_w = self.model.power_w(np.array(math.hypot(north, east)), np.array(-down))
        on_ground = self.landed is LandedState.ON_GROUND
        return 0.0 if on_ground else self.takes * float(power_w)

    def fly(self, seconds):
        for step in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            used = self.power_w * STEP_S / 3600.0 / self.model.capacity_wh
            self.charges = [charge - used for charge in self.charges]
            if step % 10 == 0 and not self.silent:
                self.report()
            self.telemetry = replace(
                self.telemetry,
                landed=None
                if self.landed is None
                else Landed(received_s=self.now_s, state=self.landed),
                local_position=LocalPosition(
                    received_s=self.now_s,
                    boot_s=self.now_s,
                    position_ned_m=(0.0, 0.0, -10.0),
                    velocity_ned_mps=self.velocity_ned_mps,
                ),
            )
            self.meter = metered(self.meter, self.telemetry, self.now_s, self.model)
        return self

    def report(self, **changes):
        """Reports each battery; the percentage is truncated, as in MAVLink."""
        count = len(self.charges)
        self.telemetry = replace(
            self.telemetry,
            batteries={
                number: replace(
                    Battery(
                        received_s=self.now_s,
                        remaining=math.floor(100.0 * charge + 1e-9) / 100.0
                        if "remaining" in self.tells
                        else None,
                        voltage_v=self.voltage_v,
                        current_a=self.sensor * self.power_w / count / self.voltage_v
                        if "current_a" in self.tells
                        else None,
                        charge_state=1,
                    ),
                    **changes,
                )
                for number, charge in enumerate(self.charges)
            },
        )


def change_first_battery(aircraft, **changes):
    """Changes the reports of the first battery from now on; the second reports as before."""
    report_before = aircraft.report

    def report(**others):
        report_before(**others)
        batteries = aircraft.telemetry.batteries
        first = replace(batteries[0], **changes)
        aircraft.telemetry = replace(aircraft.telemetry, batteries={**batteries, 0: first})

    aircraft.report = report
