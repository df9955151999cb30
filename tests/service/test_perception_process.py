"""The perception in a process of its own: real packets, a kill, bad settings."""

from __future__ import annotations

import os
import signal
import socket
import threading
from dataclasses import replace
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from moar_companion.errors import InputError, LinkError
from moar_companion.mavlink.link_basics import clock_s
from moar_companion.perception.pose_notes import AttitudeNote, PositionNote
from moar_companion.perception.scan_frame import mount_rotation
from moar_companion.planner.site import Site
from moar_companion.service.perception_process import PerceptionProcess
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.perception_config import Perception, Sensor
from sitl.lidar import PACKET_S, LidarScene, SimulatedLidar, Wire

SITE = Site.load(shipped_configs() / "sites/315kv_double_circuit.yaml")
PLACE_M = (15.0, 0.0, 12.0)


def packets_of(seconds):
    """Data packets of a lidar that hovers at its place, nose along the plane."""
    wires = tuple(
        Wire(start_m=(x_m, -60.0, z_m), end_m=(x_m, 60.0, z_m))
        for x_m, z_m in (item.position_m for item in SITE.obstacles)
    )
    lidar = SimulatedLidar(LidarScene(wires=wires))
    turn = mount_rotation(Perception().mount).as_matrix()

    def pose_at(times):
        return np.tile(PLACE_M, (len(times), 1)), np.tile(turn, (len(times), 1, 1))

    return [lidar.packet(n * PACKET_S, pose_at) for n in range(int(seconds / PACKET_S))]


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        return own.getsockname()[1]


@pytest.fixture
def settings():
    return Perception(sensor=Sensor.VELODYNE, address="127.0.0.1", port=free_port())


@pytest.fixture
def perception(settings):
    process = PerceptionProcess(settings, SITE)
    yield process
    process.close()


class Aircraft:
    """Hovers in front of conductors; sends packets and notes in real time."""

    def __init__(self, perception, port):
        self._perception = perception
        self._port = port
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._packets = packets_of(seconds=1.0)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()

    def _send(self):
        azimuth_rad = np.radians(SITE.frame.azimuth_deg)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            while not self._ending.is_set():
                for number, packet in enumerate(self._packets):
                    if number % 15 == 0:
                        now_s = clock_s()
                        level = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": azimuth_rad}
                        self._perception.send(
                            [
                                PositionNote(time_s=now_s, position_m=PLACE_M),
                                AttitudeNote(time_s=now_s, **level),
                            ]
                        )
                        if self._ending.wait(0.02):
                            return
                    own.sendto(packet, ("127.0.0.1", self._port))


def first(perception, condition, seconds=30.0):
    """The first report that meets a condition."""
    end_s = monotonic() + seconds
    while monotonic() < end_s:
        for report in perception.reports():
            if condition(report):
                return report
        threading.Event().wait(0.02)
    raise AssertionError(f"none within {seconds:g} s")


def test_packets_and_poses_become_conductors_in_another_process(settings, perception):
    with Aircraft(perception, settings.port):
        report = first(perception, lambda report: len(report.conductors) >= 2)
        known = [item.position_m for item in SITE.obstacles]
        for seen in report.conductors:
            off_m = min(np.hypot(*np.subtract(place, seen.position_m)) for place in known)
            assert off_m < 0.15
        assert report.health.returns > settings.least_returns
        assert clock_s() - report.health.scan_s < 5.0


@pytest.mark.slow
def test_a_process_that_is_killed_is_started_again(settings, perception):
    with Aircraft(perception, settings.port):
        first(perception, lambda report: report.health.scan_s is not None)
        before = perception.process_id
        os.kill(before, signal.SIGKILL)
        began_s = clock_s()
        report = first(perception, lambda report: (report.health.scan_s or 0.0) > began_s + 0.5)
        assert report.time_s > began_s
        assert perception.process_id not in {None, before}


def test_the_perception_process_ends_with_the_service(settings):
    process = PerceptionProcess(settings, SITE)
    first(process, lambda _: True)
    number = process.process_id
    process.close()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


@pytest.mark.slow
def test_the_perception_process_is_ended_before_the_service_when_memory_runs_out(perception):
    first(perception, lambda _: True)
    assert int(Path(f"/proc/{perception.process_id}/oom_score_adj").read_text()) > 0


@pytest.mark.slow
def test_a_slow_perception_process_delays_no_caller(settings, perception):
    first(perception, lambda _: True)
    os.kill(perception.process_id, signal.SIGSTOP)
    for _ in range(20_000):  # far more than the socket holds
        perception.send([PositionNote(time_s=0.0, position_m=PLACE_M)])
    began_s = clock_s()
    os.kill(perception.process_id, signal.SIGCONT)
    first(perception, lambda report: report.time_s > began_s)


def test_a_port_in_use_is_one_line(settings):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", settings.port))
        with pytest.raises(LinkError, match=rf"^perception on udpin:127.0.0.1:{settings.port}: in"):
            PerceptionProcess(settings, SITE)


def test_a_description_that_cannot_be_used_is_one_line(settings, tmp_path):
    ouster = replace(settings, sensor=Sensor.OUSTER, metadata=tmp_path / "none.json")
    with pytest.raises(InputError, match=r"none\.json: no such file"):
        PerceptionProcess(ouster, SITE)
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(InputError, match=r"bad\.json: is no JSON"):
        PerceptionProcess(replace(ouster, metadata=tmp_path / "bad.json"), SITE)
