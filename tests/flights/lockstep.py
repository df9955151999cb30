"""A flight in lockstep: the companion machine and the fake autopilot in one process.

Time is moved by the loop; nothing sleeps. Plans are made at once and handed over after a set
delay, as a planner thread would. An operator (a ground station, 255/190) speaks raw MAVLink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.config import Authority, CompanionConfig, LinkConfig, shipped_configs
from moar_companion.planner.planner import Planner
from moar_companion.service.companion import Companion, Decision, Ground
from moar_companion.service.jobs import PlanAnswer, answer_job
from moar_companion.site import Site
from moar_companion.vehicle import Vehicle
from sitl.autopilot import FakeAutopilot, Options, Truth

COMPANION_LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
PLAN_DELAY_S = 0.04
MAV_CMD_USER_1 = 31010


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

    def answers(self, command: int = MAV_CMD_USER_1) -> list[int]:
        return [
            message.result
            for message in self.heard
            if message.get_type() == "COMMAND_ACK" and message.command == command
        ]

    def texts(self) -> list[str]:
        return [m.text for m in self.heard if m.get_type() == "STATUSTEXT"]


OFFBOARD = (6, 0)
HOLD = (4, 3)
LAND = (4, 6)
POSCTL = (3, 0)
INSPECTION, EXIT, EVACUATION, RELEASE, MISSION_HOLD = 1, 2, 3, 4, 0


class Lockstep:
    """Both machines and the bytes between them."""

    def __init__(
        self,
        *,
        site: str = "315kv_double_circuit",
        vehicle: str = "linedrone_flight",
        authority: Authority = Authority.STREAM,
        options: dict | None = None,
        **config,
    ) -> None:
        self.site = Site.load(shipped_configs() / "sites" / f"{site}.yaml")
        self.vehicle = Vehicle.load(shipped_configs() / "vehicles" / f"{vehicle}.yaml")
        self.planner = Planner(self.site, self.vehicle)
        x_m, _ = self.site.start_m
        home = self.site.frame.to_geodetic((x_m, 0.0, 0.0))
        self.autopilot = FakeAutopilot(
            Options(
                latitude_deg=home.latitude_deg,
                longitude_deg=home.longitude_deg,
                altitude_amsl_m=home.altitude_amsl_m,
                **(options or {}),
            )
        )
        self.companion = Companion(
            CompanionConfig(
                vehicle=shipped_configs(),
                links=(LinkConfig(url=COMPANION_LINK),),
                authority=authority,
                **config,
            ),
            self.vehicle,
            Ground(site=self.site, maps=self.planner.maps),
        )
        self.operator = Operator(self.autopilot)
        self.now_s = 0.0
        self.decisions: list[Decision] = []
        self.truths: list[Truth] = []
        self.to_autopilot: list[tuple[float, bytes]] = []
        self.cut = False
        self.planning = True
        self._answers: list[tuple[float, PlanAnswer]] = []

    @property
    def state(self) -> str:
        return self.companion.status.state.value

    def step(self) -> None:
        self.now_s += STEP_S
        now_s = self.now_s
        self.operator.tick(now_s)
        self.autopilot.step(now_s)
        for link, data in self.autopilot.data_to_send():
            if link == "gcs":
                self.operator.receive(data)
            elif not self.cut:
                self.companion.receive(COMPANION_LINK, data, now_s)
        while self._answers and self._answers[0][0] <= now_s:
            self.companion.plan_answered(self._answers.pop(0)[1], now_s)
        self.companion.tick(now_s)
        for job in self.companion.plan_jobs():
            if self.planning:
                answer = answer_job(self.planner, job)
                self._answers.append((now_s + PLAN_DELAY_S, answer))
        for _, data in self.companion.data_to_send():
            self.to_autopilot.append((now_s, data))
            if not self.cut:
                self.autopilot.receive("companion", data)
        self.decisions += self.companion.decisions()
        self.truths.append(self.autopilot.truth)

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

    def take_off(self, height_m: float = 3.0) -> None:
        """Boot, arm, take off and hover, as an operator would."""
        self.run(8.0)
        self.operator.take_off(height_m)
        self.run(0.1)
        self.operator.arm()
        self.run_until(
            lambda: self.autopilot.truth.landed_state == 2
            and self.autopilot.truth.mode == "AUTO.LOITER"
            and abs(self.autopilot.truth.velocity_ned_mps[2]) < 0.1,
            30.0,
        )

    def give_offboard(self) -> None:
        """The operator gives OFFBOARD once a setpoint is streamed."""
        self.run_until_state("ready", 5.0)
        self.run(1.5)
        self.operator.mode(*OFFBOARD)
        self.run_until_state("flying", 3.0)
