"""One aircraft of any of the four kinds, the service, and a pilot on the ground."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import yaml

from moar_companion.planner.site import Site
from moar_companion.service.priority import NICE, ahead_of_others
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import INSPECTION, OperatorError
from sitl.demonstration.processes import free_ports, running
from sitl.demonstration.real import RealOptions, running_real
from sitl.demonstration.weather import set_battery
from tests.flights.judging import in_plane
from tests.liveness.rig import ROOT, Service
from tests.liveness.tap import clock_s
from tests.real_time import watched

from .ground import TAKEOVER_MODE, GroundStation
from .kinds import BASE, CROSSING_PERCENT
from .link import Link
from .stalls import MACHINE, Stall, stalls

LET_GO = ("released", "overridden")
_IN_AIR = 2
_START_S = 60.0
"""Real seconds within which the first packet of a process is received."""
_COMPILING_S = 600.0
"""Real seconds of the planner's compilation, at the first start on a machine."""
_LONGEST_FLIGHT_S = 240.0


def _put_session_ahead(process_id, nice=NICE):
    """Set the nice value of a process's session: others count within one, where Linux shares the
    processors among sessions first (kernel.sched_autogroup_enabled)."""
    with contextlib.suppress(OSError):
        Path(f"/proc/{process_id}/autogroup").write_text(str(nice))


class RealService(Service):
    """The service on the simulator's clock; all starts write into one log."""

    def __init__(self, folder, port, speed, **config):
        super().__init__(folder, port, **config)
        self._speed = speed
        self._starts = 0

    def ready(self):
        """True when every start so far has its planner."""
        return self.log().count("INFO planner ready") >= self._starts

    def start(self, **environment):
        self._starts += 1
        module = "moar_companion" if self._speed == 1.0 else "sitl.demonstration.companion"
        faster = [] if self._speed == 1.0 else ["--speed", f"{self._speed:g}"]
        with (self.folder / "companion.log").open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", module, "--config", str(self._config), *faster],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**os.environ, **environment},
            )


@dataclass(frozen=True)
class Place:
    """True place of the aircraft; time_s by `clock_s` when it was read."""

    time_s: float
    position_m: tuple[float, float, float]
    on_ground: bool
    armed: bool


class Truth:
    """A truth log, read while it is written."""

    def __init__(self, site):
        self._site = site
        self._file = None
        self._path = None
        self._columns = None
        self._rest = ""
        self.places = []

    def follow(self, path):
        """Read this file from now on."""
        self.close()
        self._path, self._columns, self._rest = path, None, ""

    def read(self):
        if self._file is None:
            if self._path is None or not self._path.exists():
                return
            self._file = self._path.open(encoding="utf-8")
        *lines, self._rest = (self._rest + self._file.read()).split("\n")
        now_s = clock_s()
        for line in lines:
            if line.startswith("#"):
                continue
            (values,) = csv.reader(io.StringIO(line))
            if self._columns is None:
                self._columns = values
                continue
            row = dict(zip(self._columns, values, strict=True))
            place = in_plane(
                self._site,
                float(row["latitude_deg"]),
                float(row["longitude_deg"]),
                float(row["altitude_amsl_m"]),
            )
            self.places.append(Place(now_s, place, row["on_ground"] == "1", row["armed"] == "1"))

    def close(self):
        if self._file is not None:
            self._file.close()
            self._file = None


class Decisions:
    """The service's recording, read while it is written: a second late."""

    def __init__(self, folder):
        self._folder = folder
        self._read = {}
        self.states = []
        """Each new state: (time by `clock_s` when it was read, state)."""
        self.plans = 0

    @property
    def state(self):
        return self.states[-1][1] if self.states else None

    def read(self):
        for path in sorted(self._folder.glob("flight_*/decisions.jsonl")):
            done = self._read.get(path, 0)
            with path.open("rb") as file:
                file.seek(done)
                whole, found, _ = file.read().rpartition(b"\n")
            self._read[path] = done + len(whole) + len(found)
            for line in whole.splitlines():
                self._take(json.loads(line))

    def _take(self, line):
        if line["kind"] == "plan":
            self.plans += 1
        if line["kind"] == "status" and line["data"]["state"] != self.state:
            self.states.append((clock_s(), line["data"]["state"]))


