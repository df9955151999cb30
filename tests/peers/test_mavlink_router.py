"""One UART between companion and ground station, by mavlink-router with the shipped configuration.

It is no package of Debian: skipped where `mavlink-routerd` is not on the path.
"""

from __future__ import annotations

import contextlib
import math
import os
import pty
import select
import shutil
import socket
import subprocess
import threading
import time
import tty
from collections import Counter
from functools import partial

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.mission_states import MissionState
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.wire import packet_header

from ..flights.operator import INSPECTION, Manner
from ..processes import ROOT, companion, simulator
from ..real_time import real_time

PROGRAM = shutil.which("mavlink-routerd")
SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
X500 = shipped_configs() / "vehicles" / "x500.yaml"
COMPANION, AUTOPILOT, GROUND = (1, 195), (1, 1), (255, 190)
PARAMETERS = ("--param", "COM_OBL_RC_ACT=5", "--param", "COM_OF_LOSS_T=0.5")
ACCEPTED = mavlink.MAV_RESULT_ACCEPTED


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def uart(port):
    """Name of a serial device whose other end is the simulator's TCP port."""
    far, near = pty.openpty()
    tty.setraw(near)
    with socket.create_connection(("127.0.0.1", port)) as wire:
        ended = threading.Event()

        def carry():
            while not ended.is_set():
                readable, _, _ = select.select([far, wire], [], [], 0.1)
                if far in readable:
                    wire.sendall(os.read(far, 4096))
                if wire in readable:
                    os.write(far, wire.recv(4096))

        carrying = threading.Thread(target=carry, daemon=True)
        carrying.start()
        try:
            yield os.ttyname(near)
        finally:
            ended.set()
            carrying.join()
            os.close(near)
            os.close(far)


@contextlib.contextmanager
def router(folder, device, companion_port, ground_port):
    """The router with the shipped configuration, on this device and these ports."""
    text = (ROOT / "systemd" / "mavlink-router.conf").read_text()
    for shipped, here in (
        ("/dev/ttyTHS1", device),
        ("Port = 14540", f"Port = {companion_port}"),
        ("192.168.1.10", "127.0.0.1"),
        ("Port = 14550", f"Port = {ground_port}"),
    ):
        assert text.count(shipped) == 1
        text = text.replace(shipped, here)
    configuration = folder / "main.conf"
    configuration.write_text(text)
    with subprocess.Popen([PROGRAM, "-c", configuration], stderr=subprocess.PIPE) as running:
        try:
            yield running
        finally:
            running.kill()


