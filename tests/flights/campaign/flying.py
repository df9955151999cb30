"""Flies a drawn flight and records every step."""

from __future__ import annotations

import math
import random
import struct
from dataclasses import dataclass, field, replace

import numpy as np
from shapely.geometry import Point

from moar_companion.companion.error_margin import measured_margin
from moar_companion.companion.safety.setpoint_gate import distance_m
from moar_companion.settings.config import Authority
from moar_companion.settings.mqtt_config import Mqtt, MqttCommands
from moar_companion.settings.vehicle import Vehicle, YawMode
from sitl.geodesy import Geodetic, TrueFrame
from sitl.manners import KINDS as AUTOPILOTS
from sitl.quadrotor import GRAVITY_MPS2, wrap_pi
from sitl.wire import packets as cut
from tests.mavlink.signed import SECRET
from tests.vehicles import named_vehicle

from ..aircraft import STEP_S
from ..judging import shape
from ..lidar_on_board import scene_of
from ..lockstep import COMPANION_LINK, HEARD_S, Lockstep
from ..operator import INSPECTION, Manner
from ..reasons import reason
from . import packets
from .drawing import Draw, draw
from .kinds import KINDS, Breaks
from .kinds.firmware import OPTIONS

WIND_LIMIT_MPS = 15.0
HOLDS = 0.8
LEAN_RAD = {Manner.PX4: math.radians(45.0), Manner.ARDUPILOT: math.radians(30.0)}
"""MPC_TILTMAX_AIR, ANGLE_MAX."""
HOLDS_IN = {Manner.PX4: {"AUTO.LOITER"}, Manner.ARDUPILOT: {"LOITER", "BRAKE"}}
"""Modes in which an autopilot holds when the stream has ended."""
OUR_MODE = {Manner.PX4: 6 << 16, Manner.ARDUPILOT: 4}
"""The custom mode of OFFBOARD, GUIDED."""
LOOKED_AT = {
    packets.LOCAL_POSITION, packets.HEARTBEAT, packets.CURRENT_MODE, packets.ESTIMATOR_STATUS,
    packets.GPS_RAW_INT,
}  # fmt: skip
NO_FIX_MM = 99_000
ON_LEG_M = 0.2
_READY_S = 1.5
_AGAIN_S = 4.0
_MAX_TRIES = 3
_LANDED_S = 3.0
"""Time on the ground with stopped motors after which a flight is over."""
MQTT = Mqtt(url="mqtt://broker", commands=MqttCommands(accept=True))


