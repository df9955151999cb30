"""Ctrl-C and SIGTERM at any moment: no traceback, no half file, no process left behind.

The moments begin where Python has handed over to the program: what an interrupt does to an
interpreter that is still starting is its own business.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.settings.config import shipped_configs
from tests.thorough import sampled

ROOT = Path(__file__).parents[2]
SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
HANDED_OVER = """
import os, signal, sys
signal.signal(signal.SIGINT, lambda *_: os._exit(1))
print("handed over", flush=True)
from {module} import main
sys.exit(main())
"""
PATIENCE_S = 60.0


def plan(folder, _port):
    outputs = ["--json", "plan.json", "--maps", "maps.npz", "--plot", "plan.png"]
    return ["plan", SITE, "--mission", "inspection", *outputs]


def replay(folder, _port):
    packet = mavlink.MAVLink_heartbeat_message(2, 12, 209, 0x00060000, 4, 3).pack(
        mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    )
    records = (struct.pack(">Q", 10**15 + 10**5 * index) + packet for index in range(30_000))
    (folder / "flight.tlog").write_bytes(b"".join(records))
    return ["replay", "flight.tlog", "--json", "replay.json", "--plot", "replay.png"]


def view(folder, _port):
    return ["view", "silent.sock"]


def check(_folder, port):
    return ["check", "--site", SITE, "--connect", f"udp:127.0.0.1:{port}"]


def command(_folder, port):
    return ["command", "hold", "--connect", f"udp:127.0.0.1:{port}"]


def service(folder, port):
    (folder / "companion.yaml").write_text(
        json.dumps(
            {
                "vehicle": str(shipped_configs() / "vehicles" / "x500.yaml"),
                "site": str(SITE),
                "links": [{"url": f"udp:127.0.0.1:{port}"}],
                "view": {"socket": "view.sock"},
            }
        )
    )
    return ["--config", "companion.yaml"]


def autopilot(_folder, port):
    return ["--link", f"companion=udpout:127.0.0.1:{port}", "--truth", "truth.csv"]


def demonstration(_folder, _port):
    return ["--headless", "--out", "flight"]


COMPANION, SIMULATOR, FLY = (
    "moar_companion.__main__",
    "sitl.__main__",
    "sitl.demonstration.__main__",
)
DONE, ENDED = 0, 1
LONG = sampled((0.4,), (0.0, 0.1, 0.4, 0.8, 1.1, 1.7))
PROGRAMS = {
    # title: module, arguments, moments (those before 1 s by tests/run), signals
    "plan": (COMPANION, plan, (0.0, 0.6), [signal.SIGINT]),
    "check": (COMPANION, check, (0.2,), [signal.SIGINT]),
    "replay": (COMPANION, replay, (0.6,), [signal.SIGINT]),
    "command": (COMPANION, command, (0.2, 0.9), [signal.SIGINT]),
    "view": (COMPANION, view, (0.2, 0.5), [signal.SIGINT]),
    "the service": (COMPANION, service, (0.2, 1.1), [signal.SIGINT, signal.SIGTERM]),
    "the autopilot": (SIMULATOR, autopilot, (0.0, 0.3), [signal.SIGINT, signal.SIGTERM]),
    "the demonstration": (FLY, demonstration, (0.3,), [signal.SIGINT, signal.SIGTERM]),
}
CASES = [
    pytest.param(
        module,
        arguments,
        number,
        delay_s,
        id=f"{title}, {number.name} after {delay_s} s",
        marks=()
        if delay_s in moments and delay_s < 1.0 and number is signals[0]
        else pytest.mark.slow,
    )
    for title, (module, arguments, moments, signals) in PROGRAMS.items()
    for number in signals
    for delay_s in sorted({*moments, *LONG})
]


def test_few_modules_are_loaded_before_interrupts_are_caught():
    loaded = subprocess.run(
        [sys.executable, "-S", "-c", "import moar_companion.__main__, sys; print(*sys.modules)"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert "moar_companion.__main__" in loaded
    assert {"typing", "argparse", "asyncio", "numpy"}.isdisjoint(loaded)


@contextlib.contextmanager
def begun(module, arguments, folder):
    """A program, once Python has handed over to it."""
    process = subprocess.Popen(
        [sys.executable, "-c", HANDED_OVER.format(module=module), *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "handed over\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def whole(path):
    """True if an output is complete."""
    match path.suffix:
        case ".json":
            return bool(json.loads(path.read_text()))
        case ".npz":
            with np.load(path) as maps:
                return all(maps[name].size for name in maps)
        case ".png":
            return path.read_bytes().endswith(b"IEND\xaeB`\x82")
    return True


@pytest.mark.parametrize(("module", "arguments", "number", "delay_s"), CASES)
def test_a_program_ends_cleanly_on_a_signal(
    module, arguments, number, delay_s, tmp_path, monkeypatch, unused_udp_port
):
    monkeypatch.chdir(tmp_path)
    words = arguments(tmp_path, unused_udp_port)
    with socket.socket(socket.AF_UNIX) as silent:
        silent.bind("silent.sock")
        silent.listen()
        with begun(module, words, tmp_path) as process:
            time.sleep(delay_s)
            children = psutil.Process(process.pid).children(recursive=True)
            process.send_signal(number)
            _, errors = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in errors
    assert "Exception" not in errors
    assert process.returncode in (DONE, ENDED, -number)
    if module == COMPANION:
        assert process.returncode != -signal.SIGINT
    _, left = psutil.wait_procs(children, timeout=PATIENCE_S)
    assert left == []
    assert [path.name for path in tmp_path.iterdir() if not whole(path)] == []
    assert not (tmp_path / "view.sock").exists()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
