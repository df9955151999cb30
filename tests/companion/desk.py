"""A companion on the desk: an autopilot of a few scripted messages, and an operator on its link.

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

from moar_companion.autopilots import kind_of, profile
from moar_companion.companion.companion import Companion
from moar_companion.config import Authority, CompanionConfig, Supervision, shipped_configs
from moar_companion.estimation.pose_tracker import SiteMaps
from moar_companion.link_config import LinkConfig
from moar_companion.mavlink.dialect import create
from moar_companion.planner.planner import Planner
from moar_companion.planning.map_jobs import MapAnswer, answer_map_job
from moar_companion.planning.plan_jobs import PlanAnswer, answer_job
from moar_companion.planning.planner_set import PlannerSet
from moar_companion.site import Site
from sitl.wire import packets
from tests.vehicles import named_vehicle

from ..copies import copy_of
from ..mavlink.peer import Peer
from ..packets import Packet

LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
MAP_DELAY_S = 0.02
USER_1 = 31010
PAUSE_CONTINUE = 193
DO_SET_MODE = 176
HOLD, EXIT, INSPECTION, EVACUATION, RELEASE = 0, 2, 1, 3, 4
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
POSCTL, OFFBOARD, AUTO_HOLD, AUTO_RTL = 0x00030000, 0x00060000, 0x03040000, 0x05040000
GUIDED, LOITER, RTL, BRAKE = 4, 5, 6, 17
"""ArduCopter's."""
STANDBY, ACTIVE, CRITICAL = 3, 4, 5
ARMED, DISARMED = 209, 81
PARAMETERS = {
    "COM_OBL_RC_ACT": 5.0,
    "FENCE_ACTION": 1.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_ALT_MIN": -10.0,
    "FENCE_AUTOENABLE": 0.0,
    "FENCE_ENABLE": 0.0,
    "FENCE_MARGIN": 2.0,
    "FENCE_OPTIONS": 0.0,
    "FENCE_RADIUS": 300.0,
    "FENCE_TYPE": 7.0,
    "GF_ACTION": 2.0,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_SOURCE": 0.0,
    "GUID_TIMEOUT": 0.5,
    "MPC_ACC_HOR": 3.0,
    "MPC_XY_P": 0.95,
    "MPC_Z_P": 1.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_RCL_ACT": 2.0,
    "PSC_JERK_XY": 5.0,
    "PSC_JERK_Z": 5.0,
    "RTL_CONE_ANG": 45.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_ACCEL_Z": 100.0,
}
"""Parameters of the autopilot: as the manual asks for, else as by default."""


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


