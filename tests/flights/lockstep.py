"""A flight in lockstep: the companion machine and the fake autopilot in one process.

Time is moved by the loop; nothing sleeps. Plans are made at once and handed over after a set
delay, as a planner thread would. An operator (a ground station, 255/190) speaks raw MAVLink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.config import Authority, CompanionConfig, LinkConfig, shipped_configs
from moar_companion.planner.planner import Planner
from moar_companion.service.companion import Companion
from moar_companion.service.jobs import PlanAnswer, answer_job
from moar_companion.service.reports import Decision
from moar_companion.service.surroundings import Ground
from moar_companion.site import Site
from moar_companion.vehicle import Vehicle
from sitl.autopilot import FakeAutopilot, Options, Truth

COMPANION_LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
PLAN_DELAY_S = 0.04
MAV_CMD_USER_1 = 31010
MAV_CMD_DO_PAUSE_CONTINUE = 193


@dataclass
class Operator:
    """A ground station on the autopilot's other link: what it sends and what it has heard."""

    autopilot: FakeAutopilot
    heard: list[mavlink.MAVLink_message] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._codec.robust_parsing = True
        self._heartbeat_due_s = 0.0

    def tick(self, now_s: float) -> None:
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + 1.0
            self.send(self._codec.heartbeat_encode(6, 8, 0, 0, 4))

    def receive(self, data: bytes) -> None:
        self.heard += self._codec.parse_buffer(data) or []

    def send(self, message: mavlink.MAVLink_message) -> None:
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self.autopilot.receive("gcs", data)

    def command(self, command: int, *parameters: float, component: int = 1) -> None:
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        self.send(self._codec.command_long_encode(1, component, command, 0, *padded))

    def arm(self) -> None:
        self.command(400, 1)

    def take_off(self, height_m: float) -> None:
        altitude = self.autopilot.options.altitude_amsl_m + height_m
        self.command(22, 0, 0, 0, math.nan, math.nan, math.nan, altitude)

    def mode(self, main: int, sub: int = 0) -> None:
        self.command(176, 1, main, sub)

    def mission(self, mission: int, index: float = -1) -> None:
        self.command(MAV_CMD_USER_1, mission, index, component=195)

    def pause(self) -> None:
        self.command(MAV_CMD_DO_PAUSE_CONTINUE, 0, component=195)

    def go_on(self) -> None:
        self.command(MAV_CMD_DO_PAUSE_CONTINUE, 1, component=195)

    def answers(self, command: int = MAV_CMD_USER_1) -> list[int]:
        return [
            message.result
            for message in self.heard
            if message.get_type() == "COMMAND_ACK" and message.command == command
        ]

    def texts(self) -> list[str]:
        """Whole texts: chunks of 50 characters are put together."""
        texts: list[str] = []
        for message in self.heard:
            if message.get_type() == "STATUSTEXT":
                if message.id and message.chunk_seq:
                    texts[-1] += message.text
                else:
                    texts.append(message.text)
        return texts

    def said(self, words: str) -> bool:
        return any(words in text for text in self.texts())


ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
OFFBOARD = (6, 0)
HOLD = (4, 3)
LAND = (4, 6)
POSCTL = (3, 0)
INSPECTION, EXIT, EVACUATION, RELEASE, MISSION_HOLD = 1, 2, 3, 4, 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """A SET_POSITION_TARGET_LOCAL_NED that was sent, and what its frame was then."""

    time_s: float
    state: str
    message: Any
    origin: tuple[float, float, float]
    """The local frame's: latitude and longitude in degrees, altitude AMSL in metres."""


