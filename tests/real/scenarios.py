"""Scenarios for every kind of aircraft. A scenario flies a rig, and prints nothing.

Its figures are computed afterwards (`figures.py`); OperatorError ends it if an expected event
did not happen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from sitl.demonstration.operator import EXIT, INSPECTION, OperatorError

from .ground import EVACUATION
from .kinds import CRITICAL_PERCENT, LOW_PERCENT, Kind
from .rig import LET_GO, Rig

OUTER, INNER = 0, 1
"""Targets of the site: in the open, and between the circuits."""
_INNER_REACHED_S = 200.0
_WIND_MPS, _WIND_S = 13.0, 14.0
_WIND_FROM_DEG = 250.0
_FENCE_M = 11.0
"""Radius around the take-off: the outer target is inside, both landing points are outside."""
_DRIFT_MPS, _DRIFT_M, _DRIFT_STEP_M = 0.3, 4.5, 0.15
_LOSS, _LEAST_DELAY_S, _MOST_DELAY_S = 0.3, 0.05, 0.2


@dataclass(frozen=True)
class Release:
    """An expected release: its reason for each autopilot, and its time after `Rig.cause`."""

    px4: str
    ardupilot: str
    least_s: float
    most_s: float


@dataclass(frozen=True)
class Scenario:
    """fly: the actions. release: by the companion, before the operator's LAND; None: none.

    parameters: set before the start. unable: reason why a kind cannot fly it; None if it can.
    shown: reason why its clearance and release are shown, and not judged; "" if they are.
    """

    name: str
    fly: Callable[[Rig], None]
    vehicle: str = "x500"
    release: Release | None = None
    shown: str = ""
    parameters: Callable[[Kind], dict[str, float]] = field(default=lambda _: {})
    unable: Callable[[Kind], str | None] = field(default=lambda _: None)
    speed: float = 2.0


def nominal(rig):
    """Both targets in turn, exit, LAND."""
    rig.up_and_flying()
    rig.wait_for_state("holding")
    exit_and_land(rig)


def exit_and_land(rig, mission=EXIT):
    """Fly an escape route to the landing point, and land."""
    since = rig.count
    rig.order(mission)
    rig.wait_for_state("holding", since=since)
    rig.land(above_landing_point=True)


def to_the_inner_target(rig):
    """Fly to the target between the circuits."""
    rig.up_and_flying(INNER)
    rig.wait_for_state("at_target", "holding", timeout_s=_INNER_REACHED_S)
    rig.watch(2.0)


def exit_from_inside(rig):
    to_the_inner_target(rig)
    exit_and_land(rig)


def evacuation_from_inside(rig):
    to_the_inner_target(rig)
    exit_and_land(rig, EVACUATION)


def low_battery_inside(rig):
    """The battery becomes low between the circuits; the companion begins the exit."""
    to_the_inner_target(rig)
    _wait_for_escape(rig, LOW_PERCENT)


def critical_battery_inside(rig):
    """Critical at once, where the autopilot's own landing would hit a conductor."""
    to_the_inner_target(rig)
    _wait_for_escape(rig, CRITICAL_PERCENT)


def _wait_for_escape(rig, percent):
    """Runs until the aircraft hovers above a landing point, is down, or was released earlier."""
    since = rig.count
    rig.set_battery(percent)
    rig.wait_for_state("landing_leg", *LET_GO, timeout_s=90.0, since=since)
    rig.wait_for_state("holding", *LET_GO, timeout_s=120.0)
    if rig.decisions.state in LET_GO:
        rig.watch(25.0)
        _down(rig)
        return
    rig.land(above_landing_point=True)


def critical_battery_after_low(rig):
    """Low between the circuits, critical above the landing point, where the autopilot acts."""
    to_the_inner_target(rig)
    since = rig.count
    rig.set_battery(LOW_PERCENT)
    rig.wait_for_state("landing_leg", timeout_s=90.0, since=since)
    rig.cause()  # the fake's battery may be critical by then
    rig.wait_for_state("holding", "released", timeout_s=120.0)
    rig.set_battery(CRITICAL_PERCENT)
    rig.watch(25.0)
    _down(rig)


def wind_and_calm(rig):
    """Blown off by more wind than the aircraft can hold; then calm, and recovery for 45 s."""
    rig.up_and_flying(OUTER)
    rig.watch(4.0)
    rig.set(rig.kind.wind(_WIND_MPS, _WIND_FROM_DEG))
    rig.watch(_WIND_S)
    rig.set(rig.kind.wind(0.0, _WIND_FROM_DEG))
    rig.watch(45.0)
    rig.land()


def kill_minus_nine(rig):
    """The service is killed in flight, restarts, and continues after an order."""
    rig.up_and_flying(INNER)
    rig.watch(5.0)
    rig.kill_service()
    rig.watch(4.0)
    since = rig.count
    rig.start_service()
    rig.watch(2.0)
    rig.operator.go_on()
    rig.watch(2.0)
    if not rig.ours():
        rig.operator.give_mode()
    rig.wait_for_state("at_target", "holding", timeout_s=_INNER_REACHED_S, since=since)
    exit_and_land(rig)


