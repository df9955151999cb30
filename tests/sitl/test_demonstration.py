"""The demonstration as a user flies it: real processes, real UDP, real time or faster."""

import collections
import json
import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from PIL import Image
from pymavlink import mavutil

from moar_companion import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration import fly as demonstration
from sitl.demonstration.flight_folder import gather, link_latest
from sitl.demonstration.judge import read_truth
from sitl.demonstration.settings import read_settings
from sitl.python_version import complaint
from tests.real_time import real_time
from tests.thorough import sampled

ROOT = Path(__file__).parents[2]


def fly(*arguments, timeout_s=300):
    return subprocess.run(
        [sys.executable, "-m", "sitl.demonstration", "--headless", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def refused(capsys, *arguments):
    """Error line of arguments with which nothing is flown."""
    try:
        status = demonstration.main(["--headless", *arguments])
    except SystemExit as ended:  # argparse's
        status = ended.code
    assert status == 2
    return capsys.readouterr().err


def flown_well(folder, *arguments):
    """Decisions on a flight without fault, on the simulator's clock, twice as fast."""
    flown = fly("--out", str(folder), "--speed", "2", *arguments)
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert flown.stdout.endswith("mission flown and landed\n")
    assert flown.stderr == ""
    decisions = [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()]
    states = [
        (item["time_s"], item["data"]["state"]) for item in decisions if item["kind"] == "state"
    ]
    assert [state for _, state in states].count("at_target") == 2
    # It stays 5 s at a target.
    at_target_s = next(time_s for time_s, state in states if state == "at_target")
    after_s = next(time_s for time_s, _ in states if time_s > at_target_s)
    assert after_s - at_target_s == pytest.approx(5.0, abs=0.5)
    return decisions


@real_time
def test_the_demonstration_flies_two_splices_and_the_exit_lands_and_draws_its_picture(tmp_path):
    decisions = flown_well(tmp_path)
    with Image.open(tmp_path / "flight.png") as picture:
        assert min(picture.size) > 800
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 1000
    states = [item["data"]["state"] for item in decisions if item["kind"] == "state"]
    assert states.index("landing_leg") > states.index("at_target")
    wind = [item["data"]["risk"]["wind"] for item in decisions if item["kind"] == "status"]
    assert max(wind) > 0.5
    towards = [item["data"] for item in decisions if item["kind"] in ("text", "replan")]
    reasons = [data["reason"] for data in towards]
    inner = reasons[reasons.index("flying inspection to splice-inner") :]
    inner = inner[: inner.index("at target splice-inner")]
    assert any(reason.startswith("wind risk") for reason in inner)  # the path is weighed again
    log = mavutil.mavlink_connection(str(tmp_path / "flight.tlog"), dialect="all")
    seen = set()
    while (message := log.recv_match()) is not None:
        seen.add((message.get_type(), message.get_srcComponent()))
    log.close()
    assert {
        ("SET_POSITION_TARGET_LOCAL_NED", 195),
        ("NAMED_VALUE_FLOAT", 195),
        ("LOCAL_POSITION_NED", 1),
        ("COMMAND_LONG", 190),
    } <= seen


@real_time
def test_ardupilot_is_flown_as_well(tmp_path):
    flown_well(tmp_path, "--autopilot", "ardupilot")


@real_time
@pytest.mark.alone
@pytest.mark.parametrize("autopilot", sampled(["px4"], ["px4", "ardupilot"]))
def test_with_rough_target_positions_alone_the_companion_sees_obstacles_and_avoids_them(
    tmp_path, autopilot
):
    flown = fly("--perceive", "--autopilot", autopilot, "--out", str(tmp_path))
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert "seen: wire " in flown.stdout
    assert Site.load(tmp_path / "site.yaml").obstacles == ()
    decisions = [
        json.loads(line) for line in (tmp_path / "decisions.jsonl").read_text().splitlines()
    ]
    seen = [item["data"] for item in decisions if item["kind"] == "seen"]
    assert max(len(data["conductors"]) for data in seen) == 7  # six of the line, and the cable
    with Image.open(tmp_path / "perceived.png") as picture:
        assert min(picture.size) > 800


@real_time
def test_a_machine_that_becomes_too_slow_is_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demonstration, "kept_speed", lambda wanted: wanted)
    status = demonstration.main(["--headless", "--speed", "500", "--out", str(tmp_path)])
    out, err = capsys.readouterr()
    assert status == 1
    assert "is --speed 500 too much for this machine?" in out
    assert err == ""


def test_a_speed_that_the_machine_does_not_keep_is_lowered_with_a_line(monkeypatch, capsys):
    monkeypatch.setattr(demonstration, "kept_speed", lambda wanted: min(wanted, 2.55))
    settings = read_settings(["--speed", "4"])
    assert demonstration._paced(settings) == replace(settings, speed=2.5)
    assert capsys.readouterr().out == "this machine does not keep --speed 4 now: 2.5\n"
    assert demonstration._paced(replace(settings, speed=2.0)).speed == 2.0
    assert capsys.readouterr().out == ""


@real_time
def test_on_a_terminal_the_view_of_the_service_is_shown_and_the_output_stays(tmp_path):
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "sitl.demonstration", "--out", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "30"},
        stdout=theirs,
        stderr=theirs,
    ) as running:
        shown = b""
        deadline_s = time.monotonic() + 60.0
        while b"px4, system 1" not in shown and time.monotonic() < deadline_s:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65_536)
        assert b"px4, system 1" in shown
        running.send_signal(signal.SIGINT)
        while running.poll() is None:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65_536)
    while select.select([ours], [], [], 0)[0]:
        shown += os.read(ours, 65_536)
    os.close(ours)
    os.close(theirs)
    _, _, after_the_view = shown.rpartition(b"\x1b[?1049l")
    assert running.returncode == 1
    assert b"waiting for autopilot and companion" in after_the_view
    assert b"stopped by the user" in after_the_view


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--site", "missing.yaml"), "missing.yaml"),
        (("--site", "README.md"), "README.md"),
        (("--scenario", "missing.yaml"), "missing.yaml"),
        (("--out", "/dev/null/x"), "/dev/null/x"),
        (("--out", "/sys"), "/sys"),
        (("--speed-of-light",), "--speed-of-light"),
        (("--speed", "0"), "--speed"),
        (("--speed=-2",), "--speed"),
        (("--speed", "inf"), "--speed"),
        (("--speed", "nan"), "--speed"),
        (("--speed", "fast"), "--speed"),
        (("--autopilot", "betaflight"), "betaflight"),
        (("--landing", "exit:1"), "--landing"),
        (("--landing", "home"), "--landing"),
        (("--landing", "evacuation:-1"), "--landing"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, named, tmp_path, capsys):
    out = () if "--out" in arguments else ("--out", str(tmp_path))
    output = refused(capsys, *arguments, *out)
    assert output.count("\n") == 1
    assert named in output


