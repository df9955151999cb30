"""The fake autopilot and the service as processes, on ports of their own."""

from __future__ import annotations

import contextlib
import csv
import socket
import subprocess
import sys

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from tests.processes import ROOT, process

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE = shipped_configs() / "vehicles" / "x500.yaml"


def free_ports(count):
    """Free UDP ports of this machine."""
    with contextlib.ExitStack() as stack:
        sockets = [
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            for _ in range(count)
        ]
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [item.getsockname()[1] for item in sockets]


@contextlib.contextmanager
def running(log, *module_and_arguments):
    """A Python module as a process, with its output in a file; ended by SIGTERM."""
    with (
        log.open("wb") as output,
        process(
            *module_and_arguments,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
        ) as started,
    ):
        try:
            yield started
            assert started.poll() is None, log.read_text()
        finally:
            started.terminate()
            started.wait(20)


def autopilot(folder, *arguments):
    """The fake autopilot, with its truth in the folder."""
    truth = folder / "truth.csv"
    return running(folder / "autopilot.log", "sitl", "--truth", truth, *arguments)


_KINDS = {
    "px4": ("--param", "COM_OBL_RC_ACT=5"),
    "ardupilot": ("--autopilot", "ardupilot", "--param", "SIM_BOOT_S=8"),
}
"""Arguments of the fake autopilots: PX4 holds after an offboard loss, ArduPilot starts sooner."""


@contextlib.contextmanager
def companion_beside_autopilot(folder, kind="px4"):
    """A fake autopilot at the site's start with the service on its companion link.

    Yields the ports to which the autopilot sends for ground stations.
    """
    vehicle = folder / "vehicle.yaml"
    vehicle.write_text(VEHICLE.read_text().replace("autopilot: px4", f"autopilot: {kind}"))
    companion_port, *operator_ports = free_ports(3)
    site = Site.load(SITE)
    home = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    links = [
        word
        for number, port in enumerate(operator_ports)
        for word in ("--link", f"gcs{number}=udpout:127.0.0.1:{port}")
    ]
    with (
        autopilot(
            folder,
            f"--home={home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r}",
            "--link",
            f"companion=udpout:127.0.0.1:{companion_port}",
            *_KINDS[kind],
            *links,
        ),
        running(
            folder / "companion.log",
            "moar_companion",
            "--connect",
            f"udp:127.0.0.1:{companion_port}",
            "--vehicle",
            vehicle,
            "--site",
            SITE,
        ),
    ):
        yield operator_ports


def ordered(port, *arguments):
    """Runs `moar-companion command` on a ground station's port, like its user."""
    return subprocess.run(
        [
            *(sys.executable, "-m", "moar_companion", "command"),
            *map(str, arguments),
            *("--connect", f"udp:127.0.0.1:{port}"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def truth_of(folder):
    """Rows of the truth log so far, each a dict of numbers and the mode's name."""
    lines = (folder / "truth.csv").read_text().splitlines()
    return [
        {name: value if name == "mode" else float(value) for name, value in row.items()}
        for row in csv.DictReader(lines[1:])
        if None not in row.values() and row["on_ground"]
    ]
