"""Hostile requests to the services of the component, beside a session that gets none.

Two sessions receive the same packets of an autopilot and send the same setpoints. One of them is
also flooded: with requests of every message that a service reads, from permitted ground stations
and from strangers, on a serial line and on a network; on the line none has the autopilot's ids,
since a second autopilot ends the control. Judged are

- every packet: no exception, and the processor time;
- every cycle: what commands motion is the same in both sessions, and goes first;
- every link: answers take no more bytes than its budget;
- the memory, from a tenth of the packets on.
"""

from __future__ import annotations

import gc
import math
import struct
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from random import Random

from moar_companion.mavlink.commands import MESSAGE_COMMANDS
from moar_companion.mavlink.component.component_metadata import metadata_files
from moar_companion.mavlink.component.published import PUBLISHED
from moar_companion.mavlink.component.requested_messages import CLOCK_IDS
from moar_companion.mavlink.component.services import ComponentServices
from moar_companion.mavlink.dialect import id_of, mavlink
from moar_companion.mavlink.session import Session, SystemStatus
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.flight_parameters import FlightParameters
from moar_companion.settings.link_config import LinkRole
from moar_companion.settings.vehicle import VehicleFile
from moar_companion.types import GeodeticPoint
from sitl.wire import packet_header

from ..benchmarks.soak import anonymous_mb
from .frames import OURS, frame, hostile_payload, shape_of

_X500 = shipped_configs() / "vehicles" / "x500.yaml"
PARAMETERS = FlightParameters.of(VehicleFile.load(_X500), CompanionConfig(vehicle=_X500))
LINE, NETWORK = "serial:/dev/ttyTHS1:57600", "tcp:127.0.0.1:5760"
LINKS = {LINE: LinkRole.AUTOPILOT, NETWORK: LinkRole.OPERATOR}
SHARE = {LINE: 5_760 / 2, NETWORK: 25_000.0}
"""Bytes a second that answers must stay below: no more than half a line."""
STATIONS = [(255, number) for number in range(188, 200)] + [(1, 154), (254, 1)]
STRANGERS = {
    LINE: [(42, 1), (0, 0), OURS, (2, 195)],
    NETWORK: [(42, 1), (0, 0), OURS, (2, 195), (1, 1)],
}
CYCLE_S = 0.02
PER_CYCLE = (0, 0, 0, 1, 5, 50, 300)
"""Numbers of packets in a cycle, each for a second: lists and files are sent in between."""
MOST_MB = 2.0
_FTP = id_of("FILE_TRANSFER_PROTOCOL")
_SET_INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_GET_INTERVAL = int(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)
_COMMAND_AT = 28
"""Place of the command's number in the payload of COMMAND_LONG."""
_COMMANDS = (*MESSAGE_COMMANDS, int(mavlink.MAV_CMD_DO_SET_MODE), 0xFFFF)
_NUMBERS = (*map(float, map(id_of, PUBLISHED)), -1.0, 0.5, 2.0**24, 1e30, math.nan, math.inf)
"""Numbers of messages, and what is none."""
_INTERVALS_US = (0.0, -1.0, 1.0, 5e5, 1e7, 2.1e9, 2.0**31, 3e38, -2.0, math.nan, math.inf, -3e38)
_PATHS = [*(f"/{name}".encode() for name in metadata_files(195)), b"/", b"", b"/etc/passwd", b"@P"]


