"""The loop that cycles and sends, in this process: its clocks, and cycles that take too long."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import struct
import threading
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.companion import Companion
from moar_companion.companion.safety.check_inputs import Host
from moar_companion.service import app, background_writer, host_monitor, recorder
from moar_companion.service.app import Service
from moar_companion.settings.config import CompanionConfig, RecorderSettings, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from moar_companion.settings.vehicle import Vehicle
from tests.stopped import stop_recordings

VEHICLE = shipped_configs() / "vehicles" / "x500.yaml"
POSCTL, OFFBOARD = 0x00030000, 0x00060000


def clock_s():
    return time.clock_gettime(time.CLOCK_MONOTONIC)


@pytest.fixture
def received():
    """A socket that receives the packets of the service."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as item:
        item.bind(("127.0.0.1", 0))
        item.setblocking(False)
        yield item


def serve(received, seconds, **config):
    """Run the service for a time; the messages that it sent."""
    link = LinkConfig(url=f"udpout:127.0.0.1:{received.getsockname()[1]}")
    whole = CompanionConfig(vehicle=VEHICLE, links=(link,), **config)
    companion = Companion(whole, Vehicle.load(VEHICLE), None)

    async def run():
        asyncio.get_running_loop().call_later(seconds, os.kill, os.getpid(), signal.SIGTERM)
        await Service(whole, companion, None, None).run()

    asyncio.run(run())
    codec, messages = mavlink.MAVLink(None), []
    while True:
        try:
            messages += codec.parse_buffer(received.recv(65536)) or []
        except BlockingIOError:
            return messages


def test_the_status_has_the_time_of_a_clock_that_is_set_later(monkeypatch):
    config = CompanionConfig(vehicle=VEHICLE)
    monkeypatch.setattr(time, "time", lambda: 1000.0)
    service = Service(config, Companion(config, Vehicle.load(VEHICLE), None), None, None)
    monkeypatch.setattr(time, "time", lambda: 1.8e9)
    service._follow_wall_clock(service._now_s())
    assert service._status_now()["time_s"] == pytest.approx(1.8e9, abs=5.0)


def test_steps_of_the_wall_clock_disturb_neither_the_cycles_nor_the_record(
    received, tmp_path, monkeypatch
):
    wall_s, began_s = time.time, clock_s()

    def stepped():
        """A clock that is set ahead by an hour, then back by two."""
        step = int((clock_s() - began_s) / 0.6)
        return wall_s() + (0.0, 3600.0, -3600.0)[min(step, 2)]

    clock_began_s = wall_s()
    monkeypatch.setattr(time, "time", stepped)
    messages = serve(received, 2.0, recorder=RecorderSettings(directory=tmp_path))
    reported_ms = {m.time_boot_ms for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert len(reported_ms) >= 4
    assert all(400 < later - earlier < 900 for earlier, later in pairwise(sorted(reported_ms)))
    (folder,) = tmp_path.iterdir()
    stamps_s = [stamp * 1e-6 for stamp in stamps((folder / "flight.tlog").read_bytes())]
    assert stamps_s == sorted(stamps_s)
    assert clock_began_s - 1.0 < stamps_s[0] < stamps_s[-1] < clock_began_s + 60.0


def stamps(data):
    """The times in a tlog of MAVLink 2 packets without signatures, in microseconds."""
    while data:
        yield struct.unpack(">Q", data[:8])[0]
        data = data[8 + data[9] + 12 :]


def test_control_output_of_an_old_cycle_is_not_sent(received, monkeypatch):
    cycles, followed = [], set()
    tick, ask = Companion.tick, Companion.control_to_send

    def slow_tick(self, now_s):
        tick(self, now_s)
        cycles.append(now_s)
        if len(cycles) in {10, 20}:
            time.sleep(0.15)

    def noted(self):
        followed.add(len(cycles))
        return ask(self)

    monkeypatch.setattr(Companion, "tick", slow_tick)
    monkeypatch.setattr(Companion, "control_to_send", noted)
    messages = serve(received, 1.5)
    assert not followed & {10, 20}
    assert len(followed) > len(cycles) / 2
    assert {"HEARTBEAT", "NAMED_VALUE_FLOAT"} <= {message.get_type() for message in messages}


@pytest.mark.parametrize(("pause_s", "sent"), [(0.0, 2), (0.15, 0)])
def test_control_that_is_paused_on_its_escape_route_is_not_sent(
    pause_s, sent, received, monkeypatch
):
    marked = bytes(
        mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 3, 3).pack(mavlink.MAVLink(None))
    )
    once, log = iter([[marked, marked]]), []

    def two(self):
        (link,) = self.state.config.links
        packets = [(link.url, data) for data in next(once, [])]
        log.append("marked" if packets else "empty")
        if packets:
            time.sleep(pause_s)
        return packets

    monkeypatch.setattr(Companion, "control_to_send", two)
    monkeypatch.setattr(Companion, "note_sent", lambda _: log.append("sent"))
    modes = [item.custom_mode for item in serve(received, 0.5) if item.get_type() == "HEARTBEAT"]
    assert modes.count(77) == sent
    assert (log[log.index("marked") + 1] == "sent") is bool(sent)
    assert modes.count(0) == 1


