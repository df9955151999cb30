"""The page beside a flight: `.venv/bin/python -m tests.benchmarks.page [SECONDS]`.

One flight of fake autopilot and service as processes, with phases of the given time in turn: no
viewer, three viewers, three viewers beside 200 connections of which some read nothing. For each
phase the intervals of the setpoints by the kernel's time, the frames a second that each viewer
had, and the processor time of service and page; at the end their memory.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.broker import free_tcp_port
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator

from .service import Relay, free_port, process, take_off

VIEWERS = 3
ROUNDS = 3
HOSTILE = 200


class Viewer(threading.Thread):
    """Counts its frames, as a browser reads them."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._connection: ClientConnection = connect(f"ws://127.0.0.1:{port}/live")
        self.frames = self.bytes = 0
        self.start()

    def run(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for frame in self._connection:
                self.frames += 1
                self.bytes += len(frame)

    def close(self) -> None:
        self._connection.close()


@contextlib.contextmanager
def viewers(port: int) -> Iterator[list[Viewer]]:
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(contextlib.closing(Viewer(port))) for _ in range(VIEWERS)]


@contextlib.contextmanager
def hostile(port: int) -> Iterator[None]:
    """Connections: each third is a viewer that reads nothing, the others send half a request."""
    head = (
        f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    ).encode()
    with contextlib.ExitStack() as stack:
        for number in range(HOSTILE):
            with contextlib.suppress(OSError):
                item = stack.enter_context(socket.create_connection(("127.0.0.1", port), 5))
                item.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
                item.sendall(head if number % 3 == 0 else head[:50])
        yield


class Measurements:
    """What is measured in each kind of phase, over all rounds."""

    def __init__(self, relay: Relay, service: psutil.Process, page: psutil.Process) -> None:
        self._relay = relay
        self._processes = (service, page)
        self.gaps_ms: dict[str, list[float]] = defaultdict(list)
        self.used_s: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
        self.rates_hz: dict[str, list[float]] = defaultdict(list)

    def _cpu_s(self) -> list[float]:
        times = [item.cpu_times() for item in self._processes]
        return [item.user + item.system for item in times]

    def take(self, name: str, operator: Operator, seconds: float, seen: list[Viewer]) -> None:
        operator.wait_until(lambda: False, 1.0)
        first, before, frames = len(self._relay.setpoints_s), self._cpu_s(), _frames(seen)
        began_s = time.monotonic()
        operator.wait_until(lambda: False, seconds)
        took_s = time.monotonic() - began_s
        last, after = len(self._relay.setpoints_s), self._cpu_s()
        self.gaps_ms[name] += list(1e3 * np.diff(self._relay.setpoints_s[first:last]))
        self.used_s[name].append((took_s, after[0] - before[0], after[1] - before[1]))
        pairs = zip(frames, _frames(seen), strict=True)
        self.rates_hz[name] += [(later - earlier) / took_s for earlier, later in pairs]

    def lines(self) -> Iterator[str]:
        yield "| phase | intervals | p1 | median | p99 | greatest, ms | frames/s | service | page |"
        yield "|---|---|---|---|---|---|---|---|---|"
        for name, gaps in self.gaps_ms.items():
            low, median, high = np.percentile(gaps, [1, 50, 99])
            took_s, *used_s = (sum(column) for column in zip(*self.used_s[name], strict=True))
            shares = " | ".join(f"{100 * used / took_s:.2f} %" for used in used_s)
            rate = f"{min(self.rates_hz[name]):.1f}" if self.rates_hz[name] else ""
            yield (
                f"| {name} | {len(gaps)} | {low:.2f} | {median:.2f} | {high:.2f} | "
                f"{max(gaps):.2f} | {rate} | {shares} |"
            )
        yield ""
        for name, item in zip(("service", "page"), self._processes, strict=True):
            memory = item.memory_full_info()
            sizes = f"{memory.rss / 1e6:.1f} MB resident, {memory.pss / 1e6:.1f} MB proportional"
            yield f"{name}: {sizes}"


def _frames(seen: list[Viewer]) -> list[int]:
    return [viewer.frames for viewer in seen]


def fly(seconds: float) -> Iterator[str]:
    site_file = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
    site = Site.load(site_file)
    home = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    service_port, operator_port, page_port = free_port(), free_port(), free_tcp_port()
    relay = Relay(service_port)
    relay.start()
    operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        config = {
            "vehicle": str(shipped_configs() / "vehicles" / "linedrone_flight.yaml"),
            "site": str(site_file),
            "links": [{"url": f"udp:127.0.0.1:{service_port}", "role": "autopilot"}],
            "recorder": {"directory": name},
            "page": {"enabled": True, "port": page_port},
        }
        (folder / "companion.yaml").write_text(json.dumps(config))
        stack.enter_context(
            process(
                "sitl",
                *("--home", f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"),
                *("--link", f"companion=udpout:127.0.0.1:{relay.port}"),
                *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
                *("--param", "COM_OBL_RC_ACT=5"),
            )
        )
        running = process("moar_companion", "--config", str(folder / "companion.yaml"))
        service = psutil.Process(stack.enter_context(running).pid)
        take_off(operator)
        operator.wait_for("flying", lambda: operator.has_received("MOAR: flying"), 5)
        (page,) = (item for item in service.children() if "page_worker" in " ".join(item.cmdline()))
        found = Measurements(relay, service, page)
        for _ in range(ROUNDS):
            found.take("no viewer", operator, seconds, [])
            with viewers(page_port) as seen:
                found.take("three viewers", operator, seconds, seen)
                with hostile(page_port):
                    found.take("and 200 hostile connections", operator, seconds, seen)
                sizes = [viewer.bytes / max(1, viewer.frames) for viewer in seen]
        yield from found.lines()
        yield f"a frame: {np.mean(sizes):.0f} bytes on average"


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n\n")
    sys.stdout.write("\n".join(fly(seconds)) + "\n")


if __name__ == "__main__":
    main()
