"""The unit is one that systemd accepts, for one vehicle and for each of several."""

from __future__ import annotations

import configparser
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[2] / "systemd" / "moar-companion.service"


def unit():
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str
    parser.read_string(UNIT.read_text())
    return parser


needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="no systemd on this machine"
)


@needs_systemd
@pytest.mark.parametrize("name", ["moar-companion.service", "moar-companion@linedrone-07.service"])
def test_systemd_accepts_the_unit(tmp_path, name):
    """The program itself is not installed here, so another one that can be run stands for it."""
    text = UNIT.read_text()
    assert text.count("ExecStart=moar-companion ") == 1
    copy = tmp_path / name.replace("linedrone-07", "")
    copy.write_text(text.replace("ExecStart=moar-companion", f"ExecStart={sys.executable}"))
    done = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / name)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
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
        "moar-companion",
        "--config",
        "/etc/moar-companion/%i/companion.yaml",
    ]


def test_a_service_that_hangs_is_restarted_and_finds_its_state():
    service = unit()["Service"]
    assert service["WatchdogSec"] == "2"
    assert service["StateDirectory"] == "moar-companion/%i"


def test_the_service_goes_on_when_a_child_process_is_ended_for_its_memory():
    service = unit()["Service"]
    assert service["OOMPolicy"] == "continue"
    assert service["OOMScoreAdjust"] == "-500"
