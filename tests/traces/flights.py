"""The flights that are traced: stories beside both autopilots, and random flights with faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from moar_companion.settings.config import Authority, Supervision

from ..flights.campaign.drawing import Draw, draw
from ..flights.campaign.flying import RandomFlight, Stopped
from ..flights.lockstep import Lockstep
from ..flights.operator import EVACUATION, EXIT, INSPECTION, RELEASE, Manner
from ..scenarios.test_fence import CIRCLE, NAMES
from ..scenarios.test_supervision import NO_FAILSAFE_OF_ITS_OWN

SEEDS = (
    8, 11, 15, 18, 29, 39, 48, 59, 60, 99, 230, 244, 276, 329, 439, 486, 578, 609, 1492, 1711, 2703,
    4751, 5875, 7751, 10106,
)  # fmt: skip
"""Random flights that have each of `KINDS` once or more."""
KINDS = (
    "wind_rises", "wind_beyond", "gusts", "gust_hard", "vertical_wind", "wind_turns",
    "drag_unlike", "motors_weak", "gps_no_fix", "gps_silent", "gps_jammed", "satellites_few",
    "hdop_worse", "estimate_noisy", "estimate_reset", "estimate_jump", "estimate_jump_far",
    "estimate_jump_back", "estimate_drift", "height_drift", "battery_low", "battery_critical",
    "voltage_low", "battery_drains", "battery_unreported", "motor_output_reported",
    "link_loses", "link_delays", "link_reorders", "link_duplicates", "link_corrupts",
    "link_cut", "link_deaf", "link_mute", "link_stalls", "radio_fades", "late_positions",
    "late_modes", "forged_position", "forged_mode", "second_autopilot", "hostile_commands",
    "gcs_lost", "rc_lost", "pilot_takes_mode", "pilot_gives_back", "pilot_flies", "sticks_take",
    "operator_lands", "orders_contradict", "released", "autopilot_reboot", "clock_restarts",
    "force_disarmed", "home_moved", "fence_drawn_in", "fence_uploaded", "loss_action_changed",
    "parameters_missing", "stream_missing", "position_missing", "position_frozen",
    "mode_unreported", "origin_moved", "companion_restarts", "companion_killed", "loop_pauses",
    "planner_slow", "planner_silent", "disk_full", "memory_low", "read_late",
)  # fmt: skip
"""Kinds of faults from which they are drawn: a new kind changes no trace."""


def drawn(seed: int) -> Draw:
    """The flight of a seed, with the companion from the boot on, and to its end."""
    return replace(draw(seed, KINDS), whole=True)


FLIGHTS: dict[str, tuple[Callable[[], Lockstep], Callable[[Any], object]]] = {
    f"seed-{seed}": (lambda seed=seed: RandomFlight(drawn(seed)), RandomFlight.fly)
    for seed in SEEDS
}
"""Preparation and flight of each."""


def flown_with(parameters=None, **options):
    """Add a story to the table for both autopilots. options: of Lockstep."""

    def enter(story):
        for manner in Manner:
            own = {"parameters": (parameters or {}).get(manner, {})}
            ready = partial(Lockstep, manner=manner, options=own, **{"vehicle": "x500", **options})
            FLIGHTS[f"{story.__name__}-{manner.value}"] = (ready, story)
        return story

    return enter


def left_by(flight, mission):
    """Order a mission in flight, and run until it holds above the landing point."""
    flight.operator.mission(mission)
    flight.run_until_state("landing_leg", 120.0)
    flight.run_until_state("holding", 60.0)
    flight.run(2.0)


@flown_with()
def nominal(flight):
    flight.begin(INSPECTION)
    flight.run_until_state("holding", 200.0)
    flight.run(2.0)
    left_by(flight, EXIT)
    flight.land()


@flown_with(authority=Authority.ENGAGE)
def exit_engaged(flight):
    flight.take_off()
    flight.operator.mission(EXIT)
    flight.run_until(lambda: flight.truth.on_ground and not flight.truth.armed, 120.0)
    flight.run(3.0)


@flown_with(site="horizontal_three_conductors", vehicle="linedrone_uniform")
def evacuation_planned_slowly(flight):
    flight.plan_delay_s = 1.5
    flight.begin(INSPECTION)
    flight.run(8.0)
    left_by(flight, EVACUATION)


@flown_with(NO_FAILSAFE_OF_ITS_OWN)
def low_battery(flight):
    flight.begin(INSPECTION, 0)
    flight.run(4.0)
    for percent, seconds in ((19.0, 9.0), (6.0, 25.0)):
        flight.autopilot.conditions.battery_percent = percent
        flight.run(seconds)


@flown_with(supervision=Supervision(wind_limit_mps=7.0), site="120kv_single_circuit")
def wind_and_calm(flight):
    flight.begin(INSPECTION, 0)
    flight.run(4.0)
    flight.run_in_wind(14.0, 270.0, 12.0)
    flight.run(25.0)


@flown_with()
def takeover(flight):
    flight.begin(INSPECTION)
    flight.run(3.0)
    flight.autopilot.move_sticks()
    for mode in ("position", "ours", "hold"):
        flight.operator.mode(mode)
        flight.run(3.0)
    flight.operator.mission(EVACUATION)
    flight.give_mode()
    flight.run_until_state("landing_leg", 60.0)


@flown_with()
def pause_and_release(flight):
    flight.begin(INSPECTION, 0)
    flight.run(3.0)
    flight.operator.pause()
    flight.run(4.0)
    flight.operator.go_on()
    flight.run(5.0)
    flight.operator.mission(RELEASE)
    flight.run(5.0)


@flown_with()
def kill_and_continue(flight):
    flight.begin(INSPECTION, 0)
    flight.run(3.0)
    memory = flight.companion.memory
    flight.companion = Stopped(flight.companion, keeps=False)
    flight.run(2.0)
    flight.companion = flight.new_companion(before=memory)
    flight.run(4.0)
    flight.operator.go_on()
    flight.give_mode()
    flight.run_until_state("at_target", 90.0)


@flown_with(
    {
        Manner.PX4: CIRCLE[Manner.PX4](10.0),
        Manner.ARDUPILOT: CIRCLE[Manner.ARDUPILOT](10.0) | {"FENCE_TYPE": 3},
    }
)
def fence(flight):
    flight.take_off()
    for mission, index in ((EXIT, -1), (INSPECTION, 1)):
        flight.operator.mission(mission, index)
        flight.run(1.0)
    flight.begin(INSPECTION, 0)
    flight.run(4.0)
    flight.operator.set_parameter(NAMES[flight.operator.manner][1], 8.0)
    flight.run(15.0)


@flown_with()
def outside(flight):
    flight.begin(EXIT)
    flight.run_until_state("landing_leg", 60.0)
    flight.run(1.5)
    flight.operator.mode("hold")
    flight.run(3.0)
    flight.operator.mission(INSPECTION)
    flight.give_mode()
    flight.run(20.0)
    left_by(flight, EXIT)
