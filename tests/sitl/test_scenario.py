"""Scenario files: their effect, and the errors about bad files."""

import math
from pathlib import Path

import pytest

from sitl.scenario import Scenario, ScenarioPlayer
from sitl.world import World, WorldOptions
from sitl.yaml_input import BadInputError

SHIPPED = sorted((Path(__file__).parents[2] / "sitl" / "scenarios").glob("*.yaml"))


def _scenario(*changes):
    return Scenario.parse({"name": "test", "changes": list(changes)}, "test.yaml")


def _play(scenario, seconds, took_off_s=None):
    world = World(WorldOptions())
    player = ScenarioPlayer(scenario)
    history = []
    while world.now_s < seconds:
        if took_off_s is not None and world.now_s >= took_off_s:
            world.took_off_s = took_off_s
        player.step(world)
        world.tick(armed=False)
        history.append((world.now_s, world.conditions.wind_mps))
    return world, history


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_shipped_scenarios_load(path):
    assert Scenario.load(path).changes


def test_a_ramp_moves_linearly_and_then_stays():
    world, history = _play(_scenario({"at_s": 2, "wind_mps": 8, "over_s": 4}), 8.0)
    at = {round(t, 2): wind for t, wind in history}
    assert at[1.9] == 0.0
    assert at[4.01] == pytest.approx(4.0, abs=0.1)
    assert world.conditions.wind_mps == 8.0


def test_a_change_after_take_off_waits_for_it():
    scenario = _scenario({"after_takeoff_s": 1, "satellites": 3, "gps_mode": "no_fix"})
    world, _ = _play(scenario, 5.0)
    assert world.conditions.satellites == 10
    world, _ = _play(scenario, 5.0, took_off_s=2.0)
    assert world.conditions.satellites == 3
    assert not world.conditions.has_fix()


def test_the_wind_turns_by_the_smaller_angle():
    scenario = _scenario(
        {"at_s": 0, "wind_from_deg": 350}, {"at_s": 1, "wind_from_deg": 10, "over_s": 2}
    )
    world = World(WorldOptions())
    player = ScenarioPlayer(scenario)
    while world.now_s < 2.0:
        player.step(world)
        world.tick(armed=False)
    assert math.remainder(world.conditions.wind_from_deg, 360.0) == pytest.approx(0.0, abs=2.0)


def test_a_failing_battery_ramps_down():
    world, _ = _play(_scenario({"at_s": 0, "battery_percent": 20, "over_s": 4}), 2.0)
    assert world.battery.fraction == pytest.approx(0.6, abs=0.02)
    world, _ = _play(_scenario({"at_s": 0, "battery_percent": 20, "over_s": 4}), 6.0)
    assert world.battery.fraction == pytest.approx(0.2, abs=0.001)


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"name": "x", "changes": [{"at_s": 1, "wnd_mps": 3}]}, "changes[0].wnd_mps: unknown key"),
        ({"name": "x", "wind": 3}, "wind: unknown key; allowed: name, changes"),
        ({"name": "x", "changes": [{"at_s": 1, "wind_mps": "8"}]}, "changes[0].wind_mps: '8'"),
        ({"name": "x", "changes": [{"at_s": 1, "wind_mps": True}]}, "changes[0].wind_mps: True"),
        ({"name": "x", "changes": [{"at_s": 1, "satellites": 99}]}, "less than or equal to 60"),
        ({"name": "x", "changes": [{"wind_mps": 1}]}, "exactly one of at_s, after_takeoff_s"),
        ({"name": "x", "changes": [{"at_s": 1}]}, "at least one condition"),
        ({"name": "x", "changes": [{"at_s": 1, "gps_mode": "off"}]}, "'normal', 'no_fix'"),
        ({"changes": []}, "name: is missing"),
        ({"name": "x", "changes": 5}, "changes: 5: must be a list"),
        ({"name": "x", "changes": ["y"]}, "changes[0]: 'y': must be keys and values"),
        ("calm", "file: 'calm': must be keys and values"),
        ([], "file: must be keys and values"),
        (None, "file: must be keys and values"),
    ],
)
def test_a_bad_file_is_explained_in_one_line(data, problem):
    with pytest.raises(BadInputError) as caught:
        Scenario.parse(data, "bad.yaml")
    assert str(caught.value).startswith("bad.yaml: ")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_broken_yaml_are_explained_in_one_line(tmp_path):
    with pytest.raises(BadInputError, match="cannot be read"):
        Scenario.load(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("a: [1,\nb")
    with pytest.raises(BadInputError, match="not YAML") as caught:
        Scenario.load(tmp_path / "bad.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        pytest.param("[" * 50_000, "nested too deeply", marks=pytest.mark.slow),
        ("#" * 100_001, "larger than 100000 bytes"),
    ],
)
def test_a_file_that_would_take_all_memory_or_time_is_refused_in_one_line(tmp_path, text, problem):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(BadInputError) as caught:
        Scenario.load(path)
    assert str(caught.value) == f"{path}: {problem}"
