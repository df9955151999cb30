"""A companion on the desk: an autopilot of a few scripted messages, and an operator on its link.

The aircraft is wherever its setpoint is while the mode is OFFBOARD, and stands still otherwise.
Everything speaks raw pymavlink.
"""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.config import Authority, CompanionConfig, LinkConfig, shipped_configs
from moar_companion.mavlink.dialect import create
from moar_companion.planner.planner import Planner
from moar_companion.service.companion import Companion
from moar_companion.service.jobs import PlanAnswer, answer_job
from moar_companion.service.surroundings import Ground
from moar_companion.site import Site
from moar_companion.vehicle import Vehicle

LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
USER_1 = 31010
PAUSE_CONTINUE = 193
DO_SET_MODE = 176
HOLD, EXIT, INSPECTION, EVACUATION, RELEASE = 0, 2, 1, 3, 4
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
POSCTL, OFFBOARD, AUTO_HOLD = 0x00030000, 0x00060000, 0x03040000
STANDBY, ACTIVE, CRITICAL = 3, 4, 5


class Peer:
    """Somebody on a link."""

    def __init__(self, system_id, component_id):
        self.codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def pack(self, message):
        data = bytes(message.pack(self.codec))
        self.codec.seq = (self.codec.seq + 1) % 256
        return data

    def heartbeat(self, mode, status, *, armed=True):
        return self.pack(
            mavlink.MAVLink_heartbeat_message(2, 12, 209 if armed else 81, mode, status, 3)
        )

    def command(self, command, *parameters, target=(1, 195), confirmation=0):
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        return self.pack(
            mavlink.MAVLink_command_long_message(*target, command, confirmation, *padded)
        )


