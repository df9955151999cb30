"""The companion: one machine without I/O. Bytes and time in, bytes out.

    observe -> look_ahead -> assess_risk -> rule -> transition -> route -> follow -> emit

The service calls `receive` and `plan_answered` with inputs, runs a cycle with `tick` at the
setpoint rate, and takes `data_to_send`, `plan_jobs` and `decisions`. Answers of the planner wait
for the next cycle. The machine never waits and has no clock; the same inputs at the same times give
the same outputs, byte for byte.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..mavlink.autopilots import profile
from ..mavlink.commands import CommandCancelled, DeniedCommand
from ..mavlink.identity import AutopilotFound, AutopilotRestarted
from ..mavlink.peers import Address
from ..mavlink.session import Event, Session, Severity, SystemStatus
from ..mavlink.signing import Signing, SigningState, link_signings
from ..mavlink.telemetry import Telemetry
from ..mavlink.telemetry_receiver import ModeLeft
from ..perception.perception_report import PerceptionReport
from ..perception.pose_notes import PoseNote
from ..planner.adaptation import Adaptation
from ..risk import RiskEstimate
from ..settings.config import CompanionConfig
from ..settings.perception_config import Sensor
from ..settings.vehicle import Vehicle
from ..status_values import EnergySection, PathSection
from ..types import Mission, Weights
from .estimation.pose import Jump, Pose
from .estimation.pose_tracker import PoseTracker, SiteMaps, grounded
from .intake import Arrival, Intake
from .mission.values import MissionStatus, Verdict
from .mission_executor import MissionExecutor
from .mission_snapshot import MissionSnapshot
from .mission_states import STREAMING
from .operator_commands import OperatorCommands
from .planning.map_jobs import MapAnswer, MapJob
from .planning.plan_jobs import PlanAnswer, PlanJob
from .reports import Decision, Reports, StartReport
from .safety.check_inputs import Host
from .safety.supervisor import Ruling
from .safety_monitor import SafetyMonitor
from .seen_obstacles import SeenObstacles

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_LONGEST_STEP_S = 0.1
"""Maximum time step of the reference, also after a longer stall of the shell."""


class Companion:
    """The machine. site_maps: None without a site: then telemetry and risk only.

    before: memory of the previous process. signing: needed where links are signed.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        site_maps: SiteMaps | None,
        *,
        before: MissionSnapshot | None = None,
        signing: Signing | None = None,
    ) -> None:
        self._config = config
        self._vehicle = vehicle
        self._site_maps: SiteMaps | None = None
        self._session = Session(
            links=config.session_links,
            system_id=config.system_id,
            component_id=config.component_id,
            commands=config.commands,
            signing=link_signings(config.links, signing),
            obstacles=config.perception.sensor is Sensor.MAVLINK,
        )
        self._reports = Reports(self._session)
        self._intake = Intake()
        self._orders = OperatorCommands(self._session, self._reports)
        self._safety_monitor = SafetyMonitor(
            config.supervision, vehicle.guidance.off_path_m, self._reports
        )
        self._start_report = StartReport(before)
        self._pose_tracker = PoseTracker(None, vehicle.autopilot)
        self._seen_obstacles = SeenObstacles(config.perception, self._reports)
        self._executor = MissionExecutor(
            config,
            vehicle,
            session=self._session,
            pose_tracker=self._pose_tracker,
            orders=self._orders,
            reports=self._reports,
            safety_monitor=self._safety_monitor,
            before=before,
            seen_obstacles=self._seen_obstacles,
        )
        if site_maps is not None:
            self._take_site_maps(site_maps)
        self._is_last_cycle = False
        """True in the cycle that ends the process."""
        self._cycle_s: float | None = None
        self._followed_s: float | None = None
        """Start time of the last cycle whose output was sent in time."""
        self._risk_due_s = self._report_due_s = -math.inf

    @property
    def telemetry(self) -> Telemetry:
        """Last report of every source."""
        return self._session.telemetry

    @property
    def status(self) -> MissionStatus:
        """Mission status: state, task and request."""
        return self._executor.status

    @property
    def memory(self) -> MissionSnapshot | None:
        """Memory for the next process: that of the previous one until the status has changed."""
        status = self.status
        if not self._executor.status_changed:
            return self._start_report.before
        return MissionSnapshot.of(status, None if self._site_maps is None else self._site_maps.site)

    @property
    def signing(self) -> SigningState:
        """Time stamps and references of the signed links for the next process, refused packets."""
        return self._session.signing.state

    @property
    def risk(self) -> RiskEstimate:
        """The risk indices and their inputs."""
        return self._executor.risk

    @property
    def adaptation(self) -> Adaptation:
        """The adaptation of the present mission's weights; of the active plan, if it has one."""
        task = self.status.requested or self.status.task
        return self._executor.routes.adaptation_of(
            Mission.INSPECTION if task is None else task.mission
        )

    @property
    def weights(self) -> Weights:
        """The weights of the present mission under the present risks."""
        return self.adaptation.weights(self.risk.indices)

    @property
    def ruling(self) -> Ruling:
        """Permitted action, and the conditions against a flight."""
        return self._executor.ruling

    @property
    def energy_forecast(self) -> EnergySection | None:
        """Battery energy left, and demand of the remaining flight; None without a site."""
        return self._executor.risk_monitor.energy_forecast

    @property
    def perception_report(self) -> PerceptionReport | None:
        """Newest report of the perception; None without a sensor, and before the first."""
        return self._seen_obstacles.report

    @property
    def host(self) -> Host:
        """Free resources of the computer, as noted last."""
        return self._executor.host

    @property
    def pose(self) -> Pose | None:
        """Pose of the aircraft in the site's frame; None while unknown."""
        return self._pose_tracker.pose

    @property
    def clearance_m(self) -> float | None:
        """Distance from the aircraft's hull to the nearest obstacle; None where unknown."""
        return self._executor.routes.limits.clearance_m(self.pose)

    @property
    def progress(self) -> PathSection | None:
        """PathSection of the flight; None while there is none."""
        pose, flight = self._pose_tracker.pose, self._executor.routes.flight
        return None if flight is None or pose is None else flight.progress(pose)

    # In

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere. address: their sender on a listening link."""
        self._session.receive(link, data, now_s, address)

    def take_in(self, arrived: Sequence[Arrival], now_s: float) -> None:
        """Takes all bytes since the last cycle; `intake` limits all but the autopilot's."""
        precedence = self._session.precedence
        for time_s, link, data, address in self._intake.selected(arrived, precedence, now_s):
            self.receive(link, data, time_s, address)
        for words in self._intake.texts(now_s):
            self._reports.send_text(Severity.WARNING, words, now_s, action="dropped")

    def await_planner(self, compiling: str = "") -> None:
        """Notes that the planner is in preparation; until `take_ground` telemetry and risk only.

        compiling: progress of a compilation as text; empty where the planner is ready soon.
        """
        self._orders.await_planner(compiling, self._cycle_s or 0.0)

    def take_ground(self, site_maps: SiteMaps) -> None:
        """Takes the site when its planner is ready; from then on orders are executed."""
        self._orders.planner_ready(self._cycle_s or 0.0)
        self._take_site_maps(site_maps)

    def _take_site_maps(self, site_maps: SiteMaps) -> None:
        self._site_maps = site_maps
        self._pose_tracker.take_site(site_maps.site)
        self._seen_obstacles.take_site(site_maps.site)
        self._executor.take_ground(site_maps, self._start_report.before)

    def note_host(self, host: Host) -> None:
        """Takes the computer's free resources."""
        self._executor.host = host

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for signatures."""
        self._session.signing.note_wall_clock(wall_s)

    def plan_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a job, for the next cycle; one no longer awaited is dropped."""
        self._executor.routes.plan_answered(answer)

    def contingency_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job, for the next cycle."""
        self._executor.risk_monitor.contingency_answered(answer)

    def perceived(self, report: PerceptionReport) -> None:
        """Takes a report of the perception, for the next cycle."""
        self._seen_obstacles.take(report)

    def maps_answered(self, answer: MapAnswer) -> None:
        """Takes the answer to a map job, for the next cycle; one no longer awaited is dropped."""
        self._seen_obstacles.answered(answer)

    def tick(self, now_s: float) -> None:
        """Runs one cycle, from received events to this instant's setpoint; `shut_down` the last."""
        step_s = 0.0 if self._cycle_s is None else min(_LONGEST_STEP_S, now_s - self._cycle_s)
        if self._cycle_s is None:
            self._orders.await_autopilot(now_s)
        self._observe(now_s)
        if self._is_last_cycle:
            self._is_last_cycle = False
            self._executor.rule(now_s)
            self._executor.shut_down(now_s)
            self._orders.end(now_s)
            return
        self._cycle_s = now_s
        self._executor.risk_monitor.take_answers(self._executor.routes.limits.volume)
        risk_due = now_s >= self._risk_due_s
        if risk_due:
            self._risk_due_s = now_s + _RISK_PERIOD_S
            self._executor.look_ahead(now_s)
        if self._executor.risk_monitor.note_accuracy(self.telemetry) or risk_due:
            self._executor.assess_risk(now_s)
        self._executor.rule(now_s)
        self._transition(now_s)
        self._executor.route(now_s)
        self._executor.follow(now_s, step_s)
        self._emit(now_s)

    def shut_down(self, now_s: float) -> None:
        """Runs the last cycle of the process: ends the stream at rest, if still permitted.

        Open orders get their final answer. The mission status stays, for the next process. Forecast
        and risks are not updated in it: an error there would cost the last setpoint.
        """
        self._is_last_cycle = True
        self.tick(now_s)

    # The stages of a cycle that are not the executor's

    def _observe(self, now_s: float) -> None:
        """Takes telemetry and events.

        Orders wait for `_transition`, until the checks that end our control have run.
        """
        paused_s = 0.0 if self._followed_s is None else now_s - self._followed_s
        self._executor.faults.note_pause(paused_s, self._config.supervision.position_timeout_s)
        jump = self._pose_tracker.update(self.telemetry)
        self._seen_obstacles.note_pose(self.telemetry, self._pose_tracker, jump)
        site_maps = self._seen_obstacles.taken(now_s)
        if site_maps is not None:
            self._executor.take_maps(site_maps, now_s)
        self._seen_obstacles.update(now_s, on_ground=grounded(self.telemetry))
        jumps = () if jump is None else (jump,)
        for event in (*jumps, *self._session.events_received()):
            self._take_event(event, now_s)
        routes = self._executor.routes
        routes.limits.learn(self._session, self._pose_tracker.home_m, routes.flight, now_s)

    def _transition(self, now_s: float) -> None:
        """Steps the mission machine: with the planner's answer, the ruling, and orders."""
        self._executor.transition(now_s)
        self._report(now_s)
        unread = self._executor.routes.limits.not_ready_reason is not None
        unknown = self._session.autopilot is None or unread
        for command in self._orders.due(now_s, unknown=unknown and self._site_maps is not None):
            self._executor.order(command, now_s)
            self._start_report.note_order(command)
        self._orders.report_progress(now_s)

    def _report(self, now_s: float) -> None:
        """Reports file faults, a restart, and a wrong number of cells."""
        self._reports.report_file_faults(self._executor.host.file_faults, self.telemetry, now_s)
        if self._orders.planner_awaited:
            if grounded(self.telemetry):
                self._start_report.drop_task()
            return
        may_continue = not self._executor.status_changed and self.status.task is not None
        cells = None if self.status.state in STREAMING else self._vehicle.risk.cells
        texts = self._start_report.texts(self.telemetry, cells, now_s, may_continue=may_continue)
        for text in texts:
            self._reports.send_text(Severity.WARNING, text, now_s)

    # Out

    def data_to_send(self, *, control: bool = True) -> list[tuple[str, bytes]]:
        """Packets since the last call, each with its link's URL.

        control: False when the shell is too late for the last cycle. Then setpoints and modes are
        left out, and the cycle does not count as sent.
        """
        if control:
            self.note_sent()
        return self._session.data_to_send(control=control)

    def control_to_send(self) -> list[tuple[str, bytes]]:
        """Packets that command motion; to be sent first, and in time."""
        return self._session.control_to_send()

    def note_sent(self) -> None:
        """Notes that all of `control_to_send` was sent in time."""
        self._followed_s = self._cycle_s
        self._executor.setpoints.note_sent()
        self._executor.mode_requester.note_sent()

    def peers(self, link: str) -> tuple[Address, ...]:
        """The addresses to which a listening link sends; empty for other links."""
        return self._session.peers(link)

    def received_packets(self) -> list[tuple[float, bytes]]:
        """Whole packets received since the last call, with their times, for the record."""
        return self._session.received_packets()

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return self._executor.routes.plan_jobs()

    def contingency_jobs(self) -> list[PlanJob]:
        """Planning jobs for escape routes since the last call; lower priority than `plan_jobs`."""
        return self._executor.risk_monitor.contingency_jobs()

    def map_jobs(self) -> list[MapJob]:
        """Jobs for maps with other obstacles since the last call; one at a time."""
        return self._seen_obstacles.jobs()

    def pose_notes(self) -> list[PoseNote]:
        """Poses since the last call, for the perception; none without a sensor."""
        return self._seen_obstacles.pose_notes()

    def decisions(self) -> list[Decision]:
        """Decisions since the last call."""
        return self._reports.decisions()

    # Received events

    def _take_event(self, event: Event | Jump, now_s: float) -> None:
        match event:
            case Jump():
                self._executor.shift(event, now_s)
            case CommandCancelled(command=command):
                self._executor.withdraw(command.number)
            case DeniedCommand(reason=reason):
                self._orders.report_reason(event, Verdict.DENIED, reason, now_s)
            case AutopilotFound(autopilot=autopilot):
                self._orders.await_autopilot(now_s)
                self._session.requests.want_all_of(profile(autopilot.kind))
            case ModeLeft(mode=mode):
                self._executor.faults.note_mode_left(mode)
            case AutopilotRestarted():
                self._executor.faults.note_restart()
            case _:
                self._reports.report_event(event, now_s)

    def _emit(self, now_s: float) -> None:
        """Sends heartbeat and requests, each half second risk indices and weights."""
        state = self.status.state
        active = SystemStatus.ACTIVE if state in STREAMING else SystemStatus.STANDBY
        self._session.tick(now_s, active, custom_mode=state.number)
        if now_s < self._report_due_s:
            return
        self._report_due_s = now_s + _REPORT_PERIOD_S
        self._reports.report_values(state, self.risk.indices, self.weights, self.pose, now_s)
        self._reports.report_refusals(self._session.signing, now_s)
