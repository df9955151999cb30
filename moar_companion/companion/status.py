"""Status of the companion at one instant, for all displays and recordings.

In: the companion, and its decisions. Out: `Status`, whose values `status_values` describes, as a
dict fit for JSON.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..mavlink.telemetry import LinkStatistics, Telemetry
from ..risk.explain import risk_section, weights_section
from ..status_values import (
    AircraftSection,
    AutopilotSection,
    BatteryEntry,
    ConditionEntry,
    CostEntry,
    FailsafeEntry,
    FailsafesSection,
    GateSection,
    HostSection,
    LineEntry,
    LinkSection,
    MissionSection,
    PathSection,
    PerceptionSection,
    PlanSection,
    RadioSection,
    SeenEntry,
    Status,
    SupervisionSection,
    WaypointEntry,
    json_dict,
)
from .companion import Companion
from .cycle_state import CycleState
from .mission.values import MissionStatus
from .mission_states import STREAMING
from .reports import Decision
from .safety.check_inputs import Host
from .safety.supervisor import Ruling
from .setpoint_streamer import SetpointRefusal

_NO_SOURCES = {
    "failsafes_reported",
    "ground_stations",
    "operator_id",
    "batteries",
    "second_gnss_first",
    "better_gnss_taken",
    "motor_min_us",
    "motor_max_us",
}
"""Fields of the telemetry without an age of their own."""
_STRAIGHT_M = 1e-6
"""Greatest detour over a waypoint that lies on a straight line."""
_RATE_PERIOD_S = 1.0
"""Time over which packets are counted for a rate."""


class LatestDecisions:
    """Latest decisions: the part of the status that needs memory."""

    def __init__(self) -> None:
        self._text: Decision | None = None
        self._plan: Decision | None = None
        self._path: tuple[WaypointEntry, ...] = ()
        self._paths = 0
        self._replans = 0
        self._counted: LinkStatistics | None = None
        self._rate_hz: float | None = None

    def note(self, decisions: Iterable[Decision], link: LinkStatistics | None) -> None:
        """Takes the decisions since the last call, and the count of received packets."""
        for decision in decisions:
            match decision.kind:
                case "text":
                    self._text = decision
                case "replan":
                    self._replans += 1
                case "plan":
                    self._plan = decision
                    waypoints = decision.data["plan"]["waypoints"]
                    self._path = _corners([WaypointEntry(**point) for point in waypoints])
                    self._paths += 1
        self._count(link)

    def _count(self, link: LinkStatistics | None) -> None:
        before = self._counted
        if link is None or before is None or link.packets_received < before.packets_received:
            self._counted, self._rate_hz = link, None
            return
        elapsed_s = link.received_s - before.received_s
        if elapsed_s >= _RATE_PERIOD_S:
            self._rate_hz = (link.packets_received - before.packets_received) / elapsed_s
            self._counted = link

    def status_of(
        self, companion: Companion, now_s: float, *, clock_offset_s: float, recorder: Path | None
    ) -> dict[str, Any]:
        """Returns the status. clock_offset_s: wall clock minus the machine's clock."""
        state = companion.state
        telemetry = state.telemetry
        status = Status(
            time_s=now_s + clock_offset_s,
            autopilot=_autopilot(telemetry, now_s),
            supervision=_supervision(state.ruling),
            gate=_gate(state.setpoints.last_refusal, now_s),
            failsafes=_failsafes(state),
            mission=self._mission(state.status, now_s),
            aircraft=_aircraft(state),
            path=_path(state),
            risk=risk_section(state.risk),
            batteries=_batteries(telemetry, now_s),
            energy=state.risk_monitor.energy_forecast,
            weights=weights_section(state.adaptation, state.risk.indices),
            plan=self._last_plan(now_s),
            link=self._link(telemetry),
            refused=_refused(companion),
            radio=_radio(telemetry, now_s),
            age_s=_ages_s(telemetry, now_s),
            perception=_perception(state, now_s),
            inspection=state.inspector.section(state.site, now_s),
            host=_host(state.host),
            parameters={} if companion.parameters is None else dict(companion.parameters.changed),
            recorder=None if recorder is None else str(recorder),
        )
        return json_dict(status)

    def _mission(self, status: MissionStatus, now_s: float) -> MissionSection:
        text = self._text
        task = status.requested or status.task
        return MissionSection(
            state=status.state.value,
            for_s=now_s - status.since_s if status.since_s else None,
            mission=None if task is None else task.mission.value,
            goal=None if task is None or task.done else task.goal,
            text=None if text is None else text.data["text"],
            text_age_s=None if text is None else now_s - text.time_s,
        )

    def _last_plan(self, now_s: float) -> PlanSection | None:
        if self._plan is None:
            return None
        plan, change = self._plan.data["plan"], self._plan.data["explanation"]["path"]
        return PlanSection(
            status=plan["status"],
            site=plan["site"],
            mission=plan["mission"],
            target=plan["target"],
            cost=None if plan["cost"] is None else CostEntry(**plan["cost"]),
            search_ms=plan["compute"]["search_ms"],
            age_s=now_s - self._plan.time_s,
            reason=self._plan.data["explanation"]["reason"],
            change=None if change is None else change["words"],
            path=self._path,
            paths=self._paths,
            replans=self._replans,
        )

    def _link(self, telemetry: Telemetry) -> LinkSection | None:
        link = telemetry.link
        if link is None:
            return None
        return LinkSection(
            packets_received=link.packets_received,
            packets_lost=link.packets_lost,
            packets_late=link.packets_late,
            rate_hz=self._rate_hz,
        )


