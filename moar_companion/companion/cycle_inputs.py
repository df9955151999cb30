"""Inputs of a cycle's decisions: for contingency planning, the supervisor and the mission machine.

`CycleInputs` reads telemetry, pose, route, risks and the mission status; it changes none of them.
`Faults` keeps causes that no measurement shows, until the supervisor has checked them.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..mavlink.session import Session
from ..mavlink.telemetry import LandedState
from ..planner.site import Margin
from ..risk.power.cells import misread
from ..settings.config import Supervision
from ..settings.vehicle import Vehicle
from ..texts.text_format import distance
from ..types import Mission
from .contingency.contingency_planner import ContingencyInputs
from .estimation.pose import Pose
from .estimation.pose_tracker import PoseTracker
from .mission import state_machine
from .mission.values import MissionStatus, Situation
from .mission_states import IN_CONTROL, STREAMING, MissionState
from .mode_requester import ModeRequester
from .refuge import Refuge
from .risk_monitor import RiskMonitor
from .route_manager import RouteManager
from .safety.check_inputs import CheckInputs, EscapeRoute, Host, Unmeasured
from .safety.position_checks import widening_m
from .safety.supervisor import Ruling
from .safety.uncertainty_growth import AHEAD_S
from .seen_obstacles import SeenObstacles
from .setpoint_streamer import SetpointRefusal

ON_THE_WAY = (MissionState.FLYING, MissionState.LANDING_LEG)


class Faults:
    """Causes that no measurement shows, kept until the supervisor has checked them."""

    def __init__(self) -> None:
        self.causes = Unmeasured()

    def note_pause(self, paused_s: float, limit_s: float) -> None:
        """Notes a control-loop stall: more than limit_s without an output sent in time.

        Data received meanwhile is old, and the autopilot may have acted on the offboard loss.
        """
        if paused_s > limit_s:
            stalled = f"control loop stalled {distance(paused_s)} s"
            self.causes = replace(self.causes, loop_stall=stalled)

    def note_mode_left(self, mode: str) -> None:
        """Notes that the autopilot has left our mode; it may be back in it."""
        self.causes = replace(self.causes, pilot=f"autopilot was in {mode}")

    def note_restart(self) -> None:
        """Notes a restart of the autopilot."""
        self.causes = replace(self.causes, autopilot_reboot="the autopilot restarted")

    def note_refusal(self, refused: SetpointRefusal) -> None:
        """Notes a setpoint that was not sent."""
        if refused.rest is None:
            self.causes = replace(self.causes, setpoint_rejected=refused.reason)
        elif refused.narrow:
            self.causes = replace(self.causes, no_clearance=refused.reason)
        else:
            self.causes = replace(self.causes, setpoint_held=refused.reason)

    def forget(self) -> None:
        """Clears the faults after a check."""
        self.causes = Unmeasured()


class CycleInputs:
    """Reads the inputs."""

    def __init__(
        self,
        vehicle: Vehicle,
        limits: Supervision,
        margin: Margin,
        *,
        session: Session,
        pose_tracker: PoseTracker,
        routes: RouteManager,
        risk_monitor: RiskMonitor,
        mode_requester: ModeRequester,
        seen_obstacles: SeenObstacles,
        refuge: Refuge,
    ) -> None:
        self._refuge = refuge
        self._vehicle = vehicle
        self._limits = limits
        self._margin = margin
        self._session = session
        self._pose_tracker = pose_tracker
        self._routes = routes
        self._risk_monitor = risk_monitor
        self._mode_requester = mode_requester
        self._seen_obstacles = seen_obstacles

    @property
    def mode_ours(self) -> bool:
        """True while the autopilot is in the mode in which it follows our setpoints."""
        autopilot = self._session.telemetry.autopilot
        return autopilot is not None and autopilot.ours

    def tracking_error_m(self, status: MissionStatus) -> float | None:
        """Distance from our setpoint to the aircraft; infinite where its pose is unknown.

        None while the companion is not in control.
        """
        flight, pose = self._routes.flight, self._pose_tracker.pose
        if flight is None or status.state not in IN_CONTROL:
            return None
        return math.inf if pose is None else flight.error_m(pose)

    def exposure_limit_s(self, status: MissionStatus) -> float:
        """Maximum stay where a failsafe without a forecast would hit an obstacle, dwell added."""
        return self._limits.exposure_limit_s + self._dwell_s(status)

    def scene(self, status: MissionStatus, pace: float) -> ContingencyInputs | None:
        """Inputs of contingency planning; None where no plan is possible.

        pace: fraction of the planned speed that is flown.
        """
        pose, volume = self._pose_tracker.pose, self._routes.limits.volume
        risk = self._risk_monitor.risk
        landed = self._session.telemetry.landed
        if pose is None or volume is None:
            return None
        if landed is not None and landed.state is not LandedState.IN_AIR:
            return None  # the aircraft takes off or lands
        plane, spread = self._pose_tracker.plane, risk.wind.spread
        beside = abs(pose.position_m[1]) > self._limits.plane_tolerance_m
        if beside and status.state not in STREAMING:
            return None  # the pilot or the autopilot flies the aircraft
        return ContingencyInputs(
            pose=pose,
            status=status,
            flight=self._routes.flight,
            volume=volume,
            risk=risk.indices,
            widening_m=self._routes.inflation.lasting_m,
            fence=self._routes.limits.fence,
            failsafes=self._routes.limits.watch.failsafes,
            pace=pace,
            meter=risk.meter,
            wind_mps=None
            if plane is None or spread is None
            else plane.velocity_from_ned((*spread.mean_ne_mps, 0.0)),
            model=risk.wind.learning.used(self._vehicle.risk),
        )

    def situation(self, status: MissionStatus, ruling: Ruling, now_s: float) -> Situation:
        """Inputs of the mission machine."""
        autopilot, guidance = self._session.telemetry.autopilot, self._vehicle.guidance
        flight, pose = self._routes.flight, self._pose_tracker.pose
        error_m = math.inf if flight is None or pose is None else flight.error_m(pose)
        return Situation(
            ruling=ruling,
            mode_ours=self.mode_ours,
            mode_received_s=-math.inf if autopilot is None else autopilot.received_s,
            on_leg=flight is not None and flight.on_leg,
            arrived=self._routes.arrived(pose, now_s),
            dwell_s=self._dwell_s(status),
            tracking_lost=flight is not None and error_m > guidance.tracking_hold_m,
        )

    def check_inputs(
        self, status: MissionStatus, host: Host, faults: Unmeasured, now_s: float
    ) -> CheckInputs:
        """Inputs of the supervisor's checks. faults: causes that no measurement shows."""
        flight, pose = self._routes.flight, self._pose_tracker.pose
        site_maps = self._routes.limits.site_maps
        telemetry, risk = self._session.telemetry, self._risk_monitor.risk
        escape_route = self._risk_monitor.escape_route
        room_m = None
        if site_maps is not None and pose is not None:
            room_m = site_maps.room_m(pose, self._vehicle.radius_m)
        agreement, jumped_m = self._pose_tracker.agreement, self._pose_tracker.jumped_m(now_s)
        # The cycle in which the mode is given counts as in control.
        begins = state_machine.engages(status, now_s, mode_ours=self.mode_ours)
        return CheckInputs(
            telemetry=telemetry,
            risk=risk,
            conflict=self._session.conflict,
            expected=self._vehicle.autopilot,
            pose=pose,
            position_moved_s=self._pose_tracker.position_moved_s,
            position_late_s=self._pose_tracker.position_late_s,
            jumped_m=jumped_m,
            jump_margin_m=self._jump_margin_m(room_m, jumped_m),
            origin_moved_m=agreement.origin_moved_m,
            origin_margin_m=self._jump_margin_m(room_m, agreement.origin_moved_m),
            global_off_m=agreement.global_off_m,
            home_off_m=agreement.home_off_m,
            room_m=room_m,
            widening_m=widening_m(risk, self._margin),
            uncertainty_soon_m=self._risk_monitor.uncertainty_m(AHEAD_S),
            error_hits=None if pose is None else self._error_hits(pose, status),
            in_control=begins or status.state in IN_CONTROL,
            escaping=escapes(status),
            landing=self._mode_requester.is_landing(telemetry.autopilot, now_s),
            azimuth_rad=None
            if site_maps is None
            else math.radians(site_maps.site.frame.azimuth_deg),
            misread=misread(telemetry, self._vehicle.risk.cells),
            error_m=flight.error_m(pose) if flight is not None and pose is not None else None,
            drifted_m=flight.drifted_m(pose) if flight is not None and pose is not None else None,
            saturated=self._risk_monitor.saturated,
            held_wind_mps=self._risk_monitor.held_wind_mps,
            stopped=flight is not None and flight.stopped and status.state in ON_THE_WAY,
            excursion=flight.excursion(pose) if flight is not None and pose is not None else None,
            plan_awaited_s=self._routes.awaited_for_s(now_s),
            fence_silent=self._session.requests.fence_silent,
            parameters_unknown=self._routes.limits.unreported.denying,
            escape_route=escape_route,
            exposure=self._exposure(status, escape_route, now_s),
            blind_hit=self._refuge.blind_hit,
            battery_landing=self._refuge.battery_landing,
            host=host,
            sensing=self._seen_obstacles.settings,
            sensor_health=self._seen_obstacles.health,
            unmapped_s=self._seen_obstacles.unmapped_s(now_s),
            faults=replace(
                faults,
                offboard_loss_unknown=self._routes.limits.not_ready_reason,
                autopilot_fence=self._routes.limits.fence_objection(flight, pose),
                offboard_loss_collision=self._routes.limits.offboard_loss.objection,
                path_barred=self._routes.barred,
                no_clearance=faults.no_clearance or self._routes.inflation.no_room,
            ),
        )

    def _dwell_s(self, status: MissionStatus) -> float:
        """Time to stay at the present target."""
        task, site_maps = status.task, self._routes.limits.site_maps
        return 0.0 if site_maps is None or task is None else site_maps.dwell_s(task.stops)

    def _exposure(
        self, status: MissionStatus, escape_route: EscapeRoute | None, now_s: float
    ) -> str | None:
        """Reason to leave before an autopilot failsafe acts; None if there is none."""
        return self._routes.limits.watch.reason(
            self._session.telemetry,
            self._risk_monitor.risk.meter,
            leaving_s=None if escape_route is None else escape_route.exposed_s,
            limit_s=self.exposure_limit_s(status),
            from_s=status.since_s,
            now_s=now_s,
        )

    def _error_hits(self, pose: Pose, status: MissionStatus) -> str | None:
        """Name of the obstacle that the position's error will reach, here or at the stop point.

        None below the uncertainty limit: plans keep that distance. None, too, where no place is
        better: an escape route may lead to one. An inflated escape route goes on: it leads away.
        """
        here_m = pose.position_m
        flight, site_maps = self._routes.flight, self._routes.limits.site_maps
        soon_m = self._risk_monitor.uncertainty_m(AHEAD_S)
        if soon_m is None or soon_m <= self._limits.position_uncertainty_limit_m:
            return None
        if site_maps is None or not site_maps.site.obstacles or self._refuge.is_best(here_m):
            return None
        inflated = flight is not None and flight.path.volume.reach is not None
        if inflated and escapes(status) and status.state in ON_THE_WAY:
            return None
        slack_m = math.sqrt(2.0) * site_maps.maps.grid.resolution_m  # paths lead through centres
        for place_m in (here_m, here_m if flight is None else flight.stop_m):
            room_m = site_maps.room_m(replace(pose, position_m=place_m), self._vehicle.radius_m)
            if room_m is not None and room_m + site_maps.site.margin.position_m + slack_m < soon_m:
                return site_maps.maps.reach.nearest((place_m[0], place_m[2]))
        return None

    def _jump_margin_m(self, room_m: float | None, jumped_m: float) -> float:
        """Permitted position error, here and before a jump of `jumped_m`.

        room_m: from the aircraft's hull to the nearest keep-out.
        """
        if room_m is None:
            return math.inf
        spare_m = room_m - self._margin.tracking_m - jumped_m
        return max(0.0, self._margin.position_m + min(0.0, room_m) + max(0.0, spare_m))


def escapes(status: MissionStatus) -> bool:
    """True while an exit or evacuation is flown."""
    task = status.task
    in_control = status.state in IN_CONTROL
    return in_control and task is not None and task.mission is not Mission.INSPECTION
