"""The package in a clean root, booted by its own systemd without a network, in the unit's sandbox.

The container is systemd-nspawn's, the service's sandbox inside it is that of the unit. Skipped
where this user is not root, or tools are missing.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STORY = Path(__file__).with_name("story.sh")
TOOLS = ("dpkg-deb", "mmdebstrap", "systemd-nspawn")
LONGEST_S = 1200

missing = [tool for tool in TOOLS if shutil.which(tool) is None]
may_mount = subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.geteuid() != 0, reason="only root can boot a clean root"),
    pytest.mark.skipif(may_mount.returncode != 0, reason="this container may boot no clean root"),
    pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}"),
    pytest.mark.timeout(2 * LONGEST_S),
]


def run(*command):
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=True,
        stdin=subprocess.DEVNULL,
    ).stdout


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A package, and a newer one whose configuration has changed, too."""
    folder = tmp_path_factory.mktemp("packages")
    command = [sys.executable, str(ROOT / "systemd/deb.py"), "--python", "3.11"]
    old = Path(run(*command, "--out", str(folder)).strip())
    run("dpkg-deb", "--raw-extract", str(old), str(folder / "tree"))
    control = folder / "tree/DEBIAN/control"
    control.write_text(re.sub(r"(?m)^(Version: .*)$", r"\1.1", control.read_text()))
    with (folder / "tree/etc/moar-companion/companion.yaml").open("a") as configuration:
        configuration.write("# A newer comment.\n")
    new = folder / "newer.deb"
    run("dpkg-deb", "--root-owner-group", "-Znone", "--build", str(folder / "tree"), str(new))
    shutil.rmtree(folder / "tree")
    return old, new


@pytest.fixture(scope="module")
def told(packages, tmp_path_factory):
    """Answers of the story by their name."""
    root = tmp_path_factory.mktemp("clean") / "root"
    run(
        "mmdebstrap",
        "--variant=minbase",
        "--include=python3.11,systemd-sysv,udev",
        '--aptopt=Acquire::Check-Valid-Until "false"',  # a mirror may be a frozen one
        "bookworm",
        str(root),
    )
    for file, name in zip((*packages, STORY), ("old.deb", "new.deb", "story.sh"), strict=True):
        shutil.copy(file, root / name)
    units = root / "etc/systemd/system"
    (units / "story.service").write_text(
        "[Unit]\nAfter=multi-user.target\n[Service]\nType=oneshot\n"
        "ExecStart=/story.sh /old.deb /new.deb\n"
    )
    (units / "default.target.wants").mkdir()
    (units / "default.target.wants/story.service").symlink_to("../story.service")
    run(
        "systemd-nspawn",
        "--quiet",
        f"--directory={root}",
        "--boot",
        "--register=no",
        "--keep-unit",
        "--private-network",
        "--link-journal=no",
    )
    lines = (root / "story.txt").read_text().splitlines()
    sys.stdout.write((root / "story.log").read_text())
    return dict(line.split(": ", 1) for line in lines if ": " in line)


def test_it_is_installed_without_a_network_and_runs_in_the_units_sandbox(told):
    assert told["version"].endswith("install ok installed")
    assert (told["enabled"], told["active"]) == ("enabled", "active")
    assert told["user"] == "moar-companion"
    assert told["unprivileged"] == "CapEff:\t0000000000000000"
    assert "moar-companion[" in told["log"]
    assert '"PRIORITY":"6"' in told["log-fields"]
    assert told["rules"] == ""


def test_members_of_the_group_see_the_service_and_check_runs_as_its_user(told):
    assert "status" not in told["member"]
    assert told["check"] == "FILES OK: the aircraft was not checked"
    assert told["cached"] == "numba"


def test_with_an_armed_aircraft_it_is_not_upgraded_and_goes_on(told):
    assert told["in-flight"] == "status 1"
    assert (told["kept-version"], told["kept-active"]) == (told["version"], "active")


def test_an_upgrade_and_a_rollback_keep_the_configuration_and_start_the_service(told):
    assert told["upgraded-version"] == told["version"].replace(" ", ".1 ", 1)
    assert told["rolled-back-version"] == told["version"]
    for step in ("upgraded", "rolled-back"):
        assert told[f"{step}-active"] == "active"
        assert told[f"{step}-config"].startswith("setpoint_rate_hz: 40.0")


def test_a_second_vehicle_has_an_instance_with_its_own_state_and_view(told):
    assert told["second-active"] == "active"
    assert told["second-state"] == "/var/lib/moar-companion/second"
    assert "status" not in told["second-view"]


def test_after_a_removal_the_configuration_is_left_and_after_a_purge_only_flights(told):
    assert told["removed-active"].startswith("status")
    assert told["removed-config"].startswith("setpoint_rate_hz: 40.0")
    assert told["removed-program"].startswith("status")
    assert told["purged"] == ""
    kept = told["kept-flights"].split()
    assert {f"./{folder}/flight_1/flight.mcap" for folder in ("flights", "recordings")} <= {*kept}
    assert [file for file in kept if re.search(r"/flight_\w+(\.\w+)?/[^/]+$", file)] == kept
