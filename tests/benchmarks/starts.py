"""Start time of the service: `.venv/bin/python -m tests.benchmarks.starts DIR ...`.

In seconds from the start of the process, for each checkout, `--repeats` times:
- with an empty cache of kernels: until the planner is ready
- with a warm cache: until the first datagram, and until the autopilot is identified (heartbeats at
  10 Hz)
- killed in flight and restarted: until `continue` is accepted (requested each 50 ms; the autopilot
  is that of `sitl`)
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator, OperatorError

from .service import ROOT, _configuration, free_port, process, take_off
from .starved import said

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
SYSTEM, COMPANION, PAUSE_CONTINUE = 7, 195, 193
PATIENCE_S = 300.0


@contextlib.contextmanager
def service(code: Path, folder: Path, *arguments: str, **environment: str) -> Iterator[Path]:
    """The service of a checkout as a process, killed in the end; its log."""
    log = folder / "companion.log"
    with (
        log.open("wb") as file,
        subprocess.Popen(
            [sys.executable, "-m", "moar_companion", *arguments],
            cwd=code,
            # An installation has its bytecode: the first start writes it.
            env={
                **os.environ,
                "PYTHONPATH": str(code),
                "PYTHONDONTWRITEBYTECODE": "",
                **environment,
            },
            stdout=file,
            stderr=file,
        ) as running,
    ):
        try:
            yield log
        finally:
            running.kill()


def cold_s(code: Path) -> float:
    with tempfile.TemporaryDirectory() as name, socket.socket(type=socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        began_s = time.monotonic()
        link = f"udpout:127.0.0.1:{peer.getsockname()[1]}"
        # Before it was compiled beside the loop, the links were opened when it was ready.
        beside = (code / "moar_companion" / "service" / "compiling.py").exists()
        word = "planner ready" if beside else "link on"
        folder = Path(name)
        arguments = ("--connect", link, "--site", str(SITE))
        with service(code, folder, *arguments, NUMBA_CACHE_DIR=str(folder / "cache")) as log:
            _wait(lambda: word in log.read_text())
            return time.monotonic() - began_s


def warm_s(code: Path) -> tuple[float, float]:
    """Times until the first datagram, and until the autopilot is identified."""
    with tempfile.TemporaryDirectory() as name, socket.socket(type=socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(PATIENCE_S)
        codec = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=1)
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 1, 0, 3, 3
        )
        link = f"udpout:127.0.0.1:{peer.getsockname()[1]}"
        began_s = time.monotonic()
        with service(code, Path(name), "--connect", link, "--site", str(SITE)):
            data, place = peer.recvfrom(4096)
            first_s = time.monotonic() - began_s
            peer.settimeout(0.1)
            while data[5] != SYSTEM:
                peer.sendto(beat.pack(codec), place)
                next_s = time.monotonic() + 0.1
                with contextlib.suppress(TimeoutError):
                    while data[5] != SYSTEM and time.monotonic() < next_s:
                        data = peer.recv(4096)
            return first_s, time.monotonic() - began_s


def continue_s(code: Path, repeats: int) -> list[float]:
    """Killed in flight and started again, so many times in one flight."""
    home = (site := Site.load(SITE)).frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    port, operator_port = free_port(), free_port()
    operator = Operator(operator_port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    taken_s: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config = _configuration(folder, SITE, port)
        with config.open("a") as file:
            file.write(f"state: {{directory: {folder}}}\n")
        with process(
            "sitl",
            *("--home", f"{home.latitude_deg},{home.longitude_deg},{home.altitude_amsl_m}"),
            *("--link", f"companion=udpout:127.0.0.1:{port}"),
            *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
            *("--param", "COM_OBL_RC_ACT=5"),
        ):
            try:
                with service(code, folder, "--config", str(config)):
                    take_off(operator)
                    operator.wait_until(lambda: False, 2.0)
                for _ in range(repeats):
                    began_s = time.monotonic()
                    with service(code, folder, "--config", str(config)):
                        _wait_until_accepted(operator)
                        taken_s.append(time.monotonic() - began_s)
                        operator.texts.clear()
                        operator.give_mode()
                        operator.wait_for("flying", lambda: said(operator, ["flying"]), 10)
                        operator.wait_until(lambda: False, 2.0)
            finally:
                operator.close()
    return taken_s


def _wait_until_accepted(operator: Operator) -> None:
    """Request `continue` until it is accepted: again without an answer, and after a refusal."""
    end_s = time.monotonic() + PATIENCE_S
    for number in itertools.count():
        # No repeat of what was refused, which would have that answer again; it means nothing.
        parameters = (1.0, number, *[0.0] * 5)
        answer = mavlink.MAV_RESULT_IN_PROGRESS
        while answer == mavlink.MAV_RESULT_IN_PROGRESS:
            if time.monotonic() > end_s:
                raise OperatorError(f"not within {PATIENCE_S:g} s")
            operator._answers.pop(PAUSE_CONTINUE, None)
            operator._send(
                mavlink.MAVLink_command_long_message(1, COMPANION, PAUSE_CONTINUE, 0, *parameters)
            )
            operator.wait_until(lambda: PAUSE_CONTINUE in operator._answers, 0.05)
            answer = operator._answers.get(PAUSE_CONTINUE, answer)
        if answer == mavlink.MAV_RESULT_ACCEPTED:
            return
        operator.wait_until(lambda: False, 0.05)


def _wait(reached: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not reached():
        if time.monotonic() > end_s:
            raise OperatorError(f"not within {PATIENCE_S:g} s")
        time.sleep(0.005)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("code", type=Path, nargs="*", default=[ROOT])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=("cold", "warm", "continue"))
    given = parser.parse_args()
    for code in given.code:
        for _ in range(given.repeats):
            if given.only in {None, "warm"}:
                _report(code, "first datagram, autopilot known", warm_s(code))
            if given.only in {None, "cold"}:
                _report(code, "planner ready, empty cache", [cold_s(code)])
        if given.only in {None, "continue"}:
            _report(code, "`continue` accepted", continue_s(code, given.repeats))


def _report(code: Path, what: str, seconds: Sequence[float]) -> None:
    sys.stdout.write(f"| {code.name} | {what} | {' | '.join(f'{it:.2f}' for it in seconds)} |\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
