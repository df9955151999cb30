"""A tiny peer that talks raw pymavlink to the fake autopilot in lockstep."""

import copy
import math
from collections import defaultdict
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import FakeAutopilot, Options
from sitl.wire import packets

from ..copies import copy_of
from ..packets import Packet

OFFBOARD, HOLD, POSCTL, LAND, RTL = (6, 0), (4, 3), (3, 0), (4, 6), (4, 5)
POSITION_VELOCITY_YAW = 0x9C0
GUIDED = 4
SQUARE = ((0, 0, -10), (0, 15, -10), (0, 15, -25), (0, 0, -25), (0, 0, -10))


class Peer:
    """One end of one link: sends messages as (system, component) and keeps all that it receives."""

    def __init__(self, vehicle, link, system, component):
        self.vehicle = vehicle
        self.link = link
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.received = []
        self.raw_bytes = 0

    def __deepcopy__(self, memo):
        """A copy that shares the received packets: they are constant, and many."""
        twin = memo[id(self)] = copy.copy(self)
        twin.vehicle, twin.mav = copy.deepcopy((self.vehicle, self.mav), memo)
        twin.received = list(self.received)
        return twin

    def send(self, message):
        self.vehicle.receive(self.link, message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def take(self, data, now_s):
        self.raw_bytes += len(data)
        self.received += [(now_s, Packet(packet)) for packet in packets(data)]

    def of(self, kind, *, since=0.0, until=math.inf):
        return [m for t, m in self.received if m.get_type() == kind and since <= t <= until]

    def last(self, kind):
        return next((m for _, m in reversed(self.received) if m.get_type() == kind), None)

    def texts(self, since=0.0):
        return [m.text for m in self.of("STATUSTEXT", since=since)]

    def heartbeat(self, kind=None):
        kind = mavlink.MAV_TYPE_ONBOARD_CONTROLLER if kind is None else kind
        self.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3))

    def command(self, number, *params, component=1, system=1):
        values = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *values))

    def setpoint(self, x=0.0, y=0.0, z=-10.0, v=(0.0, 0.0, 0.0), yaw=0.0, **options):
        message = mavlink.MAVLink_set_position_target_local_ned_message
        self.send(
            message(
                time_boot_ms=0,
                target_system=options.get("system", 1),
                target_component=options.get("component", 1),
                coordinate_frame=options.get("frame", 1),
                type_mask=options.get("mask", POSITION_VELOCITY_YAW),
                x=x,
                y=y,
                z=z,
                vx=v[0],
                vy=v[1],
                vz=v[2],
                afx=0.0,
                afy=0.0,
                afz=0.0,
                yaw=yaw,
                yaw_rate=options.get("yaw_rate", 0.0),
            )
        )


class Flight:
    """A vehicle with a companion and a ground station, moved in lockstep."""

    def __init__(self, **options):
        self.vehicle = FakeAutopilot(Options(**options))
        self.companion = Peer(self.vehicle, "companion", 1, 195)
        self.gcs = Peer(self.vehicle, "gcs", 255, 190)
        self.now_s = 0.0
        self.stream = None
        self.ground_station_alive = True
        self.companion_alive = True
        self._ticks = 0

    def run(self, seconds, until=None):
        """Advance; heartbeats at 1 Hz, the stream (if any) at 20 Hz. Stops early at `until`."""
        for _ in range(round(seconds * 50)):
            if self._ticks % 50 == 0:
                if self.companion_alive:
                    self.companion.heartbeat()
                if self.ground_station_alive:
                    self.gcs.heartbeat(mavlink.MAV_TYPE_GCS)
            if self.stream is not None and self._ticks % 2 == 0:
                self.stream(self)
            self._ticks += 1
            self.now_s = self._ticks * 0.02
            self._step(self.now_s)
            if until is not None and until(self):
                return True
        return until is None

    def tick(self):
        """Advance by a single tick of the vehicle, without heartbeats and stream."""
        self._step(self.now_s + 0.01)

    def _step(self, now_s):
        self.vehicle.step(now_s)
        for link, data in self.vehicle.data_to_send():
            (self.companion if link == "companion" else self.gcs).take(data, now_s)

    def ask(self, peer, number, *params, **options):
        """Send a command and return the results that came back within 0.3 s."""
        start_s = self.now_s
        peer.command(number, *params, **options)
        self.run(0.3)
        return [
            m.result for m in peer.of("COMMAND_ACK", since=start_s + 1e-9) if m.command == number
        ]

    def mode(self, peer, mode):
        return self.ask(peer, 176, 129 if self.truth.armed else 1, *mode)

    @property
    def truth(self):
        return self.vehicle.truth

    def hold_at(self, x=0.0, y=0.0, z=-10.0, **options):
        self.stream = lambda flight: flight.companion.setpoint(x, y, z, **options)

    def take_off(self, z=-10.0):
        """Boot, stream, OFFBOARD, arm, climb."""
        self.run(6.0)
        self.hold_at(z=z)
        self.run(1.5)
        assert self.mode(self.companion, OFFBOARD)[-1] == 0
        assert self.ask(self.companion, 400, 1) == [0]
        assert self.run(20.0, until=lambda f: f.truth.position_ned_m[2] < z + 0.3)

    def heartbeat(self):
        """Return the next heartbeat of the autopilot."""
        start_s = self.now_s
        self.run(1.1)
        return next(
            m for m in self.companion.of("HEARTBEAT", since=start_s) if m.get_srcComponent() == 1
        )

    def watch(self, seconds, measure):
        """Return what `measure` gives, ten times a second."""
        measured = []
        for _ in range(round(seconds * 10)):
            self.run(0.1)
            measured.append(measure(self))
        return measured

    @property
    def local_m(self):
        """The position that the autopilot reports, in its local frame."""
        local = self.companion.last("LOCAL_POSITION_NED")
        return local.x, local.y, local.z

    def count(self, peer, since):
        counts = defaultdict(int)
        for t, m in peer.received:
            if t >= since:
                counts[m.get_type()] += 1
        return counts


