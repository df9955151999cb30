"""A flight in lockstep: the companion machine and the fake autopilot in one process.

The loop advances the time; nothing sleeps. Plans are made at once and delivered after a set
delay, as by a planner thread.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.error_margin import flown_site, sighted
from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.companion.planning.map_jobs import MapJob, answer_map_job
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.companion.reports import Decision
from moar_companion.mavlink.signing import Signing, SigningKey
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.service.recording.calls import Call, RecordedCompanion
from moar_companion.settings.config import (
    Authority,
    CompanionConfig,
    Inspection,
    VisitOrder,
    shipped_configs,
)
from moar_companion.settings.link_config import LinkConfig
from moar_companion.settings.perception_config import Perception, Sensor
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import AutopilotKind
from sitl.autopilot import Options, Truth
from sitl.lidar_scene import PlacedScene
from sitl.manners import KINDS
from sitl.payload import Payload, PayloadOptions
from sitl.wire import packet_header, packets
from tests.vehicles import named_vehicle

from ..copies import flown_once
from ..packets import decoded
from .aircraft import STEP_S, Aircraft, in_the_air
from .lidar_on_board import LidarOnBoard
from .operator import Manner

COMPANION_LINK = "udp:127.0.0.1:14540"
PARAMETERS = {
    Manner.PX4: {"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 0.5},
    Manner.ARDUPILOT: {"GUID_TIMEOUT": 0.5},
}
"""Parameters that the manual asks for, as far as they matter to a flight without a pilot."""
PLAN_DELAY_S = 0.04
HEARD_S = 4.0
"""Time in which the companion receives all requested data after its start."""


def as_simulated(vehicle: Vehicle, manner: Manner) -> Vehicle:
    """The vehicle with autopilot, drag and pack of the simulated aircraft, as if measured."""
    kind = KINDS[manner.value]
    risk = replace(
        vehicle.risk,
        drag_per_s=kind.airframe.drag_per_s,
        drag_per_m=kind.airframe.drag_per_m,
        cells=None if vehicle.risk.cells is None else kind.battery.cells,
    )
    return replace(vehicle, autopilot=AutopilotKind(manner.value), risk=risk)


@dataclass(frozen=True, kw_only=True)
class Setpoint:
    """A sent SET_POSITION_TARGET_LOCAL_NED and its frame at that time.

    packet: its bytes. position: those of the LOCAL_POSITION_NED that the companion received last.
    """

    time_s: float
    state: str
    packet: bytes
    position: bytes | None
    origin: tuple[float, float, float]
    """The local frame's: latitude and longitude in degrees, altitude AMSL in metres."""

    @cached_property
    def message(self) -> Any:
        return decoded(self.packet)

    @cached_property
    def aircraft(self) -> Any:
        return None if self.position is None else decoded(self.position)


