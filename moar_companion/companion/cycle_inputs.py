"""Inputs of a cycle's decisions: for contingency planning, the supervisor and the mission machine.

Each function reads the state of the machine, and changes nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..mavlink.telemetry import LandedState
from ..risk.localization import LINE_MAX_AGE_S, PlaceByLine
from ..risk.power.cells import misread
from .contingency.contingency_planner import ContingencyInputs
from .cycle_state import CycleState
from .estimation.pose import Pose
from .estimation.pose_tracker import FOLLOWS_MPS
from .mission import state_machine
from .mission.values import MissionStatus, Situation
from .mission_states import IN_CONTROL, STREAMING, MissionState
from .safety.check_inputs import CheckInputs, EscapeRoute
from .safety.position_checks import LINE_OFF_M, widening_m
from .safety.uncertainty_growth import AHEAD_S

_SEEN_S = 1.0
"""Maximum age of the last scan that showed the line."""
_DEVIATIONS = 2.0
"""Standard deviations of the offset that count: 95 % of each axis."""
ON_THE_WAY = (MissionState.FLYING, MissionState.LANDING_LEG)


def tracking_error_m(state: CycleState) -> float | None:
    """Distance from our setpoint to the aircraft; infinite where its pose is unknown.

    None while the companion is not in control.
    """
    flight, pose = state.routes.flight, state.pose
    if flight is None or state.status.state not in IN_CONTROL:
        return None
    return math.inf if pose is None else flight.error_m(pose)


def line_is_seen(state: CycleState, now_s: float) -> bool:
    """True while scans show the place by the line, and nothing is against it."""
    report = state.seen_obstacles.report
    if report is None or report.line.seen_s is None or report.line.contradicted_s is not None:
        return False
    if math.hypot(*report.line.offset_m) > LINE_OFF_M:
        return False
    return now_s - report.time_s <= LINE_MAX_AGE_S and now_s - report.line.seen_s <= _SEEN_S


def place_by_line(state: CycleState, now_s: float) -> PlaceByLine | None:
    """Place by the line, with its uncertainty; None where the pose has no offset by it.

    Without reports, and while scans contradict it, the estimate may drift unseen: after a second
    nothing is known of the place. Out of sight the pose is the autopilot's with the last offset:
    that may be wrong by what the estimate has drifted since, or, where it has come back, by the
    offset itself.
    """
    report, offset_m = state.seen_obstacles.report, state.pose_tracker.offset_m
    if report is None or (report.line.seen_s is None and not any(offset_m)):
        return None
    line, known_m = report.line, None
    against_s = math.inf if line.contradicted_s is None else line.contradicted_s
    age_s = max(0.0, now_s - min(report.time_s, against_s))
    if line.seen_s is not None and age_s <= LINE_MAX_AGE_S:
        x_m2, _, z_m2 = line.covariance_m2
        known_m = _DEVIATIONS * (math.sqrt(max(x_m2, z_m2)) + FOLLOWS_MPS * age_s)
    off_m = 0.0 if known_m is None else state.pose_tracker.lag_m(line)
    if not line_is_seen(state, now_s):
        whole_m = math.hypot(*offset_m)
        off_m = max(off_m, whole_m if known_m is None else min(known_m, whole_m))
    return PlaceByLine(
        received_s=report.time_s, uncertainty_m=known_m, off_m=off_m, wires=line.wires
    )


def exposure_limit_s(state: CycleState) -> float:
    """Maximum stay where a failsafe without a forecast would hit an obstacle.

    The dwell is added, or the expected time of a view's pictures.
    """
    task, site_maps = state.status.task, state.routes.limits.site_maps
    hold_s = 0.0 if site_maps is None or task is None else site_maps.hold_s(task.stops)
    return state.config.supervision.exposure_limit_s + hold_s


def scene(state: CycleState) -> ContingencyInputs | None:
    """Inputs of contingency planning; None where no plan is possible."""
    pose, volume = state.pose, state.routes.limits.volume
    risk = state.risk
    landed = state.telemetry.landed
    if pose is None or volume is None:
        return None
    if landed is not None and landed.state is not LandedState.IN_AIR:
        return None  # the aircraft takes off or lands
    plane, spread = state.pose_tracker.plane, risk.wind.spread
    beside = abs(pose.position_m[1]) > state.config.supervision.plane_tolerance_m
    if beside and state.status.state not in STREAMING:
        return None  # the pilot or the autopilot flies the aircraft
    return ContingencyInputs(
        pose=pose,
        status=state.status,
        flight=state.routes.flight,
        volume=volume,
        risk=risk.indices,
        widening_m=state.routes.inflation.lasting_m,
        fence=state.routes.limits.fence,
        failsafes=state.routes.limits.watch.failsafes,
        pace=state.pace,
        meter=risk.meter,
        reserve=state.config.supervision.battery_reserve,
        wind_mps=None
        if plane is None or spread is None
        else plane.velocity_from_ned((*spread.mean_ne_mps, 0.0)),
        model=risk.wind.learning.used(state.vehicle.risk),
    )


def situation(state: CycleState, now_s: float) -> Situation:
    """Inputs of the mission machine."""
    autopilot, guidance = state.telemetry.autopilot, state.vehicle.guidance
    flight, pose = state.routes.flight, state.pose
    error_m = math.inf if flight is None or pose is None else flight.error_m(pose)
    view = state.inspector.outcome(state.status, state.site)
    return Situation(
        ruling=state.ruling,
        mode_ours=state.mode_ours,
        mode_received_s=-math.inf if autopilot is None else autopilot.received_s,
        on_leg=flight is not None and flight.on_leg,
        arrived=state.routes.arrived(pose, now_s),
        dwell_s=_dwell_s(state),
        view_pending=view.pending,
        view_failed=view.failed,
        view_others=view.others,
        views_missing=view.missing,
        tracking_lost=flight is not None and error_m > guidance.tracking_hold_m,
    )


def check_inputs(state: CycleState, now_s: float) -> CheckInputs:
    """Inputs of the supervisor's checks."""
    flight, pose = state.routes.flight, state.pose
    site_maps = state.routes.limits.site_maps
    telemetry, risk = state.telemetry, state.risk
    escape_route = state.risk_monitor.escape_route
    room_m = None
    if site_maps is not None and pose is not None:
        room_m = site_maps.room_m(pose, state.vehicle.radius_m)
    agreement, jumped_m = state.pose_tracker.agreement, state.pose_tracker.jumped_m(now_s)
    # The cycle in which the mode is given counts as in control.
    begins = state_machine.engages(state.status, now_s, mode_ours=state.mode_ours)
    return CheckInputs(
        telemetry=telemetry,
        risk=risk,
        conflict=state.session.conflict,
        expected=state.vehicle.autopilot,
        pose=pose,
        position_moved_s=state.pose_tracker.position_moved_s,
        position_late_s=state.pose_tracker.position_late_s,
        jumped_m=jumped_m,
        jump_margin_m=_jump_margin_m(state, room_m, jumped_m),
        origin_moved_m=agreement.origin_moved_m,
        origin_margin_m=_jump_margin_m(state, room_m, agreement.origin_moved_m),
        global_off_m=agreement.global_off_m,
        home_off_m=agreement.home_off_m,
        room_m=room_m,
        widening_m=widening_m(risk, state.margin),
        uncertainty_soon_m=state.risk_monitor.uncertainty_m(AHEAD_S),
        line=state.seen_obstacles.line,
        error_hits=None if pose is None else _error_hits(state, pose),
        in_control=begins or state.status.state in IN_CONTROL,
        escaping=escapes(state.status),
        landing=state.mode_requester.is_landing(telemetry.autopilot, now_s),
        azimuth_rad=None if site_maps is None else math.radians(site_maps.site.frame.azimuth_deg),
        misread=misread(telemetry, state.vehicle.risk.cells),
        error_m=flight.error_m(pose) if flight is not None and pose is not None else None,
        drifted_m=flight.drifted_m(pose) if flight is not None and pose is not None else None,
        saturated=state.risk_monitor.saturated,
        held_wind_mps=state.risk_monitor.held_wind_mps,
        stopped=flight is not None and flight.stopped and state.status.state in ON_THE_WAY,
        excursion=flight.excursion(pose) if flight is not None and pose is not None else None,
        plan_awaited_s=state.routes.awaited_for_s(now_s),
        fence_silent=state.session.requests.fence_silent,
        parameters_unknown=state.routes.limits.unreported.denying,
        escape_route=escape_route,
        exposure=_exposure(state, escape_route, now_s),
        blind_hit=state.refuge.blind_hit,
        battery_landing=state.refuge.battery_landing,
        host=state.host,
        sensing=state.seen_obstacles.settings,
        sensor_health=state.seen_obstacles.health,
        unmapped_s=state.seen_obstacles.unmapped_s(now_s),
        faults=replace(
            state.faults.causes,
            offboard_loss_unknown=state.routes.limits.not_ready_reason,
            autopilot_fence=state.routes.limits.fence_objection(flight, pose),
            offboard_loss_collision=state.routes.limits.offboard_loss.objection,
            path_barred=state.routes.barred,
            no_clearance=state.faults.causes.no_clearance or state.routes.inflation.no_room,
        ),
    )


