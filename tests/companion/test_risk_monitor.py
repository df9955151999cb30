"""Saturation: lean or motors at their limits, with and without reports."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.companion.risk_monitor import RiskMonitor
from moar_companion.mavlink.telemetry import MotorOutputs, Telemetry
from tests.vehicles import named_vehicle

from ..risk.conftest import HEALTHY

VEHICLE = named_vehicle("linedrone_uniform")


class Aircraft:
    """Reports ten times a second with one motor at its limit; messages in `silent` are missing."""

    def __init__(self):
        self.risk_monitor = RiskMonitor(VEHICLE)
        self.telemetry = Telemetry()
        self.now_s = 100.0
        self.silent = set()

    def fly(self, seconds):
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            values = {name: source(self.now_s) for name, source in HEALTHY.items()}
            values["motors"] = MotorOutputs(
                received_s=self.now_s, pulse_us=(1990, 1990, 1990, 1990)
            )
            values = {name: value for name, value in values.items() if name not in self.silent}
            self.telemetry = replace(self.telemetry, **values)
            self.risk_monitor.judge(self.telemetry, {}, None, None, self.now_s)
        return self.risk_monitor.saturated


def test_motors_at_their_limit_count_as_saturated_while_their_output_is_reported():
    aircraft = Aircraft()
    assert aircraft.fly(3.0)
    aircraft.silent = {"motors"}
    assert aircraft.fly(0.5)
    assert not aircraft.fly(3.0)
    aircraft.silent = set()
    assert aircraft.fly(3.0)
