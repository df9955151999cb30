"""Permitted packets of the companion, computed independently from its received packets.

Inputs: packets on its links, the planner's answers, the site and vehicle files; no data of the
companion itself. Distances are Shapely's; the map between the frames is the simulator's.
"""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import all as mavlink
from shapely.geometry import LineString, Point

from moar_companion.companion.error_margin import margin_of
from moar_companion.settings.config import Authority, Supervision

from ..flights.judging import cells_within, clearances_m, is_free, local_place
from ..flights.operator import Manner
from .desk import (
    ACCEPTED,
    CANCELLED,
    DO_SET_MODE,
    EVACUATION,
    EXIT,
    INSPECTION,
    KEEP_OUT_M,
    PAUSE_CONTINUE,
    USER_1,
)
from .scripted_autopilot import BRAKE, CRITICAL, GUIDED, OFFBOARD, RTL

LIMITS = Supervision(position_uncertainty_m=KEEP_OUT_M)
_ATTITUDE_S = 1.0
_SECOND_S = 1.0
"""Least time for which a second autopilot counts after its last heartbeat."""
_CLOCK_BACK_MS = 2000
_FORGIVEN_M = 2e-3
"""Rounding of conversions between the frames."""
_ROUNDING_MPS = 0.06
_HARDER = 4.0
"""A setpoint that moves changes its speed no harder than this times the planned acceleration."""
_JUMP_M = 0.1
"""A greater step between two positions is a jump, which moves the setpoint."""
_JUMP_S = 0.4
_RESTART_S = 0.36
"""Time in which packets of a restarted autopilot may be late ones of before."""
_BESIDE_M = 1.0
"""An escape leg may begin as far beside the plane."""
_REPEAT_S = 2.0
"""A command repeated by its sender within this time is the same order, ..."""
_CONFIRMED_REPEAT_S = 30.0
"""... with a confirmation above 0 within this time."""


_COPTER_LAND = 9
_FAILSAFE_MODES = {RTL, _COPTER_LAND, BRAKE}
"""ArduPilot's own."""

_WITH_LAST_SETPOINT = {
    "an old heartbeat",
    "an old position",
    "an old attitude",
    "a second autopilot",
}
"""States in which the autopilot still follows the companion."""


