"""The wire between autopilot and service: a tap that loses, delays and reorders datagrams."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import random
import selectors
import time

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.service.priority import in_real_time
from tests.liveness.tap import Tap, clock_s

_POLL_S = 0.01
_POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
_POSITION_ID = _POSITION.to_bytes(3, "little")


class Link(Tap):
    """A tap whose datagrams may be lost or late; late ones overtake each other.

    Delays are in simulator seconds, `speed` of them in a real second. The same seed draws the
    same losses and delays. Its thread is in real time where that is permitted: a wire has no load.
    """

    def __init__(self, service_port, *, speed=1.0, seed=1):
        self._speed = speed
        self._random = random.Random(seed)
        self._loss = 0.0
        self._delay_s = (0.0, 0.0)
        self._late = []
        self._numbers = itertools.count()
        self._positions = mavlink.MAVLink(None)
        self._positions.robust_parsing = True
        self.positions = []
        """(arrival, time_boot_ms in seconds) of each LOCAL_POSITION_NED of the autopilot; simulator
        seconds, the arrival by `clock_s`."""
        super().__init__(service_port)

    def impair(self, loss, least_delay_s, most_delay_s):
        """Set loss and delay for both directions."""
        self._loss, self._delay_s = loss, (least_delay_s, most_delay_s)

    def _carry(self):
        with in_real_time(), selectors.DefaultSelector() as selector:
            for item in (self._inner, self._outer):
                selector.register(item, selectors.EVENT_READ)
            while not self._ending.is_set():
                for key, _ in selector.select(self._wait_s()):
                    with contextlib.suppress(ConnectionError):
                        self._carry_one(key.fileobj)
                while self._late and self._late[0][0] <= time.monotonic():
                    _, _, inward, data = heapq.heappop(self._late)
                    with contextlib.suppress(ConnectionError):
                        self._send(inward, data)

    def _wait_s(self):
        if not self._late:
            return _POLL_S
        return min(_POLL_S, max(0.0, self._late[0][0] - time.monotonic()))

    def _carry_one(self, source):
        inward = source is self._inner
        if inward:
            data, self._autopilot = source.recvfrom(65536)
            self._note_position(data)
        else:
            data, stamps, _, _ = source.recvmsg(65536, 256)
            self._note(data, stamps)
        if self._random.random() < self._loss:
            return
        delay_s = self._random.uniform(*self._delay_s) / self._speed
        if delay_s > 0.0:
            due_s = time.monotonic() + delay_s
            heapq.heappush(self._late, (due_s, next(self._numbers), inward, data))
        else:
            self._send(inward, data)

    def _note_position(self, data):
        if _POSITION_ID not in data:
            return
        for message in self._positions.parse_buffer(data) or []:
            if message.get_msgId() == _POSITION:
                self.positions.append((clock_s() * self._speed, message.time_boot_ms * 1e-3))

    def _send(self, inward, data):
        if inward:
            self._outer.sendto(data, self._service)
        elif self._autopilot is not None:
            self._inner.sendto(data, self._autopilot)