def stopped_and_continued(rig):
    """The service is not scheduled for 3 s, and releases; `continue` resumes the mission."""
    rig.up_and_flying(INNER)
    rig.watch(5.0)
    rig.cause()
    rig.stop_scheduling(3.0)
    rig.watch(8.0)
    rig.expects_release = False
    since = rig.count
    try:
        rig.operator.go_on()
    except OperatorError as error:
        rig.object(str(error))
        rig.land()
        return
    rig.watch(2.0)
    if not rig.ours():
        rig.operator.give_mode()
    rig.wait_for_state("at_target", "holding", timeout_s=_INNER_REACHED_S, since=since)
    exit_and_land(rig)


def takeover_by_mode(rig):
    """HOLD or LOITER from the ground station; the mode given back starts nothing."""
    rig.up_and_flying(INNER)
    rig.watch(5.0)
    rig.take_over(lambda: rig.operator.ask_for_mode(rig.takeover_mode()))
    rig.operator.ask_for_mode((4, 0) if rig.kind.autopilot == "ardupilot" else (6, 0))
    rig.watch(5.0)
    rig.land()


def takeover_by_sticks(rig):
    """PX4: the stick to its end; ArduPilot: the remote control's mode switch."""
    rig.up_and_flying(INNER)
    if rig.kind.autopilot == "px4":
        rig.operator.hold_sticks()
        rig.watch(5.0)
        rig.take_over(lambda: rig.operator.hold_sticks(roll=1.0))
        rig.operator.hold_sticks()
    else:
        rig.watch(5.0)
        rig.take_over(rig.operator.flip_mode_switch)
    rig.watch(4.0)
    rig.land()


def gps_loss(rig):
    """No GNSS fix for 20 s."""
    rig.up_and_flying(INNER)
    rig.watch(5.0)
    _lose_the_fix(rig)


def gps_loss_inside(rig):
    """No GNSS fix for 20 s, beginning between the circuits: the companion leaves at once.

    The autopilot's estimate lasts some seconds longer than the fix. Then it lands blindly.
    """
    to_the_inner_target(rig)
    _lose_the_fix(rig)
    if not any(text.text.endswith(", leaving") for text in rig.operator.received_texts):
        rig.object("stayed between the circuits when the fix was lost")


def _lose_the_fix(rig):
    rig.cause()
    rig.set(rig.kind.gps(found=False))
    rig.watch(20.0)
    rig.set(rig.kind.gps(found=True))
    rig.watch(10.0)
    _down(rig)


def gps_drift(rig):
    """The receiver's position drifts at 0.3 m/s to 4.5 m, so that the aircraft nears a conductor.

    Its reported accuracy does not change.
    """
    to_the_inner_target(rig)
    site = rig.site
    target = site.targets[INNER]
    (x_m, _), frame = target.position_m, site.frame
    towards = math.copysign(1.0, target.look_at_m[0] - x_m)
    here = frame.to_geodetic((x_m, 0.0, 0.0))
    for step in range(1, round(_DRIFT_M / _DRIFT_STEP_M) + 1):
        # The autopilot flies against the drift.
        there = frame.to_geodetic((x_m - towards * step * _DRIFT_STEP_M, 0.0, 0.0))
        north_deg = there.latitude_deg - here.latitude_deg
        rig.set(rig.kind.gps_offset(north_deg, there.longitude_deg - here.longitude_deg, 0.0))
        rig.watch(_DRIFT_STEP_M / _DRIFT_MPS)
    rig.watch(10.0)
    rig.land()


def gcs_loss(rig):
    """The ground station is silent for 20 s."""
    rig.up_and_flying(INNER)
    rig.watch(3.0)
    rig.cause()
    rig.operator.fall_silent()
    rig.watch(20.0)
    rig.operator.resume_sending()
    rig.watch(4.0)
    _down(rig)


def rc_loss(rig):
    """The pilot's sticks are lost for 10 s."""
    rig.boot()
    rig.start_service()
    if rig.kind.autopilot == "px4":
        rig.operator.hold_sticks()
    rig.take_off()
    rig.begin(INSPECTION, INNER)
    rig.watch(5.0)
    rig.cause()
    rig.operator.drop_sticks()
    if rig.kind.autopilot == "ardupilot":
        rig.set({"SIM_RC_FAIL": 1})
    rig.watch(10.0)
    if rig.kind.autopilot == "ardupilot":
        rig.set({"SIM_RC_FAIL": 0})
    rig.operator.hold_sticks()
    rig.watch(3.0)
    _down(rig)


def _down(rig):
    """LAND, unless the autopilot has landed already."""
    if rig.operator.armed:
        rig.land()


def fence(rig):
    """The autopilot's fence lies between the target and the landing point."""
    rig.up_and_flying(OUTER)
    rig.wait_for_state("at_target", "holding")
    rig.watch(2.0)
    since = rig.count
    try:
        rig.order(EXIT)
    except OperatorError as error:
        rig.notes.append(str(error))
    else:
        rig.wait_for_state("holding", timeout_s=90.0, since=since)
    rig.land()


