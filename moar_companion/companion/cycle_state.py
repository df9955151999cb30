"""State of the machine between two cycles: its parts, each with its own, and the mission status.

The stages of a cycle read it and change it; nothing else outlasts a cycle.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from ..mavlink.session import Session
from ..mavlink.signing import Signing, link_signings
from ..mavlink.telemetry import Telemetry
from ..planner.adaptation import Adaptation
from ..planner.site import Margin, Site
from ..risk import RiskEstimate
from ..settings.config import CompanionConfig
from ..settings.flight_parameters import FlightParameters
from ..settings.perception_config import Sensor
from ..settings.vehicle import Vehicle
from ..texts.text_format import distance
from ..types import Mission, Weights
from .error_margin import margin_of
from .estimation.pose import Pose
from .estimation.pose_tracker import PoseTracker
from .flight_settings import FlightSettings
from .inspector import Inspector
from .mission.values import MissionStatus
from .mission_snapshot import MissionSnapshot
from .mission_states import MissionState
from .mode_requester import ModeRequester
from .operator_commands import OperatorCommands
from .refuge import Refuge
from .reports import Reports, StartReport
from .risk_monitor import RiskMonitor
from .route_manager import RouteManager
from .safety.check_inputs import Host, Unmeasured
from .safety.condition_types import Action
from .safety.supervisor import Ruling
from .safety_monitor import SafetyMonitor
from .seen_obstacles import SeenObstacles
from .setpoint_streamer import SetpointRefusal, SetpointStreamer
from .wind_recovery import WindRecovery

_SLOW_PACE = 0.5
"""Fraction of the planned speed while a condition demands SLOW."""


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
            self.causes = replace(self.causes, setpoint_rejected=refused.why.reason)
        elif refused.narrow:
            self.causes = replace(self.causes, no_clearance=refused.why.reason)
        else:
            self.causes = replace(self.causes, setpoint_held=refused.why.reason)

    def note_settings_refused(self, parameter: str) -> None:
        """Notes that a parameter was set back, since the flight has no room with it."""
        self.causes = replace(self.causes, settings_refused=f"no room at {parameter}")

    def forget(self) -> None:
        """Clears the faults after a check."""
        self.causes = Unmeasured()


class CycleState:
    """The parts, and what the cycle itself keeps. before: memory of the previous process.

    parameters: values that ground stations may change; config and vehicle have them.

    Before the maps of a site are taken there is none: telemetry and risk only.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        *,
        before: MissionSnapshot | None = None,
        signing: Signing | None = None,
        parameters: FlightParameters | None = None,
    ) -> None:
        self.config = config
        """With the settings in force."""
        self.vehicle = vehicle
        """With the settings in force."""
        self.margin = margin_of(vehicle, config.supervision)
        self.parameters = FlightSettings(parameters)
        """Values of the parameters: in force, and set."""
        self.session = Session(
            links=config.session_links,
            system_id=config.system_id,
            component_id=config.component_id,
            commands=config.commands,
            signing=link_signings(config.links, signing),
            obstacles=config.perception.sensor is Sensor.MAVLINK,
            parameters=parameters,
        )
        self.reports = Reports(self.session)
        self.start_report = StartReport(before)
        self.orders = OperatorCommands(self.session, self.reports)
        self.pose_tracker = PoseTracker(None, vehicle.autopilot)
        self.seen_obstacles = SeenObstacles(config.perception, self.reports)
        self.risk_monitor = RiskMonitor(vehicle)
        """The present risk indices, and the escape routes."""
        self.safety_monitor = SafetyMonitor(
            config.supervision, vehicle.guidance.off_path_m, self.reports
        )
        self.routes = RouteManager(vehicle, config, self.reports, self.margin)
        self.recovery = WindRecovery(self.reports)
        self.refuge = Refuge(vehicle, config.supervision, self.risk_monitor, self.reports)
        self.setpoints = SetpointStreamer(
            self.session, vehicle, config.supervision, self.margin, config.perception.keep_out_m
        )
        pilot_may_fly = before is not None and before.state is not MissionState.IDLE
        self.inspector = Inspector(self.session, self.reports, config.inspection)
        """Pictures and video of the views."""
        self.mode_requester = ModeRequester(
            config.authority, self.session, self.reports, pilot_flies=pilot_may_fly
        )
        self.status = MissionStatus()
        """Mission status: state, task and request."""
        self.status_changed = False
        """True from the first change of the status by an order, a plan or a transition."""
        self.withdrawn: deque[int] = deque()
        """Numbers of orders that were cancelled since the last transition."""
        self.paths_changed = False
        """True if a search that found no path may find one now."""
        self.host = Host()
        """Free resources of the computer."""
        self.faults = Faults()
        """Faults since the last cycle."""
        self.is_last_cycle = False
        """True in the cycle that ends the process."""
        self.cycle_s: float | None = None
        self.followed_s: float | None = None
        """Start time of the last cycle whose output was sent in time."""
        self.risk_due_s = self.report_due_s = -math.inf

    def take_settings(self, config: CompanionConfig, vehicle: Vehicle, margin: Margin) -> None:
        """Takes the settings that are in force from now on, in all parts."""
        self.config, self.vehicle, self.margin = config, vehicle, margin
        limits = config.supervision
        self.risk_monitor.take_vehicle(vehicle)
        self.safety_monitor.take_settings(limits, vehicle.guidance.off_path_m)
        self.routes.take_settings(vehicle, config, margin)
        self.refuge.take_settings(vehicle, limits)
        self.setpoints.take_settings(vehicle, limits, margin)

    @property
    def telemetry(self) -> Telemetry:
        """Last report of every source."""
        return self.session.telemetry

    @property
    def pose(self) -> Pose | None:
        """Pose of the aircraft in the site's frame; None while unknown."""
        return self.pose_tracker.pose

    @property
    def site(self) -> Site | None:
        """The site with the obstacles of its present maps; None before these are taken."""
        site_maps = self.routes.limits.site_maps
        return None if site_maps is None else site_maps.site

    @property
    def risk(self) -> RiskEstimate:
        """The present risk indices."""
        return self.risk_monitor.risk

    @property
    def ruling(self) -> Ruling:
        """Permitted action, and the conditions against a flight."""
        return self.safety_monitor.ruling

    @property
    def adaptation(self) -> Adaptation:
        """The adaptation of the present mission's weights; of the active plan, if it has one."""
        task = self.status.requested or self.status.task
        return self.routes.adaptation_of(Mission.INSPECTION if task is None else task.mission)

    @property
    def weights(self) -> Weights:
        """The weights of the present mission under the present risks."""
        return self.adaptation.weights(self.risk.indices)

    @property
    def pace(self) -> float:
        """Fraction of the planned speed that is flown."""
        return _SLOW_PACE if self.ruling.action is Action.SLOW else 1.0

    @property
    def mode_ours(self) -> bool:
        """True while the autopilot is in the mode in which it follows our setpoints."""
        autopilot = self.telemetry.autopilot
        return autopilot is not None and autopilot.ours
