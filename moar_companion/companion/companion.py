"""The companion: one machine without I/O. Bytes and time in, bytes out.

    observe -> assess_risk -> rule -> transition -> route -> follow -> emit

    bytes -> session -> telemetry -> pose, risk indices -> weights -> plan job
    plan answer -> flight -> setpoint -> gate -> session -> bytes

The shell feeds it with `receive` and `plan_answered`, runs a cycle with `tick` at the setpoint
rate, and takes `data_to_send`, `plan_jobs` and `decisions`. Answers of the planner wait for the
next cycle. It never waits and has no clock; the same inputs at the same times give the same
outputs, byte for byte.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from ..autopilots import failsafe_parameters
from ..autopilots.fence import fence_parameters
from ..config import CompanionConfig
from ..contingency.contingency_planner import Outlook
from ..estimation.pose import Pose
from ..estimation.pose_tracker import Ground, PoseTracker
from ..guidance.path_follower import Progress
from ..mavlink.commands import (
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    PauseContinue,
    stops,
)
from ..mavlink.identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from ..mavlink.peers import Address, AutopilotElsewhere, PeerRefused
from ..mavlink.session import CommandAnswered, Event, Session, Severity, SystemStatus
from ..mavlink.signing import Refusal, Signing, link_signings
from ..mavlink.telemetry_receiver import ModeLeft
from ..mission.values import MissionStatus, Verdict
from ..mission_states import STREAMING
from ..planning.plan_jobs import PlanAnswer, PlanJob
from ..power.cells import misread
from ..risk import RiskEstimate
from ..risk.holding import holding_parameters
from ..safety.check_inputs import Host
from ..safety.file_faults import FileFaultTexts
from ..safety.offboard_loss import loss_parameters
from ..safety.supervisor import Ruling
from ..telemetry import Telemetry
from ..types import Mission, Weights
from ..vehicle import Vehicle
from .intake import Arrival, Intake
from .mission_executor import MissionExecutor
from .mission_snapshot import MissionSnapshot
from .operator_commands import OperatorCommands
from .reports import Decision, Reports
from .restart_report import RestartReport
from .safety_monitor import SafetyMonitor
from .signing_report import SigningReport

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_READING_S = 1.0
"""Maximum wait of an order, after the start, for the autopilot, whose heartbeat comes each second;
then as long again for its parameters. Over UDP they are read within 0.3 s."""
_LONGEST_STEP_S = 0.1
"""Maximum time step of the reference, also after a longer stall of the shell."""


class Companion:
    """The machine. ground: None without a site: then telemetry and risk only.

    before: memory of the previous process. signing: needed where links are signed.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        ground: Ground | None,
        *,
        before: MissionSnapshot | None = None,
        signing: Signing | None = None,
    ) -> None:
        self._config = config
        self._vehicle = vehicle
        self._ground = ground
        self._session = Session(
            links={link.url: link.role for link in config.links},
            system_id=config.system_id,
            component_id=config.component_id,
            commands=config.commands,
            signing=link_signings(config.links, signing),
        )
        self._reports = Reports(self._session)
        self._intake = Intake()
        self._refusals = SigningReport()
        self._orders = OperatorCommands(self._session, self._reports)
        self._safety_monitor = SafetyMonitor(
            config.supervision, vehicle.guidance.off_path_m, self._reports
        )
        self._restart_report = RestartReport(before)
        self._begin(ground)
        self._plan_answers: deque[PlanAnswer] = deque()
        self._contingency_answers: deque[PlanAnswer] = deque()
        self._planner_awaited = False
        self._compiling = ""
        self._file_faults = FileFaultTexts()
        self._misread_told = False
        self._read_by_s = -math.inf
        """End of an order's wait for the autopilot and its parameters."""
        self._cycle_s: float | None = None
        self._followed_s: float | None = None
        """Start time of the last cycle whose output was sent in time."""
        self._risk_due_s = -math.inf
        self._told: tuple[object, ...] = ()
        """Reports of position accuracy at the last risk estimate."""
        self._report_due_s = -math.inf

    def _begin(self, ground: Ground | None) -> None:
        site = None if ground is None else ground.site
        self._pose_tracker = PoseTracker(site, self._vehicle.autopilot)
        self._executor = MissionExecutor(
            self._config,
            self._vehicle,
            ground,
            session=self._session,
            pose_tracker=self._pose_tracker,
            orders=self._orders,
            reports=self._reports,
            safety_monitor=self._safety_monitor,
            before=self._restart_report.before,
        )

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
        """Memory for the next process."""
        status = self.status
        if self._executor.untouched:
            return self._restart_report.before
        site = None if self._ground is None else self._ground.site.name
        return MissionSnapshot(
            state=status.state, since_s=status.since_s, task=status.task, site=site
        )

    @property
    def signing_timestamps(self) -> dict[str, int]:
        """The time stamp of each signed link, for the next process."""
        return self._session.signing.timestamps

    @property
    def signing_references(self) -> dict[str, int]:
        """Reference time of each signed link for new senders, for the next process."""
        return self._session.signing.references

    @property
    def packets_refused(self) -> dict[str, dict[Refusal, int]]:
        """Number of refused packets of each signed link, by reason."""
        return self._session.signing.packets_refused

    @property
    def risk(self) -> RiskEstimate:
        """The risk indices and their inputs."""
        return self._executor.risk

    @property
    def base_weights(self) -> Weights:
        """The vehicle's weights for the present mission: k_{S,0}, k_{T,0}, k_{E,0}."""
        task = self.status.sought or self.status.task
        mission = Mission.INSPECTION if task is None else task.mission
        return self._vehicle.weights[mission]

    @property
    def weights(self) -> Weights:
        """The weights of the present mission under the present risks (Eq. 9)."""
        return self.base_weights.adjusted(self.risk.indices)

    @property
    def ruling(self) -> Ruling:
        """Permitted action, and the conditions against a flight."""
        return self._executor.ruling

    @property
    def outlook(self) -> Outlook | None:
        """Battery energy left, and demand of the remaining flight; None without a site."""
        ways = self._executor.risk_monitor.ways
        return None if ways is None else ways.outlook(self.risk.meter)

    @property
    def pose(self) -> Pose | None:
        """Pose of the aircraft in the site's frame; None while unknown."""
        return self._pose_tracker.pose

    @property
    def clearance_m(self) -> float | None:
        """Distance from the aircraft's hull to the nearest obstacle; None where unknown."""
        pose, ground = self._pose_tracker.pose, self._ground
        if pose is None or ground is None:
            return None
        return ground.clearance_m(pose, self._vehicle.radius_m)

    @property
    def progress(self) -> Progress | None:
        """Progress of the flight; None while there is none."""
        pose, flight = self._pose_tracker.pose, self._executor.routes.flight
        return None if flight is None or pose is None else flight.progress(pose)

    # In

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere. address: their sender on a listening link."""
        self._session.receive(link, data, now_s, address)

    def take_in(self, arrived: Sequence[Arrival], now_s: float) -> None:
        """Takes all bytes that arrived on all links since the last cycle, in order of arrival.

        Bytes from the autopilot's address or a stream are all read. Other bytes have a budget per
        cycle; the rest is dropped, counted and reported.
        """
        precedence = self._session.precedence
        for time_s, link, data, address in self._intake.selected(arrived, precedence, now_s):
            self.receive(link, data, time_s, address)
        for words in self._intake.texts(now_s):
            self._reports.say(Severity.WARNING, words, now_s, action="dropped")

    def await_planner(self, compiling: str = "") -> None:
        """Notes that the planner is in preparation; until `take_ground` telemetry and risk only.

        Orders wait for the planner, which is ready soon. During a compilation, which takes long,
        orders are temporarily rejected. compiling: its progress as text.
        """
        self._planner_awaited = True
        if compiling and not self._compiling:
            self._reports.say(Severity.INFO, compiling, self._cycle_s or 0.0)
        self._compiling = compiling

    def take_ground(self, ground: Ground) -> None:
        """Takes the site when its planner is ready: from now on orders are executed."""
        if self._compiling:
            self._reports.say(Severity.INFO, "the planner is ready", self._cycle_s or 0.0)
        self._ground = ground
        self._planner_awaited, self._compiling = False, ""
        host = self._executor.host
        self._begin(ground)
        self._executor.host = host

    def note_host(self, host: Host) -> None:
        """Takes the computer's free resources."""
        self._executor.host = host

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for signatures."""
        self._session.signing.note_wall_clock(wall_s)

    def plan_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a job, for the next cycle."""
        self._plan_answers.append(answer)

    def contingency_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job, for the next cycle."""
        self._contingency_answers.append(answer)

    def tick(self, now_s: float) -> None:
        """Runs one cycle, from received events to this instant's setpoint."""
        step_s = 0.0 if self._cycle_s is None else min(_LONGEST_STEP_S, now_s - self._cycle_s)
        if self._cycle_s is None:
            self._read_by_s = now_s + _READING_S
        self._observe(now_s)
        self._cycle_s = now_s
        self._assess_risk(now_s)
        self._executor.rule(now_s)
        self._transition(now_s)
        self._executor.route(now_s)
        self._executor.follow(now_s, step_s)
        state = self.status.state
        active = SystemStatus.ACTIVE if state in STREAMING else SystemStatus.STANDBY
        self._session.tick(now_s, active, custom_mode=state.number)
        if now_s >= self._report_due_s:
            self._report_due_s = now_s + _REPORT_PERIOD_S
            self._report(now_s)

    def shut_down(self, now_s: float) -> None:
        """Ends the setpoint stream at rest, if still permitted: the last cycle of the process."""
        self._observe(now_s)
        self._executor.rule(now_s)
        self._executor.shut_down(now_s)

    # The stages of a cycle; the executor has the others

    def _observe(self, now_s: float) -> None:
        """Takes telemetry and events.

        Orders wait for `_transition`, until the checks that end our control have run.
        """
        self._notice_pause(now_s)
        jump = self._pose_tracker.look(self.telemetry)
        if jump is not None:
            self._executor.shift(jump, now_s)
        for event in self._session.events_received():
            self._take_event(event, now_s)
        self._learn(now_s)
        while self._contingency_answers:
            self._executor.take_contingency(self._contingency_answers.popleft())

    def _assess_risk(self, now_s: float) -> None:
        """Updates the remaining flight and the risk indices, where they are due."""
        telemetry = self.telemetry
        told = telemetry.gnss, telemetry.second_gnss, telemetry.estimator, telemetry.odometry
        # A change of position accuracy must count for the next setpoint.
        due = now_s >= self._risk_due_s
        if due:
            self._risk_due_s = now_s + _RISK_PERIOD_S
            self._executor.look_ahead(now_s)
        if due or told != self._told:
            self._told = told
            self._executor.assess_risk(now_s)

    def _transition(self, now_s: float) -> None:
        """Steps the mission machine: with the ruling, the planner's answers, and orders."""
        self._executor.transition(now_s)
        while self._plan_answers:
            self._executor.take_plan(self._plan_answers.popleft(), now_s)
        self._tell_of_files(now_s)
        if not self._planner_awaited:
            self._tell(now_s)
        if self._planner_awaited or self._is_reading(now_s):
            self._put_off(now_s)
        else:
            for command in self._orders.heard():
                self._executor.order(command, now_s)
        silence = self._executor.routes.overdue(now_s)
        if silence is not None:
            self._executor.take_plan(silence, now_s)

    def _tell(self, now_s: float) -> None:
        """Reports the findings at start: restart, and a wrong number of cells."""
        may_continue = self._executor.untouched and self.status.task is not None
        for text in self._restart_report.texts(self.telemetry, now_s, may_continue=may_continue):
            self._reports.say(Severity.WARNING, text, now_s)
        words = None if self._misread_told else misread(self.telemetry, self._vehicle.risk.cells)
        if words is not None and self.status.state not in STREAMING:
            self._misread_told = True
            self._reports.say(Severity.WARNING, words, now_s)

    def _tell_of_files(self, now_s: float) -> None:
        """Reports file faults of the service, and their ends."""
        for fault, over in self._file_faults.texts(self._executor.host.file_faults, self.telemetry):
            severity = Severity.NOTICE if over else Severity.WARNING
            action = "over" if over else fault.action
            self._reports.say(severity, fault.reason, now_s, action=action, news=True)

    def _is_reading(self, now_s: float) -> bool:
        """True while the autopilot, or its parameters, may still arrive within the waiting time.

        An order rejected meanwhile would stay rejected for all its repeats.
        """
        if self._ground is None or now_s > self._read_by_s:
            return False
        return self._session.autopilot is None or self._executor.routes.not_ready_reason is not None

    def _put_off(self, now_s: float) -> None:
        """Executes orders that end motion; other orders wait, or are rejected while compiling.

        An order that ends motion cancels the waiting orders, as if they had been executed before.
        """
        waiting: list[MissionCommand | PauseContinue] = []
        for command in self._orders.heard():
            if stops(command):
                for earlier in waiting:
                    order_id = self._orders.enter(earlier, now_s)
                    self._orders.answer(order_id, Verdict.CANCELLED, "", now_s)
                waiting = []
                self._executor.order(command, now_s)
                self._restart_report.note_stop(command)
            elif self._compiling:
                self._orders.reject(command, self._compiling, now_s)
            else:
                waiting.append(command)
        for command in waiting:
            self._orders.hear(command)

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

    def packets_heard(self) -> list[tuple[float, bytes]]:
        """Whole packets received since the last call, with their times, for the record."""
        return self._session.packets_heard()

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return self._executor.routes.plan_jobs()

    def contingency_jobs(self) -> list[PlanJob]:
        """Planning jobs for escape routes since the last call; lower priority than `plan_jobs`."""
        ways = self._executor.risk_monitor.ways
        return [] if ways is None else ways.jobs()

    def decisions(self) -> list[Decision]:
        """Decisions since the last call."""
        return self._reports.decisions()

    # Received events

    def _take_event(self, event: Event, now_s: float) -> None:
        match event:
            case MissionCommand() | PauseContinue():
                self._orders.hear(event)
            case CommandCancelled(command=command):
                self._executor.withdraw(command, now_s)
            case DeniedCommand(reason=reason):
                self._orders.tell_why(event, Verdict.DENIED, reason, now_s)
            case CommandAnswered(result=result) if result != CommandResult.ACCEPTED:
                text = "the autopilot refused the mode"
                self._reports.say(Severity.WARNING, text, now_s)
            case AutopilotFound(autopilot=autopilot):
                self._read_by_s = now_s + _READING_S
                kind = autopilot.kind
                self._session.requests.want_parameters(loss_parameters(kind))
                self._session.requests.want_parameters(fence_parameters(kind), changing=True)
                self._session.requests.want_fence()
                self._session.requests.want_parameters(failsafe_parameters(kind))
                self._session.requests.want_parameters(holding_parameters(kind))
            case ModeLeft(mode=mode):
                self._executor.faults.note_mode_left(mode)
            case AutopilotRestarted():
                self._executor.faults.note_restart()
            case AutopilotElsewhere(link=link, address=(host, port, *_)):
                text = f"autopilot also at {host} (port {port}, on {link})"
                self._reports.say(Severity.WARNING, text, now_s, action="ignored")
            case PeerRefused(link=link, address=(host, port, *_), system_id=system_id):
                where = f"{host}:{port} on {link}; commands.systems"
                text = f"system {system_id} may not command ({where})"
                self._reports.say(Severity.NOTICE, text, now_s, action="not served")
            case AutopilotConflict(autopilot=autopilot, other=other, reason=reason):
                text = f"{reason}, no control ({autopilot}, {other})"
                self._reports.say(Severity.ERROR, text, now_s)

    def _learn(self, now_s: float) -> None:
        """Takes what the autopilot's parameters, fence and home say of the routes."""
        if self._session.autopilot is None:
            return
        kind = self._session.autopilot.kind
        parameters, home_m = self._session.requests.parameters, self._pose_tracker.home_m
        self._executor.routes.learn_loss(kind, parameters, home_m, now_s)
        items = self._session.requests.fence_items
        if items is None and self._session.requests.fence_silent:
            items = ()
        readiness = self.telemetry.readiness
        enabled = readiness is not None and readiness.fence_enabled
        self._executor.routes.learn_fence(kind, parameters, items, home_m, now_s, enabled=enabled)
        self._executor.routes.learn_failsafes(kind, parameters, home_m, self.telemetry, now_s)

    def _notice_pause(self, now_s: float) -> None:
        """Notes a fault when the last output sent in time is too old: control has ended."""
        paused_s = 0.0 if self._followed_s is None else now_s - self._followed_s
        if paused_s > self._config.supervision.position_timeout_s:
            # Data received meanwhile is old, and the autopilot may have acted on offboard loss.
            self._executor.faults.note_pause(paused_s)

    # Reports

    def _report(self, now_s: float) -> None:
        """Sends risk indices and weights to ground stations; records the status."""
        indices, weights, pose = self.risk.indices, self.weights, self._pose_tracker.pose
        self._reports.send_values(indices, weights, now_s)
        self._reports.record_status(
            self.status.state.value,
            indices,
            weights,
            None if pose is None else pose.position_m,
            now_s,
        )
        behind_s, ahead_s = self._session.signing.behind_s, self._session.signing.ahead_s
        for words in self._refusals.texts(self.packets_refused, behind_s, now_s, ahead_s=ahead_s):
            self._reports.say(Severity.WARNING, words, now_s)