class GroundStation:
    """A ground station by UDP, which counts what it receives."""

    def __init__(self, port, altitude_m):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(0.1)
        self._codec = mavlink.MAVLink(None, srcSystem=GROUND[0], srcComponent=GROUND[1])
        self._codec.robust_parsing = True
        self._router = None
        self.altitude_m = altitude_m
        """Altitude AMSL of the autopilot's home."""
        self._beat_s = 0.0
        self.counts = Counter()
        """Packets by message id and source."""
        self.messages = []

    def close(self):
        self._socket.close()

    def run_until(self, condition, timeout_s=30.0):
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, [m.text for m in self.of("STATUSTEXT")][-8:]
            self.step()

    def run_for(self, seconds):
        end_s = time.monotonic() + seconds
        self.run_until(lambda: time.monotonic() >= end_s, seconds + 1.0)

    def step(self):
        with contextlib.suppress(TimeoutError):
            data, self._router = self._socket.recvfrom(65536)
            for message in self._codec.parse_buffer(data) or []:
                if message.get_type() == "BAD_DATA":
                    continue
                message_id, *source = packet_header(message.get_msgbuf())
                self.counts[message_id, tuple(source)] += 1
                self.messages.append(message)
        if time.monotonic() >= self._beat_s + 1.0 and self._router is not None:
            self._beat_s = time.monotonic()
            self.send(self._codec.heartbeat_encode(6, 8, 0, 0, 4))

    def send(self, message):
        self._socket.sendto(message.pack(self._codec), self._router)
        self._codec.seq = (self._codec.seq + 1) % 256

    def of(self, name):
        return [message for message in self.messages if message.get_type() == name]

    def result(self, component, command, *parameters):
        """Sends a command; returns the first answer of that component that is not IN_PROGRESS."""
        before = len(self.messages)
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        self.send(self._codec.command_long_encode(1, component, command, 0, *padded))
        results = []

        def answered():
            results[:] = [
                message.result
                for message in self.messages[before:]
                if message.get_type() == "COMMAND_ACK"
                and (message.get_srcComponent(), message.command) == (component, command)
                and message.result != mavlink.MAV_RESULT_IN_PROGRESS
            ]
            return results

        self.run_until(answered)
        return results[0]

    def take_off(self):
        self.run_until(lambda: self.result(1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == ACCEPTED)
        altitude_m = self.altitude_m + 3.0
        nan = math.nan
        takeoff = mavlink.MAV_CMD_NAV_TAKEOFF
        assert self.result(1, takeoff, 0, 0, 0, nan, nan, nan, altitude_m) == ACCEPTED
        self.run_for(12.0)

    def mode(self, word):
        numbers = Manner.PX4.modes[word][0]
        assert self.result(1, mavlink.MAV_CMD_DO_SET_MODE, 1, *numbers) == ACCEPTED

    @property
    def state(self):
        """The companion's, by its heartbeat; None before the first."""
        beats = [m for m in self.of("HEARTBEAT") if m.get_srcComponent() == COMPANION[1]]
        return list(MissionState)[beats[-1].custom_mode].value if beats else None

    def reads(self, words):
        return any(words in message.text for message in self.of("STATUSTEXT"))


@contextlib.contextmanager
def shared_uart(folder):
    """The ground station beside the service, on one UART of the simulated autopilot."""
    home = Site.load(SITE).frame.to_geodetic((Site.load(SITE).start_m[0], 0.0, 0.0))
    place = f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"
    wire, inside, outside = free_port(socket.SOCK_STREAM), free_port(), free_port()
    link = ("--link", f"companion=tcpin:127.0.0.1:{wire}")
    simulated = ("--home", place, *PARAMETERS, *link)
    connected = ("--connect", f"udpout:127.0.0.1:{inside}", "--vehicle", X500, "--site", SITE)
    with contextlib.ExitStack() as stack:
        stack.enter_context(simulator(*simulated))
        device = stack.enter_context(uart(wire))
        routing = stack.enter_context(contextlib.ExitStack())
        start = partial(router, folder, device, inside, outside)
        routing.enter_context(start())
        stack.enter_context(companion(*connected))
        station = GroundStation(outside, home.altitude_amsl_m)
        station.restart_router = lambda: (routing.close(), routing.enter_context(start()))
        yield stack.enter_context(contextlib.closing(station))


@pytest.mark.skipif(PROGRAM is None, reason="mavlink-routerd is not installed")
@real_time
def test_companion_and_ground_station_share_one_uart(tmp_path):
    """An order, a flight, a takeover; no packet comes twice, setpoints reach the UART alone."""
    with shared_uart(tmp_path) as station:
        heartbeats = [(mavlink.MAVLINK_MSG_ID_HEARTBEAT, ids) for ids in (AUTOPILOT, COMPANION)]
        station.run_until(lambda: all(station.counts[key] for key in heartbeats))
        station.take_off()
        station.run_until(
            lambda: station.result(195, mavlink.MAV_CMD_USER_1, INSPECTION) == ACCEPTED, 60.0
        )
        station.mode("ours")
        station.run_until(lambda: station.reads("MOAR: flying inspection"))

        station.counts.clear()
        station.run_for(5.0)
        assert [station.counts[key] for key in heartbeats] == [pytest.approx(5, abs=2)] * 2
        setpoint_id = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
        assert station.counts[setpoint_id, COMPANION] == 0

        station.mode("hold")
        station.run_until(lambda: station.state == "overridden")

        station.restart_router()
        station.messages.clear()
        station.run_until(lambda: station.state == "overridden")
        assert station.result(195, mavlink.MAV_CMD_USER_1, INSPECTION) == ACCEPTED
