"""The number of cells, against the voltage."""

from __future__ import annotations

from moar_companion.mavlink.telemetry import Battery, Telemetry
from moar_companion.risk.power.cells import misread


def test_a_wrong_number_of_cells_is_found_at_the_first_battery_with_a_voltage():
    silent, empty_port, full = (
        Battery(received_s=0.0, remaining=None, voltage_v=volts, current_a=None, charge_state=None)
        for volts in (None, 0.4, 25.0)
    )
    telemetry = Telemetry(batteries={0: silent, 1: empty_port, 2: full})
    assert misread(telemetry, 6) is None
    assert misread(telemetry, 4).startswith("battery 2: 25.0 V, not 4S")
    assert misread(Telemetry(batteries={0: silent, 1: empty_port}), 4) is None
