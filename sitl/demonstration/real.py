"""A real autopilot in its own simulator: PX4's SIH or ArduCopter's SITL, which the user has built.

Each run has a folder of its own with fresh parameters and ports of its own. The true state comes
from the simulator on a third link, and is written in the form of the fake autopilot's truth log.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from sitl.geodesy import Geodetic

from .processes import Process, free_ports

_PX4_MODEL: Final = "sihsim_quadx"
_PX4_LINKS: Final = "etc/init.d-posix/px4-rc.mavlink"
_PX4_START: Final = "etc/init.d-posix/rcS"
_PX4_SYSTEM_ID: Final = "param set MAV_SYS_ID $((px4_instance+1))"
"""Line of the start-up script; whatever the instance, the aircraft is system 1."""
_COPTER_DEFAULTS: Final = "Tools/autotest/default_params/copter.parm"
"""From the root of ArduPilot's sources; the program is in build/sitl/bin."""
_TRUTH_INTERVAL_US: Final = 50_000
_STATE_INTERVAL_US: Final = 200_000
_ASK_AGAIN_S: Final = 2.0
_POLL_S: Final = 0.2
_ON_GROUND: Final = int(mavlink.MAV_LANDED_STATE_ON_GROUND)
_FIRST_INSTANCE, _LAST_INSTANCE = 40, 250
"""PX4's numbers of instances: those of a user's own simulators are small."""

PARAMETERS: Final[Mapping[str, Mapping[str, float]]] = {
    "px4": {"SIM_BAT_DRAIN": 900.0, "SIM_BAT_MIN_PCT": 1.0},
    "ardupilot": {"SIM_WIND_T": 1},
}
"""Simulators' parameters: a battery that may become empty, the same wind at all heights."""


class RealError(Exception):
    """A path that is no autopilot, or one that cannot be started; one line."""


