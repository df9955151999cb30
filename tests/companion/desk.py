"""A companion on the desk: a scripted autopilot, and an operator on its link.

The aircraft is wherever its setpoint is while the mode is OFFBOARD (or ArduPilot's GUIDED), and
stands still otherwise.
All messages are raw pymavlink.
"""

from __future__ import annotations

import copy
import functools
import math
from collections import deque
from dataclasses import replace

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.companion import Companion
from moar_companion.companion.planning.map_jobs import MapAnswer, answer_map_job
from moar_companion.companion.planning.plan_jobs import PlanAnswer, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.mavlink.autopilots import kind_of, profile
from moar_companion.mavlink.dialect import create
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import (
    Authority,
    CompanionConfig,
    Inspection,
    Supervision,
    VisitOrder,
    shipped_configs,
)
from moar_companion.settings.link_config import LinkConfig
from sitl.wire import packets
from tests.vehicles import named_vehicle

from ..copies import copy_of
from ..mavlink.peer import Peer
from ..packets import Packet
from .scripted_autopilot import ACTIVE, ScriptedAutopilot

LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
MAP_DELAY_S = 0.02
USER_1 = 31010
PAUSE_CONTINUE = 193
DO_SET_MODE = 176
_VERSION_REQUEST = (512, 148)
"""MAV_CMD_REQUEST_MESSAGE of AUTOPILOT_VERSION."""
HOLD, EXIT, INSPECTION, EVACUATION, RELEASE = 0, 2, 1, 3, 4
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
KEEP_OUT_M = 0.9
"""All of it is for the position's error."""


@functools.cache
def usual_planner():
    """Planner of a narrow site: targets 2 m beside their conductors, total margin 0.9 m.

    The tracking error does not widen obstacles.
    """
    configs = shipped_configs()
    site = Site.load(configs / "sites" / "315kv_double_circuit.yaml")
    obstacles = tuple(replace(item, keep_out_m=KEEP_OUT_M) for item in site.obstacles)
    targets = tuple(
        replace(target, position_m=(target.position_m[0] - 2.0, target.position_m[1]))
        for target in site.targets
    )
    vehicle = named_vehicle("linedrone_uniform")
    guidance = replace(vehicle.guidance, tracking_margin_m=vehicle.guidance.tracking_hold_m)
    return Planner(
        replace(site, obstacles=obstacles, targets=targets), replace(vehicle, guidance=guidance)
    )


_MACHINES = {
    "companion",
    "autopilot",
    "operator",
    "planner",
    "planners",
    "site",
    "vehicle",
}
"""Parts of a desk before its start: equal for desks whose other attributes are equal."""
_came = {}


