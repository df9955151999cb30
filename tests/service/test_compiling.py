"""The first start: the service sends while its planner is compiled, and orders wait."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.companion import Companion
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.service import compiling
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.processes import companion as process

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE = shipped_configs() / "vehicles" / "linedrone_flight.yaml"
LINK = CompanionConfig(vehicle=VEHICLE).links[0].url
ACCEPTED, TEMPORARILY_REJECTED, DENIED, IN_PROGRESS = 0, 1, 2, 5
INSPECTION, RELEASE = 1, 4


class Station:
    """A ground station on the companion's link."""

    def __init__(self):
        self.companion = Companion(
            CompanionConfig(vehicle=VEHICLE), Vehicle.load(VEHICLE), None, before=None
        )
        self.now_s = 100.0
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def order(self, mission):
        message = mavlink.MAVLink_command_long_message(1, 195, 31010, 0, mission, -1, *[0.0] * 5)
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self.companion.receive(LINK, data, self.now_s)

    def run(self, seconds):
        """The answers and texts of so long."""
        received = []
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            self.companion.tick(self.now_s)
            for _, data in self.companion.data_to_send():
                received += self._codec.parse_buffer(data) or []
        answers = [item.result for item in received if item.get_type() == "COMMAND_ACK"]
        texts = "".join(item.text for item in received if item.get_type() == "STATUSTEXT")
        return answers, texts


def ready():
    site = Site.load(SITE)
    return SiteMaps(site=site, maps=Planner(site, Vehicle.load(VEHICLE)).maps)


def test_an_order_is_put_off_while_the_planner_is_compiled():
    station = Station()
    station.companion.await_planner("compiling planner: 3 of 11")
    station.order(INSPECTION)
    answers, texts = station.run(1.0)
    assert answers == [TEMPORARILY_REJECTED]
    assert "MOAR: compiling planner: 3 of 11" in texts
    station.companion.take_ground(ready())
    _, texts = station.run(1.0)
    assert "MOAR: the planner is ready" in texts
    assert "compiling" not in texts


def test_an_order_waits_for_a_planner_that_is_only_loaded():
    station = Station()
    station.companion.await_planner()
    station.order(INSPECTION)
    assert station.run(0.5) == ([IN_PROGRESS], "")
    station.companion.take_ground(ready())
    answers, texts = station.run(1.0)
    assert answers == [TEMPORARILY_REJECTED]
    assert "no autopilot is received" in texts


def test_an_order_that_ends_motion_does_not_wait_for_the_planner():
    station = Station()
    station.companion.await_planner("compiling planner: 3 of 11")
    station.order(RELEASE)
    answers, texts = station.run(0.5)
    assert len(answers) == 1
    assert "rejected: compiling" not in texts


def test_an_order_that_ends_motion_cancels_waiting_orders():
    station = Station()
    station.companion.await_planner()
    station.order(INSPECTION)
    station.run(0.5)
    station.order(RELEASE)
    assert station.run(0.5)[0] == [ACCEPTED]  # of two commands of one number the newer is answered
    station.companion.take_ground(ready())
    assert station.run(2.0)[0] == []


class Uncached:
    """A kernel that is not in the cache. has_cache: whether it could be kept there."""

    is_helper = is_cached = False

    def __init__(self, *, has_cache):
        self.py_func = ready
        self.has_cache = has_cache
        self.loaded = 0

    @property
    def entry(self):
        self.loaded += 1


def test_without_a_writable_cache_no_other_process_compiles(monkeypatch):
    kernel = Uncached(has_cache=False)
    monkeypatch.setattr(compiling, "KERNELS", [kernel])
    started = []
    monkeypatch.setattr(compiling.subprocess, "Popen", lambda *a, **_: started.append(a))
    reported = []
    assert compiling.make_ready(lambda *counts: reported.append(counts), threading.Event())
    assert (started, reported, kernel.loaded) == ([], [], 1)


def test_if_a_process_cannot_be_started_the_rest_end_and_the_service_compiles(monkeypatch, caplog):
    kernels = [Uncached(has_cache=True), Uncached(has_cache=True)]
    monkeypatch.setattr(compiling, "KERNELS", kernels)
    monkeypatch.setattr(compiling.os, "sched_getaffinity", lambda _: {0, 1})
    start, started = subprocess.Popen, []

    def start_one(*_, **__):
        if started:
            raise OSError(12, "Cannot allocate memory")
        started.append(start([sys.executable, "-c", "pass"]))
        return started[0]

    monkeypatch.setattr(compiling.subprocess, "Popen", start_one)
    assert compiling.make_ready(lambda *_: None, threading.Event())
    assert [process.returncode is None for process in started] == [False]
    assert [kernel.loaded for kernel in kernels] == [1, 1]
    (record,) = caplog.records
    assert record.getMessage().startswith("no process to compile the planner in: ")


@pytest.mark.slow
def test_at_the_first_start_the_service_sends_at_once_and_reports_the_progress(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as item:
        item.bind(("127.0.0.1", 0))
        item.settimeout(30)
        began = time.monotonic()
        with process(
            *("--connect", f"udpout:127.0.0.1:{item.getsockname()[1]}", "--site", SITE),
            environment={"NUMBA_CACHE_DIR": str(tmp_path)},
        ) as running:
            codec = mavlink.MAVLink(None)
            first_s, texts = None, ""
            while "planner is ready" not in texts:
                for message in codec.parse_buffer(item.recv(4096)) or []:
                    first_s = first_s or time.monotonic() - began
                    if message.get_type() == "STATUSTEXT":
                        texts += message.text
            ready_s = time.monotonic() - began
            running.terminate()
            assert running.wait(10) == 0
    assert "compiling planner: 0 of" in texts
    assert first_s < 0.5 * ready_s