@pytest.mark.timeout(20)
@pytest.mark.parametrize("option", ["--scenario", "--site"])
def test_a_pipe_is_one_line_and_status_2(option, tmp_path, capsys):
    os.mkfifo(pipe := tmp_path / "pipe.yaml")
    line = refused(capsys, option, str(pipe), "--out", str(tmp_path / "out"))
    assert line.endswith("pipe.yaml: is a pipe, must be a file\n")


@pytest.mark.parametrize("arguments", [("--site", "a\x1b[31mb.yaml"), ("a\x1b[31mb\n",)])
def test_a_name_with_control_characters_does_not_steer_the_terminal(arguments, tmp_path, capsys):
    (line,) = refused(capsys, *arguments, "--out", str(tmp_path)).splitlines()
    assert line.isprintable()


@pytest.mark.slow
def test_a_user_sees_that_line_and_status(tmp_path):
    flown = fly("--site", "missing.yaml", "--out", str(tmp_path), timeout_s=60)
    assert (flown.returncode, flown.stdout) == (2, "")
    assert flown.stderr.startswith("sitl/fly: ")
    assert flown.stderr.endswith("missing.yaml: no such file\n")


def test_a_folder_that_holds_a_flight_is_not_flown_into_again(tmp_path, capsys):
    (tmp_path / "truth.csv").write_text("kept")
    assert refused(capsys, "--out", str(tmp_path)).count("\n") == 1
    assert (tmp_path / "truth.csv").read_text() == "kept"


@pytest.mark.parametrize("missing", ["targets", "landing"])
def test_a_site_that_the_script_cannot_be_flown_on_is_refused(tmp_path, missing, capsys):
    lines = (shipped_configs() / "sites" / "315kv_double_circuit.yaml").read_text().splitlines()
    kept, skipping = [], False
    for line in lines:
        if not line.startswith((" ", "#", "-")) and line:
            skipping = line.startswith(f"{missing}:")
        kept += [] if skipping else [line]
    site = tmp_path / "site.yaml"
    site.write_text("\n".join(kept))
    output = refused(capsys, "--site", str(site), "--out", str(tmp_path / "out"))
    assert output == f"sitl/fly: {site}: must have targets and landing points to be flown\n"


def lines_of(name, *changes):
    """A shipped site with some of its text replaced."""
    text = (shipped_configs() / "sites" / name).read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text


HIGH = lines_of(
    "horizontal_three_conductors.yaml",
    (
        "z_m: [0.0, 20.0], resolution_m: 0.3, min_altitude_m: 2.0",
        "z_m: [4.0, 20.0], resolution_m: 0.3",
    ),
    ("start: {x_m: 27.0, z_m: 2.5}", "start: {x_m: 27.0, z_m: 5.0}"),
)
"""Its workspace begins 4 m above the ground."""


