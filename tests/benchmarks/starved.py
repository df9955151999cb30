"""The service beside busy processes: `.venv/bin/python -m tests.benchmarks.starved [options]`.

Flies an inspection with fake autopilot and service as processes, through the relay of `service`,
and starts busy processes (nice 0) beside the service while it streams. Of the setpoints: their
intervals by the kernel's times. Of each cycle: the age of its position, from the relay's time of
that LOCAL_POSITION_NED to the start of the cycle, on one clock.

With one core, service and busy processes share it, and autopilot, relay and operator have the
other; with two, all of them share both. `--code DIR` flies the service of another checkout.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator, OperatorError

from .service import ROOT, Relay, _configuration, free_port, process, take_off

BUSY = "while True: pass"
SERVED = Path(__file__).with_name("served.py")
POSITION = 32
LET_GO = ("released", "overridden", "let go", "you have control")
"""Words of the texts of any checkout's service that report it."""


class TimedRelay(Relay):
    """Notes, too, when it passed on each position, on the service's clock."""

    def __init__(self, service_port: int) -> None:
        super().__init__(service_port)
        self.positions_s: dict[int, float] = {}

    def passed(self, data: bytes) -> None:
        if int.from_bytes(data[7:10], "little") == POSITION:
            boot_ms = int.from_bytes(data[10:14], "little")
            self.positions_s[boot_ms] = time.clock_gettime(time.CLOCK_BOOTTIME)


@contextlib.contextmanager
def busy(count: int, cores: set[int]) -> Iterator[None]:
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        for loop in loops:
            os.sched_setaffinity(loop.pid, cores)
            with contextlib.suppress(PermissionError):
                os.setpriority(os.PRIO_PROCESS, loop.pid, 0)
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


@contextlib.contextmanager
def service(code: Path, config: Path, ages: Path, nice: int) -> Iterator[subprocess.Popen[bytes]]:
    with (
        (config.parent / "companion.log").open("wb") as log,
        subprocess.Popen(
            [sys.executable, str(SERVED), str(config), str(ages)],
            cwd=code,
            env={**os.environ, "PYTHONPATH": f"{code}{os.pathsep}{ROOT}"},
            stdout=log,
            stderr=log,
            preexec_fn=lambda: os.setpriority(os.PRIO_PROCESS, 0, nice),  # noqa: PLW1509
        ) as running,
    ):
        try:
            yield running
        finally:
            running.terminate()
            running.wait(20)


def confine(pid: int, cores: set[int]) -> None:
    for thread in Path(f"/proc/{pid}/task").iterdir():
        os.sched_setaffinity(int(thread.name), cores)


def fly(given: argparse.Namespace) -> list[str]:
    """One flight: a row for each number of busy processes."""
    cores = given.cores
    site_file = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
    home = (site := Site.load(site_file)).frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    everywhere = os.sched_getaffinity(0)
    here = {min(everywhere)} if cores == 1 else everywhere
    elsewhere = everywhere - here or everywhere
    service_port, operator_port = free_port(), free_port()
    relay = TimedRelay(service_port)
    relay.start()
    operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    rows, marks = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ages = folder / "ages"
        config = _configuration(folder, site_file, service_port)
        with (
            process(
                "sitl",
                *("--home", f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"),
                *("--link", f"companion=udpout:127.0.0.1:{relay.port}"),
                *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
                *("--param", "COM_OBL_RC_ACT=5"),
            ) as autopilot,
            service(given.code, config, ages, given.nice) as companion,
        ):
            confine(os.getpid(), elsewhere)
            confine(autopilot.pid, elsewhere)
            try:
                take_off(operator)
                operator.wait_for("flying", lambda: said(operator, ["flying"]), 5)
                confine(companion.pid, here)
                for count in given.busy:
                    with busy(count, here):
                        operator.wait_until(lambda: False, 0.5)
                        first, begin_s = len(relay.setpoints_s), _clock_s()
                        operator.wait_until(lambda: False, given.seconds)
                        marks.append((count, first, len(relay.setpoints_s), begin_s, _clock_s()))
                    if let_go(operator):
                        break
            finally:
                operator.close()
                os.sched_setaffinity(0, everywhere)
        cycles = [line.split() for line in ages.read_text().splitlines()]
    ended = let_go(operator)
    for count, first, last, begin_s, end_s in marks:
        gaps_ms = 1e3 * np.diff(relay.setpoints_s[first:last])
        ages_ms = [
            1e3 * (float(now_s) - relay.positions_s[int(boot_ms)])
            for now_s, boot_ms in cycles
            if begin_s <= float(now_s) <= end_s and int(boot_ms) in relay.positions_s
        ]
        ending = ended[0] if ended and count == marks[-1][0] else ""
        rows.append(f"| {cores} | {count} | {_spread(gaps_ms)} | {_spread(ages_ms)} | {ending} |")
    return rows


def let_go(operator: Operator) -> list[str]:
    return said(operator, LET_GO)


def said(operator: Operator, words: Iterable[str]) -> list[str]:
    """Texts of the service that contain one of these words."""
    return [text for text in operator.texts if any(word in text for word in words)]


def _clock_s() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def _spread(values: np.ndarray | list[float]) -> str:
    if len(values) == 0:
        return "none"
    median, high = np.percentile(values, [50, 99])
    return f"{median:.1f} / {high:.1f} / {max(values):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--code", type=Path, default=ROOT)
    parser.add_argument("--cores", type=int, choices=(1, 2), default=1)
    parser.add_argument("--nice", type=int, default=0)
    parser.add_argument("--busy", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--flights", type=int, default=1)
    given = parser.parse_args()
    sys.stdout.write(
        "| cores | busy | setpoint interval, ms: median / p99 / greatest"
        " | age of the position, ms | |\n|---|---|---|---|---|\n"
    )
    for _ in range(given.flights):
        try:
            rows = fly(given)
        except OperatorError as error:
            rows = [f"| {given.cores} | | | | {error} |"]
        sys.stdout.write("\n".join(rows) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
