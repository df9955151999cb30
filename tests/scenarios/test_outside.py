"""Orders outside the workspace, by the true flight.

On the landing leg of the exit 1.5 m past the border a pilot takes the mode, or the process
restarts without a state file. Above the landing point an inspection begins. Below the least
altitude, inside or outside, an order climbs first.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from itertools import pairwise

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from tests.thorough import sampled

from ..copies import flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_never_jump,
    setpoint_places,
)
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import (
    ACCEPTED,
    EVACUATION,
    EXIT,
    INSPECTION,
    MAV_CMD_DO_PAUSE_CONTINUE,
    TEMPORARILY_REJECTED,
    Manner,
)
from .marks import ARDUPILOT_FIRST

PX4, ARDUPILOT = Manner.PX4, Manner.ARDUPILOT
RIGHT_M = 30.0
"""Border of the workspace."""


def x_m(flight) -> float:
    return flight.companion.pose.position_m[0]


def z_m(flight) -> float:
    return flight.companion.pose.position_m[2]


def site_above(min_altitude_m: float) -> Site:
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    return replace(site, workspace=replace(site.workspace, min_altitude_m=min_altitude_m))


def low_site() -> Site:
    """The landing points on the ground: their legs end below the least altitude of 2.5 m."""
    site = site_above(2.5)
    landing_m = {
        mission: tuple((x, 0.0) for x, _ in points) for mission, points in site.landing_m.items()
    }
    return replace(site, landing_m=landing_m)


@flown_once
def on_the_leg(manner: Manner, low: bool = False) -> Lockstep:
    """On the landing leg of the exit, 1.5 m past the border."""
    flight = hovering(manner=manner, **({"site": low_site()} if low else {}))
    flight.begin(EXIT)
    flight.run_until(lambda: x_m(flight) > RIGHT_M + 1.5, 120.0)
    assert flight.state == "landing_leg"
    return flight


def left(manner, how, *, low=False):
    """A flight on the leg after a takeover, or after a crash without a state file."""
    flight = on_the_leg(manner, low)
    if how == "crash":
        flight.companion = flight.new_companion()
    flight.operator.mode("hold")
    flight.run(8.0 if how == "crash" else 3.0)
    assert RIGHT_M + 1.0 < x_m(flight) < RIGHT_M + 4.0
    assert flight.state == ("idle" if how == "crash" else "overridden")
    return flight


def flown(flight, order, until):
    """Flies an accepted order to a state; returns the least x on the path."""
    order()
    flight.give_mode()
    assert flight.operator.answers()[-1] == ACCEPTED
    least_m = x_m(flight)
    began_s = flight.now_s
    while flight.state != until:
        flight.step()
        least_m = min(least_m, x_m(flight))
        assert flight.now_s < began_s + 150.0, (flight.state, flight.operator.texts()[-5:])
    flight.run(1.0)
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    return least_m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "order", "low"),
    [
        (PX4, "exit", False),
        (ARDUPILOT, "continue", False),
        (PX4, "continue", True),
        (ARDUPILOT, "exit", True),
    ],
)
def test_after_a_takeover_on_the_landing_leg_an_order_flies_the_rest_of_the_leg(manner, order, low):
    flight = left(manner, "takeover", low=low)
    operator = flight.operator
    orders = {"exit": lambda: operator.mission(EXIT), "continue": operator.go_on}
    least_m = flown(flight, orders[order], "holding")
    assert least_m > RIGHT_M + 1.0
    assert operator.has_received("MOAR: above the landing point, holding")


@ARDUPILOT_FIRST
@pytest.mark.parametrize("past_m", [pytest.param(-0.6, marks=pytest.mark.slow), 0.3])
def test_an_exit_that_is_ordered_again_at_the_border_does_not_turn_back(manner, past_m):
    flight = hovering(manner=manner)
    flight.begin(EXIT)
    flight.run_until(lambda: x_m(flight) > RIGHT_M + past_m, 120.0)
    flight.operator.mission(EXIT)
    flight.run(4.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    ways_m = [x for x, _, _ in setpoint_places(flight)]
    assert all(after >= before - 1e-6 for before, after in pairwise(ways_m[-250:]))
    assert flight.state == "landing_leg"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "how", "low"),
    sampled(
        [(PX4, "crash", True)],
        list(itertools.product(Manner, ("takeover", "crash"), (False, True))),
    ),
)
def test_outside_on_the_landing_leg_an_inspection_returns_into_the_workspace(manner, how, low):
    flight = left(manner, how, low=low)
    flown(flight, lambda: flight.operator.mission(INSPECTION), "at_target")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "low", "how", "mission"),
    sampled(
        [(ARDUPILOT, False, "crash", EVACUATION), (ARDUPILOT, True, "crash", EXIT)],
        [
            (manner, low, how, mission)
            for manner, low in itertools.product(Manner, (False, True))
            for how, mission in (("takeover", EVACUATION), ("crash", EVACUATION), ("crash", EXIT))
        ],
    ),
)
def test_outside_on_the_landing_leg_another_escape_route_is_flown(manner, how, mission, low):
    flight = left(manner, how, low=low)
    flown(flight, lambda: flight.operator.mission(mission), "holding")
    assert flight.operator.has_received("MOAR: above the landing point, holding")


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_after_a_crash_without_a_state_file_there_is_nothing_to_continue(manner):
    flight = left(manner, "crash")
    flight.operator.go_on()
    flight.run(1.0)
    assert flight.operator.answers(MAV_CMD_DO_PAUSE_CONTINUE)[-1] == TEMPORARILY_REJECTED
    assert flight.operator.has_received("MOAR: nothing is held, rejected")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "low"),
    sampled([(ARDUPILOT, True)], list(itertools.product(Manner, (False, True)))),
)
def test_above_the_landing_point_the_next_inspection_is_flown(manner, low):
    flight = on_the_leg(manner, low)
    flight.run_until_state("holding", 60.0)
    flight.run(2.0)
    flight.operator.mission(INSPECTION)
    flight.run_until_state("at_target", 150.0)
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_above_the_landing_point_a_second_exit_does_not_move_the_aircraft(manner):
    flight = on_the_leg(manner)
    flight.run_until_state("holding", 60.0)
    flight.run(2.0)
    least_m = flown(flight, lambda: flight.operator.mission(EXIT), "holding")
    assert least_m > RIGHT_M + 9.0


@pytest.mark.parametrize(
    ("manner", "start_m", "mission"),
    [
        (ARDUPILOT, (27.0, 0.0), INSPECTION),
        pytest.param(ARDUPILOT, (27.0, 0.0), EXIT, marks=pytest.mark.slow),
        pytest.param(ARDUPILOT, (15.0, 0.0), INSPECTION, marks=pytest.mark.slow),
        pytest.param(ARDUPILOT, (15.0, 0.0), EXIT, marks=pytest.mark.slow),
        pytest.param(ARDUPILOT, (33.0, 0.0), INSPECTION, marks=pytest.mark.slow),
        pytest.param(ARDUPILOT, (33.0, 0.0), EXIT, marks=pytest.mark.slow),
        pytest.param(PX4, (33.0, 0.0), INSPECTION, marks=pytest.mark.slow),
    ],
)
def test_from_below_the_least_altitude_an_order_climbs_first(manner, start_m, mission):
    flight = Lockstep(manner=manner, start_m=start_m, site=site_above(4.0))
    flight.start_in_the_air(2.5)
    assert z_m(flight) < 3.0
    flight.operator.mission(mission)
    flight.give_mode()
    flight.run_until(lambda: z_m(flight) > 4.0, 20.0)
    assert x_m(flight) == pytest.approx(start_m[0], abs=0.7)
    flight.run(4.0)
    assert flight.state in {"flying", "landing_leg"}
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