class Desk:
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
        self.autopilot, self.operator = Peer(1, 1), Peer(255, 190)
        origin = self.site.frame.to_geodetic((self.site.start_m[0], 0.0, 0.0))
        self.origin = (origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m)
        self.position_ned_m = (0.0, east_m, -height_m)
        self.kind, self.vehicle_type = autopilot, mavlink.MAV_TYPE_QUADROTOR
        px4 = autopilot == mavlink.MAV_AUTOPILOT_PX4
        self.ours = OFFBOARD if px4 else GUIDED
        self.mode, self.system_status = AUTO_HOLD if px4 else LOITER, ACTIVE
        self.velocity_ned_mps = (0.0, 0.0, 0.0)
        """As the autopilot reports it."""
        self.yaw_rad, self.yaw_rate_radps = 0.3, 0.0
        """Progress likewise: the nose does not follow the setpoints."""
        self.armed, self.landed_state = True, 2
        self.estimate_off_ned_m = (0.0, 0.0, 0.0)
        """Distance of the estimator's frame from the one in which `position_ned_m` is."""
        self.behind_ned_m = (0.0, 0.0, 0.0)
        """Offset of the aircraft from its setpoint."""
        self.boot_s = 100.0
        self.reset_counter = None
        """Reset counter of ODOMETRY; None where the autopilot sends none."""
        self.position_boot_s = None
        """Frozen clock of LOCAL_POSITION_NED; None while the clock runs."""
        self.parameters = {**profile(kind_of(autopilot)).failsafe_defaults, **PARAMETERS}
        self.fence_items = fence_items
        """Number of fence items that the autopilot reports; it sends none."""
        self.battery_percent, self.charge_state = 90, 1
        self.fix_type, self.receiver_accuracy_m = 3, 0.9
        self.accuracy_m, self.wind_mps = None, wind_mps
        """Accuracy of the estimator, and wind; None where the autopilot does not report them."""
        self.height_accuracy_m = 0.3
        """Height accuracy of the estimator, reported with the other."""
        self.late_s = 0.0
        """Transmission delay of the autopilot's packets."""
        self.mute = set()
        """Types of messages that the autopilot does not send."""
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
        self._count = 0

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
            case "COMMAND_LONG" if (
                message.command == DO_SET_MODE and "COMMAND_ACK" not in self.mute
            ):
                ack = mavlink.MAVLink_command_ack_message(DO_SET_MODE, ACCEPTED, 0, 0, 1, 195)
                self._in_the_air.append((self.now_s, self.autopilot.pack(ack)))

    def _autopilot_messages(self):
        boot_ms = round(self.boot_s * 1000)
        said = []
        if self._count % 50 == 0:
            said.append(self._heartbeat())
            latitude, longitude, altitude = self.origin
            said.append(
                mavlink.MAVLink_gps_global_origin_message(
                    round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3)
                )
            )
            said += self._status_messages()
        if self._count % 10 == 0:
            said.append(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
        if self._count % 2 == 0:
            said.append(
                mavlink.MAVLink_attitude_message(
                    boot_ms, 0, 0, self.yaw_rad, 0, 0, self.yaw_rate_radps
                )
            )
            position_boot_s = self.boot_s if self.position_boot_s is None else self.position_boot_s
            estimate = map(sum, zip(self.position_ned_m, self.estimate_off_ned_m, strict=True))
            said.append(
                mavlink.MAVLink_local_position_ned_message(
                    round(position_boot_s * 1000), *estimate, *self.velocity_ned_mps
                )
            )
            if self.reset_counter is not None:
                said.append(self._odometry())
        return [
            self.autopilot.pack(message) for message in said if message.get_type() not in self.mute
        ]

    def _heartbeat(self):
        return mavlink.MAVLink_heartbeat_message(
            self.vehicle_type,
            self.kind,
            ARMED if self.armed else DISARMED,
            self.mode,
            self.system_status,
            3,
        )

    def _odometry(self):
        """ODOMETRY as PX4 fills it, without the pose, which the tests do not read."""
        unknown = [math.nan] * 21
        return mavlink.MAVLink_odometry_message(
            round(self.boot_s * 1e6),
            *(1, 1),
            *(0.0, 0.0, 0.0),
            [1.0, 0.0, 0.0, 0.0],
            *(0.0,) * 6,
            unknown,
            unknown,
            self.reset_counter,
            8,
        )

    def _status_messages(self):
        """Messages of receiver, estimator, battery and ground station, with the test's values."""
        said = [
            mavlink.MAVLink_gps_raw_int_message(
                round(self.boot_s * 1e6),
                self.fix_type,
                0,
                0,
                0,
                90,
                150,
                0,
                0,
                12,
                0,
                round(self.receiver_accuracy_m * 1000),
                1500,
            ),
            mavlink.MAVLink_battery_status_message(
                0,
                0,
                0,
                0,
                [16000, *[65535] * 9],
                -1,
                -1,
                -1,
                self.battery_percent,
                charge_state=self.charge_state,
            ),
        ]
        if self.accuracy_m is not None:
            zeros = (0.1,) * 6
            said.append(
                mavlink.MAVLink_estimator_status_message(
                    round(self.boot_s * 1e6),
                    0x37F,
                    *zeros,
                    self.accuracy_m,
                    self.height_accuracy_m,
                )
            )
        if self.wind_mps is not None:
            zeros = (0.0,) * 5
            said.append(
                mavlink.MAVLink_wind_cov_message(
                    round(self.boot_s * 1e6), self.wind_mps, 0.0, 0.0, *zeros
                )
            )
        return said

    # Actions

    def handle(self, data, link=LINK):
        self.received.append((self.now_s, link, data))
        self.companion.receive(link, data, self.now_s)
        return self

    def set(self, **changes):
        """Changes the autopilot's reports from now on."""
        for name, value in changes.items():
            assert hasattr(self, name), name
            setattr(self, name, value)
        return self

    def run_until_sought(self, mission, seconds=10.0):
        """Runs until the planner receives a request for a mission."""
        for _ in range(round(seconds / STEP_S)):
            if self.jobs[-1].request.mission.value == mission:
                return self
            self.step()
        raise AssertionError(f"{mission} is not sought")

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

    def report_parameter(self, name):
        """PARAM_VALUE: the answer to a request, or the report of a change."""
        if name in self.parameters:
            real = mavlink.MAV_PARAM_TYPE_REAL32
            told = mavlink.MAVLink_param_value_message(
                name.encode(), self.parameters[name], real, 900, 0
            )
            self.handle(self.autopilot.pack(told))

    def set_parameters(self, **values):
        """Sets parameters; the autopilot reports the change."""
        self.parameters.update(values)
        for name in values:
            self.report_parameter(name)
        return self

    def report_home(self, x_m):
        """Moves the autopilot's home below this place of the plane."""
        home = self.site.frame.to_geodetic((x_m, 0.0, 0.0))
        told = create(
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
        return self.handle(self.autopilot.pack(told))

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
        told = {name: value for name, value in vars(self).items() if name not in _MACHINES}
        alike = (self.planner, repr((state, mission, then_s, told)))
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
