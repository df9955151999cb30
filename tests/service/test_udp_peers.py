"""The service as a process on a UDP port that anybody can reach."""

from __future__ import annotations

import contextlib
import socket

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.processes import companion

from ..mavlink.peer import Peer

FLOOD = 300


class Place:
    """A socket that sends to the service's port, and what has come back."""

    def __init__(self, stack, port, peer=None):
        self._socket = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self._socket.connect(("127.0.0.1", port))
        self.peer = peer
        self._codec = mavlink.MAVLink(None)
        self._codec.robust_parsing = True
        self.messages = []
        """All that have come."""

    def send(self, data):
        # Before the service listens, the kernel refuses the packet and reports it at the next call.
        with contextlib.suppress(ConnectionRefusedError):
            self._socket.send(data)

    def until_a_heartbeat(self, beat):
        """Beats until the service's next heartbeat comes."""
        self.look()
        seen = len(self.messages)
        while not any(m.get_type() == "HEARTBEAT" for m in self.messages[seen:]):
            self.send(beat())
            with contextlib.suppress(ConnectionRefusedError, TimeoutError):
                self._socket.settimeout(0.2)
                self._take(self._socket.recv(4096))

    def look(self):
        """Takes what has come; whether there was anything, now or before."""
        self._socket.setblocking(False)
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                self._take(self._socket.recv(4096))
        return bool(self.messages)

    def _take(self, data):
        self.messages += self._codec.parse_buffer(data) or []

    def texts(self):
        return [m.text for m in self.messages if m.get_type() == "STATUSTEXT"]


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.slow
def test_an_unknown_sender_receives_nothing_and_300_addresses_replace_no_known_peer(port):
    with (
        contextlib.ExitStack() as stack,
        companion("--connect", f"udp:127.0.0.1:{port}"),
    ):
        autopilot = Place(stack, port, Peer(1, 1))
        station = Place(stack, port, Peer(255, 190))
        autopilot.until_a_heartbeat(autopilot.peer.heartbeat)
        station.until_a_heartbeat(station.peer.ground_heartbeat)
        byte, other = Place(stack, port), Place(stack, port, Peer(42, 1))
        byte.send(b"\x00")
        byte.send(b"\xfd")
        other.send(other.peer.ground_heartbeat())
        flood = [Place(stack, port, Peer(255, 190)) for _ in range(FLOOD)]
        for place in flood:
            place.send(place.peer.ground_heartbeat())
        forger = Place(stack, port, Peer(1, 1))
        for _ in range(2):
            # A packet in the same cycle as the flood may be dropped with the flood.
            forger.send(forger.peer.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA))
            autopilot.until_a_heartbeat(autopilot.peer.heartbeat)
            station.until_a_heartbeat(station.peer.ground_heartbeat)
        assert not any(place.look() for place in (byte, other, forger))
        assert 1 <= sum(place.look() for place in flood) <= 6
        assert "MOAR: autopilot also at 127.0.0.1, ignored" in station.texts()
        assert "MOAR: system 42 may not command, not served" in station.texts()
        assert not any("two autopilots" in text for text in station.texts())
