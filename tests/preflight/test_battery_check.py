"""Batteries before a flight: their values compared with each other and the vehicle file."""

import pytest

from moar_companion.companion.preflight.battery_check import CHARGE, battery_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.mavlink.telemetry import Battery, Telemetry
from moar_companion.settings.risk_model import RiskModel

OK, NOTE, WARNING, NO_GO = Level


def found(*, cells=4, reported_cells=None, **figures):
    """Finding on one battery. cells: the vehicle file's."""
    battery = Battery(
        received_s=5.0, current_a=None, charge_state=None, cells=reported_cells, **figures
    )
    (finding,) = battery_findings(Telemetry(batteries={0: battery}), RiskModel(cells=cells))
    return finding


@pytest.mark.parametrize(
    ("remaining", "voltage_v", "level", "words"),
    [
        (0.9, 16.0, OK, "90%, 16.0 V, 4.00 V a cell"),
        (None, 16.0, OK, "charge unknown"),
        (0.9, None, NOTE, "voltage unknown"),
        (1.0, 4.1, WARNING, "powered by USB"),
        (1.0, 5.2, WARNING, "powered by USB"),
        (1.0, 5.5, WARNING, "powered by USB"),
        (0.9, 11.0, NO_GO, "2.75 V a cell with 4 cells, which is impossible"),
        (0.9, 21.6, NO_GO, "5.40 V a cell with 4 cells, which is impossible"),
        (1.0, 12.6, WARNING, "3.15 V a cell with 4 cells, which is not the voltage of that charge"),
        (0.4, 16.8, WARNING, "4.20 V a cell with 4 cells, which is not the voltage of that charge"),
        (0.6, 16.4, NOTE, "60%, 16.4 V, 4.10 V a cell"),
        (0.4, 14.4, WARNING, "40%, 14.4 V, 3.60 V a cell"),
        (0.4, 12.6, NO_GO, "40%, 12.6 V, 3.15 V a cell"),
        (0.03, 13.6, NO_GO, "3%, 13.6 V, 3.40 V a cell"),
        (0.03, None, NO_GO, "3%, voltage unknown"),
    ],
)
def test_a_battery_is_judged_by_its_charge_and_voltage(remaining, voltage_v, level, words):
    finding = found(remaining=remaining, voltage_v=voltage_v)
    assert finding.subject == "battery 0"
    assert (finding.level, words in finding.text) == (level, True), finding.text
    assert bool(finding.remedy) is (level >= WARNING)


@pytest.mark.parametrize(
    ("cells", "level", "words"),
    [(None, WARNING, "powered by USB"), (2, NO_GO, "2.70 V a cell with 2 cells")],
)
def test_the_voltage_of_usb_may_be_that_of_two_empty_cells(cells, level, words):
    finding = found(cells=cells, remaining=1.0, voltage_v=5.4)
    assert (finding.level, words in finding.text) == (level, True), finding.text


def test_a_silent_battery_is_a_no_go_and_a_warning_beside_a_battery_that_reports():
    nothing = found(remaining=None, voltage_v=None)
    assert (nothing.level, nothing.text) == (
        NO_GO,
        "charge and voltage unknown: an empty battery would not be detected",
    )
    batteries = {
        number: Battery(
            received_s=5.0, remaining=share, voltage_v=volts, current_a=None, charge_state=None
        )
        for number, share, volts in ((0, 0.9, 16.0), (1, None, None))
    }
    known, unknown = battery_findings(Telemetry(batteries=batteries), RiskModel(cells=4))
    assert (known.level, unknown.level) == (OK, WARNING)
    assert unknown.subject == "battery 1"
    assert unknown.remedy != CHARGE  # it is misread


@pytest.mark.parametrize(("reported", "level"), [(4, OK), (5, NO_GO), (3, NO_GO), (None, OK)])
def test_the_number_of_cells_is_compared_with_that_of_the_battery(reported, level):
    finding = found(remaining=0.7, voltage_v=15.6, cells=4, reported_cells=reported)
    assert finding.level is level
    assert (f"voltages of {reported} cells, the vehicle file has 4" in finding.text) is (
        level is NO_GO
    )
    assert ("correct risk.cells" in finding.remedy) is (level is NO_GO)


def test_the_cells_that_a_battery_reports_are_proposed_for_the_vehicle_file():
    finding = found(remaining=0.7, voltage_v=15.6, cells=None, reported_cells=4)
    assert finding.level is NOTE
    assert finding.text.endswith("without risk.cells in the vehicle file, which is 4")


def test_a_voltage_is_not_judged_without_the_number_of_cells():
    finding = found(remaining=0.9, voltage_v=21.6, cells=None)
    assert finding.level is NOTE
    assert "not judged without risk.cells" in finding.text
    empty = found(remaining=0.03, voltage_v=21.6, cells=None)
    assert (empty.level, empty.remedy) == (NO_GO, CHARGE)


def test_a_missing_battery_is_a_no_go():
    (finding,) = battery_findings(Telemetry(), RiskModel(cells=4))
    assert finding.level is NO_GO
