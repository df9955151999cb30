"""The power model: powers by phase, the energy of paths, and measurements of the batteries."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion import autopilots
from moar_companion.config import shipped_configs
from moar_companion.power import Meter, PowerModel, cell_v, landing_s, metered
from moar_companion.power.cells import misread
from moar_companion.risk_model import RiskModel
from moar_companion.telemetry import Battery, Landed, LandedState, LocalPosition, Telemetry
from moar_companion.vehicle import Power, Vehicle

properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)
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


# The powers ------------------------------------------------------------------------------------


def test_the_power_is_linear_between_flight_phases():
    model = model_of()
    speeds_mps = [(0, 0), (5, 0), (2.5, 0), (0, 3), (0, -1.5), (0, 1.5), (50, 0)]
    powers_w = [model.power_w(*speed_mps) for speed_mps in speeds_mps]
    assert powers_w == pytest.approx([300, 240, 270, 390, 270, 345, 240])


def test_the_energy_of_a_path_is_the_sum_of_its_phases():
    # 10 m level in 2 s, 6 m up in 2 s, a wait of 3 s.
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 0.0, 6.0], [10.0, 0.0, 6.0]])
    used_wh = model_of().path_wh(points, np.array([2.0, 2.0, 3.0]))
    assert used_wh == pytest.approx((2 * 240 + 2 * 390 + 3 * 300) / 3600.0)
    stop = model_of().path_wh(points[[0, 0]], np.array([0.0]))
    assert stop == 0.0


def test_missing_powers_follow_from_hover_power_and_endurance():
    model = PowerModel.of(replace(X500, power=Power(hover_w=200.0)))
    # Climbing at 3 m/s through air that sinks at 6 m/s: x + sqrt(1 + x^2), x = 3 / 12.
    assert (model.cruise_w, model.climb_w, model.descent_w) == pytest.approx(
        (200, 256.2, 200), 1e-3
    )
    assert model.capacity_wh == pytest.approx(200.0 * 900.0 / 3600.0)
    assert not model.capacity_known


def test_the_duration_of_a_landing_depends_on_the_autopilot():
    # 2.1 m at 0.7 m/s and 5 s on the ground; at 0.5 m/s and 1 s.
    assert landing_s(2.1, autopilots.PX4) == pytest.approx(8.0)
    assert landing_s(2.1, autopilots.ARDUPILOT) == pytest.approx(5.2)
    assert landing_s(2.1, autopilots.UNKNOWN) == pytest.approx(9.2)
    assert model_of().landing_wh(2.1, autopilots.PX4) == pytest.approx(8.0 * 300.0 / 3600.0)


# The factor ------------------------------------------------------------------------------------


@pytest.mark.parametrize("takes", [0.7, 0.85, 1.0, 1.15, 1.4])
@pytest.mark.parametrize("tells", [("remaining",), ("remaining", "current_a"), ("current_a",)])
def test_a_minute_of_flight_measures_the_power_of_the_aircraft(takes, tells):
    aircraft = Aircraft(model_of(), takes=takes, tells=tells).fly(5.0)
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.15)  # mostly the vehicle file
    for velocity in ((5.0, 0.0, 0.0), (0.0, 0.0, -3.0), (0.0, 0.0, 0.0)):
        aircraft.velocity_ned_mps = velocity
        aircraft.fly(20.0)
    assert aircraft.meter.factor == pytest.approx(takes, rel=0.05)
    assert aircraft.meter.source == ("current" if "current_a" in tells else "charge")


def test_without_a_capacity_the_power_is_measured_by_the_charge():
    model = model_of(Power(hover_w=300.0), endurance_s=900.0)
    aircraft = Aircraft(model, takes=1.5).fly(90.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.5, rel=0.05)
    # 900 s of flight at the file's power are 600 s.
    assert aircraft.meter.flight_s(model) == pytest.approx(600.0 * 0.8, rel=0.05)


def test_the_measured_power_follows_the_wind():
    aircraft = Aircraft(model_of(), takes=1.0).fly(300.0)
    aircraft.takes = 1.3
    aircraft.fly(240.0)
    assert aircraft.meter.factor > 1.2


def test_no_power_is_measured_on_the_ground():
    aircraft = Aircraft(model_of())
    aircraft.landed = LandedState.ON_GROUND
    aircraft.fly(60.0)
    assert (aircraft.meter.factor, aircraft.meter.source) == (1.0, "vehicle file")
    assert aircraft.meter.left_wh == pytest.approx(95.0)


def test_a_failed_current_sensor_is_ignored():
    aircraft = Aircraft(model_of(), takes=1.2)
    aircraft.sensor = 0.0
    aircraft.fly(90.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize(("sensor", "factor"), [(6.0, 7.2), (1000.0, 20.0)])
def test_a_current_far_too_great_counts_up_to_a_limit(sensor, factor):
    aircraft = Aircraft(model_of(), takes=1.2)
    aircraft.sensor = sensor
    aircraft.fly(30.0)
    assert aircraft.meter.source == "current"
    assert aircraft.meter.factor == pytest.approx(factor, rel=0.05)


def test_one_wrong_current_does_not_empty_the_battery():
    aircraft = Aircraft(model_of()).fly(120.0)
    aircraft.sensor = 1000.0
    assert aircraft.fly(1.0).meter.factor < 1.5
    aircraft.sensor = 1.0
    assert aircraft.fly(60.0).meter.factor < 1.25


@pytest.mark.parametrize(
    ("tells", "sensor"),
    [
        pytest.param(("remaining",), 1.0, id="no current"),
        pytest.param(("remaining", "current_a"), 1.0, id="charge and current"),
        pytest.param(
            ("remaining", "current_a"), 1.0 / 6.7, id="a cell fails, the current is usual"
        ),
        pytest.param(("current_a",), 1.0, id="no charge"),
    ],
)
@pytest.mark.parametrize("sudden", [False, True])
def test_a_drain_of_seven_times_the_files_is_not_ignored(tells, sensor, sudden):
    aircraft = Aircraft(model_of(), tells=tells)
    if tells == ("current_a",):
        aircraft.landed, aircraft.voltage_v = LandedState.ON_GROUND, 4 * 4.05
        aircraft.fly(2.0)
        aircraft.charges, aircraft.landed = [1.0], LandedState.IN_AIR
    if sudden:
        aircraft.fly(60.0)
    aircraft.takes, aircraft.sensor = 6.7, sensor
    left_s = math.inf
    while left_s > 15.0:
        aircraft.fly(1.0)
        left_s = max(aircraft.charges) * 1200.0 / 6.7
    promised_s = aircraft.meter.flight_s(aircraft.model)
    # One percent of the charge is 1.8 s.
    assert promised_s <= left_s + (3.0 if not sudden else 10.0)


@pytest.mark.parametrize("takes", [2.0, 3.0, 4.0])
def test_a_drain_that_begins_late_shows_within_half_a_minute(takes):
    aircraft = Aircraft(model_of(), tells=("remaining",), charges=(1.0,)).fly(300.0)
    aircraft.takes = takes
    aircraft.fly(45.0)
    left_s = aircraft.charges[0] * 1200.0 / takes
    assert aircraft.meter.flight_s(aircraft.model) < 1.3 * left_s


def test_the_power_is_measured_by_the_battery_that_drains_fastest():
    aircraft = Aircraft(model_of(), tells=("remaining",), charges=(0.9, 0.9))
    for _ in range(20):
        aircraft.charges[1] -= 3.0 * 300.0 / 3600.0 / 100.0
        aircraft.fly(1.0)
    left_s = aircraft.charges[1] * 1200.0 / 4.0
    assert aircraft.meter.flight_s(aircraft.model) == pytest.approx(left_s, rel=0.2)


def test_a_corrected_charge_does_not_count_as_flown():
    aircraft = Aircraft(model_of(), tells=("remaining",)).fly(60.0)
    aircraft.charges = [0.4]
    aircraft.fly(3.0)
    assert aircraft.meter.left_wh == pytest.approx(40.0, abs=1.5)
    aircraft.fly(60.0)
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.1)


# Remaining energy -------------------------------------------------------------------------------


def test_of_several_batteries_the_lowest_charge_and_all_currents_count():
    aircraft = Aircraft(model_of(), takes=1.2, charges=(0.9, 0.5)).fly(60.0)
    assert aircraft.meter.left_wh == pytest.approx(100.0 * aircraft.charges[1], abs=1.5)
    assert aircraft.meter.factor == pytest.approx(1.2, rel=0.03)


def test_the_remaining_energy_of_a_silent_battery_falls_by_the_flown_energy():
    aircraft = Aircraft(model_of(), takes=1.2).fly(60.0)
    aircraft.silent = True
    before_wh = aircraft.meter.left_wh
    aircraft.fly(120.0)
    used_wh = 1.2 * 300.0 * 120.0 / 3600.0
    assert before_wh - aircraft.meter.left_wh == pytest.approx(used_wh, rel=0.1)


@pytest.mark.parametrize("voltage_v", [4.2, 5.25])
def test_on_usb_power_the_remaining_energy_is_unknown(voltage_v):
    aircraft = Aircraft(model_of())
    aircraft.voltage_v = voltage_v
    assert aircraft.fly(5.0).meter.left_wh is None
    assert aircraft.meter.flight_s(aircraft.model) is None
    assert aircraft.meter.left_after_s(aircraft.model, 1.0) is None


def test_a_critical_voltage_goes_before_the_reported_charge():
    aircraft = Aircraft(model_of(), charges=(0.85,)).fly(10.0)
    assert aircraft.meter.left_wh == pytest.approx(84.0, abs=1.5)
    aircraft.voltage_v = 4 * 3.40
    assert aircraft.fly(2.0).meter.left_wh == pytest.approx(0.0, abs=4.0)


def test_a_short_high_current_does_not_empty_the_battery():
    model = model_of()
    resting = Battery(received_s=0.0, remaining=0.8, voltage_v=15.2, current_a=20.0, charge_state=1)
    # 40 A more sag a cell by 0.2 V: the cell voltage is corrected to the mean load.
    pulled = replace(resting, voltage_v=15.2 - 4 * 40.0 * 0.005, current_a=60.0)
    assert cell_v(pulled, model, 20.0) == pytest.approx(cell_v(resting, model, 20.0))
    assert cell_v(pulled, model, None) == pytest.approx(3.6)
    assert cell_v(pulled, model_of(cells=None), 20.0) is None


def test_without_a_percentage_voltage_and_current_give_the_charge():
    aircraft = Aircraft(model_of(), tells=("current_a",))
    aircraft.landed, aircraft.voltage_v = LandedState.ON_GROUND, 4 * 4.05
    assert aircraft.fly(5.0).meter.left_wh == pytest.approx(100.0)
    aircraft.landed, aircraft.voltage_v = LandedState.IN_AIR, 4 * 3.8
    aircraft.fly(120.0)
    # 300 W for 120 s are 10 Wh; by the voltage alone it would be 62 %.
    assert aircraft.meter.left_wh == pytest.approx(90.0, abs=1.5)


def test_without_a_percentage_and_a_current_the_voltage_gives_the_charge():
    aircraft = Aircraft(model_of(), tells=())
    aircraft.voltage_v = 4 * 3.9
    assert aircraft.fly(5.0).meter.left_wh == pytest.approx(100.0 * 0.5 / 0.65, abs=1.0)


def test_without_a_percentage_and_cells_the_remaining_energy_is_unknown():
    aircraft = Aircraft(model_of(cells=None), tells=("current_a",))
    assert aircraft.fly(5.0).meter.left_wh is None


# Silent batteries and wrong reports -------------------------------------------------------------


def change_first_battery(aircraft, **changes):
    """Changes the reports of the first battery from now on; the second reports as before."""
    report_before = aircraft.report

    def report(**others):
        report_before(**others)
        batteries = aircraft.telemetry.batteries
        first = replace(batteries[0], **changes)
        aircraft.telemetry = replace(aircraft.telemetry, batteries={**batteries, 0: first})

    aircraft.report = report


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"received_s": 100.0}, id="silent"),
        pytest.param({"remaining": None}, id="tells its charge no more"),
        pytest.param({"voltage_v": 4.1, "remaining": 1.0}, id="as if on USB"),
    ],
)
@pytest.mark.parametrize("cells", [4, None])
def test_the_emptiest_battery_keeps_counting_when_it_reports_no_charge(changes, cells):
    aircraft = Aircraft(model_of(cells=cells), tells=("remaining",), charges=(0.3, 0.8)).fly(30.0)
    before_wh = aircraft.meter.left_wh
    change_first_battery(aircraft, **changes)
    aircraft.fly(60.0)
    used_wh = aircraft.meter.factor * 300.0 * 60.0 / 3600.0
    assert before_wh - aircraft.meter.left_wh == pytest.approx(used_wh, abs=0.3)


def test_a_battery_removed_on_the_ground_is_dropped():
    aircraft = Aircraft(model_of(), charges=(0.3, 0.8)).fly(10.0)
    aircraft.landed, aircraft.charges = LandedState.ON_GROUND, [0.9]
    assert aircraft.fly(10.0).meter.left_wh == pytest.approx(90.0)


def test_the_remaining_energy_falls_while_the_landed_state_is_undefined():
    aircraft = Aircraft(model_of()).fly(60.0)
    before_wh, aircraft.silent, aircraft.landed = aircraft.meter.left_wh, True, None
    aircraft.fly(60.0)
    assert before_wh - aircraft.meter.left_wh == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"current_a": None}, id="no current"),
        pytest.param({"current_a": 0.0}, id="a dead sensor"),
        pytest.param({"received_s": 100.0}, id="one of two silent"),
    ],
)
def test_the_power_measured_by_current_is_kept_while_a_part_of_it_is_missing(changes):
    tells = ("current_a",)
    aircraft = Aircraft(model_of(), takes=1.5, tells=tells, charges=(0.9, 0.9)).fly(90.0)
    assert aircraft.meter.factor == pytest.approx(1.5, abs=0.05)
    change_first_battery(aircraft, **changes)
    for _ in range(12):
        assert aircraft.fly(10.0).meter.factor >= 1.45


def test_after_a_loss_of_the_current_the_power_is_measured_by_the_charge():
    aircraft = Aircraft(model_of(), takes=1.0).fly(90.0)
    aircraft.tells, aircraft.takes = ("remaining",), 1.5
    aircraft.fly(240.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor > 1.3


def test_a_charge_that_varies_by_a_percent_keeps_the_measured_power():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    assert aircraft.meter.factor == pytest.approx(1.5, abs=0.1)
    for _ in range(10):  # a gauge by voltage rises at each throttle-down
        aircraft.charges = [charge + 0.015 for charge in aircraft.charges]
        aircraft.fly(2.0)
        aircraft.charges = [charge - 0.015 for charge in aircraft.charges]
        assert aircraft.fly(10.0).meter.factor == pytest.approx(1.5, abs=0.15)


def test_two_batteries_that_drain_alike_measure_as_one_does():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",), charges=(0.9, 0.895))
    assert aircraft.fly(120.0).meter.factor == pytest.approx(1.5, abs=0.1)


def test_a_new_battery_keeps_the_measured_power_of_the_one_before():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    aircraft.charges = [0.95]
    for _ in range(30):
        assert aircraft.fly(2.0).meter.factor == pytest.approx(1.5, abs=0.15)


def test_a_current_reported_late_starts_from_the_power_measured_by_charge():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    aircraft.tells = ("remaining", "current_a")
    for _ in range(40):
        assert aircraft.fly(1.0).meter.factor == pytest.approx(1.5, abs=0.1)
    assert aircraft.meter.source == "current"


def test_a_current_reported_no_more_does_not_measure_a_later_flight():
    aircraft = Aircraft(model_of(), takes=1.5).fly(90.0)
    aircraft.tells, aircraft.landed = ("remaining",), LandedState.ON_GROUND
    assert aircraft.fly(2.0).meter.factor == pytest.approx(1.5, abs=0.05)
    aircraft.takes, aircraft.landed, aircraft.charges = 1.0, LandedState.IN_AIR, [0.95]
    aircraft.fly(120.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.1)


# Properties ------------------------------------------------------------------------------------

values = st.one_of(st.none(), st.floats(min_value=0.0, max_value=1.0))


@properties
@given(
    reports=st.lists(
        st.tuples(
            values,
            st.one_of(st.none(), st.floats(0.0, 60.0)),
            st.one_of(st.none(), st.floats(0.0, 400.0)),
            st.sampled_from(LandedState),
            st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3),
        ),
        max_size=12,
    ),
    capacity_known=st.booleans(),
)
def test_the_meter_stays_within_bounds_for_any_reports(reports, capacity_known):
    power = POWER if capacity_known else replace(POWER, capacity_wh=None)
    aircraft = Aircraft(model_of(power))
    model = aircraft.model
    for remaining, voltage_v, current_a, landed, velocity in reports:
        aircraft.landed, aircraft.velocity_ned_mps = landed, (0.0, 0.0, 0.0)
        aircraft.fly(0.5)
        aircraft.report(remaining=remaining, voltage_v=voltage_v, current_a=current_a)
        aircraft.telemetry = replace(
            aircraft.telemetry,
            local_position=replace(aircraft.telemetry.local_position, velocity_ned_mps=velocity),
        )
        aircraft.meter = metered(aircraft.meter, aircraft.telemetry, aircraft.now_s + 0.1, model)
        meter = aircraft.meter
        assert 0.2 <= meter.factor <= 20.0
        assert meter.left_wh is None or 0.0 <= meter.left_wh <= model.capacity_wh
        assert math.isfinite(meter.flown_wh)


lost = st.fixed_dictionaries(
    {},
    optional={
        "received_s": st.just(100.0),
        "remaining": st.none(),
        "voltage_v": st.none() | st.just(4.1),
        "current_a": st.none() | st.just(0.0),
    },
)


@settings(properties, max_examples=25)
@given(first=lost, undefined=st.booleans(), capacity_known=st.booleans())
def test_a_missing_report_never_raises_the_energy_nor_lowers_the_power(
    first, undefined, capacity_known
):
    power = POWER if capacity_known else replace(POWER, capacity_wh=None)
    aircraft = Aircraft(model_of(power), takes=1.4, charges=(0.7, 0.9)).fly(90.0)
    before = aircraft.meter
    change_first_battery(aircraft, **first)
    aircraft.landed = None if undefined else aircraft.landed
    for _ in range(4):
        left_wh = aircraft.meter.left_wh
        aircraft.fly(10.0)
        # A report is a whole percentage: the counted energy may be 1 % below the next report.
        assert aircraft.meter.left_wh <= left_wh + 0.01 * aircraft.model.capacity_wh
        assert aircraft.meter.factor >= before.factor - 0.1


@properties
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(12.0, 17.0), st.floats(12.0, 17.0))
def test_less_charge_or_voltage_never_leaves_more_energy(charge, other, volts, other_volts):
    left = []
    for remaining, voltage_v in (
        (min(charge, other), min(volts, other_volts)),
        (max(charge, other), max(volts, other_volts)),
    ):
        battery = Battery(
            received_s=1.0, remaining=remaining, voltage_v=voltage_v, current_a=None, charge_state=1
        )
        meter = metered(Meter(), Telemetry(batteries={0: battery}), 1.0, model_of())
        left.append(meter.left_wh)
    assert left[0] <= left[1]


def test_the_sections_of_a_vehicle_file_make_the_power_model():
    model = PowerModel.made(Power(capacity_wh=77.0), RiskModel(cells=6), 4.0, 2.0, 1.0)
    assert (model.capacity_wh, model.capacity_known, model.cells) == (77.0, True, 6)
    assert (model.cruise_mps, model.climb_mps, model.descent_mps) == (4.0, 2.0, 1.0)


def test_the_time_until_a_charge_is_unknown_without_the_remaining_energy():
    model = model_of()
    assert Meter().until_s(model, 0.2) is None
    assert Meter(left_wh=50.0).until_s(model, 0.2) == pytest.approx(30.0 / 300.0 * 3600.0)
    assert Meter(left_wh=10.0).until_s(model, 0.2) == 0.0


def test_a_wrong_number_of_cells_is_found_at_the_first_battery_with_a_voltage():
    silent, empty_port, full = (
        Battery(received_s=0.0, remaining=None, voltage_v=volts, current_a=None, charge_state=None)
        for volts in (None, 0.4, 25.0)
    )
    telemetry = Telemetry(batteries={0: silent, 1: empty_port, 2: full})
    assert misread(telemetry, 6) is None
    assert misread(telemetry, 4).startswith("battery 2: 25.0 V, not 4S")
    assert misread(Telemetry(batteries={0: silent, 1: empty_port}), 4) is None