def _refused(companion: Companion) -> dict[str, dict[str, int]] | None:
    """Packets refused by signed link and reason; None if no link is signed."""
    refused = companion.signing.packets_refused
    if not refused:
        return None
    return {
        link: {reason.name.lower(): count for reason, count in counts.items()}
        for link, counts in refused.items()
    }


def _autopilot(telemetry: Telemetry, now_s: float) -> AutopilotSection | None:
    autopilot = telemetry.autopilot
    if autopilot is None:
        return None
    return AutopilotSection(
        kind=autopilot.kind,
        system_id=autopilot.system_id,
        mode=autopilot.mode,
        ours=autopilot.ours,
        armed=autopilot.armed,
        failsafe=autopilot.failsafe,
        age_s=now_s - autopilot.received_s,
    )


def _supervision(ruling: Ruling) -> SupervisionSection:
    return SupervisionSection(
        action=ruling.action.name.lower(),
        conditions=tuple(
            ConditionEntry(
                name=item.condition.name,
                action=item.condition.action.name.lower(),
                reason=item.reason,
                overridden=item.overridden,
            )
            for item in ruling.conditions
        ),
    )


def _gate(refused: SetpointRefusal | None, now_s: float) -> GateSection | None:
    if refused is None:
        return None
    return GateSection(
        action="ended" if refused.rest is None else "held",
        reason=refused.why.reason,
        value=refused.why.value,
        limit=refused.why.limit,
        unit=refused.why.unit,
        age_s=now_s - refused.time_s,
    )


def _failsafes(state: CycleState) -> FailsafesSection | None:
    watch, supervision = state.routes.limits.watch, state.config.supervision
    if not watch.known:
        return None
    own = FailsafeEntry(
        trigger="ground station",
        by="companion",
        action=supervision.ground_link_action.value,
        after_s=supervision.ground_link_lost_s,
    )
    autopilots = (
        FailsafeEntry(
            trigger=item.trigger.value, by="autopilot", action=item.action.value, after_s=None
        )
        for item in watch.enabled.actions
    )
    return FailsafesSection(actions=(own, *autopilots))


def _aircraft(state: CycleState) -> AircraftSection:
    telemetry, pose = state.telemetry, state.pose
    local, landed = telemetry.local_position, telemetry.landed
    place = telemetry.global_position
    return AircraftSection(
        landed=None if landed is None else landed.state.name.lower(),
        position_m=None if pose is None else pose.position_m,
        position_ned_m=None if local is None else local.position_ned_m,
        velocity_mps=None if pose is None else pose.velocity_mps,
        speed_mps=None if local is None else math.hypot(*local.velocity_ned_mps),
        yaw_rad=None if telemetry.attitude is None else telemetry.attitude.yaw_rad,
        clearance_m=state.routes.limits.clearance_m(pose),
        global_position=None if place is None else place.point,
    )


