"""A tiny peer that talks raw pymavlink to the fake autopilot in lockstep."""

import math
from collections import defaultdict

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import FakeAutopilot, Options

OFFBOARD, HOLD, POSCTL, LAND, RTL = (6, 0), (4, 3), (3, 0), (4, 6), (4, 5)
POSITION_VELOCITY_YAW = 0x9C0


class Peer:
    """One end of one link: sends messages as (system, component), keeps all it hears."""

    def __init__(self, vehicle, link, system, component):
        self.vehicle = vehicle
        self.link = link
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.heard = []
        self.raw_bytes = 0

    def send(self, message):
        self.vehicle.receive(self.link, message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def take(self, data, now_s):
        self.raw_bytes += len(data)
        for message in self.mav.parse_buffer(data) or []:
            self.heard.append((now_s, message))

    def of(self, kind, *, since=0.0, until=math.inf):
        return [m for t, m in self.heard if m.get_type() == kind and since <= t <= until]

    def last(self, kind):
        found = self.of(kind)
        return found[-1] if found else None

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
            self.vehicle.step(self.now_s)
            for link, data in self.vehicle.data_to_send():
                (self.companion if link == "companion" else self.gcs).take(data, self.now_s)
            if until is not None and until(self):
                return True
        return until is None

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

    def count(self, peer, since):
        counts = defaultdict(int)
        for t, m in peer.heard:
            if t >= since:
                counts[m.get_type()] += 1
        return counts


@pytest.fixture
def flight():
    return Flight()


@pytest.fixture(scope="session")
def make_flight():
    return Flight


@pytest.fixture
def airborne():
    made = Flight()
    made.take_off()
    return made
