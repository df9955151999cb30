"""Late packets, and forged packets with the autopilot's ids: the aircraft does not follow them."""

from __future__ import annotations

import itertools
import math
import re

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.wire import packet_header, packets

from ..copies import flown_once
from ..flights.aircraft import STEP_S
from ..flights.judging import assert_nothing_was_touched
from ..flights.lockstep import hovering
from ..flights.operator import INSPECTION, TEMPORARILY_REJECTED, Manner
from .marks import ARDUPILOT_FIRST, BOTH, PX4_FIRST

METRES_PER_DEGREE = math.radians(6_371_000.0)
EAST_SCALE = math.cos(math.radians(45.3781))
LOCAL_POSITION, GLOBAL_POSITION, ORIGIN = 32, 33, 49


@flown_once
def in_flight(manner, target=0):
    flight = hovering(vehicle="x500", manner=manner)
    flight.begin(INSPECTION, target)
    flight.run(3.0)
    assert flight.state == "flying"
    return flight


def reported_origin(flight):
    point = flight.companion.telemetry.local_origin.point
    return (
        round(point.latitude_deg * 1e7),
        round(point.longitude_deg * 1e7),
        round(point.altitude_amsl_m * 1e3),
    )


class Intruder:
    """A sender on the link with the autopilot's ids and sequence numbers."""

    def __init__(self, flight):
        self.flight = flight
        self.received = []
        """(time, message id, packet) of every packet of the autopilot."""
        self.origin = reported_origin(flight)
        """The true one: latitude and longitude in 1e-7 degrees, altitude in mm."""
        self.boot_ms = 0
        self.sequence = 0
        self.forge = None
        """Change of a packet of the autopilot: bytes in, bytes out."""
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._reader = mavlink.MAVLink(None)
        self._reader.robust_parsing = True
        self._handle = flight.handle
        flight.handle = self.listen

    def listen(self, data):
        for packet in packets(data):
            message_id = packet_header(packet)[0]
            self.received.append((self.flight.now_s, message_id, packet))
            message = self.read(packet)
            self.sequence = message.get_seq()
            if message_id == LOCAL_POSITION:
                self.boot_ms = message.time_boot_ms
            forged = packet if self.forge is None else self.forge(message_id, packet)
            if forged:
                self._handle(forged)

    def read(self, packet):
        (message,) = self._reader.parse_buffer(packet)
        return message

    def send(self, message, system_id=1):
        self._codec.srcSystem = system_id
        self._codec.seq = (self.sequence + 1) % 256
        self._handle(message.pack(self._codec))

    def send_again(self, message_id, late_s):
        """Sends again the packet of this kind that was received `late_s` ago."""
        reported_s = self.flight.now_s - late_s
        self._handle(
            next(
                packet
                for time_s, kind, packet in self.received
                if kind == message_id and time_s >= reported_s
            )
        )

    def origin_off(self, north_m, east_m, up_m=0.0):
        """GPS_GLOBAL_ORIGIN at an offset from the true one."""
        latitude_e7, longitude_e7, altitude_mm = self.origin
        scale = math.cos(math.radians(latitude_e7 * 1e-7))
        return mavlink.MAVLink_gps_global_origin_message(
            latitude_e7 + round(north_m / METRES_PER_DEGREE * 1e7),
            longitude_e7 + round(east_m / METRES_PER_DEGREE / scale * 1e7),
            altitude_mm + round(up_m * 1e3),
            self.boot_ms * 1000,
        )


def steps_m(flight, since_s):
    """Distances between successive setpoints, in the local frame."""
    places = [
        (s.message.x, s.message.y, s.message.z) for s in flight.setpoints if s.time_s > since_s
    ]
    return [math.dist(*pair) for pair in itertools.pairwise(places)]


def jumps(flight):
    return [decision for decision in flight.decisions if decision.kind == "jump"]


def reported(flight, cause):
    """Texts to the pilot with this cause of a hold, its distance and limit."""
    words = rf"MOAR: {cause} ([\d.]+ m > [\d.]+|over [\d.]+ m), holding"
    return [text for text in flight.operator.texts() if re.fullmatch(words, text)]


@pytest.mark.parametrize(
    ("manner", "late_s", "counted"),
    [
        pytest.param(Manner.PX4, 0.2, 0, marks=pytest.mark.slow),
        pytest.param(Manner.ARDUPILOT, 0.3, 0, marks=pytest.mark.slow),
        pytest.param(Manner.PX4, 0.6, 5, marks=pytest.mark.slow),
        (Manner.PX4, 0.9, 5),
        pytest.param(Manner.ARDUPILOT, 0.6, 0, marks=pytest.mark.slow),
        (Manner.ARDUPILOT, 0.9, 5),
    ],
)
def test_a_position_that_is_received_again_late_moves_no_setpoint(manner, late_s, counted):
    """Within the last 128 packets it is dropped as a copy; later it counts as a late packet."""
    flight = in_flight(manner)
    intruder = Intruder(flight)
    flight.run(1.5)
    began_s, late = flight.now_s, flight.companion.telemetry.link.packets_late
    for _ in range(5):
        intruder.send_again(LOCAL_POSITION, late_s)
        flight.run(0.2)
    assert not jumps(flight)
    fastest_mps = flight.vehicle.speed.horizontal_mps + flight.vehicle.speed.min_mps
    assert max(steps_m(flight, began_s)) <= fastest_mps * STEP_S + 1e-3
    assert flight.state == "flying"
    assert flight.companion.telemetry.link.packets_late == late + counted