class Lockstep:
    """Both machines and the bytes between them."""

    def __init__(
        self,
        *,
        site: str = "315kv_double_circuit",
        vehicle: str = "linedrone_flight",
        authority: Authority = Authority.STREAM,
        options: dict | None = None,
        start_m: tuple[float, float] | None = None,
        **config,
    ) -> None:
        """start_m: where it stands in the site's frame (x, y); under the site's start."""
        self.site = Site.load(shipped_configs() / "sites" / f"{site}.yaml")
        self.vehicle = Vehicle.load(shipped_configs() / "vehicles" / f"{vehicle}.yaml")
        self.planner = Planner(self.site, self.vehicle)
        x_m, y_m = (self.site.start_m[0], 0.0) if start_m is None else start_m
        home = self.site.frame.to_geodetic((x_m, y_m, 0.0))
        self.autopilot = FakeAutopilot(
            Options(
                latitude_deg=home.latitude_deg,
                longitude_deg=home.longitude_deg,
                altitude_amsl_m=home.altitude_amsl_m,
                **(options or {}),
            )
        )
        self.config = CompanionConfig(
            vehicle=shipped_configs(),
            links=(LinkConfig(url=COMPANION_LINK),),
            authority=authority,
            **config,
        )
        self.companion = self.new_companion()
        self.operator = Operator(self.autopilot)
        self.now_s = 0.0
        self.decisions: list[Decision] = []
        self.truths: list[Truth] = []
        self.to_autopilot: list[tuple[float, bytes]] = []
        self.inputs: list[tuple[str, float, Any]] = []
        """Everything that entered the companion: ("bytes" | "answer" | "tick", time, what)."""
        self.setpoints: list[Setpoint] = []
        self.states: list[tuple[float, str]] = []
        """The companion's state after each step."""
        self.cut = False
        self.deaf = False
        """The autopilot's words do not reach the companion; the other way is open."""
        self.planning = True
        self.plan_delay_s = PLAN_DELAY_S
        self._setpoint_codec = mavlink.MAVLink(None)
        self._answers: list[tuple[float, PlanAnswer]] = []

    def new_companion(self) -> Companion:
        """A companion that knows nothing yet, of this site and vehicle."""
        return Companion(self.config, self.vehicle, Ground(site=self.site, maps=self.planner.maps))

    @property
    def state(self) -> str:
        return self.companion.status.state.value

    @property
    def truth(self) -> Truth:
        return self.autopilot.truth

    @property
    def last_setpoint_s(self) -> float:
        """When the last setpoint was sent; minus infinity before the first."""
        return self.setpoints[-1].time_s if self.setpoints else -math.inf

    def step(self) -> None:
        self.now_s += STEP_S
        now_s = self.now_s
        self.operator.tick(now_s)
        self.autopilot.step(now_s)
        for link, data in self.autopilot.data_to_send():
            if link == "gcs":
                self.operator.receive(data)
            elif not self.cut and not self.deaf:
                self.hear(data)
        while self._answers and self._answers[0][0] <= now_s:
            answer = self._answers.pop(0)[1]
            self.inputs.append(("answer", now_s, answer))
            self.companion.plan_answered(answer, now_s)
        self.inputs.append(("tick", now_s, None))
        self.companion.tick(now_s)
        for job in self.companion.plan_jobs():
            if self.planning:
                answer = answer_job(self.planner, job)
                self._answers.append((now_s + self.plan_delay_s, answer))
        for _, data in self.companion.data_to_send():
            self.to_autopilot.append((now_s, data))
            self._note_setpoint(data)
            if not self.cut:
                self.autopilot.receive("companion", data)
        self.decisions += self.companion.decisions()
        self.truths.append(self.autopilot.truth)
        self.states.append((now_s, self.state))

    def hear(self, data: bytes) -> None:
        """Bytes for the companion, from whomever."""
        self.inputs.append(("bytes", self.now_s, data))
        self.companion.receive(COMPANION_LINK, data, self.now_s)

    def _note_setpoint(self, data: bytes) -> None:
        for message in self._setpoint_codec.parse_buffer(data) or []:
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                origin = self.companion.telemetry.local_origin
                assert origin is not None
                self.setpoints.append(
                    Setpoint(
                        time_s=self.now_s,
                        state=self.state,
                        message=message,
                        origin=(
                            origin.point.latitude_deg,
                            origin.point.longitude_deg,
                            origin.point.altitude_amsl_m,
                        ),
                    )
                )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def run_until(self, condition, timeout_s: float) -> None:
        """Runs until a condition holds; fails when it does not within the time."""
        end_s = self.now_s + timeout_s
        while not condition():
            if self.now_s >= end_s:
                raise AssertionError(
                    f"not within {timeout_s:g} s: state {self.state}, "
                    f"mode {self.autopilot.truth.mode}, texts {self.operator.texts()[-5:]}"
                )
            self.step()

    def run_until_state(self, state: str, timeout_s: float) -> None:
        self.run_until(lambda: self.state == state, timeout_s)

    def run_in_wind(self, wind_mps: float, from_deg: float, seconds: float) -> None:
        """Time in a wind, and calm after."""
        conditions = self.autopilot.conditions
        conditions.wind_mps, conditions.wind_from_deg = wind_mps, from_deg
        self.run(seconds)
        conditions.wind_mps = 0.0

    def begin(self, mission: int, index: float = -1) -> None:
        """Take off, order a mission, and give OFFBOARD for it."""
        self.take_off()
        self.operator.mission(mission, index)
        self.give_offboard()

    def land(self) -> None:
        """The operator gives LAND; until it stands there, disarmed."""
        self.operator.mode(*LAND)
        self.run_until(lambda: self.truth.on_ground and not self.truth.armed, 60.0)
        self.run(1.0)

    def take_off(self, height_m: float = 3.0) -> None:
        """Boot, arm, take off and hover, as an operator would."""
        self.run(8.0)
        self.operator.take_off(height_m)
        self.run(0.1)
        self.operator.arm()
        self.run_until(
            lambda: (
                self.autopilot.truth.landed_state == 2
                and self.autopilot.truth.mode == "AUTO.LOITER"
                and abs(self.autopilot.truth.velocity_ned_mps[2]) < 0.1
            ),
            30.0,
        )
        self.run(0.5)  # until the companion has heard it, too

    def give_offboard(self) -> None:
        """The operator gives OFFBOARD once a setpoint is streamed."""
        self.run_until_state("ready", 5.0)
        self.run(1.5)
        self.operator.mode(*OFFBOARD)
        self.run_until_state("flying", 3.0)