class ArduPilotFlight(Flight):
    """A flight with ArduPilot. Its start is shortened unless `boot_s` is given."""

    def __init__(self, boot_s=10.0, parameters=None, **options):
        super().__init__(
            autopilot="ardupilot",
            parameters={"SIM_BOOT_S": boot_s} | (parameters or {}),
            **options,
        )

    def mode(self, peer, mode):
        return self.ask(peer, 176, 1, mode)

    def ready(self):
        """Run until the estimator uses GPS."""
        assert self.run(60.0, until=lambda f: "EKF3 IMU0 is using GPS" in f.gcs.texts())
        self.run(0.5)

    def launch(self, height_m=10.0):
        """Boot, GUIDED, arm, and the order to take off."""
        self.ready()
        assert self.mode(self.companion, GUIDED) == [0]
        assert self.ask(self.companion, 400, 1) == [0]
        assert self.ask(self.companion, 22, 0, 0, 0, 0, 0, 0, height_m) == [0]

    def take_off(self, height_m=10.0):
        """Launch and climb; then the pilot holds the sticks in the middle."""
        self.launch(height_m)
        assert self.run(20.0, until=lambda f: f.truth.landed_state == 2)
        self.vehicle.move_sticks()
        self.run(2.0)

    def along(self, speed_mps, mask=0x9C0, x=0.0, z=-10.0):
        """Stream a point that moves north from x metres, with its velocity."""
        start_s = self.now_s
        self.stream = lambda f: f.companion.setpoint(
            x + speed_mps * (f.now_s - start_s), 0.0, z, v=(speed_mps, 0.0, 0.0), mask=mask
        )

    @property
    def local_m(self):
        """The autopilot's own estimate of its place."""
        return self.vehicle.manner.position_ned_m

    @property
    def tilt_deg(self):
        roll, pitch, _ = self.truth.attitude_rad
        return math.degrees(math.acos(math.cos(roll) * math.cos(pitch)))


def _on_square(distance_m):
    """The point and the direction after a distance along the vertical square."""
    for a, b in pairwise(SQUARE):
        length_m = math.dist(a, b)
        if distance_m < length_m:
            share = distance_m / length_m
            return (
                tuple(p + (q - p) * share for p, q in zip(a, b, strict=True)),
                tuple((q - p) / length_m for p, q in zip(a, b, strict=True)),
            )
        distance_m -= length_m
    return SQUARE[-1], (0.0, 0.0, 0.0)


def fly_square(flight, rate_hz, mask=POSITION_VELOCITY_YAW, speed_mps=0.7):
    """Errors of position along the square, streamed at a rate."""
    start_s = flight.now_s
    sent_s = [-1.0]

    def stream(f):
        if f.now_s - sent_s[0] >= 1.0 / rate_hz - 1e-6:
            sent_s[0] = f.now_s
            point, way = _on_square(speed_mps * (f.now_s - start_s))
            velocity = tuple(speed_mps * w for w in way)
            f.companion.setpoint(*point, v=velocity, mask=mask)

    flight.stream = stream
    return flight.watch(
        85.0,
        lambda f: math.dist(_on_square(speed_mps * (f.now_s - start_s))[0], f.local_m),
    )


@pytest.fixture
def flight():
    return Flight()


@pytest.fixture(scope="session")
def make_flight():
    return Flight


@pytest.fixture(scope="session")
def taken_off():
    made = Flight()
    made.take_off()
    return made


@pytest.fixture
def airborne(taken_off):
    """PX4 in OFFBOARD, 10 m up."""
    return copy_of(taken_off)


@pytest.fixture
def ardupilot():
    return ArduPilotFlight()


@pytest.fixture(scope="session")
def make_ardupilot():
    return ArduPilotFlight


@pytest.fixture(scope="session")
def launched():
    made = ArduPilotFlight()
    made.take_off()
    return made


@pytest.fixture
def hovering(launched):
    """ArduPilot in GUIDED, 10 m up."""
    return copy_of(launched)
