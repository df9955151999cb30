"""Outputs that cannot be written: files, stdout, recordings."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands import cli, outputs
from moar_companion.settings.config import shipped_configs
from tests.processes import companion

SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = str(shipped_configs() / "vehicles" / "x500.yaml")
PLAN = ["plan", SITE, "--mission", "exit"]


def program(arguments, *, file_bytes=None, **options):
    """The program as a process. A limit on its file size stands for a disk that is soon full."""

    def limit():
        if file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))

    return companion(*arguments, preexec_fn=limit, **options)


@pytest.fixture
def recording(tmp_path):
    """A minute of heartbeats."""
    packet = mavlink.MAVLink_heartbeat_message(2, 12, 209, 0x00060000, 4, 3).pack(
        mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    )
    path = tmp_path / "flight.tlog"
    path.write_bytes(
        b"".join((10**15 + 10**6 * second).to_bytes(8, "big") + packet for second in range(60))
    )
    return str(path)


@pytest.mark.parametrize("option", ["--json", "--maps", "--plot"])
def test_a_full_device_as_output_of_plan_is_one_line(option, capsys):
    assert cli.main([*PLAN, option, "/dev/full"]) == 1
    out, err = capsys.readouterr()
    assert "exit: found" in out
    assert err == f"moar-companion: {option}: /dev/full: No space left on device\n"


@pytest.mark.parametrize("option", ["--json", "--plot"])
def test_a_full_device_as_output_of_replay_is_one_line(option, recording, capsys):
    assert cli.main(["replay", recording, option, "/dev/full"]) == 1
    out, err = capsys.readouterr()
    assert "px4" in out
    assert err == f"moar-companion: {option}: /dev/full: No space left on device\n"


@pytest.mark.slow
def test_a_disk_that_is_full_in_the_middle_leaves_no_half_file(tmp_path):
    files = {option: tmp_path / f"out.{option[2:]}" for option in ("--json", "--maps", "--plot")}
    files["--plot"] = tmp_path / "out.png"
    files["--maps"].write_bytes(b"old")
    words = [str(word) for pair in files.items() for word in pair]
    with program([*PLAN, *words], file_bytes=1000, stdout=subprocess.PIPE) as process:
        out, err = process.communicate()
    assert process.returncode == 1
    assert "exit: found" in out
    reported = "; ".join(f"{option}: {path}: File too large" for option, path in files.items())
    assert err == f"moar-companion: {reported}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["out.maps"]
    assert files["--maps"].read_bytes() == b"old"


@pytest.mark.slow
def test_a_full_stdout_is_one_line_and_a_closed_stdout_is_silent(recording):
    commands = {
        "check": ["check", "--files"],
        "replay --json": ["replay", recording, "--json", "-"],
    }
    with contextlib.ExitStack() as stack:
        full = stack.enter_context(Path("/dev/full").open("w"))
        reading, writing = os.pipe()
        os.close(reading)
        processes = {
            (name, stdout): stack.enter_context(program(arguments, stdout=stdout))
            for name, arguments in commands.items()
            for stdout in (full, writing)
        }
        os.close(writing)
        for (name, stdout), process in processes.items():
            _, err = process.communicate()
            line = "moar-companion: stdout: No space left on device\n" if stdout is full else ""
            assert (name, process.returncode, err) == (name, 1, line)


def test_a_full_disk_ends_the_recording_and_not_the_service(tmp_path, unused_udp_port):
    config = tmp_path / "companion.yaml"
    config.write_text(
        json.dumps(
            {
                "vehicle": VEHICLE,
                "links": [{"url": f"udp:127.0.0.1:{unused_udp_port}"}],
                "recorder": {"directory": "flights"},
            }
        )
    )
    with program(["--config", config], file_bytes=200, stdout=subprocess.DEVNULL) as process:
        recording, link, warning = itertools.islice(process.stderr, 3)
        process.terminate()
        _, rest = process.communicate()
    assert recording.startswith(f"INFO recording to {tmp_path / 'flights'}")
    assert link.startswith("INFO autopilot link on udpin:")
    assert warning.startswith("WARNING recording ended: ")
    assert warning.endswith(": File too large\n")
    assert (process.returncode, rest) == (0, "")


def test_the_planner_is_compiled_with_a_bar_where_a_person_watches(monkeypatch, capsys):
    shown = []

    def fill_cache(report, _stopped):
        report(3, 11)
        shown.append(True)
        return True

    monkeypatch.setattr("moar_companion.service.compiling.fill_cache", fill_cache)
    outputs.report_compiling()
    assert shown == []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    outputs.report_compiling()
    assert shown == [True]
    assert "3/11" in capsys.readouterr().err
