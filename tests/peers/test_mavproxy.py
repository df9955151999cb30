"""MAVProxy as a program with the module of `site actions`, beside the service and an autopilot.

Skipped without MOAR_MAVPROXY, the folder into which `pip install --no-deps --target` put MAVProxy.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from moar_companion.commands import cli
from tests.real_time import real_time

from .processes import SITE, companion_beside_autopilot, truth_of

FOLDER = os.environ.get("MOAR_MAVPROXY")
pytestmark = pytest.mark.skipif(not FOLDER, reason="MOAR_MAVPROXY names no MAVProxy")
TAKE_OFFS = {
    "px4": ("arm throttle", "long DO_SET_MODE 1 4 2"),
    "ardupilot": ("mode GUIDED", "arm throttle", "takeoff 3"),
}
"""PX4's modes are not MAVProxy's: its `mode` fails."""
ORDERS = {"px4": "inspection splice-inner", "ardupilot": "exit 0"}
"""Those that fly for long. The fake ArduPilot's battery is too small for an inspection with this
vehicle."""
OFFBOARD = "long DO_SET_MODE 1 6 0"


class Console:
    """A running MAVProxy: lines are typed, and words awaited in its output, a file."""

    def __init__(self, running, log):
        self._running, self._log = running, log
        self._read = 0

    def type(self, line):
        """Types a line; what is awaited then comes after it."""
        self._read = len(self._log.read_bytes())
        self._running.stdin.write(line.encode() + b"\n")
        self._running.stdin.flush()
        return self

    def type_until(self, line, pattern, seconds=60.0):
        """Types a line every 2 s until its answer, as a pilot does who waits for the sensors."""
        until_s = time.monotonic() + seconds
        while True:
            with contextlib.suppress(AssertionError):
                self.type(line).await_text(pattern, 2.0)
                return
            assert time.monotonic() < until_s, self._log.read_text()

    def await_text(self, pattern, seconds=20.0):
        """Waits for a regular expression in the output since the last line."""
        await_text(self._log, pattern, seconds, self._read)


def await_text(file, pattern, seconds=20.0, start=0):
    """Waits for a regular expression in a file that grows, from an offset on."""
    until_s = time.monotonic() + seconds
    while not re.search(pattern, text := file.read_bytes()[start:].decode()):
        assert time.monotonic() < until_s, f"no {pattern} in:\n{text}"
        time.sleep(0.05)


@contextlib.contextmanager
def mavproxy(folder, port):
    """MAVProxy on a port, with the module loaded as its page says."""
    assert cli.main(["site", "actions", str(SITE), "--out", str(folder)]) == 0
    command = [sys.executable, "-u", Path(FOLDER) / "bin" / "mavproxy.py"]
    options = ["--master", f"udpin:127.0.0.1:{port}", "--no-state", "--load-module=mavproxy_moar"]
    log = folder / "mavproxy.log"
    with (
        log.open("wb") as output,
        subprocess.Popen(
            [*command, *options],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": f"{FOLDER}:{folder}", "HOME": str(folder)},
        ) as running,
    ):
        try:
            yield Console(running, log)
        finally:
            running.kill()


@real_time
@pytest.mark.parametrize("kind", TAKE_OFFS)
def test_mavproxy_orders_a_flight_and_takes_it_over(kind, tmp_path):
    with (
        companion_beside_autopilot(tmp_path, kind) as (port, _),
        mavproxy(tmp_path, port) as console,
    ):
        console.await_text("online system 1")
        console.await_text("Detected vehicle 1:195", 60.0)
        for line in TAKE_OFFS[kind]:
            console.type_until(line, "ACCEPTED")
        airborne(tmp_path)
        console.type(f"moar {ORDERS[kind]}")
        console.await_text(f"moar: MOAR {ORDERS[kind].replace(' ', ': ')}: ACCEPTED", 60.0)
        if kind == "ardupilot":  # flown at once: it hovers in GUIDED
            console.type("mode LOITER").await_text("MOAR: autopilot in LOITER, overridden")
            console.type("set target_component 195").await_text("change target_component 195")
            console.type("mode RTL").await_text("MOAR: mode commands go to component 1, denied")
            return
        console.type(OFFBOARD).await_text("MOAR: flying inspection to splice-inner")
        console.type("moar hold").await_text("MOAR hold: ACCEPTED")
        console.type("moar continue").await_text("MOAR continue: ACCEPTED")
        console.type("set target_component 195").await_text("`mode` does not reach the autopilot")
        console.type("moar takeover").await_text("moar: HOLD: ACCEPTED")
        await_text(tmp_path / "companion.log", "MOAR: autopilot in HOLD, overridden")


def airborne(folder):
    """Waits until the aircraft hovers, by its true flight."""
    until_s = time.monotonic() + 40.0
    while True:
        state = truth_of(folder)[-1]
        if state["down_m"] < -2.0 and abs(state["vd_mps"]) < 0.1:
            return
        assert time.monotonic() < until_s, state
        time.sleep(0.1)