class Judge:
    """Checks a desk after every step; fails on a forbidden packet."""

    def __init__(self, desk, authority):
        self.desk = desk
        px4 = desk.kind == mavlink.MAV_AUTOPILOT_PX4
        self.manner = Manner.PX4 if px4 else Manner.ARDUPILOT
        self.our_mode = OFFBOARD if px4 else GUIDED
        self.authority = authority
        self.codec = mavlink.MAVLink(None)
        self.codec.robust_parsing = True
        self.seen = {"received": 0, "answered": 0, "sent": 0}
        self.looked_s = desk.now_s
        # Autopilot
        self.heartbeat = self.origin = self.position = None
        self.heartbeat_s = self.position_s = self.attitude_s = self.foreign_s = -math.inf
        self.landed_state = 0
        self.restarted_s = -math.inf
        self.accuracy_m = {}
        self.jumps = deque()
        self.jumped_m = (0.0, 0.0, 0.0)
        """Sum of all jumps since the last setpoint that moved."""
        # Orders
        self.given_s = {}
        self.awaiting = set()
        """Numbers of commands that were ordered again and have no answer yet."""
        self.mode_requests_left = 0
        self.failsafe_known = False
        # Stream
        self.may_stream = False
        """An order was accepted since the stream ended."""
        self.controlled = self.pilots = False
        self.legs, self.escapes, self.left_legs = [], [], []
        self.last = None
        self.free = {}

    def look(self):
        """Checks all packets since the last call, in their order."""
        now_s = self.desk.now_s
        if now_s == self.looked_s:
            return
        for time_s, _, data in self._fresh("received"):
            for message in self.codec.parse_buffer(data) or []:
                self._handle(message, time_s)
        for job, answer in self._fresh("answered"):
            self._note_legs(job, answer)
        ended = self._ended(now_s)
        if ended is not None:
            self._forbid()
        streamed = False
        for time_s, _, message in self._fresh("sent"):
            kind = message.get_type()
            if kind == "COMMAND_ACK":
                self._note_answer(message)
            elif kind == "SET_POSITION_TARGET_LOCAL_NED" and ended is not None:
                self._judge_last_setpoint(message, ended)
            elif kind == "SET_POSITION_TARGET_LOCAL_NED":
                self._judge(message, time_s)
                streamed = True
            elif kind == "COMMAND_LONG" and message.command == DO_SET_MODE:
                self._judge_mode_request(message)
        if not streamed:
            self.may_stream = False if not self.awaiting else self.may_stream
            self.last, self.jumped_m = None, (0.0, 0.0, 0.0)
            if not (self.awaiting or self.may_stream):
                self.left_legs = self.legs or self.left_legs
                self.legs, self.escapes = [], []
        self.pilots |= self.controlled and self._mode() != self.our_mode
        self.controlled = streamed and self._mode() == self.our_mode
        if self.controlled or self.landed_state == 1:
            self.pilots = False
        self.looked_s = now_s

    def _fresh(self, name):
        items = getattr(self.desk, name)
        fresh = items[self.seen[name] :]
        self.seen[name] = len(items)
        return fresh

    # Received packets

    def _handle(self, message, now_s):
        source = (message.get_srcSystem(), message.get_srcComponent())
        kind = message.get_type()
        if kind in {"COMMAND_LONG", "COMMAND_INT"}:
            self._handle_order(message, source, now_s)
        elif source != (1, 1):
            if kind == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                self.foreign_s = now_s
        elif kind == "HEARTBEAT":
            before = self._failsafe()
            self.heartbeat, self.heartbeat_s = message, now_s
            if self._failsafe() and not before:
                self.failsafe_known = False
                self._forbid()
        elif kind == "GPS_GLOBAL_ORIGIN":
            self.origin = (
                message.latitude * 1e-7,
                message.longitude * 1e-7,
                message.altitude * 1e-3,
            )
        elif kind == "EXTENDED_SYS_STATE":
            self.landed_state = message.landed_state
        elif kind == "ESTIMATOR_STATUS":
            self.accuracy_m["estimator"] = message.pos_horiz_accuracy
            self.accuracy_m["height"] = message.pos_vert_accuracy
        elif kind == "GPS_RAW_INT":
            self.accuracy_m["receiver"] = message.h_acc * 1e-3
        elif kind == "ATTITUDE":
            self.attitude_s = now_s
        elif kind == "LOCAL_POSITION_NED":
            self._handle_position(message, now_s)

    def _handle_position(self, message, now_s):
        place = (message.x, message.y, message.z)
        if not all(map(math.isfinite, (*place, message.vx, message.vy, message.vz))):
            return
        if self.position is not None and message.time_boot_ms == self.position[0]:
            return
        if self.position is not None:
            if message.time_boot_ms < self.position[0] - _CLOCK_BACK_MS:
                self.restarted_s = now_s
            moved_m = math.dist(place, self.position[1])
            if moved_m > _JUMP_M:
                self.jumps.append((now_s, moved_m))
                steps_m = (b - a for a, b in zip(self.position[1], place, strict=True))
                self.jumped_m = tuple(map(sum, zip(self.jumped_m, steps_m, strict=True)))
        self.position, self.position_s = (message.time_boot_ms, place), now_s

    def _handle_order(self, message, source, now_s):
        words = (source, message.command, message.param1, message.param2)
        moves = (
            message.command == USER_1 and message.param1 in {INSPECTION, EXIT, EVACUATION}
        ) or (message.command == PAUSE_CONTINUE and message.param1 == 1.0)
        confirmed = getattr(message, "confirmation", 0) > 0
        within_s = _CONFIRMED_REPEAT_S if confirmed else _REPEAT_S
        if moves and now_s - self.given_s.get(words, -math.inf) > within_s:
            self.given_s[words] = now_s
            self.awaiting.add(message.command)

    def _note_answer(self, message):
        if message.command in self.awaiting and message.result == ACCEPTED:
            self.may_stream = True
            self.mode_requests_left = 1
            self.failsafe_known |= self._failsafe()
        # A cancelled order may have been replaced by another one.
        if message.result not in {mavlink.MAV_RESULT_IN_PROGRESS, CANCELLED}:
            self.awaiting.discard(message.command)

    def _forbid(self):
        """Forbids setpoints until a new order."""
        self.may_stream = False
        self.awaiting.clear()
        self.mode_requests_left = 0

    @property
    def streaming(self):
        """True if the last cycle sent a setpoint."""
        return self.last is not None

    def _note_legs(self, job, answer):
        """Notes the checked legs of a plan: the escape leg and the landing leg."""
        if answer.plan is None:
            return
        points = [tuple(point) for point in answer.plan.waypoints.position_m.tolist()]
        if answer.escape_m:
            self.escapes.append(LineString([job.request.start_m, *answer.escape_m]))
        leg = answer.plan.landing_leg
        if leg is not None:
            self.legs.append(LineString(points[-1 - len(leg.points_m) :]))

    def _note_resumed_leg(self, place):
        """Notes a landing leg that was left, and the free straight line to it from a place."""
        x_m, _, z_m = place
        site, here = self.desk.site, Point(x_m, z_m)
        for leg in self.left_legs:
            line = LineString([here, leg.interpolate(leg.project(here))])
            points = [(x, 0.0, z) for x, z in line.segmentize(0.1).coords]
            room_m = clearances_m(site, points, keep_out=True).min() + site.margin.total_m
            if (
                site.workspace.outside_m((x_m, z_m)) > 0.0
                and line.length <= self.desk.vehicle.guidance.tracking_hold_m
                and room_m >= self.desk.vehicle.radius_m
            ):
                self.legs.append(leg)
                self.escapes.append(line)

    # End of control

    def _mode(self):
        return None if self.heartbeat is None else self.heartbeat.custom_mode

    def _failsafe(self):
        """True if a failsafe changed the mode; ArduPilot also reports failsafes that did not."""
        if self.heartbeat is None or self.heartbeat.system_status < CRITICAL:
            return False
        px4 = self.manner is Manner.PX4
        return self._mode() != self.our_mode and (px4 or self._mode() in _FAILSAFE_MODES)

    def _ended(self, now_s):
        """Reason why no setpoint is permitted now; None if an ordered stream is permitted."""
        if self.heartbeat is None or self.position is None:
            return "an autopilot that is not known"
        reasons = {
            "the pilot has taken over": self.controlled and self._mode() != self.our_mode,
            "disarmed": not self.heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED,
            "on the ground": self.landed_state == 1,
            "an old heartbeat": now_s - self.heartbeat_s > LIMITS.mode_timeout_s,
            "an old position": now_s - self.position_s > LIMITS.position_timeout_s,
            "an old attitude": now_s - self.attitude_s > _ATTITUDE_S,
            "a second autopilot": now_s - self.foreign_s < _SECOND_S,
            "a restart": self.looked_s < self.restarted_s + _RESTART_S <= now_s,
            "a pause": now_s - self.looked_s > LIMITS.position_timeout_s,
        }
        return next((reason for reason, holds in reasons.items() if holds), None)

    # Sent packets of control

    def _judge_mode_request(self, message):
        assert self.authority is Authority.ENGAGE
        assert not self._failsafe()
        own = message.param2 == (6 if self.manner is Manner.PX4 else GUIDED)
        if own:
            assert not self.pilots, "the mode of a pilot who has taken over"
            assert self.mode_requests_left, "a mode that nobody has ordered"
            self.mode_requests_left -= 1

    def _judge_last_setpoint(self, message, ended):
        """Checks the last setpoint: at the previous one, at rest; none if control was taken."""
        assert ended in _WITH_LAST_SETPOINT, ended
        assert self.last is not None, ended
        assert (message.vx, message.vy, message.vz) == (0.0, 0.0, 0.0), ended
        assert math.dist((message.x, message.y, message.z), self.last[1]) <= _FORGIVEN_M, ended
        self.last = None

    def _judge(self, message, now_s):
        """Checks a setpoint: form, place and motion."""
        place, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
        assert all(map(math.isfinite, (*place, *velocity, message.yaw)))
        assert (message.type_mask, message.coordinate_frame) == (0x9C0, 1)
        assert (message.target_system, message.target_component) == (1, 1)
        assert self.may_stream, "a setpoint that nobody has ordered"
        assert self.failsafe_known or not self._failsafe(), "a setpoint in a failsafe"
        if any(velocity):
            self.jumped_m = (0.0, 0.0, 0.0)
        begins = self.last is None
        self._judge_motion(place, velocity, now_s)
        here = local_place(self.desk.site, self.manner, self.origin, message)
        if begins:
            self._note_resumed_leg(here)
        objection = self._objection(here, velocity)
        if objection is None or (not any(velocity) and self._jumped_to(here)):
            return
        assert self.jumps, objection
        assert not any(velocity), objection
        self._forbid()  # the last setpoint, at rest after a jump

    def _judge_motion(self, place, velocity, now_s):
        speed = self.desk.vehicle.speed
        greatest_mps = speed.max_mps + speed.min_mps + _ROUNDING_MPS
        assert math.hypot(*velocity) <= greatest_mps
        while self.jumps and now_s - self.jumps[0][0] > _JUMP_S:
            self.jumps.popleft()
        if self.last is not None:
            before_s, before, before_mps = self.last
            carried_m = sum(moved_m for _, moved_m in self.jumps)
            moved_m = math.dist(place, before) - carried_m
            assert moved_m <= greatest_mps * (now_s - before_s) + _FORGIVEN_M, "it jumps"
            hard_mps2 = _HARDER * self.desk.vehicle.guidance.acceleration_mps2
            changed_mps = hard_mps2 * (now_s - before_s) + speed.min_mps + _ROUNDING_MPS
            # A setpoint that stays at its place may stop at once.
            assert not any(velocity) or math.dist(velocity, before_mps) <= changed_mps, "too hard"
        self.last = (now_s, place, velocity)

    def _objection(self, place, velocity):
        """Reason why a place is forbidden; None if it is permitted."""
        x_m, y_m, z_m = place
        space = self.desk.site.workspace
        if abs(y_m) > LIMITS.plane_tolerance_m + _FORGIVEN_M:
            return "off the plane"
        widened_m = self._widened_m() if any(velocity) else 0.0
        low_m = -math.inf if space.min_altitude_m is None else space.min_altitude_m
        if z_m >= low_m - _FORGIVEN_M and any(
            self._is_free(cell, widened_m) for cell in cells_within(place, space, _FORGIVEN_M)
        ):
            return None
        # A leg may cross cells that are not free, except cells that are only too near. A landing
        # leg needs its room.
        width_m = space.resolution_m + _FORGIVEN_M
        room_m = clearances_m(self.desk.site, [place], keep_out=True)[0] + width_m
        roomy = room_m >= self.desk.vehicle.radius_m + widened_m
        here = Point(x_m, z_m)
        beside_m = [
            math.hypot(leg.distance(here), max(0.0, abs(y_m) - _BESIDE_M)) for leg in self.escapes
        ]
        if roomy:
            beside_m += [math.hypot(leg.distance(here), y_m) for leg in self.legs]
        if min(beside_m, default=math.inf) <= width_m:
            return None
        return f"not free: {place}, {widened_m:.1f} m"

    def _jumped_to(self, place):
        """True for rest where jumps, no greater than the margin, have put it, out of keep-outs."""
        site, margin = self.desk.site, margin_of(self.desk.vehicle, LIMITS)
        clear_m = clearances_m(site, [place], keep_out=True)[0] + site.margin.total_m
        return (
            0.0 < math.hypot(*self.jumped_m) <= margin.total_m + _JUMP_M
            and abs(place[1]) <= LIMITS.plane_tolerance_m + _FORGIVEN_M
            and clear_m >= self.desk.vehicle.radius_m - _FORGIVEN_M
        )

    def _is_free(self, cell, widened_m):
        key = (cell, widened_m)
        if key not in self.free:
            self.free[key] = is_free(self.desk.site, cell, self.desk.vehicle.radius_m, widened_m)
        return self.free[key]

    def _widened_m(self):
        """Reported position error beyond the keep-outs' allowance."""
        known = {
            source: accuracy_m
            for source, accuracy_m in self.accuracy_m.items()
            if accuracy_m and math.isfinite(accuracy_m)
        }
        level_m = known.get("estimator", known.get("receiver", 0.0))
        return max(
            0.0,
            max(level_m, known.get("height", 0.0))
            - margin_of(self.desk.vehicle, LIMITS).position_m,
        )
