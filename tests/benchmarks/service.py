"""The service in real time: `.venv/bin/python -m tests.benchmarks.service [SECONDS]`.

Flies an inspection with fake autopilot and service as processes, through a relay that takes the
kernel's time of every setpoint. Beside them, in the same run, a bare asyncio timer of the same
rate in its own process. Also CPU and memory of the service, and the time to its first heartbeat.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import selectors
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import INSPECTION, Operator

ROOT = Path(__file__).parents[2]
PERIOD_S = 0.02
SETPOINT = 84
SO_TIMESTAMPNS = 35  # asm-generic/socket.h; Python has no name for it
FIRST_HEARTBEATS = 5


class Relay(threading.Thread):
    """Passes datagrams between autopilot and service; notes when the kernel got each setpoint."""

    def __init__(self, service_port: int) -> None:
        super().__init__(daemon=True)
        self._service = ("127.0.0.1", service_port)
        self._autopilot: tuple[str, int] | None = None
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for item in self._sockets:
            item.bind(("127.0.0.1", 0))
            item.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.port = self._sockets[0].getsockname()[1]
        self.setpoints_s: list[float] = []

    def passed(self, data: bytes) -> None:
        """A datagram of the autopilot was passed on."""

    def run(self) -> None:
        autopilot, service = self._sockets
        waiting = selectors.DefaultSelector()
        for item in self._sockets:
            waiting.register(item, selectors.EVENT_READ)
        while True:
            for key, _ in waiting.select():
                data, extra, _, peer = key.fileobj.recvmsg(65536, 64)
                if key.fileobj is autopilot:
                    self._autopilot = peer
                    service.sendto(data, self._service)
                    self.passed(data)
                    continue
                if int.from_bytes(data[7:10], "little") == SETPOINT:
                    seconds, nanoseconds = struct.unpack("qq", extra[0][2])
                    self.setpoints_s.append(seconds + 1e-9 * nanoseconds)
                if self._autopilot is not None:
                    autopilot.sendto(data, self._autopilot)


def bare_timer(seconds: float, queue: multiprocessing.Queue[list[float]]) -> None:
    """Lateness of asyncio's clock alone on this machine, at the same rate."""

    async def tick() -> list[float]:
        loop = asyncio.get_running_loop()
        times, due_s = [], loop.time()
        end_s = due_s + seconds
        while due_s < end_s:
            times.append(time.monotonic())
            due_s += PERIOD_S
            await asyncio.sleep(due_s - loop.time())
        return times

    queue.put(asyncio.run(tick()))


@contextlib.contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    running = subprocess.Popen(
        [sys.executable, "-m", *arguments],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield running
    finally:
        running.terminate()
        running.wait(10)


def first_heartbeat_s() -> float:
    """From the start of the process to the first datagram it sends."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(30)
        began = time.monotonic()
        with process(
            "moar_companion",
            "--connect",
            f"udpout:127.0.0.1:{listener.getsockname()[1]}",
            "--site",
            str(shipped_configs() / "sites" / "315kv_double_circuit.yaml"),
        ):
            listener.recv(1024)
            return time.monotonic() - began


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as item:
        item.bind(("127.0.0.1", 0))
        return int(item.getsockname()[1])


def take_off(operator: Operator) -> None:
    """Boot, take off and give the mode for an inspection."""
    operator.wait_for("ready", lambda: operator.ready_to_arm and operator.companion_received, 40)
    operator.take_off(height_m=3.0)
    operator.wait_for("take-off", lambda: operator.altitude_m > 2.3, 30)
    operator.wait_until(lambda: False, 3)
    operator.order("inspection", INSPECTION)
    operator.wait_until(lambda: False, 1.5)
    operator.give_mode()


def intervals(name: str, times_s: list[float]) -> str:
    gaps = 1e3 * np.diff(times_s)
    low, median, high = np.percentile(gaps, [1, 50, 99])
    return f"| {name} | {len(gaps)} | {low:.2f} | {median:.2f} | {high:.2f} | {gaps.max():.2f} |"


def fly(seconds: float) -> list[str]:
    """Fly, and measure for the given time while setpoints are streamed."""
    site_file = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
    site = Site.load(site_file)
    home = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    service_port, operator_port = free_port(), free_port()
    relay = Relay(service_port)
    relay.start()
    operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    with (
        tempfile.TemporaryDirectory() as folder,
        process(
            "sitl",
            *("--home", f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"),
            *("--link", f"companion=udpout:127.0.0.1:{relay.port}"),
            *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
            *("--param", "COM_OBL_RC_ACT=5"),
        ),
        process(
            "moar_companion",
            *("--config", str(_configuration(Path(folder), site_file, service_port))),
        ) as service,
    ):
        take_off(operator)
        operator.wait_for("flying", lambda: operator.has_received("MOAR: flying"), 5)
        queue: multiprocessing.Queue[list[float]] = multiprocessing.Queue()
        timer = multiprocessing.Process(target=bare_timer, args=(seconds, queue))
        watched = psutil.Process(service.pid)
        before, began, first = watched.cpu_times(), time.monotonic(), len(relay.setpoints_s)
        timer.start()
        operator.wait_until(lambda: False, seconds)
        after, took_s, last = watched.cpu_times(), time.monotonic() - began, len(relay.setpoints_s)
        bare = queue.get()
        timer.join()
        used_s = after.user + after.system - before.user - before.system
        memory_mb = watched.memory_info().rss / 2**20
    return [
        "| intervals (ms) | n | p1 | median | p99 | greatest |",
        "|---|---|---|---|---|---|",
        intervals("setpoints, kernel time", relay.setpoints_s[first:last]),
        intervals("bare asyncio timer", bare),
        "",
        f"service: {100 * used_s / took_s:.1f} % of one core, {memory_mb:.0f} MB resident",
    ]


def _configuration(folder: Path, site: Path, port: int) -> Path:
    path = folder / "companion.yaml"
    path.write_text(
        f"vehicle: {shipped_configs() / 'vehicles' / 'linedrone_flight.yaml'}\n"
        f"site: {site}\n"
        f"links: [{{url: 'udp:127.0.0.1:{port}', role: autopilot}}]\n"
        f"recorder: {{directory: {folder}}}\n"
    )
    return path


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 40.0
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n\n")
    sys.stdout.write("\n".join(fly(seconds)) + "\n")
    beats = sorted(first_heartbeat_s() for _ in range(FIRST_HEARTBEATS))
    sys.stdout.write(
        f"start to first heartbeat: {beats[len(beats) // 2]:.2f} s (greatest {beats[-1]:.2f} s)\n"
    )


if __name__ == "__main__":
    main()