def test_the_take_off_ends_at_the_start_of_the_site(tmp_path):
    site = tmp_path / "site.yaml"
    for text, height_m in ((HIGH, 5.0), (HIGH.replace("z_m: 5.0", "z_m: 4.0"), 4.5)):
        site.write_text(text)
        assert demonstration._height_m(Site.load(site)) == height_m
    for shipped in (shipped_configs() / "sites").iterdir():
        assert demonstration._height_m(Site.load(shipped)) == 2.5


@real_time
@pytest.mark.parametrize("autopilot", sampled(["px4"], ["px4", "ardupilot"]))
def test_a_site_whose_workspace_begins_high_up_is_flown(tmp_path, autopilot):
    site = tmp_path / "site.yaml"
    site.write_text(HIGH)
    flown_well(tmp_path / "out", "--site", str(site), "--autopilot", autopilot)


def flight_of(folder, *files):
    """A flight's folder as the service leaves it when it is interrupted."""
    inner = folder / "flight_20260101T000000Z"
    inner.mkdir(parents=True)
    for name in files:
        (inner / name).write_text(name)
    return folder


def test_the_recording_of_an_interrupted_flight_is_directly_in_its_folder(tmp_path):
    out = flight_of(tmp_path / "out", "flight.tlog", "decisions.jsonl")
    assert gather(out)
    assert {path.name for path in out.iterdir()} == {"flight.tlog", "decisions.jsonl"}
    assert gather(out)  # once more it is still there
    assert not gather(flight_of(tmp_path / "none"))


def test_latest_links_to_the_last_flight_with_any_outcome(tmp_path):
    for name in ("20260101T000000Z", "20260101T000100Z"):
        (tmp_path / name).mkdir()
        link_latest(tmp_path / name)
        assert (tmp_path / "latest").resolve() == tmp_path / name
    (tmp_path / "latest").unlink()
    (tmp_path / "latest").mkdir()  # something of the user's
    link_latest(tmp_path / name)
    assert (tmp_path / "latest").is_dir()


def copy_of_the_script(tmp_path):
    """A checkout in which nothing is installed."""
    shutil.copytree(ROOT / "sitl", tmp_path / "sitl")
    shutil.copytree(ROOT / ".ci", tmp_path / ".ci")
    return tmp_path


def test_help_is_printed_without_installing(tmp_path):
    checkout = copy_of_the_script(tmp_path)
    for word in ("--help", "-h"):
        process = subprocess.run(
            [checkout / "sitl" / "fly", "--headless", word],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        assert (process.returncode, process.stderr) == (0, "")
        assert process.stdout.startswith("usage: sitl/fly ")
    assert not (checkout / ".venv").exists()


@pytest.mark.parametrize("module", ["sitl", "sitl.demonstration"])
def test_a_python_without_the_packages_is_reported_in_one_line(module):
    process = subprocess.run(
        [sys.executable, "-S", "-m", module],  # without site-packages
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert (process.returncode, process.stdout) == (1, "")
    assert process.stderr.count("\n") == 1
    assert ": this Python has no " in process.stderr
    assert process.stderr.endswith(": use .venv/bin/python, which tests/run and sitl/fly make\n")


def test_an_old_python_is_reported(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 8, 10, "final", 0))
    assert complaint(SyntaxError()).startswith("this is Python 3.8, must be 3.10 to 3.13: ")


def test_a_full_disk_is_refused_before_the_flight(tmp_path, monkeypatch, capsys):
    usage = collections.namedtuple("usage", "total used free")  # noqa: PYI024 - shutil's own
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9 - 10**6, 10**6))
    output = f"sitl/fly: --out: {tmp_path} has 1 MB free, must be at least 50\n"
    assert refused(capsys, "--out", str(tmp_path)) == output


def test_a_row_of_the_truth_that_a_full_disk_cut_short_is_left_out(tmp_path):
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    header = "time_s,latitude_deg,longitude_deg,altitude_amsl_m,on_ground,armed\n"
    row = "1.0,45.3781,-71.9295,215.0,0,1\n"
    for cut in range(len(row)):
        (tmp_path / "truth.csv").write_text(f"# a comment\n{header}{row}{row[:cut]}")
        (read,) = read_truth(tmp_path / "truth.csv", site)
        assert read.armed


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_the_demonstration_ends_its_processes_when_it_is_ended(tmp_path, number):
    with subprocess.Popen(
        [sys.executable, "-m", "sitl.demonstration", "--headless", "--out", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout.readline().startswith("recording to ")
        assert running.stdout.readline().startswith("waiting")
        children = psutil.Process(running.pid).children(recursive=True)
        assert len(children) == 2
        running.send_signal(number)
        _, errors = running.communicate(timeout=30)
    assert running.returncode == 1
    assert "Traceback" not in errors
    assert not psutil.wait_procs(children, timeout=10)[1]
