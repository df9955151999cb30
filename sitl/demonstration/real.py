"""A real autopilot in its own simulator: PX4's SIH or ArduCopter's SITL, which the user has built.

Each run has a folder of its own with fresh parameters and ports of its own. The true state comes
from the simulator on a third link.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from sitl.geodesy import Geodetic

from .processes import Process, free_ports
from .truth_recorder import TRUTH_HZ, TruePose, TruthRecorder

_PX4_MODEL: Final = "sihsim_quadx"
_PX4_LINKS: Final = "etc/init.d-posix/px4-rc.mavlink"
_PX4_START: Final = "etc/init.d-posix/rcS"
_PX4_SYSTEM_ID: Final = "param set MAV_SYS_ID $((px4_instance+1))"
"""Line of the start-up script; the aircraft of any instance is system 1."""
_PX4_MODULES: Final[Mapping[str, tuple[str, ...]]] = {
    "MNT_MODE_IN": ("gimbal",),
    "TRIG_MODE": ("camera_trigger", "camera_feedback"),
}
"""Modules that the start-up script starts by a parameter, before it sets those of this run."""
_COPTER_DEFAULTS: Final = "Tools/autotest/default_params/copter.parm"
"""From the root of ArduPilot's sources; the program is in build/sitl/bin."""
_FIRST_INSTANCE, _LAST_INSTANCE = 40, 250
"""PX4's numbers of instances: those of a user's own simulators are small."""

PARAMETERS: Final[Mapping[str, Mapping[str, float]]] = {
    "px4": {"SIM_BAT_DRAIN": 900.0, "SIM_BAT_MIN_PCT": 1.0},
    "ardupilot": {"SIM_WIND_T": 1},
}
"""Simulators' parameters: a battery that may become empty, the same wind at all heights."""


class RealError(Exception):
    """A path without an autopilot, or an autopilot that cannot be started; one line."""


def autopilot_at(path: Path) -> str:
    """Kind of the autopilot: PX4's build folder, or ArduCopter's program; RealError if neither."""
    if (path / "bin" / "px4").is_file() and (path / "etc").is_dir():
        return "px4"
    if path.is_file() and os.access(path, os.X_OK):
        return "ardupilot"
    raise RealError(
        f"{path}: must be PX4's build folder (with bin/px4 and etc) or the program arducopter"
    )


class Carried(Protocol):
    """A sensor on the aircraft."""

    def step(self, truth: TruePose) -> None:
        """Take the next true pose."""

    def close(self) -> None:
        """End."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealOptions:
    """A run. folder: its own, made when missing; truth: the log of the true state.

    carried: makes each sensor that the aircraft carries.
    """

    path: Path
    folder: Path
    home: Geodetic
    companion_port: int
    operator_port: int
    truth: Path
    parameters: Mapping[str, float] = field(default_factory=dict)
    speed: float = 1.0
    carried: tuple[Callable[[], Carried], ...] = ()


@contextlib.contextmanager
def running_real(options: RealOptions) -> Iterator[Process]:
    """The autopilot as a process within the context, and its truth in a file; RealError."""
    kind = autopilot_at(options.path)
    options.folder.mkdir(parents=True, exist_ok=True)
    (truth_port,) = free_ports(1)
    with contextlib.ExitStack() as stack:
        carried = [stack.enter_context(contextlib.closing(make())) for make in options.carried]

        def look(pose: TruePose) -> None:
            for each in carried:
                each.step(pose)

        recorder = TruthRecorder(
            truth_port, options.truth, speed=options.speed, ask=kind == "ardupilot", look=look
        )
        stack.callback(recorder.close)
        process = (_px4 if kind == "px4" else _ardupilot)(options, truth_port)
        stack.callback(process.stop)
        yield process


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
        *(f"{module} start" for name in values for module in _PX4_MODULES.get(name, ())),
        f"mavlink start -x -u {gcs} -r 4000000 -f -o {options.operator_port}",
        f"mavlink stream -r 50 -s GLOBAL_POSITION_INT -u {gcs}",
        f"mavlink start -x -u {onboard} -r 4000000 -f -m onboard -o {options.companion_port}",
        f"mavlink start -x -u {truth} -r 400000 -m custom -o {truth_port}",
        f"mavlink stream -r {TRUTH_HZ} -s HIL_STATE_QUATERNION -u {truth}",
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


def numbers_of(texts: tuple[str, ...]) -> dict[str, float]:
    """Parameters as on the command line, NAME=NUMBER."""
    pairs = (re.split("=", text, maxsplit=1) for text in texts)
    return {name: float(value) for name, value in pairs}