@dataclass
class Report:
    """Received packets and findings."""

    given: int = 0
    cycles: int = 0
    costs_us: Counter[int] = field(default_factory=Counter)
    """Number of packets by their processor time."""
    answers: Counter[str] = field(default_factory=Counter)
    bytes_per_s: dict[str, float] = field(default_factory=dict)
    memory_mb: list[float] = field(default_factory=list)
    found: list[str] = field(default_factory=list)

    def cost_us(self, fraction: float) -> int:
        """Processor time that this fraction of the packets did not exceed."""
        left = fraction * self.given
        for cost, count in sorted(self.costs_us.items()):
            left -= count
            if left <= 0:
                return cost
        return max(self.costs_us)

    def __str__(self) -> str:
        answered = ", ".join(f"{name} {count}" for name, count in (+self.answers).most_common())
        rates = ", ".join(f"{link} {rate:.0f} B/s" for link, rate in self.bytes_per_s.items())
        memory = " ".join(f"{value:.1f}" for value in self.memory_mb)
        costs = ", ".join(
            f"{name} {self.cost_us(fraction)}"
            for name, fraction in (("median", 0.5), ("p99.99", 0.9999), ("greatest", 1.0))
        )
        lines = [
            f"{self.given} packets in {self.cycles} cycles; answers: {answered}",
            f"answers took {rates}; memory {memory} MB",
            f"processor time of a packet: {costs} us",
            f"found: {len(self.found)}",
            *self.found[:10],
        ]
        return "\n".join(lines) + "\n"


def new_session() -> Session:
    """A session as in the service, with parameters."""
    return Session(links=LINKS, parameters=PARAMETERS)


class Flood:
    """Hostile packets: of each message of the services, of the file transfer most."""

    def __init__(self, seed: int) -> None:
        self.pick = Random(f"services {seed}")
        self.shapes = [
            shape_of(mavlink.mavlink_map[number])
            for number in sorted(ComponentServices.MESSAGE_IDS)
        ]
        self.file_transfer = mavlink.mavlink_map[_FTP]
        self.command_long = mavlink.mavlink_map[id_of("COMMAND_LONG")]
        self.before: list[bytes] = [bytes(254)]
        self.then: tuple[str, bytes] | None = None
        """Packet that comes next: a request for the interval that the last one has set."""

    def path(self) -> tuple[GeodeticPoint, ...]:
        """A planned path, to be downloaded as a mission."""
        pick = self.pick
        return tuple(
            GeodeticPoint(
                latitude_deg=pick.uniform(-90.0, 90.0),
                longitude_deg=pick.uniform(-180.0, 180.0),
                altitude_amsl_m=pick.uniform(-100.0, 9000.0),
            )
            for _ in range(pick.randrange(60))
        )

    def packet(self) -> tuple[str, bytes]:
        """A link and a packet."""
        pick = self.pick
        if self.then is not None:
            packet, self.then = self.then, None
            return packet
        link = pick.choice((LINE, NETWORK))
        source = pick.choice(STATIONS if pick.random() < 0.9 else STRANGERS[link])
        kind = pick.random()
        if kind < 0.5:
            message_class, payload = self.file_transfer, self._file_request()
        elif kind < 0.65:
            message_class, payload = self.command_long, self._command()
            (command,) = struct.unpack_from("<H", payload, _COMMAND_AT)
            if command == _SET_INTERVAL:
                asked = bytearray(payload)
                struct.pack_into("<H", asked, _COMMAND_AT, _GET_INTERVAL)
                packet = frame(message_class, bytes(asked), source, pick.randrange(256))
                self.then = (link, packet)
        else:
            shape = pick.choice(self.shapes)
            message_class, payload = shape.message_class, hostile_payload(pick, shape, None, 1.0)
        return link, frame(message_class, payload, source, pick.randrange(256))

    def _command(self) -> bytes:
        """Payload of a command about messages, with any numbers."""
        pick = self.pick
        number = pick.choice(_NUMBERS) if pick.random() < 0.7 else pick.uniform(-1.0, 2.0**24)
        interval = pick.choice(_INTERVALS_US)
        target = pick.choice((OURS, OURS, OURS, (0, 0), (1, 0), (1, 1)))
        command = _SET_INTERVAL if pick.random() < 0.5 else pick.choice(_COMMANDS)
        return struct.pack("<7fHBBB", number, interval, *[0.0] * 5, command, *target, 0)

    def _file_request(self) -> bytes:
        """Payload of a request; some are those before, as they were or with a byte changed."""
        pick = self.pick
        if pick.random() < 0.3:
            payload = bytearray(pick.choice(self.before))
            if pick.random() < 0.7:
                payload[pick.randrange(len(payload))] = pick.randrange(256)
            return bytes(payload)
        data = pick.choice(_PATHS) if pick.random() < 0.8 else pick.randbytes(pick.randrange(240))
        header = struct.pack(
            "<HBBBBBBI",
            pick.randrange(8) if pick.random() < 0.7 else pick.randrange(1 << 16),
            pick.choice((0, 0, 0, 0, 1, 255)),
            pick.choice((3, 4, 5, 15, 1, 2, 14)) if pick.random() < 0.9 else pick.randrange(256),
            pick.choice((len(data), 80, 239, 0, 240, 255)),
            pick.randrange(256),
            pick.randrange(2),
            0,
            pick.choice((0, 0, 1, 100, 5000, 10**6, (1 << 32) - 1)),
        )
        target = bytes((0, *pick.choice((OURS, OURS, OURS, OURS, (0, 0), (1, 0), (1, 1)))))
        payload = (target + header + data).ljust(254, b"\0")
        self.before = [*self.before[-31:], payload]
        return payload


