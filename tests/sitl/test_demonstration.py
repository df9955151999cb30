"""The demonstration as a user flies it: real processes, real UDP, real time."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image
from pymavlink import mavutil

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
        (("--speed-of-light",), "--speed-of-light"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, named, tmp_path):
    out = () if "--out" in arguments else ("--out", str(tmp_path))
    flown = fly(*arguments, *out, timeout_s=60)
    assert flown.returncode == 2
    assert flown.stderr.count("\n") == 1
    assert named in flown.stderr
