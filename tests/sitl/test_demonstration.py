"""The demonstration as a user flies it: real processes, real UDP, real time."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from PIL import Image
from pymavlink import mavutil

from moar_companion import Mission, Planner, RiskIndices, Site, Vehicle
from moar_companion.config import shipped_configs

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


@pytest.mark.slow
def test_the_demonstration_flies_two_splices_and_the_exit_lands_and_draws_its_picture(tmp_path):
    flown = fly("--out", str(tmp_path))
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert flown.stdout.endswith("mission flown and landed\n")
    assert flown.stderr == ""
    with Image.open(tmp_path / "flight.png") as picture:
        assert min(picture.size) > 800
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 1000
    decisions = [
        json.loads(line) for line in (tmp_path / "decisions.jsonl").read_text().splitlines()
    ]
    states = [item["data"]["state"] for item in decisions if item["kind"] == "state"]
    assert states.count("at_target") == 2
    assert states.index("landing_leg") > states.index("at_target")
    wind = [item["data"]["risk"]["wind"] for item in decisions if item["kind"] == "status"]
    assert max(wind) > 0.5
    plans = [item["data"] for item in decisions if item["kind"] == "plan"]
    assert any(
        not made["first"]
        and made["plan"]["target"] == "splice-inner"
        and made["plan"]["risk"]["wind"] > 0.5
        for made in plans
    )
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


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--site", "missing.yaml"), "missing.yaml"),
        (("--site", "README.md"), "README.md"),
        (("--scenario", "missing.yaml"), "missing.yaml"),
        (("--out", "/dev/null/x"), "/dev/null/x"),
        (("--out", "/sys"), "/sys"),
        (("--speed-of-light",), "--speed-of-light"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, named, tmp_path):
    out = () if "--out" in arguments else ("--out", str(tmp_path))
    flown = fly(*arguments, *out, timeout_s=60)
    assert flown.returncode == 2
    assert flown.stderr.count("\n") == 1
    assert named in flown.stderr


def test_the_wind_of_the_demonstration_moves_its_path_away_from_the_conductors():
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    planner = Planner(site, vehicle)
    clearance_m = [
        planner.plan(
            mission="inspection",
            target="splice-inner",
            start=site.target("splice-outer").position_m,
            weights=vehicle.weights[Mission.INSPECTION].adjusted(RiskIndices(wind=wind)),
        ).metrics.mean_clearance_m
        for wind in (0.0, 0.8)
    ]
    assert clearance_m[1] > clearance_m[0] + 0.2


def test_a_folder_that_holds_a_flight_is_not_flown_into_again(tmp_path):
    (tmp_path / "truth.csv").write_text("kept")
    flown = fly("--out", str(tmp_path), timeout_s=60)
    assert (flown.returncode, flown.stderr.count("\n")) == (2, 1)
    assert (tmp_path / "truth.csv").read_text() == "kept"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_it_takes_its_processes_with_it_when_it_is_ended(tmp_path, number):
    with subprocess.Popen(
        [sys.executable, "-m", "sitl.demonstration", "--headless", "--out", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout.readline().startswith("waiting")
        children = psutil.Process(running.pid).children(recursive=True)
        assert len(children) == 2
        running.send_signal(number)
        _, errors = running.communicate(timeout=30)
    assert running.returncode == 1
    assert "Traceback" not in errors
    assert not psutil.wait_procs(children, timeout=10)[1]