def reboot(rig):
    """A reboot is refused in the air; after the landing the autopilot reboots and flies again."""
    rig.up_and_flying(OUTER)
    rig.watch(3.0)
    try:
        rig.operator.reboot()
    except OperatorError as error:
        rig.notes.append(str(error))
    rig.wait_for_state("at_target", "holding")
    rig.land()
    rig.watch(3.0)
    rig.operator.drop_sticks()  # the autopilot does not arm with a middle throttle
    rig.restart_autopilot()
    rig.expects_release = False
    rig.boot()
    rig.take_off()
    rig.watch(12.0)  # resets of the estimator on the ground count for 12 s
    rig.begin(INSPECTION, OUTER)
    rig.wait_for_state("at_target", "holding")
    rig.land()


def lossy_link(rig):
    """The whole mission with 30 % lost, 50 to 200 ms late and out of order; then a takeover."""
    rig.boot()
    rig.start_service()
    rig.take_off()
    rig.link.impair(_LOSS, _LEAST_DELAY_S, _MOST_DELAY_S)
    rig.watch(3.0)
    rig.begin(INSPECTION, -1)
    rig.wait_for_state("holding")
    since = rig.count
    rig.order(EXIT)
    rig.wait_for_state("landing_leg", since=since)
    rig.take_over(lambda: rig.operator.ask_for_mode(rig.takeover_mode()))
    rig.land()


def started_in_the_air(rig):
    """The service starts while the aircraft hovers."""
    rig.boot()
    rig.take_off()
    rig.start_service()
    rig.watch(3.0)
    rig.begin(INSPECTION, OUTER)
    rig.wait_for_state("at_target", "holding")
    exit_and_land(rig)


def _fence_parameters(kind):
    if kind.autopilot == "px4":
        return {"GF_MAX_HOR_DIST": _FENCE_M, "GF_ACTION": 2}
    return {"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": _FENCE_M, "FENCE_ACTION": 4}


def _switch_parameters(kind):
    """LOITER at the switch position of the pilot, and at the one after the override has expired."""
    return {"FLTMODE4": 5, "FLTMODE6": 5} if kind.autopilot == "ardupilot" else {}


def _gcs_parameters(kind):
    if kind.autopilot == "px4":
        return {"NAV_DLL_ACT": 1}
    return {"FS_GCS_ENABLE": 7}


def _driftless(kind):
    if not kind.real:
        return "flown in lockstep: tests/flights/campaign"
    if kind.autopilot == "px4":
        return "PX4 v1.17's own simulator has no offset of the receiver"
    return None


def _windless(kind):
    if kind.real and kind.autopilot == "px4":
        return "PX4 v1.17's own simulator has no wind"
    return None


_BLIND = Release("failsafe chose LAND", "failsafe chose LAND", 2.0, 15.0)
"""The autopilot lands without a position."""

SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("nominal", nominal),
        Scenario("exit", exit_from_inside),
        Scenario("evacuation", evacuation_from_inside),
        Scenario(
            "low_battery",
            low_battery_inside,
            parameters=lambda kind: kind.battery_thresholds(critical=False),
        ),
        Scenario(
            "critical_battery",
            critical_battery_inside,
            parameters=lambda kind: kind.battery_thresholds(critical=True, acts=False),
        ),
        Scenario(
            "critical_battery_after_low",
            critical_battery_after_low,
            release=Release("failsafe chose HOLD", "failsafe chose LAND", 0.0, 120.0),
            parameters=lambda kind: kind.battery_thresholds(critical=True),
        ),
        Scenario("wind_and_calm", wind_and_calm, vehicle="linedrone_flight", unable=_windless),
        Scenario("kill_minus_nine", kill_minus_nine, speed=1.0),
        Scenario(
            "stopped_and_continued",
            stopped_and_continued,
            release=Release("control loop stalled 3", "control loop stalled 3", 2.5, 4.0),
            speed=1.0,
        ),
        Scenario("takeover_by_mode", takeover_by_mode, speed=1.0),
        Scenario(
            "takeover_by_sticks",
            takeover_by_sticks,
            parameters=_switch_parameters,
            speed=1.0,
        ),
        Scenario("gps_loss", gps_loss, release=_BLIND),
        Scenario("gps_loss_inside", gps_loss_inside, release=_BLIND),
        Scenario(
            "gps_drift",
            gps_drift,
            shown="no sensor sees the line",
            unable=_driftless,
        ),
        Scenario(
            "gcs_loss",
            gcs_loss,
            release=Release("failsafe chose HOLD", "failsafe chose BRAKE", 4.0, 16.0),
            parameters=_gcs_parameters,
        ),
        Scenario(
            "rc_loss",
            rc_loss,
            release=Release("failsafe chose HOLD", "failsafe chose BRAKE", 0.3, 3.0),
        ),
        Scenario("fence", fence, parameters=_fence_parameters),
        Scenario("reboot", reboot),
        Scenario("lossy_link", lossy_link, speed=1.0),
        Scenario("started_in_the_air", started_in_the_air),
    )
}
