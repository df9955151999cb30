"""A flight in lockstep over a serial line, whose bytes take their time in both directions."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from itertools import pairwise

from moar_companion.mavlink.urls import line_bytes_per_s
from sitl.wire import packet_header, packets

from .lockstep import Lockstep
from .operator import Manner

URL = "serial:/dev/serial/by-id/usb-FTDI_FT232R-if00-port0:57600"
BYTES_PER_S = line_bytes_per_s(URL)
BUFFER_BYTES = 1024
"""Size of the autopilot's transmit buffer; a packet that does not fit is lost."""


class Line:
    """One direction of a serial line."""

    def __init__(self, buffer_bytes=None):
        self._buffer_bytes = buffer_bytes
        self._idle_s = 0.0
        self._packets = deque()
        self.clear()

    def clear(self):
        """Forgets what was counted."""
        self.bytes = Counter()
        """Bytes by message id."""
        self.arrivals_s = defaultdict(list)
        """Times of arrival by message id."""
        self.waits_s = defaultdict(list)
        """Times behind other packets, by message id."""
        self.lost = 0

    def send(self, packet, now_s):
        begin_s = max(self._idle_s, now_s)
        waiting_bytes = (begin_s - now_s) * BYTES_PER_S + len(packet)
        if self._buffer_bytes is not None and waiting_bytes > self._buffer_bytes:
            self.lost += 1
            return
        message_id = packet_header(packet)[0]
        self.bytes[message_id] += len(packet)
        self.waits_s[message_id].append(begin_s - now_s)
        self._idle_s = begin_s + len(packet) / BYTES_PER_S
        self._packets.append((self._idle_s, message_id, packet))

    def arrived(self, now_s):
        """Removes and returns the packets whose last byte has arrived."""
        arrived = []
        while self._packets and self._packets[0][0] <= now_s:
            time_s, message_id, packet = self._packets.popleft()
            self.arrivals_s[message_id].append(time_s)
            arrived.append(packet)
        return arrived

    def longest_gap_s(self, message_id):
        """Longest time between two arrivals of a message."""
        return max(after - before for before, after in pairwise(self.arrivals_s[message_id]))


class SlowLine(Lockstep):
    """The companion on a UART of 57600 baud.

    PX4 lowers its rates to half of the line's, as with MAV_1_RATE 0. A packet arrives at the first
    step after its last byte.
    """

    link_url = URL

    def __init__(self, *, manner, **options):
        super().__init__(manner=manner, **options)
        self.down, self.up = Line(BUFFER_BYTES), Line()
        self._limit_rates()

    def start_in_the_air(self, height_m=3.0):
        self.operator.silent = False
        super().start_in_the_air(height_m)

    def move(self):
        self._limit_rates()
        for data in super().move():
            for packet in packets(data):
                self.down.send(packet, self.now_s)
        return self.down.arrived(self.now_s)

    def step(self):
        super().step()
        for packet in self.up.arrived(self.now_s):
            super().report(packet)

    def report(self, data):
        for packet in packets(data):
            self.up.send(packet, self.now_s)

    def _limit_rates(self):
        if self.operator.manner is Manner.PX4:
            self.autopilot.conditions.link_rate_bytes_per_s = BYTES_PER_S / 2