def _path(state: CycleState) -> PathSection | None:
    """Path that is flown; None while nothing is streamed."""
    pose, flight = state.pose, state.routes.flight
    if flight is None or pose is None or state.status.state not in STREAMING:
        return None
    return flight.progress(pose)


def _corners(waypoints: Sequence[WaypointEntry]) -> tuple[WaypointEntry, ...]:
    """Waypoints at which the path begins, turns or ends."""
    inner = (
        at
        for before, at, after in zip(waypoints, waypoints[1:], waypoints[2:], strict=False)
        if not _is_straight(before, at, after)
    )
    return (*waypoints[:1], *inner, *waypoints[1:][-1:])


def _is_straight(before: WaypointEntry, at: WaypointEntry, after: WaypointEntry) -> bool:
    """True if the path does not turn at the second of three waypoints."""
    places = [(point.x_m, point.y_m, point.z_m) for point in (before, at, after)]
    direct_m, detour_m = math.dist(places[0], places[2]), math.dist(*places[:2])
    return detour_m + math.dist(*places[1:]) - direct_m < _STRAIGHT_M


def _batteries(telemetry: Telemetry, now_s: float) -> tuple[BatteryEntry, ...]:
    return tuple(
        BatteryEntry(
            id=number,
            remaining=battery.remaining,
            voltage_v=battery.voltage_v,
            current_a=battery.current_a,
            charge_state=battery.charge_state,
            age_s=now_s - battery.received_s,
        )
        for number, battery in sorted(telemetry.batteries.items())
    )


def _perception(state: CycleState, now_s: float) -> PerceptionSection | None:
    report = state.seen_obstacles.report
    if report is None:
        return None
    health, line = report.health, report.line
    return PerceptionSection(
        scan_age_s=None if health.scan_s is None else now_s - health.scan_s,
        returns=health.returns,
        refused=health.refused,
        refusal=None if health.refusal is None else health.refusal.value,
        late=health.late,
        conductors=tuple(
            SeenEntry(
                name=seen.name,
                x_m=seen.position_m[0],
                z_m=seen.position_m[1],
                deviation_m=seen.deviation_m,
                age_s=now_s - seen.seen_s,
            )
            for seen in report.conductors
        ),
        solids=len(report.solids),
        line=LineEntry(
            offset_m=line.offset_m,
            applied_m=state.pose_tracker.offset_m,
            covariance_m2=None if line.seen_s is None else line.covariance_m2,
            heading_offset_rad=None if line.seen_s is None else line.turned_rad,
            wires=line.wires,
            age_s=None if line.seen_s is None else now_s - line.seen_s,
        ),
    )


def _host(host: Host) -> HostSection:
    disk, memory = host.disk_free, host.memory_available
    return HostSection(
        disk_free_mb=None if disk is None else disk / 1e6,
        memory_free_mb=None if memory is None else memory / 1e6,
        read_late_s=host.read_late_s,
    )


def _radio(telemetry: Telemetry, now_s: float) -> RadioSection | None:
    radio = telemetry.radio
    if radio is None:
        return None
    return RadioSection(
        kind=radio.kind.value,
        rssi=radio.rssi,
        remote_rssi=radio.remote_rssi,
        noise=radio.noise,
        remote_noise=radio.remote_noise,
        transmit_buffer_percent=radio.transmit_buffer_percent,
        age_s=now_s - radio.received_s,
    )


def _ages_s(telemetry: Telemetry, now_s: float) -> dict[str, float | None]:
    """Age of every source; of batteries the newest."""
    latest = {
        source.name: getattr(telemetry, source.name)
        for source in fields(telemetry)
        if source.name not in _NO_SOURCES
    }
    latest["battery"] = max(
        telemetry.batteries.values(), key=lambda battery: battery.received_s, default=None
    )
    return {
        name: None if received is None else now_s - received.received_s
        for name, received in latest.items()
    }
