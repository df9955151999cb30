"""The companion: one machine without I/O. Bytes and time in, bytes out.

The service calls `receive` and `plan_answered` with inputs, runs a cycle with `tick` at the
setpoint rate (`cycle_stages`), and takes `data_to_send`, `plan_jobs` and `decisions`. Answers of
the planner wait for the next cycle. The machine never waits and has no clock; the same inputs at
the same times give the same outputs, byte for byte.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..mavlink.peers import Address
from ..mavlink.session import Severity
from ..mavlink.signing import Signing, SigningState
from ..mavlink.telemetry import Telemetry
from ..perception.perception_report import PerceptionReport
from ..perception.pose_notes import PoseNote
from ..risk import RiskEstimate
from ..settings.config import CompanionConfig
from ..settings.flight_parameters import FlightParameters
from ..settings.vehicle import Vehicle
from . import cycle_stages
from .cycle_state import CycleState
from .estimation.pose import Pose
from .intake import Arrival, Intake
from .mission.values import MissionStatus
from .mission_snapshot import MissionSnapshot
from .planning.map_jobs import MapAnswer, MapJob
from .planning.plan_jobs import PlanAnswer, PlanJob
from .planning.site_maps import SiteMaps
from .reports import Decision
from .safety.check_inputs import Host
from .safety.supervisor import Ruling


class Companion:
    """The machine. site_maps: None without a site: then telemetry and risk only.

    before: memory of the previous process. signing: needed where links are signed. parameters:
    values that ground stations may change, which config and vehicle have; None: there are none.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        site_maps: SiteMaps | None,
        *,
        before: MissionSnapshot | None = None,
        signing: Signing | None = None,
        parameters: FlightParameters | None = None,
    ) -> None:
        self._intake = Intake()
        self.state = CycleState(
            config, vehicle, before=before, signing=signing, parameters=parameters
        )
        """State between two cycles, for displays, which change none of it."""
        if site_maps is not None:
            cycle_stages.take_ground(self.state, site_maps)

    @property
    def telemetry(self) -> Telemetry:
        """Last report of every source."""
        return self.state.telemetry

    @property
    def status(self) -> MissionStatus:
        """Mission status: state, task and request."""
        return self.state.status

    @property
    def memory(self) -> MissionSnapshot | None:
        """Memory for the next process: that of the previous one until the status has changed."""
        if not self.state.status_changed:
            return self.state.start_report.before
        return MissionSnapshot.of(self.status, self.state.site)

    @property
    def parameters(self) -> FlightParameters | None:
        """Values of the parameters that are in force; None: there are none."""
        return self.state.parameters.in_force

    @property
    def setpoint_rate_hz(self) -> float:
        """Rate at which the shell runs cycles."""
        return self.state.config.setpoint_rate_hz

    @property
    def signing(self) -> SigningState:
        """Time stamps and references of the signed links for the next process, refused packets."""
        return self.state.session.signing.state

    @property
    def risk(self) -> RiskEstimate:
        """The risk indices and their inputs."""
        return self.state.risk

    @property
    def ruling(self) -> Ruling:
        """Permitted action, and the conditions against a flight."""
        return self.state.ruling

    @property
    def site_maps(self) -> SiteMaps | None:
        """The site and maps that are flown by; None before `take_ground`."""
        return self.state.routes.limits.site_maps

    @property
    def pose(self) -> Pose | None:
        """Pose of the aircraft in the site's frame; None while unknown."""
        return self.state.pose

    # In

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere. address: their sender on a listening link."""
        self.state.session.receive(link, data, now_s, address)

    def take_in(self, arrived: Sequence[Arrival], now_s: float) -> None:
        """Takes all bytes since the last cycle; `intake` limits all but the autopilot's."""
        precedence = self.state.session.precedence
        for time_s, link, data, address in self._intake.selected(arrived, precedence, now_s):
            self.receive(link, data, time_s, address)
        for words in self._intake.texts(now_s):
            self.state.reports.send_text(Severity.WARNING, words, now_s, action="dropped")

    def await_planner(self, compiling: str = "") -> None:
        """Notes that the planner is in preparation; until `take_ground` telemetry and risk only.

        compiling: progress of a compilation as text; empty where the planner is ready soon.
        """
        self.state.orders.await_planner(compiling, self.state.cycle_s or 0.0)

    def take_ground(self, site_maps: SiteMaps) -> None:
        """Takes the site when its planner is ready; from then on orders are executed."""
        self.state.orders.planner_ready(self.state.cycle_s or 0.0)
        cycle_stages.take_ground(self.state, site_maps)

    def note_host(self, host: Host) -> None:
        """Takes the computer's free resources."""
        self.state.host = host

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for signatures."""
        self.state.session.signing.note_wall_clock(wall_s)

    def plan_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a job, for the next cycle; one no longer awaited is dropped."""
        self.state.routes.plan_answered(answer)

    def contingency_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job, for the next cycle."""
        self.state.risk_monitor.contingency_answered(answer)

    def perceived(self, report: PerceptionReport) -> None:
        """Takes a report of the perception, for the next cycle."""
        self.state.seen_obstacles.take(report)

    def maps_answered(self, answer: MapAnswer) -> None:
        """Takes the answer to a map job, for the next cycle; one no longer awaited is dropped."""
        self.state.seen_obstacles.answered(answer)

    def tick(self, now_s: float) -> None:
        """Runs one cycle, from received events to this instant's setpoint; `shut_down` the last."""
        cycle_stages.run(self.state, now_s)

    def shut_down(self, now_s: float) -> None:
        """Runs the last cycle of the process: ends the stream at rest, if still permitted.

        Open orders get their final answer. The mission status stays, for the next process. Forecast
        and risks are not updated in it: an error there would cost the last setpoint.
        """
        self.state.is_last_cycle = True
        self.tick(now_s)

    # Out

    def data_to_send(self, *, control: bool = True) -> list[tuple[str, bytes]]:
        """Packets since the last call, each with its link's URL.

        control: False when the shell is too late for the last cycle. Then setpoints and modes are
        left out, and the cycle does not count as sent.
        """
        if control:
            self.note_sent()
        return self.state.session.data_to_send(control=control)

    def control_to_send(self) -> list[tuple[str, bytes]]:
        """Packets that command motion; to be sent first, and in time."""
        return self.state.session.control_to_send()

    def note_sent(self) -> None:
        """Notes that all of `control_to_send` was sent in time."""
        self.state.followed_s = self.state.cycle_s
        self.state.setpoints.note_sent()
        self.state.mode_requester.note_sent()

    def peers(self, link: str) -> tuple[Address, ...]:
        """The addresses to which a listening link sends; empty for other links."""
        return self.state.session.peers(link)

    def received_packets(self) -> list[tuple[float, bytes]]:
        """Whole packets received since the last call, with their times, for the record."""
        return self.state.session.received_packets()

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return self.state.routes.plan_jobs()

    def contingency_jobs(self) -> list[PlanJob]:
        """Planning jobs for escape routes since the last call; lower priority than `plan_jobs`."""
        return self.state.risk_monitor.contingency_jobs()

    def map_jobs(self) -> list[MapJob]:
        """Jobs for maps with other obstacles since the last call; one at a time."""
        return self.state.seen_obstacles.jobs()

    def pose_notes(self) -> list[PoseNote]:
        """Poses since the last call, for the perception; none without a sensor."""
        return self.state.seen_obstacles.pose_notes()

    def decisions(self) -> list[Decision]:
        """Decisions since the last call."""
        return self.state.reports.decisions()
