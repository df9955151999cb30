"""Flying a real autopilot: how its path is read, and how the operator plays its weather."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from sitl.demonstration.real import RealError, RealOptions, autopilot_at, running_real
from sitl.demonstration.weather import Weather
from sitl.geodesy import Geodetic
from sitl.scenario import Scenario

ROOT = Path(__file__).parents[2]
HOME = Geodetic(latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0)


@dataclass
class Recorded:
    """An operator that records the requested actions."""

    landed_state: int = 1
    autopilot_received: bool = True
    done: list = field(default_factory=list)

    def set_parameter(self, name, value):
        self.done.append((name, value))

    def command(self, _, number, *values):
        self.done.append((number, *values))


def weather_of(autopilot, *changes, speed=1.0):
    scenario = Scenario.parse({"name": "test", "changes": list(changes)}, "test")
    return Weather(scenario=scenario, autopilot=autopilot, speed=speed)


def px4_build(folder, *, start="param set MAV_SYS_ID $((px4_instance+1))\n"):
    """A build folder of PX4 with a program that prints its working folder and ends."""
    scripts = folder / "etc" / "init.d-posix"
    scripts.mkdir(parents=True)
    (scripts / "rcS").write_text(start)
    (scripts / "px4-rc.mavlink").write_text("mavlink start -x -u 18570\n")
    (folder / "bin").mkdir()
    program = folder / "bin" / "px4"
    program.write_text('#!/bin/sh\necho "$@" $PX4_HOME_LAT\n')
    program.chmod(0o755)
    return folder


def options(path, folder):
    return RealOptions(
        path=path,
        folder=folder,
        home=HOME,
        companion_port=4001,
        operator_port=4002,
        truth=folder.parent / "truth.csv",
        parameters={"COM_OF_LOSS_T": 0.5},
    )


def test_a_path_determines_the_autopilot(tmp_path):
    assert autopilot_at(px4_build(tmp_path / "build")) == "px4"
    program = tmp_path / "arducopter"
    program.touch(0o755)
    assert autopilot_at(program) == "ardupilot"


def test_px4_is_started_as_system_1_with_our_links_and_parameters(tmp_path):
    build, folder = px4_build(tmp_path / "build"), tmp_path / "run"
    with running_real(options(build, folder)) as process:
        process.stop()
    scripts = folder / "etc" / "init.d-posix"
    assert (scripts / "rcS").read_text() == "param set MAV_SYS_ID 1\n"
    links = (scripts / "px4-rc.mavlink").read_text()
    assert "-m onboard -o 4001" in links
    assert "-o 4002" in links
    assert "param set COM_OF_LOSS_T 0.5" in links
    assert "18570" in (build / "etc" / "init.d-posix" / "px4-rc.mavlink").read_text()


def test_a_lidar_is_mounted_for_the_run_and_removed_after_it(tmp_path):
    done = []

    class Lidar:
        def step(self, pose):
            done.append(pose)

        def close(self):
            done.append("closed")

    run = replace(options(px4_build(tmp_path / "build"), tmp_path / "run"), carried=(Lidar,))
    with running_real(run):
        assert done == []
    assert done == ["closed"]


def test_ardupilot_without_its_source_tree_is_refused(tmp_path):
    program = tmp_path / "a" / "b" / "c" / "arducopter"
    program.parent.mkdir(parents=True)
    program.touch(0o755)
    with (
        pytest.raises(RealError, match=r"copter\.parm is missing"),
        running_real(options(program, tmp_path / "run")),
    ):
        pass


def test_the_operator_plays_wind_from_the_take_off_on():
    weather = weather_of(
        "ardupilot", {"after_takeoff_s": 0, "wind_mps": 6.0, "wind_from_deg": 250.0}
    )
    operator = Recorded()
    weather.play(operator)
    assert operator.done == []
    operator.landed_state = 2
    weather.next_s = 0.0
    weather.play(operator)
    assert sorted(operator.done) == [("SIM_WIND_DIR", 250.0), ("SIM_WIND_SPD", 6.0)]
    weather.next_s = 0.0
    weather.play(operator)
    assert len(operator.done) == 2


def test_a_battery_falls_by_parameters_on_px4_and_by_a_command_on_ardupilot():
    for autopilot, done in (
        ("px4", [("SIM_BAT_MIN_PCT", 32.0), ("SIM_BAT_DRAIN", 1.0)]),
        ("ardupilot", [(42651, 1, 32.0)]),
    ):
        operator = Recorded()
        weather_of(autopilot, {"at_s": 0, "battery_percent": 32}).play(operator)
        assert operator.done == done


def test_a_condition_that_a_simulator_cannot_play_is_named():
    changes = {"at_s": 0, "wind_mps": 3.0, "satellites": 5}
    assert weather_of("px4", changes).left_out == ("satellites", "wind_mps")
    assert weather_of("ardupilot", changes).left_out == ("satellites",)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--real", "missing"), "must be PX4's build folder"),
        (("--real", "build", "--autopilot", "ardupilot"), "is px4, not --autopilot ardupilot"),
    ],
)
def test_a_bad_path_of_a_real_autopilot_is_one_line(arguments, words, tmp_path):
    px4_build(tmp_path / "build")
    ended = subprocess.run(
        [sys.executable, "-m", "sitl.demonstration", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
    )
    assert ended.returncode == 2
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1
