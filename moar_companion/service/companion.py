"""The companion: one machine without I/O. Bytes and time in, bytes out.

    bytes -> session -> telemetry -> pose, risk indices -> weights -> plan job
    plan answer -> flight -> setpoint -> gate -> session -> bytes

The shell feeds it with `receive` and `plan_answered`, lets it think with `tick` at the setpoint
rate, and carries away `data_to_send`, `plan_jobs` and `decisions`. It never waits and has no clock;
the same inputs at the same times give the same outputs, byte for byte.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..autopilots import failsafe_parameters
from ..autopilots.fence import fence_parameters
from ..config import CompanionConfig
from ..mavlink.commands import (
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    PauseContinue,
    stops,
)
from ..mavlink.identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from ..mavlink.listener import ModeLeft
from ..mavlink.peers import Address, AutopilotElsewhere, PeerRefused
from ..mavlink.session import CommandAnswered, Session, Severity, SystemStatus
from ..mavlink.signing import Refusal, Signing, link_signings
from ..mission.states import STREAMING
from ..mission.supervisor import Ruling
from ..mission.values import MissionStatus, Verdict
from ..power.cells import misread
from ..risk import RiskEstimate
from ..risk.holding import holding_parameters
from ..types import Mission, Telemetry, Weights
from ..vehicle import Vehicle
from .awakening import Awakening
from .causes import Host
from .conduct import Conduct
from .contingencies import Outlook
from .file_faults import FileFaultTexts
from .flight import Progress
from .intake import Arrival, Intake
from .jobs import PlanAnswer, PlanJob
from .loss import loss_parameters
from .memory import Memory
from .motion import Pose
from .orders import OrderBook
from .overseer import Overseer
from .refusals import Refusals
from .reports import Decision, Reports
from .surroundings import Ground, Surroundings

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_READING_S = 1.0
"""So long after the start an order waits for the autopilot, whose heartbeat comes each second, and
as long again for its parameters: over UDP they are read within 0.3 s."""
_LONGEST_STEP_S = 0.1
"""After a longer pause of the shell the reference moves on as if only this had passed."""


class Companion:
    """The machine. ground: None without a site: then telemetry and risk only.

    before: what the process before this one remembered. signing: needed where links are signed.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        ground: Ground | None,
        *,
        before: Memory | None = None,
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
        self._refusals = Refusals()
        self._orders = OrderBook(self._session, self._reports)
        self._overseer = Overseer(config.supervision, vehicle.guidance.off_path_m, self._reports)
        self._before = before
        self._begin(ground)
        self._planner_awaited = False
        self._compiling = ""
        self._awakening = Awakening(before)
        self._file_faults = FileFaultTexts()
        self._misread_told = False
        self._read_by_s = -math.inf
        """Until then an order waits for the autopilot, and for what must be known of it."""
        self._thought_s: float | None = None
        self._followed_s: float | None = None
        """When the last thought began that was sent in time."""
        self._risk_due_s = -math.inf
        self._told: tuple[object, ...] = ()
        """Of the position's accuracy, when the risks were last judged."""
        self._report_due_s = -math.inf

    def _begin(self, ground: Ground | None) -> None:
        site = None if ground is None else ground.site
        self._surroundings = Surroundings(site, self._vehicle.autopilot)
        self._conduct = Conduct(
            self._config,
            self._vehicle,
            ground,
            session=self._session,
            surroundings=self._surroundings,
            orders=self._orders,
            reports=self._reports,
            overseer=self._overseer,
            before=self._before,
        )
        self._first_status = self._conduct.status

    @property
    def telemetry(self) -> Telemetry:
        """The last word of every source."""
        return self._session.telemetry

    @property
    def status(self) -> MissionStatus:
        """Where the mission stands."""
        return self._conduct.status

    @property
    def memory(self) -> Memory | None:
        """What a process that is started after this one has to know."""
        status = self.status
        if status == self._first_status:
            return self._before
        site = None if self._ground is None else self._ground.site.name
        return Memory(state=status.state, since_s=status.since_s, task=status.task, site=site)

    @property
    def signing_timestamps(self) -> dict[str, int]:
        """The time stamp of each signed link, for the process after this one."""
        return self._session.signing_timestamps

    @property
    def signing_references(self) -> dict[str, int]:
        """What new senders of each signed link are judged by, for the process after this one."""
        return self._session.signing_references

    @property
    def packets_refused(self) -> dict[str, dict[Refusal, int]]:
        """How many packets each signed link has refused, and why."""
        return self._session.packets_refused

    @property
    def risk(self) -> RiskEstimate:
        """The risk indices and what they are made of."""
        return self._conduct.risk

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
        """What may be flown, and what is against it."""
        return self._conduct.ruling

    @property
    def outlook(self) -> Outlook | None:
        """What is left in the batteries, and what is still to be flown; None without a site."""
        ways = self._conduct.prospects.ways
        return None if ways is None else ways.outlook(self.risk.meter)

    @property
    def pose(self) -> Pose | None:
        """The aircraft in the site's frame; None while that is unknown."""
        return self._surroundings.pose

    @property
    def clearance_m(self) -> float | None:
        """From the aircraft's hull to the nearest obstacle; None where that is unknown."""
        pose, ground = self._surroundings.pose, self._ground
        if pose is None or ground is None:
            return None
        return ground.clearance_m(pose, self._vehicle.radius_m)

    @property
    def progress(self) -> Progress | None:
        """How far the flight has come; None while there is none."""
        pose, flight = self._surroundings.pose, self._conduct.course.flight
        return None if flight is None or pose is None else flight.progress(pose)

    # In

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere. address: who sent them to a listening link."""
        self._session.receive(link, data, now_s, address)

    def take_in(self, arrived: Sequence[Arrival], now_s: float) -> None:
        """Takes what has arrived on all links since the last cycle, in the order of arrival.

        Of what neither the autopilot's address nor a stream has brought, so much as a cycle has
        time for; the rest is dropped, counted and told.
        """
        for time_s, link, data, address in self._intake.selected(arrived, self._session.precedence):
            self.receive(link, data, time_s, address)
        for words in self._intake.texts(now_s):
            self._reports.say(Severity.WARNING, words, now_s, action="dropped")

    def await_planner(self, compiling: str = "") -> None:
        """The site's planner is being made ready; until `take_ground` telemetry and risk only.

        Orders wait for it, which is soon; but while something has to be compiled, which takes
        long, they are temporarily rejected. compiling: in words, how far that is.
        """
        self._planner_awaited = True
        if compiling and not self._compiling:
            self._reports.say(Severity.INFO, compiling, self._thought_s or 0.0)
        self._compiling = compiling

    def take_ground(self, ground: Ground) -> None:
        """Takes the site when its planner is ready: from now on orders are carried out."""
        if self._compiling:
            self._reports.say(Severity.INFO, "the planner is ready", self._thought_s or 0.0)
        self._ground = ground
        self._planner_awaited, self._compiling = False, ""
        host = self._conduct.host
        self._begin(ground)
        self._conduct.host = host

    def note_host(self, host: Host) -> None:
        """Takes what the computer has left."""
        self._conduct.host = host

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for signatures."""
        self._session.note_wall_clock(wall_s)

    def shut_down(self, now_s: float) -> None:
        """The process is about to end: what is streamed ends at rest, if it still may."""
        self._notice_pause(now_s)
        self._hear(now_s)
        self._conduct.shut_down(now_s)

    def plan_answered(self, answer: PlanAnswer, now_s: float) -> None:
        """Takes the answer to a job; one that is no longer awaited is dropped."""
        self._hear(now_s)
        self._conduct.plan_answered(answer, now_s)

    def contingency_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job; one that is no longer awaited is dropped."""
        self._conduct.way_answered(answer)

    def tick(self, now_s: float) -> None:
        """Think: what was heard, what it means, what is to be streamed now."""
        self._notice_pause(now_s)
        step_s = 0.0 if self._thought_s is None else min(_LONGEST_STEP_S, now_s - self._thought_s)
        if self._thought_s is None:
            self._read_by_s = now_s + _READING_S
        self._thought_s = now_s
        self._hear(now_s)
        telemetry = self.telemetry
        told = telemetry.gnss, telemetry.second_gnss, telemetry.estimator, telemetry.odometry
        # How well the position is known counts for the next setpoint already.
        if now_s >= self._risk_due_s or told != self._told:
            self._risk_due_s, self._told = now_s + _RISK_PERIOD_S, told
            self._conduct.judge(now_s)
        self._conduct.supervise(now_s)
        self._tell_of_files(now_s)
        if not self._planner_awaited:
            self._tell(now_s)
        if self._planner_awaited or self._is_reading(now_s):
            self._put_off(now_s)
        else:
            for command in self._orders.heard():
                self._conduct.order(command, now_s)
        self._conduct.fly(now_s, step_s)
        state = self.status.state
        active = SystemStatus.ACTIVE if state in STREAMING else SystemStatus.STANDBY
        self._session.tick(now_s, active, custom_mode=state.number)
        if now_s >= self._report_due_s:
            self._report_due_s = now_s + _REPORT_PERIOD_S
            self._report(now_s)

    def _tell(self, now_s: float) -> None:
        """Tell what was found at the start."""
        may_continue = self.status == self._first_status and self.status.held
        for text in self._awakening.texts(self.telemetry, now_s, may_continue=may_continue):
            self._reports.say(Severity.WARNING, text, now_s)
        words = None if self._misread_told else misread(self.telemetry, self._vehicle.risk.cells)
        if words is not None and self.status.state not in STREAMING:
            self._misread_told = True
            self._reports.say(Severity.WARNING, words, now_s)

    def _tell_of_files(self, now_s: float) -> None:
        """Tell what the service cannot write, and since when it can again."""
        for fault, over in self._file_faults.texts(self._conduct.host.file_faults, self.telemetry):
            severity = Severity.NOTICE if over else Severity.WARNING
            action = "over" if over else fault.action
            self._reports.say(severity, fault.reason, now_s, action=action, news=True)

    def _is_reading(self, now_s: float) -> bool:
        """Whether the autopilot may be found, and what must be known of it read, any moment now.

        An order that were rejected for that would stay so for all its repeats.
        """
        if self._ground is None or now_s > self._read_by_s:
            return False
        return self._session.autopilot is None or self._conduct.course.reluctance is not None

    def _put_off(self, now_s: float) -> None:
        """Carry out what ends motion; all else waits, or is given again later.

        What waits is cancelled by what ends motion, as if it had been carried out before.
        """
        waiting: list[MissionCommand | PauseContinue] = []
        for command in self._orders.heard():
            if stops(command):
                for earlier in waiting:
                    order_id = self._orders.enter(earlier, now_s)
                    self._orders.answer(order_id, Verdict.CANCELLED, "", now_s)
                waiting = []
                self._conduct.order(command, now_s)
            elif self._compiling:
                self._orders.reject(command, self._compiling, now_s)
            else:
                waiting.append(command)
        for command in waiting:
            self._orders.hear(command)

    # Out

    def data_to_send(self, *, control: bool = True) -> list[tuple[str, bytes]]:
        """Packets since the last call, each with its link's URL.

        control: False when the shell comes too late with the last thought. Then setpoints and modes
        are left out, and for what ends our control that thought has not been.
        """
        if control:
            self.note_sent()
        return self._session.data_to_send(control=control)

    def control_to_send(self) -> list[tuple[str, bytes]]:
        """Of that what moves the aircraft: for a shell that sends it in time, before the rest."""
        return self._session.control_to_send()

    def note_sent(self) -> None:
        """All of `control_to_send` was sent in time."""
        self._followed_s = self._thought_s
        self._conduct.setpoints.note_sent()
        self._conduct.engaging.note_sent()

    def peers(self, link: str) -> tuple[Address, ...]:
        """The addresses to which a listening link sends; empty for other links."""
        return self._session.peers(link)

    def packets_heard(self) -> list[tuple[float, bytes]]:
        """Whole packets that arrived since the last call, with their times, for the record."""
        return self._session.packets_heard()

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return self._conduct.course.plan_jobs()

    def contingency_jobs(self) -> list[PlanJob]:
        """Planning jobs for ways out since the last call: to be done when no other one waits."""
        ways = self._conduct.prospects.ways
        return [] if ways is None else ways.jobs()

    def decisions(self) -> list[Decision]:
        """What was decided since the last call."""
        return self._reports.decisions()

    # What is heard

    def _hear(self, now_s: float) -> None:
        """Take in telemetry and events.

        Orders wait for the next thought, until what ends our control has been looked at.
        """
        jump = self._surroundings.look(self.telemetry)
        if jump is not None:
            self._conduct.shift(jump, now_s)
        for event in self._session.events_received():
            match event:
                case MissionCommand() | PauseContinue():
                    self._orders.hear(event)
                case CommandCancelled(command=command):
                    self._conduct.withdraw(command, now_s)
                case DeniedCommand(reason=reason):
                    self._orders.tell_why(event, Verdict.DENIED, reason, now_s)
                case CommandAnswered(result=result) if result != CommandResult.ACCEPTED:
                    text = "the autopilot refused the mode"
                    self._reports.say(Severity.WARNING, text, now_s)
                case AutopilotFound(autopilot=autopilot):
                    self._read_by_s = now_s + _READING_S
                    kind = autopilot.kind
                    self._session.want_parameters(loss_parameters(kind))
                    self._session.want_parameters(fence_parameters(kind), changing=True)
                    self._session.want_fence()
                    self._session.want_parameters(failsafe_parameters(kind))
                    self._session.want_parameters(holding_parameters(kind))
                case ModeLeft(mode=mode):
                    self._conduct.faults.note_mode_left(mode)
                case AutopilotRestarted():
                    self._conduct.faults.note_restart()
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
        if self._session.autopilot is not None:
            kind = self._session.autopilot.kind
            parameters, home_m = self._session.parameters, self._surroundings.home_m
            self._conduct.course.learn_loss(kind, parameters, home_m, now_s)
            items = self._session.fence_items
            if items is None and self._session.fence_silent:
                items = ()
            readiness = self.telemetry.readiness
            enabled = readiness is not None and readiness.fence_enabled
            self._conduct.course.learn_fence(
                kind, parameters, items, home_m, now_s, enabled=enabled
            )
            self._conduct.course.learn_failsafes(kind, parameters, home_m, self.telemetry, now_s)

    def _notice_pause(self, now_s: float) -> None:
        """When the last thought that was sent in time is long ago, control has ended."""
        paused_s = 0.0 if self._followed_s is None else now_s - self._followed_s
        if paused_s > self._config.supervision.position_timeout_s:
            # What has arrived meanwhile is old, and the autopilot may have given up on us.
            self._conduct.faults.note_pause(paused_s)

    # What people see

    def _report(self, now_s: float) -> None:
        """Risk indices and weights for ground stations; the state of things for the record."""
        indices, weights, pose = self.risk.indices, self.weights, self._surroundings.pose
        self._reports.send_values(indices, weights, now_s)
        self._reports.record_status(
            self.status.state.value,
            indices,
            weights,
            None if pose is None else pose.position_m,
            now_s,
        )
        behind_s, ahead_s = self._session.signers_behind_s, self._session.signing_ahead_s
        for words in self._refusals.texts(self.packets_refused, behind_s, now_s, ahead_s=ahead_s):
            self._reports.say(Severity.WARNING, words, now_s)
