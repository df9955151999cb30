"""The fake PX4 and the service as processes, a tap between them, an operator in raw MAVLink."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import yaml
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import INSPECTION, Operator, OperatorError
from sitl.demonstration.processes import free_ports

from .tap import Tap, clock_s

ROOT = Path(__file__).parents[2]
SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE = shipped_configs() / "vehicles" / "x500.yaml"
OFFBOARD, HOLD = 6 << 16, 4 << 16 | 3 << 24
RELEASE = 4
PAUSE_CONTINUE = 193
COMPANION = 195
IN_AIR = 2
FLY_ATTEMPTS = 4


class Service:
    """The service as a process that can be started, killed and started again."""

    def __init__(self, folder, port, **config):
        self.folder = folder
        self.state = folder / "state" / "mission.json"
        self._config = folder / "companion.yaml"
        values = {
            "vehicle": str(VEHICLE),
            "site": str(SITE),
            "links": [{"url": f"udp:127.0.0.1:{port}"}],
            "state": {"directory": "state"},
            **config,
        }
        self._config.write_text(yaml.safe_dump(values))
        self.process = None

    def start(self, **environment):
        with (self.folder / "companion.log").open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "moar_companion", "--config", str(self._config)],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**os.environ, **environment},
            )

    def running(self):
        return self.process is not None and self.process.poll() is None

    def end(self, number):
        """The exit status after a signal."""
        self.process.send_signal(number)
        return self.process.wait(20)

    @contextlib.contextmanager
    def stopped(self):
        """Stops the scheduling of the process (SIGSTOP). Yields the time of the stop."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield clock_s()
        finally:
            self.process.send_signal(signal.SIGCONT)

    def remembered(self):
        """State in the snapshot file; None without a file."""
        with contextlib.suppress(FileNotFoundError):
            return json.loads(self.state.read_text())["memory"]["state"]
        return None

    def log(self):
        return (self.folder / "companion.log").read_text()


class Rig:
    """One aircraft in the air, with autopilot, tap, service and operator."""

    def __init__(self, folder, stack):
        service_port, operator_port = free_ports(2)
        self.recordings = folder / "flights"
        self.service = Service(folder, service_port, recorder={"directory": str(self.recordings)})
        self.tap = Tap(service_port)
        stack.callback(self.tap.close)
        stack.callback(self._end_service)
        home = Site.load(SITE)
        home = home.frame.to_geodetic((home.start_m[0], 0.0, 0.0))
        with (folder / "autopilot.log").open("wb") as log:
            autopilot = subprocess.Popen(
                [
                    *(sys.executable, "-m", "sitl"),
                    f"--home={home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r}",
                    *("--link", f"companion=udpout:127.0.0.1:{self.tap.port}"),
                    *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
                    *("--param", "COM_OF_LOSS_T=0.5", "--param", "COM_OBL_RC_ACT=5"),
                ],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        stack.callback(autopilot.wait)
        stack.callback(autopilot.terminate)
        self.operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
        stack.callback(self.operator.close)

    def _end_service(self):
        if self.service.running():
            self.service.end(signal.SIGKILL)

    def take_off(self):
        operator = self.operator
        operator.wait_for("the autopilot", lambda: operator.autopilot_received, 30.0)
        operator.wait_for("ready to arm", lambda: operator.ready_to_arm, 30.0)
        operator.take_off(3.0)
        operator.wait_for("in the air", lambda: operator.landed_state == IN_AIR, 20.0)
        operator.wait_for("take-off done", lambda: operator.altitude_m > 2.3, 20.0)
        self.watch(3.0)

    def watch(self, seconds):
        """Let the aircraft fly, and read what the ground station receives."""
        self.operator.wait_until(lambda: False, seconds)

    def hover(self):
        """Bring the rig to a hover: the service runs without a stream, and the autopilot holds."""
        operator = self.operator
        if self.service.running():
            operator.command("release", 31010, RELEASE, component=COMPANION)
        else:
            self.start()
        operator.wait_for("hold", lambda: operator.custom_mode == HOLD, 10.0)
        self.watch(1.5)

    def start(self, **environment):
        """Start the service; returns when its heartbeat is received."""
        operator = self.operator
        operator.companion_received = False
        operator.texts.clear()
        self.service.start(**environment)
        operator.wait_for("the companion", lambda: operator.companion_received, 30.0)

    def wait_for_text(self, text, timeout_s=10.0):
        self.operator.wait_for(text, lambda: text in self.said(), timeout_s)

    def fly(self):
        """Fly from a hover to a started mission; waits for a machine that stalls."""
        for attempts_left in reversed(range(FLY_ATTEMPTS)):
            self.operator.texts.clear()
            try:
                self.operator.order("inspection", INSPECTION)
                self.engage()
            except OperatorError as error:
                if not attempts_left:
                    raise AssertionError(f"{error}; said: {self.said()}") from error
                self.hover()
            else:
                return

    def engage(self):
        """Give the mode to a waiting stream."""
        self.watch(1.5)
        self.operator.give_mode()
        self.wait_for_text("MOAR: flying inspection")
        self.operator.wait_for("moving", lambda: self.speed_mps() > 0.3, 10.0)

    def said(self):
        """Texts of the companion since the last start or flight."""
        return "".join(self.operator.texts)

    def ask_for_inspection(self):
        """Order an inspection without waiting for an answer."""
        self.operator._send(
            mavlink.MAVLink_command_long_message(1, COMPANION, 31010, 0, INSPECTION, -1, *[0.0] * 5)
        )

    def speed_mps(self):
        return self.tap.setpoints[-1].speed_mps