def _dwell_s(state: CycleState) -> float:
    """Time to stay at the present target."""
    task, site_maps = state.status.task, state.routes.limits.site_maps
    return 0.0 if site_maps is None or task is None else site_maps.dwell_s(task.stops)


def _exposure(state: CycleState, escape_route: EscapeRoute | None, now_s: float) -> str | None:
    """Reason to leave before an autopilot failsafe acts; None if there is none."""
    return state.routes.limits.watch.reason(
        state.telemetry,
        state.risk.meter,
        leaving_s=None if escape_route is None else escape_route.exposed_s,
        limit_s=exposure_limit_s(state),
        from_s=state.status.since_s,
        now_s=now_s,
    )


def _error_hits(state: CycleState, pose: Pose) -> str | None:
    """Name of the obstacle that the position's error will reach, here or at the stop point.

    None below the uncertainty limit: plans keep that distance. None, too, where no place is
    better: an escape route may lead to one. An inflated escape route goes on: it leads away.
    """
    here_m = pose.position_m
    flight, site_maps = state.routes.flight, state.routes.limits.site_maps
    soon_m = state.risk_monitor.uncertainty_m(AHEAD_S)
    if soon_m is None or soon_m <= state.config.supervision.position_uncertainty_limit_m:
        return None
    if site_maps is None or not site_maps.site.obstacles or state.refuge.is_best(here_m):
        return None
    inflated = flight is not None and flight.path.volume.reach is not None
    if inflated and escapes(state.status) and state.status.state in ON_THE_WAY:
        return None
    slack_m = math.sqrt(2.0) * site_maps.maps.grid.resolution_m  # paths lead through centres
    for place_m in (here_m, here_m if flight is None else flight.stop_m):
        room_m = site_maps.room_m(replace(pose, position_m=place_m), state.vehicle.radius_m)
        if room_m is not None and room_m + site_maps.site.margin.position_m + slack_m < soon_m:
            return site_maps.maps.reach.nearest((place_m[0], place_m[2]))
    return None


def _jump_margin_m(state: CycleState, room_m: float | None, jumped_m: float) -> float:
    """Permitted position error, here and before a jump of `jumped_m`.

    room_m: from the aircraft's hull to the nearest keep-out.
    """
    if room_m is None:
        return math.inf
    spare_m = room_m - state.margin.tracking_m - jumped_m
    return max(0.0, state.margin.position_m + min(0.0, room_m) + max(0.0, spare_m))


def escapes(status: MissionStatus) -> bool:
    """True while an exit or evacuation is flown."""
    task = status.task
    in_control = status.state in IN_CONTROL
    return in_control and task is not None and not task.mission.visits_targets