class Lockstep(Aircraft):
    """The companion and its planner beside the aircraft, and the bytes between them."""

    link_url = COMPANION_LINK

    def __init__(
        self,
        *,
        site: str | Site = "315kv_double_circuit",
        vehicle: str | Vehicle = "linedrone_uniform",
        manner: Manner = Manner.PX4,
        authority: Authority = Authority.STREAM,
        options: dict | None = None,
        start_m: tuple[float, float] | None = None,
        secret: bytes | None = None,
        lidar_scene: PlacedScene | None = None,
        payload: PayloadOptions | None = None,
        **config,
    ) -> None:
        """start_m: place of the aircraft in the site's frame (x, y); None: under the site's start.

        secret: key of all signed links. lidar_scene: scene of the lidar on board; None: no lidar.
        payload: camera and gimbal on board; None: neither.
        """
        if isinstance(site, str):
            site = Site.load(shipped_configs() / "sites" / f"{site}.yaml")
        self.site = site
        if isinstance(vehicle, str):
            vehicle = named_vehicle(vehicle)
        if lidar_scene is not None:
            config.setdefault("perception", Perception(sensor=Sensor.VELODYNE))
        # Stories name their targets in the order of the visits.
        config.setdefault("inspection", Inspection(order=VisitOrder.FILE))
        self.config = CompanionConfig(
            vehicle=shipped_configs(),
            links=(LinkConfig(url=self.link_url, signed=secret is not None),),
            authority=authority,
            **config,
        )
        self.vehicle = sighted(as_simulated(vehicle, manner), self.config)
        self.flown_site = flown_site(site, self.vehicle, self.config.supervision)
        # Decisions have the planning time, which is 0 in lockstep.
        self.planner = Planner(self.flown_site, self.vehicle, clock=lambda: 0.0)
        self.planners = PlannerSet(self.planner)
        x_m, y_m = (self.site.start_m[0], 0.0) if start_m is None else start_m
        options = dict(options or {})
        parameters = {**PARAMETERS[manner], **options.pop("parameters", {})}
        home = self.site.frame.to_geodetic((x_m, y_m, 0.0))
        super().__init__(
            Options(
                autopilot=manner.value,
                latitude_deg=home.latitude_deg,
                longitude_deg=home.longitude_deg,
                altitude_amsl_m=home.altitude_amsl_m,
                parameters=parameters,
                **options,
            ),
            secret=secret,
        )
        self._secret = secret
        self.companion = self.new_companion()
        self.lidar = lidar_scene and LidarOnBoard(
            lidar_scene, self.config.perception, site, seed=self.autopilot.options.seed
        )
        self.payload = payload and Payload(payload)
        self.decisions: list[Decision] = []
        self.truths: list[Truth] = []
        self.to_autopilot: list[tuple[float, bytes]] = []
        self.calls: list[Call] = []
        """All inputs of the companion and its answers, in order."""
        self.setpoints: list[Setpoint] = []
        self.states: list[tuple[float, str]] = []
        """The companion's state after each step."""
        self.cut = False
        self.deaf = False
        """True: the autopilot's packets do not reach the companion; the other direction is open."""
        self.blind = False
        """The lidar is off."""
        self.planning = True
        self.plan_delay_s = PLAN_DELAY_S
        self._position: bytes | None = None
        self._jobs: list[tuple[float, PlanJob | MapJob]] = []

    def _constants(self) -> list:
        planner, planners = self.planner, self.planners
        site_maps = (self.site, self.flown_site, self.vehicle, planner.maps, planner, planners)
        return [*super()._constants(), self.config, *site_maps]

    def new_companion(self, before: MissionSnapshot | None = None) -> RecordedCompanion:
        """A new companion with only the snapshot of the previous one."""
        site_maps = SiteMaps(site=self.flown_site, maps=self.planner.maps)
        signing = self._secret and Signing(key=SigningKey(self._secret), wall_s=0.0)
        return RecordedCompanion(
            self.config, self.vehicle, site_maps, before=before, signing=signing or None
        )

    @property
    def received(self) -> list[tuple[float, bytes]]:
        """The bytes that the companion has received, with their times."""
        received = [call.arguments for call in self.calls if call.method == "receive"]
        return [(time_s, data) for _, data, time_s, *_ in received]

    @property
    def state(self) -> str:
        return self.companion.status.state.value

    @property
    def status(self) -> str:
        return f"state {self.state}, {super().status}"

    @property
    def last_setpoint_s(self) -> float:
        """Time of the last setpoint; minus infinity before the first."""
        return self.setpoints[-1].time_s if self.setpoints else -math.inf

    def step(self) -> None:
        said = self.move()
        now_s = self.now_s
        if not self.cut and not self.deaf:
            for data in said:
                self.handle(data)
            if self.payload is not None:
                for data in self.payload.step(self.autopilot.truth):
                    self.handle(data)
        while self._jobs and self._jobs[0][0] <= now_s:
            self._do(self._jobs.pop(0)[1])
        self.companion.tick(now_s)
        if self.lidar is not None and not self.blind:
            self.lidar.step(self.autopilot.truth, self.companion, now_s)
        for job in (*self.companion.map_jobs(), *self.companion.plan_jobs()):
            if self.planning:
                self._jobs.append((now_s + self.plan_delay_s, job))
        for job in self.companion.contingency_jobs():
            if self.planning:
                answer = answer_job(self.planners, job)
                self.companion.contingency_answered(answer)
        for _, data in self.companion.data_to_send():
            self.to_autopilot.append((now_s, data))
            self._note_setpoint(data)
            if not self.cut:
                self.report(data)
        self.decisions += self.companion.decisions()
        self.calls += self.companion.calls()
        self.truths.append(self.autopilot.truth)
        self.states.append((now_s, self.state))

    def stop_process(self, seconds: float) -> None:
        """The companion's process is not scheduled (SIGSTOP): its packets wait in the socket."""
        waiting = [data for _ in range(round(seconds / STEP_S)) for data in self.move()]
        for data in waiting:
            self.handle(data)

    def _do(self, job: PlanJob | MapJob) -> None:
        """Carries out a job of the planner's thread, on the maps of the jobs before it."""
        if isinstance(job, MapJob):
            self.companion.maps_answered(answer_map_job(self.planners, job))
        else:
            self.companion.plan_answered(answer_job(self.planners, job))

    def handle(self, data: bytes) -> None:
        """Bytes for the companion, from any sender."""
        for packet in packets(data):
            if packet_header(packet)[0] == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._position = packet
        self.companion.receive(self.link_url, data, self.now_s)

    def report(self, data: bytes) -> None:
        """Bytes of the companion, for the autopilot and what else is on board."""
        self.autopilot.receive("companion", data)
        if self.payload is not None:
            self.payload.receive(data)

    def _note_setpoint(self, data: bytes) -> None:
        for packet in packets(data):
            if packet_header(packet)[0] == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                origin = self.companion.telemetry.local_origin
                assert origin is not None
                self.setpoints.append(
                    Setpoint(
                        time_s=self.now_s,
                        state=self.state,
                        packet=packet,
                        position=self._position,
                        origin=(
                            origin.point.latitude_deg,
                            origin.point.longitude_deg,
                            origin.point.altitude_amsl_m,
                        ),
                    )
                )

    def run_until_state(self, state: str, timeout_s: float) -> None:
        self.run_until(lambda: self.state == state, timeout_s)

    def run_in_wind(self, wind_mps: float, from_deg: float, seconds: float) -> None:
        """Runs in a wind, with calm air afterwards."""
        conditions = self.autopilot.conditions
        conditions.wind_mps, conditions.wind_from_deg = wind_mps, from_deg
        self.run(seconds)
        conditions.wind_mps = 0.0

    def begin(self, mission: int, index: float = -1) -> None:
        """Order a mission and give the companion's mode; on the ground, take off before."""
        if self.truth.on_ground:
            self.take_off()
        self.operator.mission(mission, index)
        self.give_mode()

    def start_in_the_air(self, height_m: float = 3.0) -> None:
        """Instead of a take-off: the companion starts beside an aircraft that hovers.

        Parameters are set there: the take-off is flown once, whatever they are.
        """
        options = self.autopilot.options
        aircraft = in_the_air(replace(options, parameters={}), self._secret, height_m)
        self.now_s, self.autopilot = aircraft.now_s, aircraft.autopilot
        self.operator = aircraft.operator
        for name, value in options.parameters.items():
            self.autopilot.set_parameter(name, value)
        self.run(HEARD_S)

    def give_mode(self) -> None:
        """The operator gives the companion's mode: PX4 accepts it once a setpoint is streamed."""
        if not self.operator.in_mode("ours"):
            self.run_until_state("ready", 5.0)
            self.run(1.5)
            self.operator.mode("ours")
        self.run_until_state("flying", 3.0)


@flown_once
def hovering(**options) -> Lockstep:
    """In the air and hovering, ready for an order."""
    flight = Lockstep(**options)
    flight.start_in_the_air()
    return flight
