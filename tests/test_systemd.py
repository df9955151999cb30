"""The unit is one that systemd accepts, and starts what the wheel installs."""

from __future__ import annotations

import configparser
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[1] / "systemd" / "moar-companion.service"
INSTALLED = "/opt/moar-companion/bin/moar-companion"


def unit():
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str
    parser.read_string(UNIT.read_text())
    return parser


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd on this machine")
def test_systemd_accepts_the_unit(tmp_path):
    """The program itself is not installed here, so another one that can be run stands for it."""
    text = UNIT.read_text()
    assert text.count(INSTALLED) == 1
    copy = tmp_path / UNIT.name
    copy.write_text(text.replace(INSTALLED, sys.executable))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd on this machine")
def test_systemd_rates_the_exposure_of_the_unit_at_2_or_less():
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(UNIT)],
        capture_output=True,
        text=True,
        check=False,
    )
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd does not rate a file")
    assert done.returncode == 0, done.stdout


def test_the_service_notifies_readiness_and_is_not_restarted_with_a_wrong_file():
    service = unit()["Service"]
    assert service["Type"] == "notify"
    assert service["RestartPreventExitStatus"] == "2"
    assert service["Restart"] == "on-failure"
    assert service["ExecStart"].split() == [
        INSTALLED,
        "--config",
        "/etc/moar-companion/companion.yaml",
    ]


def test_a_service_that_hangs_is_restarted_and_finds_its_state():
    service = unit()["Service"]
    assert service["WatchdogSec"] == "2"
    assert service["StateDirectory"] == "moar-companion"


def test_the_service_goes_on_when_a_child_process_is_ended_for_its_memory():
    service = unit()["Service"]
    assert service["OOMPolicy"] == "continue"
    assert service["OOMScoreAdjust"] == "-500"
