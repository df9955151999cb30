"""Failsafe exposure: the companion leaves before the autopilot's action would hit a conductor."""

from __future__ import annotations

import pytest

from moar_companion.settings.config import Supervision
from moar_companion.types import Mission

from ..copies import flown_once
from ..flights.judging import assert_nothing_was_touched, clearances_m, true_places
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import INSPECTION, Manner

INNER = 1.0
"""Index of the target above the lowest conductor."""
LANDS_AT_40 = {
    Manner.ARDUPILOT: {
        "BATT_CAPACITY": 3300,
        "BATT_CRT_MAH": 1320,
        "BATT_FS_CRT_ACT": 1,
        "BATT_LOW_VOLT": 0.0,
        "FS_OPTIONS": 20,
    },
    Manner.PX4: {
        "BAT_LOW_THR": 0.45,
        "BAT_CRIT_THR": 0.4,
        "BAT_EMERGEN_THR": 0.35,
        "COM_LOW_BAT_ACT": 2,
    },
}
LANDING = {Manner.ARDUPILOT: "LAND", Manner.PX4: "AUTO.LAND"}


def over_a_conductor(flight):
    """True if a vertical descent from here would enter a conductor's keep-out."""
    x_m, _, z_m = true_places(flight)[-1]
    return any(
        abs(item.position_m[0] - x_m) < flight.vehicle.radius_m + item.keep_out_m
        and item.position_m[1] < z_m
        for item in flight.site.obstacles
    )


@flown_once
def at_the_inner_target(manner):
    return inspecting(manner, LANDS_AT_40[manner])


def inspecting(manner, parameters, **options):
    """At the inner target."""
    flight = hovering(
        manner=manner, options={"parameters": parameters}, start_m=(15.0, 0.0), **options
    )
    flight.begin(INSPECTION, INNER)
    flight.run_until_state("at_target", 90.0)
    return flight


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize(("drain_factor", "percent"), [(3.0, 60.0), (12.0, 90.0)])
@pytest.mark.parametrize("manner", Manner)
def test_the_exit_begins_so_early_that_the_battery_is_never_critical_over_a_conductor(
    manner, drain_factor, percent
):
    flight = at_the_inner_target(manner)
    flight.autopilot.conditions.drain_factor = drain_factor
    flight.autopilot.conditions.battery_percent = percent
    flight.run_until(lambda: flight.companion.status.task.mission is Mission.EXIT, 120.0)
    assert flight.operator.has_received("landing in ")
    flight.run_until(
        lambda: LANDING[manner] in flight.truth.mode or flight.state == "landing_leg", 120.0
    )
    assert not over_a_conductor(flight)
    if flight.state != "landing_leg":
        flight.run_until(lambda: flight.truth.on_ground, 30.0)
    assert min(clearances_m(flight.site, true_places(flight), keep_out=True)) > 0.0


@pytest.mark.slow
def test_where_a_low_battery_only_brakes_the_exit_begins_before_the_low_battery_action():
    """BRAKE takes the mode: then no exit is possible before the critical-battery landing."""
    flight = Lockstep(
        manner=Manner.ARDUPILOT,
        options={
            "parameters": {
                **LANDS_AT_40[Manner.ARDUPILOT],
                "BATT_FS_LOW_ACT": 7,
                "BATT_LOW_MAH": 1980,
            }
        },
    )
    flight.begin(INSPECTION, INNER)
    flight.run_until_state("at_target", 90.0)
    flight.autopilot.conditions.drain_factor = 3.0
    flight.autopilot.conditions.battery_percent = 75.0
    flight.run_until(lambda: flight.truth.mode != "GUIDED", 240.0)
    assert flight.operator.has_received("landing in ")
    assert flight.operator.has_received("flying exit")
    assert not over_a_conductor(flight)


@pytest.mark.slow
def test_where_rc_loss_would_land_on_a_conductor_operators_get_a_text_and_the_exit_is_in_time():
    flight = inspecting(
        Manner.ARDUPILOT,
        {"FS_THR_ENABLE": 3, "FS_EKF_ACTION": 2},
        supervision=Supervision(exposure_limit_s=15.0),
    )
    assert flight.operator.has_received("MOAR: RC loss: landing hits ")
    flight.run_until(lambda: flight.companion.status.task.mission is Mission.EXIT, 60.0)
    assert flight.operator.has_received("RC loss hits left-lower")
    flight.run(10.0)
    assert flight.state == "flying"
    assert_nothing_was_touched(flight)
