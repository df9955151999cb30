"""Commands where the extras are not installed: one line that names the extra, or no difference."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from moar_companion.errors import without_extra
from moar_companion.settings.config import shipped_configs

ROOT = Path(__file__).parents[2]
SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
PLAN = ("plan", SITE, "--mission", "inspection")
RECORDING = str(ROOT / "tests" / "data" / "ardupilot_failsafes.tlog")
WITHOUT_EXTRAS = """\
import sys
extras = ["matplotlib", "pyulog", "laspy", "plyfile", "pypcd4", "pyproj"]
extras += ["dpkt", "velodyne_decoder", "ouster"]
sys.modules |= dict.fromkeys(extras)
from moar_companion.commands.cli import main
sys.exit(main())
"""


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_EXTRAS, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=ROOT,
    )


@pytest.mark.parametrize(
    ("command", "option", "others"),
    [
        (PLAN, "--plot", ("--json", "--maps")),
        (PLAN, "--pareto-plot", ("--pareto",)),
        (("replay", RECORDING), "--plot", ("--json",)),
    ],
)
def test_without_matplotlib_a_picture_is_refused_before_anything_is_written(
    command, option, others, tmp_path
):
    files = [word for other in others for word in (other, str(tmp_path / other.strip("-")))]
    done = run(*command, *files, option, str(tmp_path / "picture.png"))
    line = f'{option}: needs matplotlib: {sys.executable} -m pip install "moar-companion[plots]"'
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"moar-companion: {line}\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ending", "module"),
    [
        pytest.param("las", "laspy", marks=pytest.mark.slow),
        pytest.param("ply", "plyfile", marks=pytest.mark.slow),
        pytest.param("pcd", "pypcd4", marks=pytest.mark.slow),
        ("pcap", "velodyne_decoder"),
    ],
)
def test_without_the_extra_a_point_cloud_is_refused(ending, module, tmp_path):
    cloud = tmp_path / f"scan.{ending}"
    cloud.write_bytes(b"")
    done = run(
        "site", "from-cloud", str(cloud), "--at", "0,0", "--out", str(tmp_path / "site.yaml")
    )
    line = f'{cloud}: needs {module}: {sys.executable} -m pip install "moar-companion[lidar]"'
    assert (done.returncode, done.stderr) == (2, f"moar-companion: {line}\n")


def test_without_the_extra_a_capture_of_an_ouster_is_refused(tmp_path):
    file, out = str(tmp_path / "scan.pcap"), str(tmp_path / "site.yaml")
    Path(file).write_bytes(b"")
    done = run("site", "from-cloud", file, "--metadata", file, "--at", "0,0", "--out", out)
    line = f'{file}: needs ouster.sdk: {sys.executable} -m pip install "moar-companion[ouster]"'
    assert (done.returncode, done.stderr) == (2, f"moar-companion: {line}\n")


def test_without_pyulog_a_log_is_refused(tmp_path):
    log = tmp_path / "flight.ulg"
    log.write_bytes(b"ULog\x01\x12\x35" + bytes(9))
    done = run("replay", str(log))
    line = f'{log}: needs pyulog: {sys.executable} -m pip install "moar-companion[ulog]"'
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"moar-companion: {line}\n"


@pytest.mark.slow
@pytest.mark.parametrize("command", [PLAN, ("replay", RECORDING)])
def test_summary_and_json_need_no_extra(command, tmp_path):
    answer = tmp_path / "answer.json"
    done = run(*command, "--json", str(answer))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout
    assert answer.exists()


def test_without_pip_as_in_the_package_the_remedy_is_a_checkout(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    remedy = "not in this package, install from a checkout with the extra plots"
    error = without_extra("--plot", "", "matplotlib", "plots")
    assert str(error) == f"--plot: needs matplotlib: {remedy}"
