"""A long flight in real time: `.venv/bin/python -m tests.benchmarks.resident DIR ...`.

For each checkout a service with recording, state and view, and a fake PX4, all at once and in real
time; 10 messages a second of other systems on the service's link. Inspections are ordered every 2
minutes. Every 30 s resident and anonymous memory, address space and the recorded files (MB); in the
end the slope of resident memory after the first 3 minutes, and the intervals of setpoints by the
kernel's times. --busy: so many busy processes beside, at the services' priority. --unrecorded: the
last checkout once more without a recording. --mqtt: of each checkout a second flight,
which publishes to a broker on this machine.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.broker import broker_name, free_tcp_port, running_broker
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import INSPECTION, Operator, OperatorError

from .service import ROOT, Relay, _configuration, free_port, process
from .soak import Chatter
from .starved import busy

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
WARM_S, LOOK_S, LOOKS_PER_ORDER = 180.0, 30.0, 4
PAUSE_S = 2.0
"""A longer interval lies between two flights."""


def memory_mb(process_id: int) -> tuple[float, float, float]:
    """Resident, anonymous, address space."""
    folder = Path(f"/proc/{process_id}")
    lines = [*(folder / "smaps_rollup").read_text().splitlines()[1:]]
    lines += (folder / "status").read_text().splitlines()
    values = {name: value.split() for name, _, value in (line.partition(":") for line in lines)}
    resident, anonymous, address_space = (
        int(values[name][0]) / 1024 for name in ("Rss", "Anonymous", "VmSize")
    )
    return resident, anonymous, address_space


class Flight:
    """The service of a checkout, and what it flies."""

    def __init__(
        self,
        code: Path,
        stack: contextlib.ExitStack,
        *,
        recorded: bool = True,
        broker_port: int | None = None,
    ) -> None:
        home = (site := Site.load(SITE)).frame.to_geodetic((site.start_m[0], 0.0, 0.0))
        self.port, operator_port = free_port(), free_port()
        self.name = code.name
        if not recorded:
            self.name += ", unrecorded"
        if broker_port is not None:
            self.name += " with MQTT"
        self.rows: list[tuple[float, float]] = []
        self.operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
        stack.callback(self.operator.close)
        self.relay = Relay(self.port)
        self.relay.start()
        self.folder = folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        config = _configuration(folder, SITE, self.port)
        if not recorded:
            config.write_text(
                config.read_text().replace("{directory:", "{enabled: false, directory:")
            )
        with config.open("a") as file:
            file.write(f"state: {{directory: {folder}}}\nview: {{socket: {folder}/view.sock}}\n")
            if broker_port is not None:
                url = f"mqtt://127.0.0.1:{broker_port}"
                file.write(f"mqtt: {{url: '{url}', vehicle: resident}}\n")
        stack.enter_context(
            process(
                "sitl",
                *("--home", f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"),
                *("--link", f"companion=udpout:127.0.0.1:{self.relay.port}"),
                *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
                *("--param", "COM_OBL_RC_ACT=5"),
                *("--param", "COM_OF_LOSS_T=0.5"),
            )
        )
        self.service = subprocess.Popen(
            [sys.executable, "-m", "moar_companion", "--config", str(config)],
            cwd=code,
            env={**os.environ, "PYTHONPATH": str(code)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        stack.callback(self.service.kill)

    def begin(self) -> None:
        operator = self.operator
        operator.wait_for(
            "ready", lambda: operator.ready_to_arm and operator.companion_received, 60.0
        )
        operator.wait_until(lambda: False, 3.0)
        self.report("planner ready")
        operator.take_off(height_m=3.0)
        operator.wait_for("take-off", lambda: operator.altitude_m > 2.3, 60.0)
        operator.wait_until(lambda: False, 3.0)
        self.inspect()

    def inspect(self) -> None:
        with contextlib.suppress(OperatorError):
            self.operator.order("inspection", INSPECTION)
            self.operator.wait_until(lambda: False, 1.5)
            self.operator.give_mode()

    def report(self, what: str) -> float:
        memory = memory_mb(self.service.pid)
        files = sum(file.stat().st_size for file in self.folder.rglob("*") if file.is_file()) / 1e6
        figures = " | ".join(f"{value:.1f}" for value in (*memory, files))
        sys.stdout.write(f"| {self.name} | {what} | {figures} |\n")
        sys.stdout.flush()
        return memory[0]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("code", type=Path, nargs="*", default=[ROOT])
    parser.add_argument("--minutes", type=float, default=10.0, help="more than 4")
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--unrecorded", action="store_true")
    parser.add_argument("--mqtt", action="store_true")
    given = parser.parse_args()
    with contextlib.ExitStack() as stack, socket.socket(type=socket.SOCK_DGRAM) as other:
        flights = [Flight(code, stack) for code in given.code]
        if given.unrecorded:
            flights.append(Flight(given.code[-1], stack, recorded=False))
        if given.mqtt:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            stack.enter_context(running_broker(folder, port := free_tcp_port()))
            sys.stdout.write(f"broker: {broker_name()}\n")
            flights += [Flight(code, stack, broker_port=port) for code in given.code]
        for flight in flights:
            flight.begin()
        stack.enter_context(busy(given.busy, os.sched_getaffinity(0)))
        chatter, began_s, looks = Chatter(), time.monotonic(), 0
        while (now_s := time.monotonic() - began_s) < 60.0 * given.minutes:
            for flight in flights:
                flight.operator.wait_until(lambda: False, 0.1 / len(flights))
                other.sendto(chatter.message(), ("127.0.0.1", flight.port))
            if now_s < looks * LOOK_S:
                continue
            looks += 1
            for flight in flights:
                flight.rows.append((now_s, flight.report(f"{now_s:.0f} s")))
                if looks % LOOKS_PER_ORDER == 0:
                    flight.inspect()
        for flight in flights:
            rows = np.array([row for row in flight.rows if row[0] >= WARM_S])
            slope = 3600.0 * np.polyfit(rows[:, 0], rows[:, 1], 1)[0]
            gaps_s = np.diff(flight.relay.setpoints_s)
            gaps_ms = 1e3 * gaps_s[gaps_s < PAUSE_S]
            median, p99, most = np.percentile(gaps_ms, [50, 99, 100])
            spread = f"median {median:.1f} ms, p99 {p99:.1f}, greatest {most:.1f}"
            sys.stdout.write(
                f"{flight.name}: {slope:+.1f} MB/h, {len(gaps_ms)} intervals: {spread}\n"
            )


if __name__ == "__main__":
    main()
