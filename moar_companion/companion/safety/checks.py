"""The checks of one cycle: telemetry, flight and computer against the limits. Pure.

Inputs: observations, limits, time; output: the supervisor's `Causes`, as texts with the value. A
required measurement that is missing is a cause. A reported value counts until the next one, at any
age: only a measurement ends a cause. Those of the position are in `position_checks`, of energy and
wind in `energy_checks`, of the link in `link_age`, of the autopilot's failsafes in
`autopilot_failsafe`; the others are here.
"""

from __future__ import annotations

from ...mavlink.telemetry import LandedState, Telemetry
from ...risk.receivers import trouble
from ...risk.wind import strongest
from ...settings.config import Supervision
from ...texts.text_format import exceeds, limit_text, listed, reason_chars, seconds
from ...types import Mission
from ..estimation.pose_tracker import LANDED_TIMEOUT_S, airborne, grounded
from . import energy_checks, link_age, position_checks
from .autopilot_failsafe import battery_failsafe, holding_failsafe, taken_mode
from .check_inputs import ROUTE_MAX_AGE_S, CheckInputs
from .condition_types import Causes

_MB = 1e6
_GROUNDED = "not in the air"


def causes(seen: CheckInputs, limits: Supervision, off_path_m: float, now_s: float) -> Causes:
    """Returns all present reasons against a flight. off_path_m: the vehicle's."""
    telemetry, faults = seen.telemetry, seen.faults
    no_fix = trouble(telemetry, seen.risk.localization.receivers, now_s)
    return Causes(
        autopilot_identity=_autopilot_identity(seen),
        autopilot_link_lost=link_age.silence(telemetry, limits, now_s),
        mode_unconfirmed=link_age.mode_unconfirmed(telemetry, limits, now_s),
        position=position_checks.position(seen, limits, now_s),
        attitude=position_checks.attitude(telemetry, now_s),
        origin="local origin unknown" if seen.pose is None else None,
        loop_stall=faults.loop_stall,
        autopilot_reboot=faults.autopilot_reboot,
        setpoint_rejected=faults.setpoint_rejected,
        failsafe_took_mode=taken_mode(telemetry),
        ground="on the ground" if grounded(telemetry) else None,
        landing=_mode_left(seen, landing=True),
        pilot=_mode_left(seen, landing=False),
        battery_critical=energy_checks.battery_critical(seen),
        battery_failsafe=battery_failsafe(telemetry),
        failsafe_reported=holding_failsafe(telemetry, escaping=seen.escaping),
        battery_reserve=energy_checks.battery_reserve(seen, limits.battery_reserve),
        energy_evacuation=energy_checks.energy_left(seen, Mission.EVACUATION),
        energy_exit=energy_checks.energy_left(seen, Mission.EXIT),
        energy_low_soon=energy_checks.energy_low_soon(seen.escape_route),
        failsafe_exposure=seen.exposure if seen.in_control else None,
        memory=_free("memory", seen.host.memory_available, limits.memory_free_mb),
        setpoint_held=faults.setpoint_held,
        no_clearance=faults.no_clearance,
        position_jump=position_checks.position_jump(seen, limits),
        origin_moved=position_checks.origin_moved(seen, limits),
        position_disagreement=position_checks.position_disagreement(seen),
        uncertainty=position_checks.uncertainty(seen, limits),
        uncertainty_grows=position_checks.uncertainty_grows(seen, limits),
        error_reach=position_checks.error_reach(seen),
        blind_landing=seen.blind_hit if seen.in_control else None,
        battery_landing=seen.battery_landing if seen.in_control else None,
        gnss=no_fix,
        localization=exceeds(
            "localization risk", seen.risk.indices.localization, limits.localization_limit, ""
        ),
        control_saturated=energy_checks.control_saturated(seen),
        wind=energy_checks.wind(seen, limits.wind_limit_mps),
        ground_link=_ground_link(telemetry, limits, now_s),
        autopilot_fence=faults.autopilot_fence if seen.in_control else None,
        outside_workspace=seen.excursion if seen.in_control else None,
        off_path=position_checks.off_path(seen, off_path_m),
        no_progress=position_checks.no_progress(seen),
        planner=_plan(seen, limits.plan_stale_s),
        planner_late=_plan(seen, limits.plan_stale_s) or _plan(seen, 0.5 * limits.plan_stale_s),
        path_barred=faults.path_barred,
        perception=perception(seen, now_s),
        obstacle=position_checks.obstacle(seen),
        off_plane=position_checks.off_plane(seen, limits),
        not_hovering=position_checks.not_hovering(seen),
        offboard_loss_unknown=faults.offboard_loss_unknown,
        parameter_unknown=_parameter_unknown(seen),
        offboard_loss_collision=faults.offboard_loss_collision,
        battery_silent=energy_checks.battery_silent(seen, now_s),
        disk=_free("disk", seen.host.disk_free, limits.disk_free_mb),
        not_flying=None if seen.in_control else _not_flying(telemetry, now_s),
        unmonitored=_unmonitored(seen, now_s)
        if seen.in_control or airborne(telemetry, now_s)
        else None,
    )


