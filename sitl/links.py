"""Links between the autopilot and the world, and the forwarding between them.

Bytes in, decoded messages out; payloads in, framed bytes out. The autopilot's manner decides which
link gets which message.
"""

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from pymavlink.dialects.v20 import all as mavlink

from sitl.signing import SignOptions, sign
from sitl.wire import Layout, frame, packet_header

SYSTEM: Final = 1
AUTOPILOT_COMPONENT: Final = 1
RADIO_SYSTEM: Final = 51
RADIO_COMPONENT: Final = 68
_MAX_QUEUE_BYTES: Final = 4_000_000
"""A link that is not drained keeps the last of its data."""
Packet = TypeVar("Packet")


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkOptions:
    """One link: its name, and its purpose (`onboard`, or `normal`: a ground station).

    signing: of the packets on it; None: they are not signed.
    """

    name: str
    profile: str = "onboard"
    signing: SignOptions | None = None


class DelayedPackets(Generic[Packet]):
    """Packets under way in one direction; those with less delay overtake others."""

    def __init__(self) -> None:
        """Start with no packet under way."""
        self._packets: list[tuple[float, int, Packet]] = []
        self._count = 0

    def send(self, packet: Packet, due_us: float) -> None:
        """Send a packet that arrives at `due_us`."""
        self._count += 1
        heapq.heappush(self._packets, (due_us, self._count, packet))

    def arrived(self, now_us: int) -> list[Packet]:
        """Return and remove the packets that have arrived."""
        arrived = []
        while self._packets and self._packets[0][0] <= now_us:
            arrived.append(heapq.heappop(self._packets)[2])
        return arrived


class Link:
    """One link: parser, sequence numbers, senders received on it, bytes waiting to be sent."""

    def __init__(self, options: LinkOptions, link_id: int = 0) -> None:
        """Start without a sender. link_id: of its signatures."""
        self.name = options.name
        self.profile = options.profile
        self.senders: set[tuple[int, int]] = set()
        self.sender_systems: set[int] = set()
        self.ground_station_received = False
        self.out: list[bytes] = []
        self.sent = 0
        self.received = 0
        self.sent_bytes = 0
        self.received_bytes = 0
        self.loss_fraction = 0.0
        self.from_autopilot = DelayedPackets[bytes]()
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._signed = options.signing is not None
        if options.signing is not None:
            options.signing.start(self._parser, link_id)
        self._seq = 0
        self._radio_seq = 0
        self._queued = 0

    def parse(self, data: bytes) -> list[Any]:
        """Return the whole messages that `data` completes; broken ones are dropped."""
        self.received_bytes += len(data)
        messages = []
        for message in self._parser.parse_buffer(data) or []:
            if message.get_type() == "BAD_DATA":
                continue
            self.received += 1
            _, system, component = packet_header(message.get_msgbuf())
            self.senders.add((system, component))
            self.sender_systems.add(system)
            if message.get_type() == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_GCS:
                self.ground_station_received = True
            messages.append(message)
        return messages

    def send(self, layout: Layout, payload: bytes) -> None:
        """Frame a payload as the autopilot's own packet."""
        packet = frame(
            layout,
            payload,
            seq=self._seq,
            system=SYSTEM,
            component=AUTOPILOT_COMPONENT,
            signed=self._signed,
        )
        if self._signed:
            packet = sign(packet, self._parser)
        self._seq = (self._seq + 1) & 0xFF
        self.put(packet)

    def send_as_radio(self, layout: Layout, payload: bytes) -> None:
        """Frame a payload as a telemetry radio's (system 51, component 68)."""
        packet = frame(
            layout, payload, seq=self._radio_seq, system=RADIO_SYSTEM, component=RADIO_COMPONENT
        )
        self._radio_seq = (self._radio_seq + 1) & 0xFF
        self.put(packet)

    def put(self, packet: bytes) -> None:
        """Queue a whole packet as it is."""
        self.sent += 1
        self.sent_bytes += len(packet)
        self._queued += len(packet)
        if self._queued > _MAX_QUEUE_BYTES:
            self.out.clear()
            self._queued = len(packet)
        self.out.append(packet)

    def drain(self, generator: random.Random) -> list[bytes]:
        """Return and clear the waiting packets, without those that a bad link loses."""
        packets, self.out = self.out, []
        self._queued = 0
        if self.loss_fraction > 0.0:
            packets = [p for p in packets if generator.random() >= self.loss_fraction]
        return packets


class Router:
    """All links of one autopilot."""

    def __init__(self, links: list[Link]) -> None:
        """Take the links."""
        self.links = {link.name: link for link in links}

    def forward(self, source: Link, message: Any, wanted: Callable[[Link], bool]) -> bool:
        """Pass a message on to the other links that get it; True when there was any."""
        targets = [link for link in self.links.values() if link is not source and wanted(link)]
        raw = bytes(message.get_msgbuf())
        for link in targets:
            link.put(raw)
        return bool(targets)