def run(count: int, seed: int = 0) -> Report:
    """Feeds so many packets."""
    report, flood = Report(), Flood(seed)
    flooded, calm = new_session(), new_session()
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 209, 6 << 16, 4, 3)
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    answered = dict.fromkeys(LINKS, 0)
    # As in the service: cycles do not garbage-collect the objects from before the start.
    gc.collect()
    gc.freeze()
    while report.given < count:
        before = report.given
        if report.cycles % 50 == 0:
            packets = flood.pick.choice(PER_CYCLE)
            path = flood.path()
            for session in (flooded, calm):
                session.services.path.offer(path)
        report.cycles += 1
        now_s = report.cycles * CYCLE_S
        if report.cycles % 50 == 1:
            packet = bytes(heartbeat.pack(packer))
            packer.seq = (packer.seq + 1) & 0xFF
            for session in (flooded, calm):
                session.receive(LINE, packet, now_s)
        for _ in range(packets):
            _feed(flooded, *flood.packet(), now_s, report)
        _cycle(flooded, calm, now_s, report)
        for session, sign in ((flooded, 1), (calm, -1)):
            for link, packet in session.data_to_send():
                number = packet_header(packet)[0]
                report.answers[mavlink.mavlink_map[number].msgname] += sign
                answered[link] += sign * len(packet) * (number not in CLOCK_IDS)
        if report.given * 10 // count != before * 10 // count:
            report.memory_mb.append(anonymous_mb())
    report.bytes_per_s = {link: sent / now_s for link, sent in answered.items()}
    for link, rate in report.bytes_per_s.items():
        if rate > SHARE[link]:
            report.found.append(f"{link}: answers take {rate:.0f} B/s")
    if report.memory_mb[-1] - report.memory_mb[0] > MOST_MB:
        report.found.append(f"memory grew from {report.memory_mb[0]:.1f} MB")
    return report


def _feed(session: Session, link: str, packet: bytes, now_s: float, report: Report) -> None:
    began_ns = time.thread_time_ns()
    try:
        session.receive(link, packet, now_s)
    except Exception:  # noqa: BLE001 - any is a finding
        report.found.append(f"{packet.hex()}: {traceback.format_exc(limit=-2)}")
    report.costs_us[(time.thread_time_ns() - began_ns) // 1000] += 1
    report.given += 1


def _cycle(flooded: Session, calm: Session, now_s: float, report: Report) -> None:
    """A cycle of both sessions, to the packets that command motion."""
    motion = []
    for session in (flooded, calm):
        session.tick(now_s, SystemStatus.ACTIVE)
        if session.autopilot is not None:
            session.send_setpoint((now_s, 0.0, -5.0), (1.0, 0.0, 0.0), 0.0, now_s)
        # Without sequence number and checksum: answers have taken numbers.
        motion.append([(link, item[5:-2]) for link, item in session.control_to_send()])
        session.events_received()
        session.received_packets()
    if motion[0] != motion[1]:
        report.found.append(f"cycle {report.cycles}: motion differs")
