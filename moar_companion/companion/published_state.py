"""State of the companion as ground stations plot, draw and read it. Reads the state, changes none.

In: the state after a cycle. Out: the heartbeat's system status, and to the session's services the
values to plot, the path as a mission and as the next corners, the computer's status.
"""

from __future__ import annotations

from functools import partial

from ..mavlink.session import SystemStatus
from ..mavlink.translate_outgoing import computer_status_messages, trajectory_messages
from ..types import GeodeticPoint, Vector
from .cycle_state import CycleState
from .estimation.landed_state import grounded
from .mission_states import ENGAGED, STREAMING, MissionState
from .safety.autopilot_failsafe import taken_mode
from .safety.check_inputs import ROUTE_MAX_AGE_S
from .safety.condition_types import Action
from .safety.conditions import CONDITIONS

_NUMBERS = {condition.name: number for number, condition in enumerate(CONDITIONS, start=1)}
"""Numbers of the conditions, from 1, by the order of the table."""


def system_status(state: CycleState) -> SystemStatus:
    """State of the companion in its heartbeat.

    EMERGENCY: a condition has released the aircraft in the air, until a pilot takes the mode or an
    operator orders a release, or the aircraft leaves a place where it would hit something.
    CRITICAL: a condition holds the flight, or ends it by an exit or evacuation. ACTIVE: setpoints
    are sent. STANDBY: none are.
    """
    mission, action = state.status.state, state.ruling.action
    if mission is MissionState.RELEASED and state.status.by_condition and _is_unattended(state):
        return SystemStatus.EMERGENCY
    if mission not in STREAMING:
        return SystemStatus.STANDBY
    if action >= Action.LEAVE:
        return SystemStatus.EMERGENCY
    return SystemStatus.CRITICAL if action >= Action.HOLD else SystemStatus.ACTIVE


def _is_unattended(state: CycleState) -> bool:
    """Returns True in the air in our mode or in one that a failsafe has chosen."""
    failsafe_flies = taken_mode(state.telemetry) is not None
    return (state.mode_ours or failsafe_flies) and not grounded(state.telemetry)


def publish(state: CycleState) -> None:
    """Gives the session's services what they publish and serve."""
    services = state.session.services
    services.values.take(_values(state))
    services.path.offer(_mission(state))
    ahead = partial(trajectory_messages, _ahead_ned_m(state))
    services.published.offer("TRAJECTORY_REPRESENTATION_WAYPOINTS", ahead)
    host = state.host
    computer = partial(
        computer_status_messages,
        memory_bytes=_used_bytes(host.memory_available, host.memory_total),
        disk_bytes=_used_bytes(host.disk_free, host.disk_total),
    )
    services.published.offer("ONBOARD_COMPUTER_STATUS", computer)


def _values(state: CycleState) -> dict[str, float | None]:
    """Values to plot by name; None where unknown."""
    risk, weights, leading = state.risk.indices, state.weights, state.ruling.leading
    route = state.risk_monitor.escape_route
    known = route is not None and route.age_s <= ROUTE_MAX_AGE_S
    flight = state.routes.flight if state.status.state in STREAMING else None
    return {
        "RISK_WIND": risk.wind,
        "RISK_COMM": risk.communication,
        "RISK_LOC": risk.localization,
        "RISK_BATT": risk.battery,
        "K_SAFETY": weights.safety,
        "K_TIME": weights.time,
        "K_ENERGY": weights.energy,
        "RESERVE_S": route.left_s if known and route is not None else None,
        "CLEARANCE": state.routes.limits.clearance_m(state.pose),
        "TO_GO": None if flight is None else flight.left_m,
        "M_STATE": state.status.state.number,
        "M_TARGET": _target(state),
        "CONDITION": 0 if leading is None else _NUMBERS[leading.condition.name],
    }


def _target(state: CycleState) -> int | None:
    """Number of the target that is flown to, from 0; None for an escape, and without a task."""
    task, site = state.status.requested or state.status.task, state.site
    if state.status.state not in ENGAGED or task is None or site is None or not task.stops:
        return None
    names = {target.name: target.target_name for target in site.targets}
    stop = task.stops[0]
    return site.target_names.index(names[stop]) if stop in names else None


def _mission(state: CycleState) -> tuple[GeodeticPoint, ...]:
    """Corners of the path that is flown or offered, on the map; none without a path.

    Where the autopilot's position will be, as ground stations draw it: without the line's offset.
    """
    flight, site = state.routes.flight, state.site
    if flight is None or site is None or state.status.state not in STREAMING:
        return ()
    x_m, z_m = state.pose_tracker.offset_m
    return tuple(
        site.frame.to_geodetic((corner_m[0] - x_m, corner_m[1], corner_m[2] - z_m))
        for corner_m in flight.corners_m()
    )


def _ahead_ned_m(state: CycleState) -> tuple[Vector, ...]:
    """The next corners of the path, in the autopilot's local frame; none without a path."""
    flight, plane = state.routes.flight, state.pose_tracker.plane
    if flight is None or plane is None or state.status.state not in STREAMING:
        return ()
    return tuple(plane.position_to_ned(corner_m) for corner_m in flight.corners_m(ahead=True))


def _used_bytes(free: float | None, total: float | None) -> tuple[float, float] | None:
    """Bytes in use, and all; None where either is unknown."""
    return None if free is None or total is None else (max(0.0, total - free), total)
