"""The speed that this machine keeps: simulated seconds in a real one, measured before a flight."""

from __future__ import annotations

import time
from typing import Final

from sitl.autopilot import FakeAutopilot, Options

_MEASURED_S: Final = 2.0
"""Real time of a measurement."""
_CYCLE_S: Final = 0.02
_STEPS: Final = 20
"""Cycles of the fake autopilot, on the ground, that cost as much processor time as one of the
service: 17, and some for the processes beside it."""
_KEPT: Final = 0.95
"""Part of a speed that counts as kept."""
_PART: Final = 0.8
"""Part of what was reached that is flown: plans need the rest."""


def kept_speed(wanted: float) -> float:
    """The wanted speed, or a lower one if this machine does not keep it beside what runs now.

    Never below 1, as on an aircraft.
    """
    if wanted <= 1.0:
        return wanted
    reached = _reached(wanted)
    return wanted if reached >= _KEPT * wanted else max(1.0, _PART * reached)


def _reached(wanted: float) -> float:
    """Speed of cycles that cost as much as the service's and have the wanted deadlines."""
    vehicle = FakeAutopilot(Options())
    began_s, cycles = time.perf_counter(), 0
    while (taken_s := time.perf_counter() - began_s) < _MEASURED_S:
        time.sleep(max(0.0, cycles * _CYCLE_S / wanted - taken_s))
        for _ in range(_STEPS):
            vehicle.step(vehicle.truth.time_s + _CYCLE_S)
            list(vehicle.data_to_send())
        cycles += 1
    return cycles * _CYCLE_S / taken_s