def _autopilot_identity(seen: CheckInputs) -> str | None:
    """Text where not exactly one autopilot, of the expected kind, is received."""
    autopilot = seen.telemetry.autopilot
    if autopilot is None:
        return "no autopilot is received"
    if seen.conflict is not None:
        return seen.conflict
    if seen.expected not in (None, autopilot.kind):
        return f"autopilot {autopilot.kind}, file {seen.expected}"
    return None if autopilot.multirotor else "the vehicle is no multirotor"


def _mode_left(seen: CheckInputs, *, landing: bool) -> str | None:
    """Text for a mode that is not ours. landing: the companion has requested the landing."""
    autopilot = seen.telemetry.autopilot
    if not seen.in_control or autopilot is None or seen.landing is not landing:
        return None
    # The mode may have been left and given back between two cycles.
    return seen.faults.pilot if autopilot.ours else f"autopilot in {autopilot.mode}"


def _not_flying(telemetry: Telemetry, now_s: float) -> str | None:
    """Text for an aircraft that is not in the air, lands or takes off."""
    if airborne(telemetry, now_s):
        return None
    landed = telemetry.landed
    known = landed is not None and now_s - landed.received_s <= LANDED_TIMEOUT_S
    words = {LandedState.LANDING: "landing", LandedState.TAKEOFF: "taking off"}
    return words.get(landed.state, _GROUNDED) if landed is not None and known else _GROUNDED


def _parameter_unknown(seen: CheckInputs) -> str | None:
    names = seen.parameters_unknown
    return listed("unread", names, reason_chars("rejected")) if names else None


def _ground_link(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Text for an operator's ground station that has sent nothing for too long."""
    received = telemetry.ground_station
    if received is None or now_s - received.received_s <= limits.ground_link_lost_s:
        return None
    return f"no ground station for {seconds(now_s - received.received_s)} s"


def _plan(seen: CheckInputs, limit_s: float) -> str | None:
    awaited_s = seen.plan_awaited_s
    return exceeds("no new plan for", awaited_s, limit_s, "s")


def perception(seen: CheckInputs, now_s: float) -> str | None:
    """Text for a lost, late, blinded or unread sensor, or an obstacle that the maps lack."""
    settings, health = seen.sensing, seen.sensor_health
    if settings.sensor is None:
        return None
    if health.refusal is not None:
        return f"lidar data {health.refusal.value}"
    if health.received_s is None or health.scan_s is None:
        return "no data of the lidar is received"
    silent_s, age_s = now_s - health.received_s, now_s - health.scan_s
    text = exceeds("lidar silent for", silent_s, settings.timeout_s, "s")
    text = text or exceeds("lidar scan age", age_s, settings.late_s, "s")
    if text is None and health.returns < settings.least_returns:
        text = f"lidar blinded, {health.returns:.0%} returns < {settings.least_returns:.0%}"
    return text or exceeds("obstacle unmapped for", seen.unmapped_s, settings.timeout_s, "s")


def _unmonitored(seen: CheckInputs, now_s: float) -> str | None:
    missing = [
        name
        for name, known in (
            ("wind", strongest(seen.risk.report.wind.inputs) is not None),
            ("battery", energy_checks.battery_monitored(seen, now_s)),
            ("position accuracy", seen.risk.position_accuracy_known),
            ("uploaded fence", not seen.fence_silent),
            ("ground station", seen.telemetry.ground_station is not None),
            (
                "escape route",
                seen.escape_route is not None and seen.escape_route.age_s <= ROUTE_MAX_AGE_S,
            ),
        )
        if not known
    ]
    return listed("unknown", missing, reason_chars("over")) if missing else None


def _free(what: str, left: float | None, limit_mb: float) -> str | None:
    if left is None or left >= limit_mb * _MB:
        return None
    return f"{what} {left / _MB:.0f} MB < {limit_text(limit_mb)}"