def autopilot_at(path: Path) -> str:
    """Kind of the autopilot: PX4's build folder, or ArduCopter's program; RealError if neither."""
    if (path / "bin" / "px4").is_file() and (path / "etc").is_dir():
        return "px4"
    if path.is_file() and os.access(path, os.X_OK):
        return "ardupilot"
    raise RealError(
        f"{path}: must be PX4's build folder (with bin/px4 and etc) or the program arducopter"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RealOptions:
    """A run. folder: its own, made when missing; truth: the log of the true state."""

    path: Path
    folder: Path
    home: Geodetic
    companion_port: int
    operator_port: int
    truth: Path
    parameters: Mapping[str, float] = field(default_factory=dict)
    speed: float = 1.0


@contextlib.contextmanager
def running_real(options: RealOptions) -> Iterator[Process]:
    """The autopilot as a process within the context, and its truth in a file; RealError."""
    kind = autopilot_at(options.path)
    options.folder.mkdir(parents=True, exist_ok=True)
    (truth_port,) = free_ports(1)
    recorder = TruthRecorder(
        truth_port, options.truth, speed=options.speed, ask=kind == "ardupilot"
    )
    try:
        process = (_px4 if kind == "px4" else _ardupilot)(options, truth_port)
        try:
            yield process
        finally:
            process.stop()
    finally:
        recorder.close()


def _px4(options: RealOptions, truth_port: int) -> Process:
    """PX4, in a folder with its start-up scripts, with the links of this run."""
    etc = options.folder / "etc"
    if not etc.exists():
        shutil.copytree(options.path / "etc", etc)
        start = options.folder / _PX4_START
        text = start.read_text(encoding="utf-8")
        start.write_text(text.replace(_PX4_SYSTEM_ID, "param set MAV_SYS_ID 1"), encoding="utf-8")
    gcs, onboard, truth = free_ports(3)
    values = {**PARAMETERS["px4"], **options.parameters}
    lines = [
        "#!/bin/sh",
        *(f"param set {name} {value:g}" for name, value in values.items()),
        f"mavlink start -x -u {gcs} -r 4000000 -f -o {options.operator_port}",
        f"mavlink stream -r 50 -s GLOBAL_POSITION_INT -u {gcs}",
        f"mavlink start -x -u {onboard} -r 4000000 -f -m onboard -o {options.companion_port}",
        f"mavlink start -x -u {truth} -r 400000 -m custom -o {truth_port}",
        f"mavlink stream -r 25 -s HIL_STATE_QUATERNION -u {truth}",
        f"mavlink stream -r 5 -s EXTENDED_SYS_STATE -u {truth}",
    ]
    (options.folder / _PX4_LINKS).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Process(
        "autopilot",
        options.folder / "autopilot.log",
        str(options.path / "bin" / "px4"),
        *("-d", "-w", ".", "-i", str(_free_instance())),
        folder=options.folder,
        environment={
            "PX4_SIM_MODEL": _PX4_MODEL,
            "PX4_SIM_SPEED_FACTOR": f"{options.speed:g}",
            "PX4_HOME_LAT": repr(options.home.latitude_deg),
            "PX4_HOME_LON": repr(options.home.longitude_deg),
            "PX4_HOME_ALT": repr(options.home.altitude_amsl_m),
        },
    )


def _free_instance() -> int:
    """A number of an instance of PX4 that does not run on this machine."""
    for number in range(_FIRST_INSTANCE, _LAST_INSTANCE):
        if not Path(f"/tmp/px4-sock-{number}").exists():  # noqa: S108 - PX4's own
            return number
    raise RealError("PX4: no instance is free, remove /tmp/px4-sock-*")


def _ardupilot(options: RealOptions, truth_port: int) -> Process:
    """ArduCopter, with the parameters of its own simulator and of this run."""
    defaults = options.path.resolve().parents[3] / _COPTER_DEFAULTS
    if not defaults.is_file():
        raise RealError(f"{options.path}: {defaults} is missing, must be beside the build")
    ours = options.folder / "ours.parm"
    values = {**PARAMETERS["ardupilot"], **options.parameters}
    ours.write_text(
        "".join(f"{name} {value:g}\n" for name, value in values.items()), encoding="utf-8"
    )
    home = options.home
    base, remote_control = free_ports(2)
    return Process(
        "autopilot",
        options.folder / "autopilot.log",
        str(options.path.resolve()),
        *("--model", "+", "--speedup", f"{options.speed:g}"),
        *("--home", f"{home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r},0"),
        *("--defaults", f"{defaults},{ours}"),
        *("--base-port", str(base), "--rc-in-port", str(remote_control)),
        *("--serial0", f"udpclient:127.0.0.1:{options.operator_port}"),
        *("--serial1", f"udpclient:127.0.0.1:{options.companion_port}"),
        *("--serial2", f"udpclient:127.0.0.1:{truth_port}"),
        folder=options.folder,
    )


class TruthRecorder:
    """Writes a simulator's true state: HIL_STATE_QUATERNION (PX4), SIM_STATE (ArduPilot).

    Times are of a clock that runs `speed` times as fast as real time.
    """

    def __init__(self, port: int, path: Path, *, speed: float, ask: bool) -> None:
        """Listen; ask: the autopilot sends requested messages alone."""
        self._speed, self._ask = speed, ask
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(_POLL_S)
        self._codec = mavlink.MAVLink(None, srcSystem=254, srcComponent=1)
        self._codec.robust_parsing = True
        self._armed, self._on_ground = False, True
        self._asked_s = self._heard_s = 0.0
        self._start_s = time.monotonic()
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self._file.write("time_s,latitude_deg,longitude_deg,altitude_amsl_m,armed,on_ground\n")
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._ending.set()
        self._thread.join()
        self._socket.close()
        self._file.close()

    def _record(self) -> None:
        while not self._ending.is_set():
            try:
                data, peer = self._socket.recvfrom(65536)
            except (TimeoutError, ConnectionError):
                continue
            for message in self._codec.parse_buffer(data) or []:
                self._take(message)
            now_s = time.monotonic()
            if self._ask and now_s - max(self._asked_s, self._heard_s) > _ASK_AGAIN_S:
                self._asked_s = now_s
                self._request(peer)

    def _request(self, peer: tuple[str, int]) -> None:
        for number, interval_us in (
            (mavlink.MAVLINK_MSG_ID_SIM_STATE, _TRUTH_INTERVAL_US),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, _STATE_INTERVAL_US),
        ):
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            message = mavlink.MAVLink_command_long_message(
                1, 1, command, 0, number, interval_us, *[0.0] * 5
            )
            self._socket.sendto(message.pack(self._codec), peer)

    def _take(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            case "EXTENDED_SYS_STATE":
                self._on_ground = message.landed_state == _ON_GROUND
            case "HIL_STATE_QUATERNION":
                self._write(message.lat, message.lon, message.alt * 1e-3)
            case "SIM_STATE":
                self._write(message.lat_int, message.lon_int, message.alt)

    def _write(self, latitude_e7: int, longitude_e7: int, altitude_m: float) -> None:
        self._heard_s = time.monotonic()
        time_s = (self._heard_s - self._start_s) * self._speed
        self._file.write(
            f"{time_s:.3f},{latitude_e7 * 1e-7:.7f},"
            f"{longitude_e7 * 1e-7:.7f},{altitude_m:.4f},"
            f"{int(self._armed)},{int(self._on_ground)}\n"
        )


def numbers_of(texts: tuple[str, ...]) -> dict[str, float]:
    """Parameters as on the command line, NAME=NUMBER."""
    pairs = (re.split("=", text, maxsplit=1) for text in texts)
    return {name: float(value) for name, value in pairs}