class Desk:
    """The companion and all that it hears."""

    def __init__(self, *, height_m=2.6, east_m=0.0, with_site=True, plan_delay_s=0.04, **config):
        self.site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
        self.vehicle = Vehicle.load(shipped_configs() / "vehicles" / "linedrone_flight.yaml")
        self.planner = Planner(self.site, self.vehicle)
        config.setdefault("authority", Authority.STREAM)
        links = config.pop("links", (LinkConfig(url=LINK),))
        self.companion = Companion(
            CompanionConfig(vehicle=shipped_configs(), links=links, **config),
            self.vehicle,
            Ground(site=self.site, maps=self.planner.maps) if with_site else None,
        )
        self.autopilot, self.operator = Peer(1, 1), Peer(255, 190)
        origin = self.site.frame.to_geodetic((self.site.start_m[0], 0.0, 0.0))
        self.origin = (origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m)
        self.position_ned_m = (0.0, east_m, -height_m)
        self.mode, self.system_status = AUTO_HOLD, ACTIVE
        self.armed, self.landed_state = True, 2
        self.estimate_off_ned_m = (0.0, 0.0, 0.0)
        """How far the estimator's frame lies from the one in which `position_ned_m` is."""
        self.behind_ned_m = (0.0, 0.0, 0.0)
        """Where the aircraft is from its setpoint."""
        self.boot_s = 100.0
        self.position_boot_s = None
        """The clock in LOCAL_POSITION_NED when it stands still."""
        self.mute = set()
        """Types of messages that the autopilot does not send."""
        self.now_s = 50.0
        self.plan_delay_s = plan_delay_s
        """None: the planner never answers."""
        self.jobs = []
        self.sent = []
        """(time, link, message) of everything the companion sent."""
        self.decisions = []
        self.raw = b""
        self._codec = mavlink.MAVLink(None)
        self._answers = deque()
        self._count = 0

    @property
    def state(self):
        return self.companion.status.state.value

    # Time

    def step(self, seconds=STEP_S):
        self.now_s += seconds
        self.boot_s += seconds
        for data in self._autopilot_says():
            self.companion.receive(LINK, data, self.now_s)
        while self._answers and self._answers[0][0] <= self.now_s:
            self.companion.plan_answered(self._answers.popleft()[1], self.now_s)
        self.companion.tick(self.now_s)
        for job in self.companion.plan_jobs():
            self.jobs.append(job)
            if self.plan_delay_s is not None:
                answer = answer_job(self.planner, job)
                self._answers.append((self.now_s + self.plan_delay_s, answer))
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
            self.raw += data
            for message in self._codec.parse_buffer(data) or []:
                self.sent.append((self.now_s, link, message))
                if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and self.mode == OFFBOARD:
                    self.position_ned_m = tuple(
                        setpoint - off + behind
                        for setpoint, off, behind in zip(
                            (message.x, message.y, message.z),
                            self.estimate_off_ned_m,
                            self.behind_ned_m,
                            strict=True,
                        )
                    )

    def _autopilot_says(self):
        boot_ms = round(self.boot_s * 1000)
        said = []
        if self._count % 50 == 0:
            said.append(
                mavlink.MAVLink_heartbeat_message(
                    2, 12, 209 if self.armed else 81, self.mode, self.system_status, 3
                )
            )
            latitude, longitude, altitude = self.origin
            said.append(
                mavlink.MAVLink_gps_global_origin_message(
                    round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3)
                )
            )
        if self._count % 10 == 0:
            said.append(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
        if self._count % 2 == 0:
            said.append(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0.3, 0, 0, 0))
            position_boot_s = self.boot_s if self.position_boot_s is None else self.position_boot_s
            estimate = map(sum, zip(self.position_ned_m, self.estimate_off_ned_m, strict=True))
            said.append(
                mavlink.MAVLink_local_position_ned_message(
                    round(position_boot_s * 1000), *estimate, 0, 0, 0
                )
            )
        return [
            self.autopilot.pack(message) for message in said if message.get_type() not in self.mute
        ]

    # What is done

    def hear(self, data, link=LINK):
        self.companion.receive(link, data, self.now_s)
        return self

    def pause(self):
        return self.order(0.0, command=PAUSE_CONTINUE)

    def go_on(self):
        return self.order(1.0, command=PAUSE_CONTINUE)

    def take_back(self):
        return self.hear(
            self.operator.pack(
                create("COMMAND_CANCEL", command=USER_1, target_system=1, target_component=195)
            )
        )

    def order(self, mission, index=-1.0, *, command=USER_1, peer=None, target=(1, 195)):
        return self.hear((peer or self.operator).command(command, mission, index, target=target))

    def say_heartbeat(self, mode, status=ACTIVE):
        """The autopilot's mode, told at once."""
        self.mode, self.system_status = mode, status
        return self.hear(self.autopilot.heartbeat(mode, status, armed=self.armed))

    def drift(self, north_m, east_m, down_m, *, seconds=2.0):
        """The aircraft moves away without its setpoint, evenly."""
        steps = round(seconds / STEP_S)
        for _ in range(steps):
            self.position_ned_m = tuple(
                place + part / steps
                for place, part in zip(self.position_ned_m, (north_m, east_m, down_m), strict=True)
            )
            self.step()
        return self

    def fall_behind(self, *behind_ned_m, seconds=2.0):
        """The aircraft comes to follow its setpoint at another place, evenly."""
        before, steps = self.behind_ned_m, round(seconds / STEP_S)
        for step in range(1, steps + 1):
            self.behind_ned_m = tuple(
                old + (new - old) * step / steps
                for old, new in zip(before, behind_ned_m, strict=True)
            )
            self.step()
        return self

    def jump(self, *off_ned_m):
        """The estimator is reset: from its next word on its frame lies elsewhere."""
        self.run_to_position().estimate_off_ned_m = off_ned_m
        return self

    def run_to_position(self):
        """Until the next step brings a position."""
        return self.step() if self._count % 2 else self

    def run_to_heartbeat(self):
        """Until the autopilot's heartbeat has just been heard: the next one comes in a second."""
        while self._count % 50 != 1:
            self.step()
        return self

    def answer_plan(self, number=-1, **changes):
        """The planner's answer to a job that waits."""
        job = self.jobs[number]
        answer = (
            PlanAnswer(job_id=job.job_id, **changes) if changes else answer_job(self.planner, job)
        )
        self.companion.plan_answered(answer, self.now_s)
        return self

    def come_to(self, state, mission=INSPECTION):
        """From hovering to a state, by the usual way."""
        self.run(1.2)
        if state == "idle":
            return self
        self.order(mission).run_until("ready")
        if state == "ready":
            return self
        self.run(1.1).say_heartbeat(OFFBOARD).run_until("flying", 0.1)
        return self if state == "flying" else self.run_until(state, 120.0)

    # What was sent

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
            if message.id and message.chunk_seq:
                texts[-1] += message.text
            else:
                texts.append(message.text)
        return texts

    def said(self, words):
        return any(words in text for text in self.texts())