@ARDUPILOT_FIRST
def test_old_packets_of_every_kind_in_one_burst_are_no_restart(manner):
    flight = in_flight(manner)
    intruder = Intruder(flight)
    flight.run(5.0)
    old = [
        packet for time_s, kind, packet in intruder.received if kind and time_s < flight.now_s - 3.0
    ]
    before = flight.companion.telemetry.local_position
    for packet in old:
        intruder._handle(packet)
    assert flight.companion.telemetry.local_position == before
    flight.run(2.0)
    assert flight.state in {"flying", "at_target"}
    assert not jumps(flight)


def creep(flight, *, forge_global=False):
    """Sends an origin that drifts at 0.1 m/s until the mission holds; returns the offset then."""
    intruder, began_s = Intruder(flight), flight.now_s

    def east_m():
        return 0.1 * (flight.now_s - began_s)

    def forged(message_id, packet):
        if message_id == GLOBAL_POSITION and forge_global:
            message = intruder.read(packet)
            message.lon += round(east_m() / METRES_PER_DEGREE / EAST_SCALE * 1e7)
            packet = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
        return b"" if message_id == ORIGIN else packet

    intruder.forge = forged
    while flight.state != "holding":
        assert east_m() < 3.0
        flight.run(0.1)
        intruder.send(intruder.origin_off(0.0, east_m()))
    flight.run(0.2)
    return east_m()


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_an_origin_that_creeps_away_from_the_global_position_is_held(manner):
    flight = in_flight(manner, target=-1)
    assert creep(flight) < 0.75
    assert reported(flight, "global position off") or reported(flight, "the origin moved")
    flight.run(10.0)
    assert flight.state == "holding"
    assert_nothing_was_touched(flight)


@PX4_FIRST
def test_an_origin_that_creeps_with_the_global_position_is_held_at_the_margin(manner):
    flight = in_flight(manner, target=-1)
    margin_m = {Manner.PX4: 1.4, Manner.ARDUPILOT: 0.5}[manner]
    assert creep(flight, forge_global=True) < margin_m + 0.4
    assert reported(flight, "the origin moved") or reported(flight, "home position off")
    flight.run(10.0)
    assert flight.state == "holding"
    assert_nothing_was_touched(flight)


@ARDUPILOT_FIRST
def test_forged_origins_between_true_ones_are_held_too(manner):
    """Any of the causes is correct; the setpoint must not alternate between the origins."""
    flight = in_flight(manner, target=-1)
    intruder, began_s = Intruder(flight), flight.now_s
    while flight.state != "holding" and flight.now_s < began_s + 20.0:
        flight.run(0.2)
        intruder.send(intruder.origin_off(0.0, 0.1 * (flight.now_s - began_s)))
    assert flight.state == "holding"
    assert flight.now_s - began_s < 10.0
    assert_nothing_was_touched(flight)


@ARDUPILOT_FIRST
def test_an_origin_that_moves_by_less_than_a_jump_moves_no_setpoint_at_once(manner):
    """The setpoint fades back over half a metre as slowly as onto a new path."""
    flight = in_flight(manner)
    intruder = Intruder(flight)
    flight.run(0.2)
    began_s = flight.now_s
    intruder.send(intruder.origin_off(0.0, 0.4))
    flight.run(0.4)
    fastest_mps = flight.vehicle.speed.horizontal_mps + flight.vehicle.speed.min_mps
    assert max(steps_m(flight, began_s - STEP_S)) <= fastest_mps * STEP_S + 1e-3
    assert flight.state == "flying"


@BOTH
def test_a_real_reset_of_the_estimator_is_no_disagreement(manner):
    flight = in_flight(manner)
    flight.autopilot.jump(0.0, 0.45)
    flight.run(5.0)
    assert flight.state in {"flying", "at_target"}
    assert not flight.operator.has_received("global position")


ONE_PACKET = {
    "two autopilots are received": (
        2,
        mavlink.MAVLink_heartbeat_message(2, 12, 81, 0x03040000, 3, 3),
    ),
    "two clocks, autopilot id 1": (1, mavlink.MAVLink_system_time_message(0, 900_000_000)),
}


@pytest.mark.slow
@pytest.mark.parametrize("words", ONE_PACKET)
def test_one_packet_of_another_autopilot_ends_control_but_not_for_good(words):
    flight = in_flight(Manner.PX4, target=-1)
    system_id, message = ONE_PACKET[words]
    intruder = Intruder(flight)
    flight.run(0.2)
    intruder.send(message, system_id)
    flight.run(0.1)
    assert flight.state == "released"
    assert flight.operator.has_received(f"MOAR: {words}, released")
    flight.run(5.0)
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED
    flight.operator.mode("hold")
    flight.run(6.0)
    flight.begin(INSPECTION)
    assert flight.state == "flying"
