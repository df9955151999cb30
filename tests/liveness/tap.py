"""Packets from the service to the autopilot, captured with the kernel's times."""

from __future__ import annotations

import contextlib
import math
import selectors
import socket
import struct
import threading
import time
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as mavlink

SO_TIMESTAMPNS = 35
"""Linux: the time at which a datagram arrived, which on loopback is the time it was sent."""
OLDEST_S = 0.2
"""No setpoint leaves later than this after its cycle began."""


def clock_s():
    """The service's clock."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """A sent setpoint. cycle_s: begin of its cycle."""

    sent_s: float
    cycle_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]

    @property
    def age_s(self):
        return self.sent_s - self.cycle_s

    @property
    def speed_mps(self):
        return math.hypot(*self.velocity_ned_mps)


class Tap:
    """Forwards datagrams between the autopilot, which sends to `port`, and the service."""

    def __init__(self, service_port):
        self._service = ("127.0.0.1", service_port)
        self._autopilot = None
        self._inner, self._outer = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
        for item in (self._inner, self._outer):
            item.bind(("127.0.0.1", 0))
        self._outer.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.port = self._inner.getsockname()[1]
        self._codec = mavlink.MAVLink(None)
        self._codec.robust_parsing = True
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self.setpoints = []
        self._thread.start()

    def since(self, time_s):
        """Setpoints sent after a time."""
        return [item for item in list(self.setpoints) if item.sent_s > time_s]

    def close(self):
        self._ending.set()
        self._thread.join()
        self._inner.close()
        self._outer.close()

    def _carry(self):
        with selectors.DefaultSelector() as selector:
            for item in (self._inner, self._outer):
                selector.register(item, selectors.EVENT_READ)
            while not self._ending.is_set():
                for key, _ in selector.select(0.1):
                    with contextlib.suppress(ConnectionError):
                        self._carry_one(key.fileobj)

    def _carry_one(self, source):
        if source is self._inner:
            data, self._autopilot = source.recvfrom(65536)
            self._outer.sendto(data, self._service)
            return
        data, stamps, _, _ = source.recvmsg(65536, 256)
        self._note(data, stamps)
        if self._autopilot is not None:
            self._inner.sendto(data, self._autopilot)

    def _note(self, data, stamps):
        (stamp,) = (value for _, kind, value in stamps if kind == SO_TIMESTAMPNS)
        seconds, nanoseconds = struct.unpack("qq", stamp)
        sent_s = seconds + nanoseconds * 1e-9 - time.time() + clock_s()
        for message in self._codec.parse_buffer(data) or []:
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints.append(
                    Setpoint(
                        sent_s=sent_s,
                        cycle_s=message.time_boot_ms * 1e-3,
                        position_ned_m=(message.x, message.y, message.z),
                        velocity_ned_mps=(message.vx, message.vy, message.vz),
                    )
                )