def test_after_a_stall_waiting_packets_are_received_before_any_packet_is_sent(
    received, monkeypatch
):
    autopilot = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeats = [
        autopilot.heartbeat_encode(2, 12, 209, mode, 4) for mode in (*[OFFBOARD] * 4, POSCTL)
    ]
    waiting = [bytes(message.pack(autopilot)) for message in heartbeats]
    modes, tick, ask = [], Companion.tick, Companion.control_to_send

    def stalled(self, now_s):
        tick(self, now_s)
        with contextlib.suppress(BlockingIOError):
            _, service = received.recvfrom(65536)
            while waiting:
                received.sendto(waiting.pop(0), service)
                time.sleep(0.05)

    def noted(self):
        if not waiting:
            modes.append(self.telemetry.autopilot)
        return ask(self)

    monkeypatch.setattr(Companion, "tick", stalled)
    monkeypatch.setattr(Companion, "control_to_send", noted)
    serve(received, 1.0)
    assert modes[0] is not None
    assert modes[0].custom_mode == POSCTL


@pytest.mark.parametrize(("computed_s", "fed"), [(0.0, True), (0.15, False)])
def test_the_watchdog_is_fed_by_cycles_that_are_sent_in_time_alone(
    computed_s, fed, received, tmp_path, monkeypatch
):
    tick, address = Companion.tick, str(tmp_path / "notify")

    def slow_tick(self, now_s):
        tick(self, now_s)
        time.sleep(computed_s)

    monkeypatch.setattr(Companion, "tick", slow_tick)
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.setblocking(False)
        serve(received, 1.0)
        reported = set()
        with contextlib.suppress(BlockingIOError):
            while True:
                reported.add(manager.recv(64))
    assert reported == {b"READY=1", b"STOPPING=1", *([b"WATCHDOG=1"] if fed else [])}


def test_the_companion_receives_the_free_memory_and_disk_of_the_computer(
    received, tmp_path, monkeypatch
):
    asked, reported = set(), set()

    def left(recordings):
        asked.add(recordings)
        return SimpleNamespace(free=3e9, total=4e9)

    monkeypatch.setattr(host_monitor.shutil, "disk_usage", left)
    monkeypatch.setattr(host_monitor, "memory_bytes", lambda _: {"MemAvailable": 2e8})
    monkeypatch.setattr(Companion, "note_host", lambda _, host: reported.add(host))
    serve(received, 0.3, recorder=RecorderSettings(directory=tmp_path))
    assert asked == set(tmp_path.iterdir())
    assert reported == {Host(disk_free=3e9, disk_total=4e9, memory_available=2e8)}


def test_a_stalled_disk_delays_neither_the_cycles_nor_the_end(
    received, tmp_path, monkeypatch, caplog
):
    answers, looks, usage = threading.Event(), [], shutil.disk_usage

    def asked(folder):
        looks.append(folder)
        if len(looks) > 1:
            answers.wait(20)
        return usage(folder)

    monkeypatch.setattr(host_monitor, "_PERIOD_S", 0.0)
    monkeypatch.setattr(host_monitor.shutil, "disk_usage", asked)
    monkeypatch.setattr(recorder, "_PERIOD_S", 0.1)
    monkeypatch.setattr(background_writer, "_LAST_WRITE_S", 0.1)
    disks = stop_recordings(monkeypatch)
    messages = serve(received, 2.0, recorder=RecorderSettings(directory=tmp_path))
    reported_ms = {m.time_boot_ms for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert len(reported_ms) >= 3
    assert len(looks) == 2
    answers.set()
    (disk,), (folder,) = disks, tmp_path.iterdir()
    assert disk.rest()
    warnings = [item.getMessage() for item in caplog.records if item.levelname == "WARNING"]
    assert warnings == [f"recording ended: {folder}: the disk is too slow"]


def test_without_a_recording_no_received_packets_wait_for_one():
    url = "udpout:127.0.0.1:9"
    whole = CompanionConfig(vehicle=VEHICLE, links=(LinkConfig(url=url),))
    companion = Companion(whole, Vehicle.load(VEHICLE), None)
    service = Service(whole, companion, None, None)
    service._links = {url: SimpleNamespace(send=lambda *_: None)}
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
    now_s = clock_s()
    companion.receive(url, heartbeat.pack(mavlink.MAVLink(None, 1, 1)), now_s)
    companion.tick(now_s)
    service._send(now_s)
    service._worker.close()
    assert companion.telemetry.autopilot is not None
    assert companion.received_packets() == []


def test_after_a_stall_a_flood_does_not_keep_the_service_from_sending(monkeypatch):
    whole = CompanionConfig(vehicle=VEHICLE, links=(LinkConfig(url="udp:127.0.0.1:14540"),))
    service = Service(whole, Companion(whole, Vehicle.load(VEHICLE), None), None, None)
    looks = []

    def moved_s():
        """Each look for waiting bytes takes 10 ms, because there are so many."""
        looks.append(1)
        return 0.01 * len(looks)

    async def catch_up():
        async def flood():
            while True:
                service._arrived.append((0.0, "udp:127.0.0.1:14540", b"\xfe", ("10.0.0.66", 1)))
                await asyncio.sleep(0)

        flooding = asyncio.create_task(flood())
        await service._catch_up()
        flooding.cancel()

    monkeypatch.setattr(app, "clock_s", moved_s)
    asyncio.run(catch_up())
    service._worker.close()
    assert len(looks) <= 12