class Desk(ScriptedAutopilot):
    """The companion and the source of all data that it receives."""

    def __init__(
        self,
        *,
        autopilot=mavlink.MAV_AUTOPILOT_PX4,
        height_m=2.6,
        east_m=0.0,
        planner=None,
        with_site=True,
        plan_delay_s=0.04,
        before=None,
        wind_mps=None,
        fence_items=0,
        **config,
    ):
        self.planner = planner or usual_planner()
        self.planners = PlannerSet(self.planner)
        self.site, self.vehicle = self.planner.site, self.planner.vehicle
        config.setdefault("authority", Authority.STREAM)
        # Stories name their targets in the order of the visits.
        config.setdefault("inspection", Inspection(order=VisitOrder.FILE))
        limits = config.pop("supervision", Supervision())
        if limits.position_uncertainty_m is None:
            limits = replace(limits, position_uncertainty_m=KEEP_OUT_M)
        config["supervision"] = limits
        links = config.pop("links", (LinkConfig(url=LINK),))
        config = CompanionConfig(vehicle=shipped_configs(), links=links, **config)
        self._options = (config, with_site, before)
        self.companion = Companion(
            config,
            self.vehicle,
            SiteMaps(site=self.site, maps=self.planner.maps) if with_site else None,
            before=before,
        )
        self.operator = Peer(255, 190)
        origin = self.site.frame.to_geodetic((self.site.start_m[0], 0.0, 0.0))
        super().__init__(
            autopilot,
            origin=(origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m),
            position_ned_m=(0.0, east_m, -height_m),
            wind_mps=wind_mps,
            fence_items=fence_items,
        )
        self.now_s = 50.0
        self.received = []
        """(time, link, bytes) of all data that the companion received."""
        self.answered = []
        """(job, answer) of the planner."""
        self.plan_delay_s = plan_delay_s
        """None: the planner never answers."""
        self.jobs, self.contingency_jobs, self.map_jobs = [], [], []
        self.map_delay_s = MAP_DELAY_S
        self.maps_made = True
        """False: the planner fails to make maps."""
        self.contingencies = False
        """True if the planner answers the jobs of contingencies, too."""
        self.sent = []
        """(time, link, message) of every message that the companion sent."""
        self.decisions = []
        self._answers = deque()
        self._in_the_air = deque()

    def __deepcopy__(self, memo):
        """Independent copy; constants and past data are shared."""
        site_maps = (self.planner, self.planner.maps, self.planners, self.site, self.vehicle)
        memo |= {id(item): item for item in site_maps}
        twin = memo[id(self)] = copy.copy(self)
        for name, value in vars(self).items():
            past = isinstance(value, list)
            setattr(twin, name, list(value) if past else copy.deepcopy(value, memo))
        return twin

    @property
    def state(self):
        return self.companion.status.state.value

    # Time

    def step(self, seconds=STEP_S):
        self.now_s += seconds
        self.boot_s += seconds
        self._in_the_air += [(self.now_s, data) for data in self._autopilot_messages()]
        while self._in_the_air and self._in_the_air[0][0] <= self.now_s - self.late_s:
            self.handle(self._in_the_air.popleft()[1])
        while self._answers and self._answers[0][0] <= self.now_s:
            self._give(*self._answers.popleft()[1:])
        self.companion.tick(self.now_s)
        for job in self.companion.plan_jobs():
            self.jobs.append(job)
            if self.plan_delay_s is not None:
                answer = answer_job(self.planners, job)
                self._answers.append((self.now_s + self.plan_delay_s, job, answer))
        for job in self.companion.map_jobs():
            self.map_jobs.append(job)
            answer = answer_map_job(self.planners, job) if self.maps_made else None
            answer = answer or MapAnswer(job_id=job.job_id, site_maps=None)
            self._answers.append((self.now_s + self.map_delay_s, job, answer))
        for job in self.companion.contingency_jobs():
            self.contingency_jobs.append(job)
            if self.contingencies:
                self.companion.contingency_answered(answer_job(self.planners, job))
        self.take_what_is_sent()
        self._count += 1
        return self

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.step()
        return self

    def run_until(self, state, seconds=5.0):
        for _ in range(round(seconds / STEP_S)):
            if self.state == state:
                return self
            self.step()
        raise AssertionError(f"not {state} within {seconds:g} s: {self.state}, {self.texts()}")

    def take_what_is_sent(self):
        self.decisions += self.companion.decisions()
        for link, data in self.companion.data_to_send():
            for packet in packets(data):
                message = Packet(packet)
                self.sent.append((self.now_s, link, message))
                self._take_sent(message)

    def _take_sent(self, message):
        """The autopilot's answer to a message, or its flight."""
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED" if self.mode == self.ours:
                self.position_ned_m = tuple(
                    wanted - off + behind
                    for wanted, off, behind in zip(
                        (message.x, message.y, message.z),
                        self.estimate_off_ned_m,
                        self.behind_ned_m,
                        strict=True,
                    )
                )
            case "PARAM_REQUEST_READ":
                self.report_parameter(message.param_id)
            case "MISSION_REQUEST_LIST":
                count = mavlink.MAVLink_mission_count_message(
                    1, 195, self.fence_items, message.mission_type
                )
                self.handle(self.autopilot.pack(count))
            case "TIMESYNC" if message.tc1 == 0 and "TIMESYNC" not in self.mute:
                answer = mavlink.MAVLink_timesync_message(round(self.boot_s * 1e9), message.ts1)
                self._in_the_air.append((self.now_s, self.autopilot.pack(answer)))
            case "COMMAND_LONG" if (message.command, message.param1) == _VERSION_REQUEST:
                self.report_version()
            case "COMMAND_LONG" if (
                message.command == DO_SET_MODE and "COMMAND_ACK" not in self.mute
            ):
                ack = mavlink.MAVLink_command_ack_message(DO_SET_MODE, ACCEPTED, 0, 0, 1, 195)
                self._in_the_air.append((self.now_s, self.autopilot.pack(ack)))

    # Actions

    def handle(self, data, link=LINK):
        self.received.append((self.now_s, link, data))
        self.companion.receive(link, data, self.now_s)
        return self

    def run_until_requested(self, mission, seconds=10.0):
        """Runs until the planner receives a request for a mission."""
        for _ in range(round(seconds / STEP_S)):
            if self.jobs[-1].request.mission.value == mission:
                return self
            self.step()
        raise AssertionError(f"{mission} is not requested")

    def pause(self):
        return self.order(0.0, command=PAUSE_CONTINUE)

    def go_on(self):
        return self.order(1.0, command=PAUSE_CONTINUE)

    def take_back(self):
        return self.handle(
            self.operator.pack(
                create("COMMAND_CANCEL", command=USER_1, target_system=1, target_component=195)
            )
        )

    def order(self, mission, index=-1.0, *, command=USER_1, peer=None, target=(1, 195)):
        return self.handle((peer or self.operator).command(command, mission, index, target=target))

    def report_version(self):
        """AUTOPILOT_VERSION of the release whose names the parameters have."""
        release = profile(kind_of(self.kind)).assumed_release
        zeros = [0] * 8
        reported = mavlink.MAVLink_autopilot_version_message(
            0, int.from_bytes(bytes((*release, 255)), "big"), 0, 0, 0, zeros, zeros, zeros, 0, 0, 0
        )
        self.handle(self.autopilot.pack(reported))

    def report_parameter(self, name):
        """PARAM_VALUE: the answer to a request, or the report of a change."""
        if name in self.parameters:
            real = mavlink.MAV_PARAM_TYPE_REAL32
            reported = mavlink.MAVLink_param_value_message(
                name.encode(), self.parameters[name], real, 900, 0
            )
            self.handle(self.autopilot.pack(reported))

    def set_parameters(self, **values):
        """Sets parameters; the autopilot reports the change."""
        self.parameters.update(values)
        for name in values:
            self.report_parameter(name)
        return self

    def report_home(self, x_m):
        """Moves the autopilot's home below this place of the plane."""
        home = self.site.frame.to_geodetic((x_m, 0.0, 0.0))
        reported = create(
            "HOME_POSITION",
            latitude=round(home.latitude_deg * 1e7),
            longitude=round(home.longitude_deg * 1e7),
            altitude=round(home.altitude_amsl_m * 1e3),
            x=0.0,
            y=x_m - self.site.start_m[0],
            z=0.0,
            q=[1.0, 0.0, 0.0, 0.0],
            approach_x=0.0,
            approach_y=0.0,
            approach_z=0.0,
        )
        return self.handle(self.autopilot.pack(reported))

    def send_heartbeat(self, mode, status=ACTIVE):
        """Changes the autopilot's mode and sends a HEARTBEAT at once."""
        self.mode, self.system_status = mode, status
        return self.handle(self.autopilot.pack(self._heartbeat()))

    def drift(self, north_m, east_m, down_m, *, seconds=2.0):
        """Moves the aircraft away from its setpoint at constant speed."""
        steps = round(seconds / STEP_S)
        for _ in range(steps):
            self.position_ned_m = tuple(
                place + part / steps
                for place, part in zip(self.position_ned_m, (north_m, east_m, down_m), strict=True)
            )
            self.step()
        return self

    def fall_behind(self, *behind_ned_m, seconds=2.0):
        """Changes the offset of aircraft and setpoint at constant speed."""
        before, steps = self.behind_ned_m, round(seconds / STEP_S)
        for step in range(1, steps + 1):
            self.behind_ned_m = tuple(
                old + (new - old) * step / steps
                for old, new in zip(before, behind_ned_m, strict=True)
            )
            self.step()
        return self

    def jump(self, *off_ned_m):
        """Resets the estimator: from its next report on its frame has moved."""
        self.run_to_position().estimate_off_ned_m = off_ned_m
        return self

    def run_to_position(self):
        """Runs until the next step brings a position."""
        return self.step() if self._count % 2 else self

    def run_to_heartbeat(self):
        """Runs until a heartbeat has just been received: the next one comes in a second."""
        while self._count % 50 != 1:
            self.step()
        return self

    def answer_plan(self, number=-1, **changes):
        """Gives the planner's answer to a waiting job."""
        job = self.jobs[number]
        answer = (
            PlanAnswer(job_id=job.job_id, **changes) if changes else answer_job(self.planners, job)
        )
        self._give(job, answer)
        return self

    def _give(self, job, answer):
        if isinstance(answer, MapAnswer):
            self.companion.maps_answered(answer)
            return
        self.answered.append((job, answer))
        self.companion.plan_answered(answer)

    def come_to(self, state, mission=INSPECTION, *, then_s=0.0):
        """Flies from a hover to a state, then continues for `then_s`.

        Desks with equal options share one flight.
        """
        if self._count or self.received:
            return self._come_to(state, mission).run(then_s)
        reported = {name: value for name, value in vars(self).items() if name not in _MACHINES}
        alike = (self.planner, repr((state, mission, then_s, reported)))
        if alike not in _came:
            twin = copy_of(self)
            _came[alike] = (
                twin.come_to(state, mission).run(then_s)
                if then_s
                else twin._come_to(state, mission)
            )
        vars(self).update(vars(copy_of(_came[alike])))
        return self

    def _come_to(self, state, mission):
        self.run(1.2)
        if state == "idle":
            return self
        self.order(mission).run_until("ready")
        if state == "ready":
            return self
        self.run(1.1).send_heartbeat(self.ours).run_until("flying", 0.1)
        return self if state == "flying" else self.run_until(state, 120.0)

    # Sent packets

    def messages(self, kind, since_s=-math.inf):
        return [
            message
            for time_s, _, message in self.sent
            if message.get_type() == kind and time_s > since_s
        ]

    def setpoints(self, since_s=-math.inf):
        return self.messages("SET_POSITION_TARGET_LOCAL_NED", since_s)

    def answers(self, command=USER_1):
        return [
            message.result for message in self.messages("COMMAND_ACK") if message.command == command
        ]

    def mode_requests(self, since_s=-math.inf):
        return [m for m in self.messages("COMMAND_LONG", since_s) if m.command == DO_SET_MODE]

    def decided(self, kind):
        return [decision.data for decision in self.decisions if decision.kind == kind]

    def texts(self):
        texts = []
        for message in self.messages("STATUSTEXT"):
            assert message.id == 0, message.text  # a text has one chunk
            texts.append(message.text)
        return texts

    def reported_reasons(self):
        """Reasons of the texts, with the details that only the recording has."""
        return [data["reason"] for data in self.decided("text")]

    def said(self, words):
        return any(words in text for text in self.texts())