def held_wind_mps(manner: Manner) -> float:
    """Wind that the promise covers."""
    frame = AUTOPILOTS[manner.value].airframe
    push = GRAVITY_MPS2 * math.tan(LEAN_RAD[manner])
    linear, quadratic = frame.drag_per_s, frame.drag_per_m
    if quadratic:
        wind = (-linear + math.sqrt(linear**2 + 4.0 * quadratic * push)) / (2.0 * quadratic)
    else:
        wind = push / linear
    return min(WIND_LIMIT_MPS, HOLDS * wind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sent:
    """A setpoint. reported_m: its place in the site's frame by the autopilot's own estimate.

    With a lidar by that and the offset of the line with which the companion flies.
    """

    time_s: float
    state: str
    on_leg: bool
    """On a leg that the companion flies, out of the workspace or back, whatever its task is."""
    local_m: tuple[float, float, float]
    moves: bool
    reported_m: tuple[float, float, float]
    aircraft_m: tuple[float, float, float]
    """The aircraft's place by the estimate, then."""
    position_age_s: float
    mode_age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """Data for the judge. Arrays have a row per step of `STEP_S`.

    true_m       (n, 3)  the aircraft in the site's frame
    error_m      (n, 3)  the estimate less true_m
    wind_mps     (n, 3)
    reported_m       (n,)    the accuracy that the autopilot reports
    """

    draw: Draw
    vehicle: Vehicle
    margin_m: float
    held_wind_mps: float
    time_s: np.ndarray
    true_m: np.ndarray
    error_m: np.ndarray
    wind_mps: np.ndarray
    reported_m: np.ndarray
    modes: list[str]
    airborne: np.ndarray
    states: list[str]
    sent: list[Sent]
    ours: str
    holds_in: set[str]
    began_s: dict[str, tuple[float, float]]
    """By the number of the fault and its kind: its beginning and end, on the flight's clock."""
    broken_s: dict[Breaks, float]
    """End of each part of the promise, by the faults' kinds."""
    orders_s: list[float]
    taken_reported_s: list[float]
    """Times at which a message with another mode than the companion's has arrived."""
    forbidden: list[tuple[float, str]]
    notes: list[dict]
    texts: list[str] = field(default_factory=list)
    missions_s: list[float] = field(default_factory=list)
    """Times at which a mission was ordered; repetitions of a rejected order left out."""

    @property
    def why(self) -> str:
        """Reason why the first order's goal was not reached; empty if it was.

        The goal: to be at a target, or on the leg to a landing point.
        """
        inspects = self.draw.orders[0].mission == INSPECTION
        goal = "at_target" if inspects else "landing_leg"
        end_s = min(self.missions_s[1:], default=math.inf)
        before = [
            state for time_s, state in zip(self.time_s, self.states, strict=True) if time_s <= end_s
        ]
        if goal in before:
            return ""
        if end_s < math.inf:
            return "another order came before"
        return reason(self.states[-1], self.texts)


class Stopped:
    """Replacement of a companion that does not run. keeps: received data is read later."""

    def __init__(self, companion, *, keeps: bool) -> None:
        self.companion = companion
        self.keeps = keeps
        self.received: list[tuple[str, bytes]] = []
        self.answers: list = []

    def __getattr__(self, name):
        return getattr(self.companion, name)

    def receive(self, link, data, _now_s):
        if self.keeps:
            self.received.append((link, data))

    def perceived(self, _report):
        """Reports of the perception are lost."""

    def plan_answered(self, answer):
        if self.keeps:
            self.answers.append(answer)

    def _nothing(self, *_):
        return ()

    tick = contingency_answered = plan_jobs = contingency_jobs = decisions = _nothing
    data_to_send = calls = map_jobs = pose_notes = _nothing


class RandomFlight(Lockstep):
    """A drawn flight with the methods that its faults need."""

    def __init__(self, drawn: Draw) -> None:
        vehicle, options = named_vehicle(drawn.vehicle), dict(OPTIONS.get(drawn.firmware, {}))
        if drawn.lidar:  # it scans the site's plane
            azimuth_deg = drawn.site.frame.azimuth_deg
            options["yaw_deg"] = azimuth_deg
            guidance = replace(
                vehicle.guidance,
                yaw_mode=YawMode.FIXED,
                fixed_yaw_rad=wrap_pi(math.radians(azimuth_deg)),
            )
            vehicle = replace(vehicle, guidance=guidance)
        super().__init__(
            site=drawn.file_site,
            vehicle=vehicle,
            manner=drawn.manner,
            authority=drawn.authority,
            options={"parameters": drawn.parameters, "seed": drawn.seed, **options},
            secret=SECRET if drawn.signed else None,
            lidar_scene=scene_of(drawn.site) if drawn.lidar else None,
            **({"mqtt": MQTT} if drawn.orders_by_mqtt else {}),
        )
        self.drawn = drawn
        self.held_wind_mps = held_wind_mps(drawn.manner)
        self.mute = False
        self.filters: list[packets.Filter] = []
        self.rows: list[tuple] = []
        self.sent: list[Sent] = []
        self.modes: list[str] = []
        self.orders_s: list[float] = []
        self.missions_s: list[float] = []
        self.taken_reported_s: list[float] = []
        self.forbidden: list[tuple[float, str]] = []
        self.began_s: dict[str, tuple[float, float]] = {}
        self.broken_s: dict[Breaks, float] = {}
        self.notes: list[dict] = []
        self._noted: dict = {}
        self._alone = False
        """The companion does not run yet."""
        self._each_step: list = []
        self._later: list[tuple[float, object]] = []
        self._position_s = self._mode_s = -math.inf
        self._boot_us: int | None = None
        """Start of the autopilot that sent the last position which the companion received."""
        self._accuracy_m = 0.0
        self._landed_s = math.inf
        self.start_s = math.inf
        """Time of the first order."""
        self._ready_since_s: float | None = None
        self._asked_s = -math.inf
        self._tries = 0
        self._wanted: tuple[int, float] | None = None
        self._frame = TrueFrame(
            Geodetic(
                latitude_deg=self.site.frame.origin.latitude_deg,
                longitude_deg=self.site.frame.origin.longitude_deg,
                altitude_amsl_m=0.0,
            )
        )
        azimuth = math.radians(self.site.frame.azimuth_deg)
        self._cos, self._sin = math.cos(azimuth), math.sin(azimuth)

    # Methods for faults

    def note(self, **values) -> None:
        """Adds the numbers of the starting fault to the row."""
        self._noted |= {
            name: round(value, 4) if isinstance(value, float) else value
            for name, value in values.items()
        }

    def note_order(self) -> None:
        """Notes that a sender has sent the companion an order."""
        self.orders_s.append(self.now_s)

    def filter(self, one: packets.Filter):
        """Pass packets to the companion through a filter; returns the function that ends it."""
        self.filters.append(one)
        return lambda: self.filters.remove(one)

    @property
    def key(self) -> bytes:
        """Key of the links; empty where they are not signed."""
        return SECRET if self.drawn.signed else b""

    def flag(self, name: str, value):
        """Set an attribute; returns the function that restores it."""
        before = getattr(self, name)
        self.note(**{name: value})
        setattr(self, name, value)
        return lambda: setattr(self, name, before)

    def each_step(self, act):
        """Call in each step with its length; returns the function that ends it."""
        self._each_step.append(act)
        return lambda: self._each_step.remove(act)

    def later(self, after_s: float, act) -> None:
        """Call once, after a time."""
        self._later.append((self.now_s + after_s, act))

    def ramp(self, name: str, start: float, end: float, over_s: float):
        """Move a condition; returns the function that moves it back."""

        def move(first, last):
            began_s = self.now_s
            act = []

            def step(_):
                part = min(1.0, (self.now_s - began_s) / over_s)
                setattr(self.autopilot.conditions, name, first + part * (last - first))
                if part >= 1.0:
                    act.pop()()

            act.append(self.each_step(step))

        move(start, end)
        return lambda: move(end, start)

    def when(self, condition, act) -> None:
        """Call once, in the first step in which a condition holds: a fault begins only then."""
        noted = self._noted

        def look(_):
            if condition():
                end()
                self._noted = noted
                act()

        end = self.each_step(look)

    @property
    def place_m(self) -> tuple[float, float, float]:
        """True place of the aircraft in the site's frame."""
        return self.rows[-1][1:4]

    @property
    def room_m(self) -> float:
        """True distance from the hull to the nearest obstacle."""
        x_m, _, z_m = self.place_m
        nearest_m = min(
            (shape(item).distance(Point(x_m, z_m)) for item in self.drawn.site.obstacles),
            default=math.inf,
        )
        return nearest_m - self.vehicle.radius_m

    @property
    def commanded(self) -> bool:
        """True while the companion flies the aircraft on a mission, or holds it there."""
        flies = self.state in {"flying", "at_target", "holding"}
        return flies and self.operator.in_mode("ours")

    def stop_companion(self, *, killed: bool) -> None:
        """Stop the companion; killed: its process has ended."""
        if not isinstance(self.companion, Stopped):
            self.companion = Stopped(self.companion, keeps=not killed)
        if killed:
            self._jobs.clear()

    def wake_companion(self) -> None:
        """Resume the companion, which reads all waiting data at once."""
        stopped = self.companion
        if not isinstance(stopped, Stopped) or not stopped.keeps:
            return
        self.companion = stopped.companion
        for link, data in stopped.received:
            self.companion.receive(link, data, self.now_s)
        for answer in stopped.answers:
            self.companion.plan_answered(answer)

    def restart_companion(self) -> None:
        """Start a new companion with the snapshot of the killed one."""
        if not isinstance(self.companion, Stopped):
            return
        memory = self.companion.memory
        self.companion = self.new_companion(before=memory)
        if self.lidar is not None:
            self.lidar.restart()

    # Steps

    def step(self) -> None:
        if self._alone:
            self.move()
            return
        for act in list(self._each_step):
            act(STEP_S)
        for item in [item for item in self._later if item[0] <= self.now_s]:
            self._later.remove(item)
            item[1]()
        before = len(self.setpoints)
        self.blind = not (self.truths and self.truths[-1].armed)
        super().step()
        self._write_down(self.setpoints[before:])

    def handle(self, data: bytes) -> None:
        items = [(self._sent_s(packet), packet) for packet in cut(data)]
        for one in list(self.filters):
            items = one(self.now_s, items)
        for sent_s, packet in items:
            self._look(sent_s, packet)
        data = b"".join(packet for _, packet in items)
        self.companion.receive(COMPANION_LINK, data, self.now_s)

    def report(self, data: bytes) -> None:
        for packet in cut(data):
            self._watch(packet)
        if not self.mute:
            super().report(data)

    def _sent_s(self, packet: bytes) -> float:
        if packets.number(packet) != packets.LOCAL_POSITION:
            return self.now_s
        (boot_ms,) = struct.unpack_from("<I", packet, packets.HEADER_BYTES)
        return self.autopilot.manner._boot_us / 1e6 + boot_ms / 1e3

    def _look(self, sent_s: float, packet: bytes) -> None:
        number = packets.number(packet)
        if number not in LOOKED_AT or (message := packets.decoded(packet)) is None:
            return
        if number == packets.LOCAL_POSITION:
            self._position, self._boot_us = packet, self.autopilot.manner._boot_us
            self._position_s = max(self._position_s, sent_s)
        elif number in {packets.HEARTBEAT, packets.CURRENT_MODE}:
            self._mode_s = max(self._mode_s, sent_s)
            from_autopilot = (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)
            if from_autopilot and message.custom_mode != OUR_MODE[self.drawn.manner]:
                self.taken_reported_s.append(self.now_s)
        elif number == packets.ESTIMATOR_STATUS and self.drawn.manner is Manner.PX4:
            self._accuracy_m = max(message.pos_horiz_accuracy, message.pos_vert_accuracy)
        elif number == packets.GPS_RAW_INT and self.drawn.manner is Manner.ARDUPILOT:
            reported = 0 < message.h_acc < NO_FIX_MM
            self._accuracy_m = message.h_acc / 1e3 if reported else self._accuracy_m

    def _watch(self, packet: bytes) -> None:
        """Requests that no companion may send to an autopilot."""
        if packets.number(packet) not in {75, 76}:
            return
        message = packets.decoded(packet)
        if message is None:
            return
        if message.command in {400, 22}:
            self.forbidden.append((self.now_s, f"command {message.command}"))
        if message.command in {176, 21, 20} and self.drawn.authority is not Authority.ENGAGE:
            self.forbidden.append((self.now_s, f"mode command {message.command}"))

    def _in_site(self, latitude_deg, longitude_deg, altitude_m):
        north, east, _ = self._frame.ned(
            Geodetic(
                latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_m
            )
        )
        up = altitude_m - self.site.frame.origin.altitude_amsl_m
        return (*self._turned(north, east), up)

    def _local_in_site(self, x, y, z):
        """A place of the autopilot's local frame in the site's frame, by the true (last) origin.

        After a restart by the last one before, until a position tells the companion of it: what it
        sends meanwhile is meant so, and an autopilot that has just started follows no setpoint.
        """
        nav = self.autopilot.manner.navigation
        if self._boot_us in {None, self.autopilot.manner._boot_us}:
            if self.drawn.manner is Manner.PX4:
                self._origin = nav.origin, nav.origin_altitude_m
            elif nav._projection is not None:
                self._origin = nav._projection, nav._origin_altitude_m
        projection, altitude_m = self._origin
        return self._in_site(*projection.reproject(x, y), altitude_m - z)

    def _by_line(self, place_m):
        (x_m, y_m, z_m), (by_x_m, by_z_m) = place_m, self.companion.state.pose_tracker.offset_m
        return x_m + by_x_m, y_m, z_m + by_z_m

    def _turned(self, north, east):
        return north * self._cos + east * self._sin, north * self._sin - east * self._cos

    @staticmethod
    def _is_on_leg(flown, place_m) -> bool:
        """True on a leg that was checked as a whole, out of the workspace or back into it."""
        return any(distance_m(place_m, leg.points_m) <= ON_LEG_M for leg in flown._path.legs)

    def _write_down(self, setpoints) -> None:
        truth = self.truths[-1]
        estimator = self.autopilot._world.estimator
        true_m = self._in_site(truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)
        reported_m = self._in_site(
            estimator.latitude_deg, estimator.longitude_deg, estimator.altitude_m
        )
        wind_north, wind_east, wind_down = truth.wind_ned_mps
        self.rows.append(
            (
                self.now_s, *true_m, *(a - b for a, b in zip(reported_m, true_m, strict=True)),
                *self._turned(wind_north, wind_east), -wind_down,
                self._accuracy_m, float(not truth.on_ground),
            )
        )  # fmt: skip
        self.modes.append(truth.mode)
        flown = self.companion.state.routes.flight
        for item in setpoints:
            message, nav = item.message, self.autopilot.manner.navigation
            reported_m = self._by_line(self._local_in_site(message.x, message.y, message.z))
            self.sent.append(
                Sent(
                    time_s=item.time_s,
                    state=item.state,
                    on_leg=flown is not None and self._is_on_leg(flown, reported_m),
                    local_m=(message.x, message.y, message.z),
                    moves=any((message.vx, message.vy, message.vz)),
                    reported_m=reported_m,
                    aircraft_m=self._by_line(self._local_in_site(nav.x, nav.y, nav.z)),
                    position_age_s=self.now_s - self._position_s,
                    mode_age_s=self.now_s - self._mode_s,
                )
            )

    # The flight

    def order(self, mission: int, index: float = -1) -> None:
        """The operator orders, and gives the mode when a hold is offered."""
        self._wanted, self._tries = (mission, index), 0
        self.missions_s.append(self.now_s)
        self._send_order()

    def pause_or_go_on(self, word: str) -> None:
        """The operator orders `pause` or `go_on`."""
        self.note_order()
        (self.operator.pause if word == "pause" else self.operator.go_on)()

    def _send_order(self) -> None:
        self._asked_s = self.now_s
        self._tries += 1
        self.note_order()
        self.operator.mission(*self._wanted)

    def fly(self) -> Record:
        """Flies from boot to the end of the drawn flight."""
        drawn = self.drawn
        conditions = self.autopilot.conditions
        conditions.wind_mps, conditions.wind_from_deg = drawn.wind_mps, drawn.wind_from_deg
        conditions.gust_mps = drawn.gust_mps
        self._begin_in_the_air()
        self.start_s = start_s = self.now_s
        due = [(start_s + fault.at_s, number, fault) for number, fault in enumerate(drawn.faults)]
        ends: list = []
        orders = list(drawn.orders)
        while self.now_s < start_s + drawn.lasts_s and not self._is_over():
            while orders and self.now_s >= start_s + orders[0].at_s:
                self._carry_out(orders.pop(0))
            for item in [item for item in due if item[0] <= self.now_s]:
                due.remove(item)
                self._begin_fault(item[1], item[2], ends)
            for item in [item for item in ends if item[0] <= self.now_s]:
                ends.remove(item)
                item[1]()
                began_s, _ = self.began_s[item[2]]
                self.began_s[item[2]] = (began_s, self.now_s)
            self._insist()
            self.step()
        return self._record()

    def _begin_in_the_air(self) -> None:
        """Takes off; unless the flight is flown whole, the companion starts only then."""
        self._alone = not self.drawn.whole
        self.take_off()
        if self._alone:
            self._alone = False
            self.run(HEARD_S)

    def _is_over(self) -> bool:
        """True some time after a landing, unless the flight is flown whole."""
        if self.truths[-1].armed or self.drawn.whole:
            self._landed_s = self.now_s
        return self.now_s - self._landed_s > _LANDED_S

    def _carry_out(self, order) -> None:
        if order.word == "mission":
            self.order(order.mission, order.index)
        else:
            self.pause_or_go_on(order.word)

    def _begin_fault(self, number, fault, ends) -> None:
        kind = KINDS[fault.kind]
        self._noted = {"kind": fault.kind, "at_s": fault.at_s}
        self.notes.append(self._noted)
        undo = kind.begin(self, random.Random(fault.seed))
        key = f"{number} {fault.kind}"
        self.began_s[key] = (self.now_s, math.inf if undo else self.now_s)
        if undo:
            ends.append((self.now_s + fault.lasts_s, undo, key))
        # On a signed link words of other senders are refused. The autopilot's own still count.
        refused = self.drawn.signed and Breaks.AIRCRAFT not in kind.breaks
        parts = (Breaks.AIRCRAFT,) if refused else (Breaks.AIRCRAFT, Breaks.WORDS)
        for part in parts:
            if part in kind.breaks:
                self.broken_s.setdefault(part, self.now_s)
        self._noted["lasts_s"] = fault.lasts_s if undo else None

    def _insist(self) -> None:
        """Give the mode when a hold is offered; repeat an order that was temporarily rejected."""
        if self._wanted is None:
            return
        if self.state != "ready" or self.operator.in_mode("ours"):
            self._ready_since_s = None
        elif self._ready_since_s is None:
            self._ready_since_s = self.now_s
        elif self.now_s - self._ready_since_s > _READY_S:
            self.operator.mode("ours")
            self._ready_since_s = self.now_s
        waits = self.state == "idle" and self.now_s - self._asked_s > _AGAIN_S
        if waits and self._tries < _MAX_TRIES:
            self._send_order()

    def _record(self) -> Record:
        rows = np.array(self.rows)
        return Record(
            draw=self.drawn,
            vehicle=self.vehicle,
            margin_m=measured_margin(self.vehicle.autopilot).position_m,
            held_wind_mps=self.held_wind_mps,
            time_s=rows[:, 0],
            true_m=rows[:, 1:4],
            error_m=rows[:, 4:7],
            wind_mps=rows[:, 7:10],
            reported_m=rows[:, 10],
            airborne=rows[:, 11] > 0.5,
            modes=self.modes,
            states=[state for _, state in self.states],
            sent=self.sent,
            ours=self.drawn.manner.modes["ours"][1],
            holds_in=HOLDS_IN[self.drawn.manner],
            began_s=self.began_s,
            broken_s=self.broken_s,
            orders_s=self.orders_s,
            missions_s=self.missions_s,
            taken_reported_s=self.taken_reported_s,
            forbidden=self.forbidden,
            notes=self.notes,
            texts=self.operator.texts(),
        )


def fly(seed: int) -> Record:
    """The flight of a seed."""
    return RandomFlight(draw(seed)).fly()