class Rig:
    """Aircraft, link, service and operator. Seconds are the simulator's, except of `clock_s`."""

    def __init__(self, kind, folder, stack, *, vehicle="x500", speed=1.0, parameters=None):
        self.kind, self.folder, self.speed = kind, folder, speed
        # Autopilot, pilot and wire have no computer to share: the service has this priority, too.
        stack.enter_context(ahead_of_others())
        _put_session_ahead("self")
        stack.callback(_put_session_ahead, "self", 0)
        self.site_file = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
        self.site = Site.load(self.site_file)
        self._parameters = {**BASE[kind.autopilot], **(parameters or {})}
        service_port, self._operator_port = free_ports(2)
        folder.mkdir(parents=True, exist_ok=True)
        self.vehicle = self._vehicle(vehicle)
        self.service = RealService(
            folder,
            service_port,
            speed,
            vehicle="vehicle.yaml",
            site=str(self.site_file),
            recorder={"directory": str(folder)},
        )
        self.link = Link(service_port, speed=speed)
        stack.callback(self.link.close)
        stack.callback(self._end_service)
        self.truth = Truth(self.site)
        stack.callback(self.truth.close)
        self.decisions = Decisions(folder)
        self.operator = GroundStation(
            self._operator_port, kind.autopilot, speed=speed, look=self.truth.read
        )
        stack.callback(self.operator.close)
        self._pauses = []
        stack.enter_context(watched(self._pauses))
        self._starts = 0
        self._autopilot = None
        self.start_autopilot()
        stack.callback(self._end_autopilot)
        self.expects_release = False
        self.cause_s = None
        """Time of the event that causes a release."""
        self.judged = None
        """Number of judged places: all, or those before a LAND of the operator's."""
        self.states_in_charge = None
        """Number of states when the pilot took over, or LAND was given."""
        self.takeover_s = None
        self.objections = []
        """Faults that the scenario itself found."""
        self.notes = []

    def _vehicle(self, name):
        values = yaml.safe_load((shipped_configs() / "vehicles" / f"{name}.yaml").read_text())
        values["autopilot"] = self.kind.autopilot
        cells = values.setdefault("risk", {})
        cells["cells"] = MANNERS[self.kind.autopilot].cells
        cells.setdefault("endurance_s", 900.0)
        file = self.folder / "vehicle.yaml"
        file.write_text(yaml.safe_dump(values, sort_keys=False))
        return Vehicle.load(file)

    # The processes.

    def start_autopilot(self):
        """Power on at the site's start; the second call is a restart with default parameters."""
        self._starts += 1
        truth = self.folder / f"truth{self._starts}.csv"
        home = self.site.frame.to_geodetic((self.site.start_m[0], 0.0, 0.0))
        if self.kind.real:
            options = RealOptions(
                path=self.kind.path,
                folder=self.folder / f"autopilot{self._starts}",
                home=home,
                companion_port=self.link.port,
                operator_port=self._operator_port,
                truth=truth,
                parameters=self._parameters,
                speed=self.speed,
            )
            started = running_real(options)
        else:
            started = running(
                "autopilot",
                self.folder / "autopilot.log",
                "sitl",
                *("--autopilot", self.kind.autopilot),
                f"--home={home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r}",
                *("--link", f"companion=udpout:127.0.0.1:{self.link.port}"),
                *("--link", f"gcs=udpout:127.0.0.1:{self._operator_port}"),
                *(
                    word
                    for name, value in self._parameters.items()
                    for word in ("--param", f"{name}={value!r}")
                ),
                *("--truth", str(truth), "--speed", str(self.speed)),
            )
        self._autopilot = contextlib.ExitStack()
        self._process = self._autopilot.enter_context(started)
        _put_session_ahead(self._process.id)
        self.truth.follow(truth)

    def _end_autopilot(self):
        if self._autopilot is not None:
            self._autopilot.close()
            self._autopilot = None

    def restart_autopilot(self):
        """Power the autopilot off and on."""
        self._end_autopilot()
        self.operator.reset_autopilot()
        self.start_autopilot()

    def _end_service(self):
        if self.service.running():
            self.service.end(signal.SIGKILL)

    def stop_scheduling(self, seconds):
        """SIGSTOP, and SIGCONT after a while."""
        with self.service.stopped():
            self.watch(seconds)

    def start_service(self):
        """Start the service; returns when its heartbeat is received, and its planner is ready."""
        self.operator.companion_received = False
        self.service.start()
        self.wait_for(
            "the companion", lambda: self.operator.companion_received, _START_S * self.speed
        )
        self.wait_for("the planner", self.service.ready, _COMPILING_S * self.speed)

    def kill_service(self):
        """kill -9."""
        self.service.end(signal.SIGKILL)

    # Time.

    def wait_for(self, what, condition, timeout_s):
        self.operator.wait_for(what, lambda: self._look() and condition(), timeout_s)

    def watch(self, seconds):
        """Let the aircraft fly, and read what the ground station receives."""
        self.operator.wait_until(lambda: not self._look(), seconds)

    def wait_for_state(self, *states, timeout_s=_LONGEST_FLIGHT_S, since=None):
        """Waits until the service is in one of these states, or was after `since` states (`count`).

        A release that was not expected ends the wait.
        """
        since = len(self.decisions.states) - 1 if since is None else since

        def reached():
            new = [state for _, state in self.decisions.states[max(0, since) :]]
            if not self.expects_release and any(state in LET_GO for state in new):
                raise OperatorError("the companion let go")
            return any(state in states for state in new)

        self.wait_for(" or ".join(states), reached, timeout_s)

    @property
    def count(self):
        """Number of states so far."""
        return len(self.decisions.states)

    def _look(self):
        """Read the truth; OperatorError when the autopilot has ended."""
        self.truth.read()
        self.decisions.read()
        ended = self._process.ended()
        if ended is not None:
            raise OperatorError(ended)
        return True

    # The flight.

    def boot(self):
        """Waits until the autopilot is ready to arm."""
        operator = self.operator
        self.wait_for("the autopilot", lambda: operator.autopilot_received, _START_S * self.speed)
        operator.request_messages()
        self.wait_for("ready to arm", lambda: operator.ready_to_arm, max(90.0, 20.0 * self.speed))

    def take_off(self):
        """Take off to a hover above the site's start."""
        operator = self.operator
        height_m = self.site.start_m[1] + 0.5
        for attempts_left in reversed(range(10)):
            try:
                operator.take_off(height_m)
                break
            except OperatorError:
                if not attempts_left:
                    raise
                self.watch(3.0)
        self.wait_for("in the air", lambda: operator.landed_state == _IN_AIR, 30.0)
        self.wait_for("take-off done", lambda: operator.altitude_m > height_m - 0.7, 30.0)
        operator.request_origin()
        if self.kind.autopilot == "ardupilot":
            operator.hold_sticks()  # otherwise LOITER descends
        self.watch(4.0)

    def begin(self, mission=INSPECTION, index=-1):
        """Order a mission and give the companion's mode."""
        operator = self.operator
        since = self.count
        operator.order_target(mission, index)
        self.watch(1.5)
        operator.give_mode()
        self.wait_for_state("flying", timeout_s=5.0 + 3.0 * self.speed, since=since)

    def up_and_flying(self, index=-1):
        """Fly from power-on to a started mission."""
        self.boot()
        self.start_service()
        self.take_off()
        self.begin(INSPECTION, index)

    def order(self, mission, index=-1):
        self.operator.order_target(mission, index)

    def set(self, values):
        """Set parameters in flight."""
        for name, value in values.items():
            self.operator.set_parameter(name, value)

    def set_battery(self, percent):
        """Set the charge of the battery; a real ArduPilot needs 2 s."""
        if self.kind.real and self.kind.autopilot == "ardupilot":
            percent += CROSSING_PERCENT
        if self.kind.real:
            set_battery(self.operator, self.kind.autopilot, percent)
        else:
            self.set({"SIM_BATT_PCT": percent})

    def cause(self):
        """Note that the next event causes a release."""
        self.expects_release = True
        self.cause_s = clock_s()

    def object(self, text):
        """Note a fault without an end of the flight."""
        self.objections.append(text)

    def stalls(self):
        """Delays of the autopilot's positions so far, and the machine's; ends by `clock_s`."""
        found = [
            Stall(stall.time_s / self.speed, stall.length_s, stall.cause)
            for stall in stalls(self.link.positions)
        ]
        ahead_s = clock_s() - time.monotonic()
        found += [
            Stall(end_s + ahead_s, late_s * self.speed, MACHINE) for end_s, late_s in self._pauses
        ]
        return found

    def take_over(self, ask):
        """The pilot takes over with `ask`; notes the end of the stream."""
        self.expects_release = True
        self.states_in_charge = self.count
        asked_s = clock_s()
        ask()
        self.watch(3.0)
        sent = self.link.since(asked_s)
        self.takeover_s = (sent[-1].sent_s - asked_s) * self.speed if sent else 0.0

    def takeover_mode(self):
        return TAKEOVER_MODE[self.kind.autopilot]

    def land(self, *, above_landing_point=False):
        """LAND; waits until the aircraft is on the ground, disarmed.

        Elsewhere than above a landing point the operator is responsible for collisions.
        """
        self.expects_release = True
        if not above_landing_point and self.judged is None:
            self.judged = len(self.truth.places)
        self.watch(1.5 * self.speed)  # until earlier decisions are written
        if self.states_in_charge is None:
            self.states_in_charge = self.count
        self.operator.land()
        self.wait_down()

    def wait_down(self, timeout_s=90.0):
        operator = self.operator
        operator.landing = True
        self.wait_for("landed and disarmed", lambda: not operator.armed, timeout_s)

    def x_m(self):
        """The true place along the site's plane."""
        self.truth.read()
        return self.truth.places[-1].position_m[0]

    def ours(self):
        return self.operator.custom_mode == MANNERS[self.kind.autopilot].given_custom_mode
