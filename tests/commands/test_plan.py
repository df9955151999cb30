"""`moar-companion plan`: its options, what it writes, and what it refuses."""

import json
import math
import os
import stat
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line
from tests.vehicles import vehicle_file

SHIPPED = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
SITES = sorted((shipped_configs() / "sites").glob("*.yaml"))

PLAN_KEYS = {
    "site", "mission", "target", "status", "resolution_m", "v_max_mps", "heading_speed_mps",
    "headings", "risk", "weights", "cost", "start_velocity_mps", "states", "waypoints", "metrics",
    "compute",
}  # fmt: skip
MAP_KEYS = {
    "x_m", "z_m", "occupied", "safety_cost", "speed_limit_mps", "obstacle_distance_m",
    "hull_distance_m", "horizontal_distance_m", "collision_cost", "insertion_cost", "damage_cost",
}  # fmt: skip


@pytest.fixture
def site(tmp_path):
    """A copy of a shipped site, and the working directory of the test."""
    file = tmp_path / "site.yaml"
    file.write_text(SHIPPED.read_text())
    return str(file)


@pytest.fixture
def plan(site, capsys):
    """Run the command on the site; the plan, which must be found."""

    def run(*options, mission="inspection"):
        status = cli.main(["plan", site, "--mission", mission, *options, "--json", "-"])
        out, err = capsys.readouterr()
        assert status == 0
        assert err == ""
        return json.loads(out)

    return run


def variant(path, **changes):
    content = yaml.safe_load(SHIPPED.read_text()) | changes
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value}))
    return str(path)


@pytest.mark.parametrize("file", SITES, ids=lambda file: file.stem)
@pytest.mark.parametrize("mission", ["inspection", "exit", "evacuation"])
def test_every_shipped_site_has_a_plan_for_every_mission(file, mission, capsys):
    assert cli.main(["plan", str(file), "--mission", mission, "--start", "15,14"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "found" in out.splitlines()[0]
    assert all(word in out for word in ("J = ", "waypoints", "clearance", "weights", "computed"))


def test_the_json_is_the_contract(plan):
    answer = plan("--velocity=-1,0.5")
    assert set(answer) >= PLAN_KEYS
    assert answer["status"] == "found"
    assert answer["target"] == "splice-outer"
    assert answer["start_velocity_mps"] == [-1.0, 0.5]
    assert answer["states"][0] == [90, 8, 0]
    assert set(answer["waypoints"][0]) == {"x_m", "z_m", "speed_mps", "time_s"}
    assert len(answer["waypoints"]) == len(answer["states"])
    assert set(answer["cost"]) == {"total", "safety", "time", "energy"}
    assert set(answer["compute"]) == {"map_ms", "search_ms", "expanded"}
    assert all(value > 0.0 for value in answer["compute"].values())


@pytest.mark.parametrize("joined", [True, False])
def test_an_option_is_read_in_both_forms_and_with_negative_numbers(plan, joined, tmp_path):
    options = {"--start": "26.2,3", "--velocity": "-1,-.5", "--weights": "2,1,1"}
    words = [f"{name}={value}" for name, value in options.items()]
    if not joined:
        words = [word for pair in options.items() for word in pair]
    answer = plan(*words)
    assert answer["states"][0] == [87, 10, 0]
    assert answer["start_velocity_mps"] == [-1.0, -0.5]
    assert answer["weights"] == {"safety": 0.5, "time": 0.25, "energy": 0.25}


def test_a_start_with_negative_coordinates_is_read(tmp_path, capsys):
    low = variant(
        tmp_path / "low.yaml",
        workspace={"x_m": [-30, 0], "z_m": [-20, 0], "resolution_m": 0.5},
        obstacles=[],
        targets=None,
        landing={"exit": [{"x_m": 5.0, "z_m": -20.0}]},
    )
    # `obstacles` may be empty, but not missing.
    Path(low).write_text(Path(low).read_text() + "obstacles: []\n")
    words = ["plan", low, "--mission", "exit", "--start", "-1,-2", "--json", "-"]
    assert cli.main(words) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["states"][0] == [58, 36, 0]
    assert answer["metrics"]["min_clearance_m"] is None


def test_weights_are_normalised_and_risk_adjusts_them(plan):
    # Eq. 9 by hand: shift = 0.5 * 0.8 + 0.25 * 0.4 + 0 - 0.2 = 0.3, energy 1 + 0.4 + 0.1.
    answer = plan("--weights", "2,1,1", "--risk", "wind=0.8,communication=.4, battery=0.2")
    terms = 0.5 * 1.3, 0.25 * 0.7, 0.25 * 1.5
    assert list(answer["weights"].values()) == pytest.approx([t / sum(terms) for t in terms])
    assert answer["risk"] == {
        "wind": 0.8,
        "communication": 0.4,
        "localization": 0.0,
        "battery": 0.2,
    }


def test_the_weights_of_the_vehicle_are_those_of_the_mission(plan):
    assert plan(mission="exit")["weights"]["safety"] == pytest.approx(0.43)
    assert plan(mission="evacuation")["weights"]["safety"] == pytest.approx(0.6)


@pytest.mark.slow
def test_the_alternatives_are_listed_and_drawn(plan, site, tmp_path, capsys):
    options = ("--target", "splice-inner", "--risk", "wind=0.5")
    alone = plan(*options)
    answer = plan(*options, "--alternatives")
    others = answer.pop("alternatives")
    for each in (alone, answer):
        each.pop("compute")
    assert answer == alone  # the plan itself is the same
    assert [other["risk"]["wind"] for other in others] == [0, 0.5, 1, 1, 0, 0, 1]
    same = next(other for other in others if other["risk"] == alone["risk"])
    assert same == {key: alone[key] for key in same}
    sizes = []
    for flags in ([], ["--alternatives"]):
        picture = tmp_path / f"{len(flags)}.png"
        words = ["plan", site, "--mission", "inspection", *options, *flags, "--plot", str(picture)]
        assert cli.main(words) == 0
        sizes.append(np.frombuffer(picture.read_bytes()[16:24], dtype=">u4").tolist())
    assert sizes[0][0] == sizes[1][0]
    assert sizes[1][1] > sizes[0][1]  # room for their names
    out = capsys.readouterr().out
    assert out.count(" m in ") == 2 + len(others)
    assert "  others     no risk: " in out
    assert "wind 1, communication 1, localization 1: " in out


@pytest.mark.slow
@pytest.mark.parametrize("mission", ["inspection", "exit", "evacuation"])
def test_the_refined_path_is_printed_and_drawn_beside_the_plan(
    mission, plan, site, tmp_path, capsys
):
    alone = plan(mission=mission)
    answer = plan("--refine", mission=mission)
    refined = answer.pop("refined")
    for each in (alone, answer):
        each.pop("compute")
    assert answer == alone  # the plan itself is the same
    assert refined["cost"]["total"] < refined["plan_cost"]["total"]
    assert refined["plan_cost"]["total"] == pytest.approx(alone["cost"]["total"], rel=0.1)
    assert refined["metrics"].keys() == alone["metrics"].keys()
    assert refined["waypoints"][0].keys() == alone["waypoints"][0].keys()
    for axis in ("x_m", "z_m"):
        assert refined["points"][0][axis] == pytest.approx(alone["waypoints"][0][axis])
        assert refined["waypoints"][-1][axis] == pytest.approx(alone["waypoints"][-1][axis])
    picture = tmp_path / "refined.png"
    words = ["plan", site, "--mission", mission, "--refine", "--plot", str(picture)]
    assert cli.main(words) == 0
    off = np.abs(imread(picture)[..., :3] - to_rgb("#e619e6")).max(axis=-1)
    assert (off < 0.01).sum() > 500
    out = capsys.readouterr().out
    assert out.count("  refined    ") == 1
    assert f"J = {refined['cost']['total']:.3f}, " in out


def test_no_plan_is_not_refined(site, tmp_path, capsys):
    words = ["plan", site, "--mission", "exit", "--start=-1,2", "--refine", "--json", "-"]
    assert cli.main([*words, "--plot", str(tmp_path / "none.png")]) == 2
    assert json.loads(capsys.readouterr().out)["refined"] is None


def test_no_plan_has_no_alternatives_either(site, tmp_path, capsys):
    words = ["plan", site, "--mission", "exit", "--start=-1,2", "--alternatives", "--json", "-"]
    assert cli.main([*words, "--plot", str(tmp_path / "none.png")]) == 2
    answer = json.loads(capsys.readouterr().out)
    assert {other["status"] for other in answer["alternatives"]} == {"out_of_bounds"}


def test_the_explanation_gives_the_effect_of_the_risks_on_weights_and_path(plan):
    vehicle = ("--vehicle", str(vehicle_file("linedrone_uniform")))
    options = (
        "--target",
        "splice-inner",
        *vehicle,
        "--risk",
        "wind=1,communication=1,localization=1",
    )
    calm, risky = plan(*options[:4]), plan(*options, "--explain")
    assert "explanation" not in calm
    explanation = risky.pop("explanation")
    assert set(risky) == set(calm)
    assert explanation["weights"]["base"] == pytest.approx(calm["weights"])
    assert explanation["weights"]["adjusted"] == pytest.approx(risky["weights"])
    lost = sum(change["time"] for change in explanation["weights"]["by_risk"].values())
    assert lost < 0.0
    path = explanation["path"]
    assert path["mean_clearance_m"] == pytest.approx(
        [calm["metrics"]["mean_clearance_m"], risky["metrics"]["mean_clearance_m"]]
    )
    assert path["words"].startswith(f"path {path['greatest_m']:.1f} m inward")


@pytest.mark.parametrize(
    ("options", "limited", "value_of"),
    [
        (("--within", "60 s"), "duration_s", lambda answer: answer["metrics"]["duration_s"]),
        (("--within=60", "--fastest"), "duration_s", lambda it: it["metrics"]["duration_s"]),
        (("--clearance", "2m"), "clearance_m", lambda it: it["metrics"]["min_clearance_m"]),
        (("--energy", "20Wh"), "energy_wh", None),
    ],
)
def test_a_wish_is_answered_by_the_best_path_that_keeps_its_limit(plan, options, limited, value_of):
    answer = plan(*options)
    wish = answer["wish"]
    assert wish["limited"] == limited
    assert wish["fulfilled"]
    above = wish["value"] - wish["limit"]
    assert (above if limited == "clearance_m" else -above) >= 0.0
    if value_of is not None:
        assert wish["value"] == pytest.approx(value_of(answer))


def test_a_wish_that_no_path_fulfils_names_the_nearest_and_writes_its_plan(site, tmp_path, capsys):
    file = tmp_path / "plan.json"
    words = ["plan", site, "--mission", "inspection", "--within", "1s", "--json", str(file)]
    assert cli.main(words) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    written = json.loads(file.read_text())
    nearest_s = written["metrics"]["duration_s"]
    assert f"no path has at most 1 s, the nearest has {nearest_s:.2f} s" in line
    assert written["wish"]["fulfilled"] is False
    assert written["wish"]["value"] == pytest.approx(nearest_s)


def test_calibrated_adaptation_ends_with_the_safest_path(plan):
    options = ("--target", "splice-inner", "--risk", "wind=1,communication=1,localization=1")
    printed, calibrated = plan(*options), plan(*options, "--adaptation", "calibrated")
    safest = plan(*options[:2], "--weights", "1,0,0")
    assert printed["adaptation"] == {"kind": "paper", "calibrated": False}
    assert calibrated["adaptation"] == {"kind": "calibrated", "calibrated": True}
    assert calibrated["states"] == safest["states"]
    assert calibrated["cost"]["safety"] < printed["cost"]["safety"]


def test_the_explanation_is_in_the_summary(site, capsys):
    arguments = ["plan", site, "--mission", "inspection", "--risk", "wind=0.8"]
    assert cli.main([*arguments, "--explain"]) == 0
    explained = capsys.readouterr().out
    assert "k_S 0.43 -> 0.47 (wind +0.04)" in explained
    assert explained.splitlines()[-1].strip().startswith("path ")
    assert cli.main(arguments) == 0
    assert "->" not in capsys.readouterr().out


def test_without_a_path_the_weights_are_explained_all_the_same(site, capsys):
    arguments = ["plan", site, "--mission", "exit", "--start", "1000,3", "--risk", "wind=0.8"]
    assert cli.main([*arguments, "--explain"]) == 2
    assert "k_S 0.43 -> 0.47 (wind +0.04)" in capsys.readouterr().out


def test_the_plan_is_made_for_the_given_vehicle(plan):
    fast = shipped_configs() / "vehicles" / "linedrone.yaml"
    assert plan()["v_max_mps"] == 0.7  # the service's default
    assert plan("--vehicle", str(fast))["v_max_mps"] == 10.0


def test_the_target_is_a_name_or_the_index_of_a_landing_point(plan):
    assert plan("--target", "splice-inner")["target"] == "splice-inner"
    right = plan("--target", "1", mission="evacuation")
    left = plan("--target=0", mission="evacuation")
    assert (right["target"], right["waypoints"][-1]["x_m"]) == (1, 40.0)
    assert (left["target"], left["waypoints"][-1]["x_m"]) == (0, -10.0)
    assert plan(mission="evacuation")["target"] is None


@pytest.mark.slow
def test_all_files_are_written(site, tmp_path, capsys):
    outputs = {option: tmp_path / f"out.{option}" for option in ("json", "maps")}
    outputs |= {"plot": tmp_path / "out.png", "pareto-plot": tmp_path / "front.png"}
    outputs["pareto"] = tmp_path / "front.json"
    words = [word for option, file in outputs.items() for word in (f"--{option}", str(file))]
    assert cli.main(["plan", site, "--mission", "exit", *words]) == 0
    assert "exit: found" in capsys.readouterr().out
    assert json.loads(outputs["json"].read_text())["mission"] == "exit"
    with np.load(outputs["maps"], allow_pickle=False) as maps:
        assert set(maps) == MAP_KEYS
        assert (maps["x_m"].shape, maps["z_m"].shape) == ((100,), (66,))
        assert all(maps[key].shape == (100, 66) for key in MAP_KEYS - {"x_m", "z_m"})
        assert maps["occupied"].dtype == bool
        assert math.isinf(maps["horizontal_distance_m"].max())
        assert maps["x_m"][0] == pytest.approx(0.15)
    for picture in ("plot", "pareto-plot"):
        assert outputs[picture].read_bytes().startswith(b"\x89PNG\r\n")
    front = json.loads(outputs["pareto"].read_text())
    assert front["mission"] == "exit"
    assert {"safety", "time", "energy", "weights", "metrics", "states"} == set(front["points"][0])
    assert set(front["sensitivity"]) == {"weights", "risk"}
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(
        ["site.yaml", *(file.name for file in outputs.values())]
    )


def test_no_plan_is_an_answer_in_all_files(site, tmp_path, capsys):
    outputs = [
        tmp_path / name for name in ("plan.json", "maps.npz", "plan.png", "front.json", "front.png")
    ]
    options = ("json", "maps", "plot", "pareto", "pareto-plot")
    words = [w for o, f in zip(options, outputs, strict=True) for w in (f"--{o}", str(f))]
    assert cli.main(["plan", site, "--mission", "inspection", "--start", "9.2,3.7", *words]) == 2
    out, err = capsys.readouterr()
    assert "start_occupied" in out
    assert err.count("\n") == 1
    assert "start_occupied: the start at (9.2, 3.7) is too close" in err
    answer = json.loads(outputs[0].read_text())
    assert (answer["status"], answer["states"], answer["waypoints"]) == ("start_occupied", [], [])
    assert (answer["cost"], answer["metrics"]) == (None, None)
    assert all(file.stat().st_size > 0 for file in outputs)


@pytest.mark.parametrize(
    ("start", "status"),
    [("-1,2", "out_of_bounds"), ("1e300,-1e300", "out_of_bounds"), ("27,1", "start_occupied")],
)
def test_no_plan_still_writes_json_to_stdout_and_nothing_else(site, start, status, capsys):
    words = ["plan", site, "--mission", "exit", "--start", start, "--json", "-"]
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == status
    assert err.startswith(f"moar-companion: no plan: {status}: ")
    assert err.count("\n") == 1


REFUSED = [
    ("mission unknown", ["--mission", "fly"], ["--mission", "'fly'", "evacuation"]),
    ("start with one number", ["--start", "1"], ["--start", "'1'", "X,Z"]),
    ("start with three numbers", ["--start", "1,2,3"], ["--start", "'1,2,3'", "X,Z"]),
    ("start with a word", ["--start=a,2"], ["--start", "'a,2'", "finite"]),
    ("start not a number", ["--start", "nan,2"], ["--start", "'nan,2'", "finite"]),
    ("start infinite", ["--start", "-inf,2"], ["--start", "'-inf,2'", "finite"]),
    ("start overflowing", ["--start", "1e999,2"], ["--start", "'1e999,2'", "finite"]),
    ("start with Python's underscores", ["--start", "1_0,2"], ["--start", "'1_0,2'"]),
    ("start empty", ["--start="], ["--start", "''"]),
    ("velocity infinite", ["--velocity=inf,0"], ["--velocity", "'inf,0'", "m/s"]),
    ("velocity absurd", ["--velocity", "-1e9,0"], ["--velocity", "'-1e9,0'", "at most 1000"]),
    ("adaptation unknown", ["--adaptation", "none"], ["--adaptation", "'none'", "calibrated"]),
    ("weights negative", ["--weights", "-1,1,1"], ["--weights", "'-1,1,1'", "negative"]),
    ("weights all zero", ["--weights", "0,0,0"], ["--weights", "'0,0,0'", "positive sum"]),
    ("weights two", ["--weights", "1,1"], ["--weights", "'1,1'", "S,T,E"]),
    ("risk above one", ["--risk", "wind=1.5"], ["--risk", "'wind=1.5'", "[0, 1]"]),
    ("risk negative", ["--risk", "wind=-0.1"], ["--risk", "wind", "[0, 1]"]),
    ("risk not a number", ["--risk", "battery=nan"], ["--risk", "battery", "[0, 1]"]),
    ("risk unknown", ["--risk", "rain=0.5"], ["--risk", "'rain'", "localization"]),
    ("risk without index", ["--risk", "wind"], ["--risk", "'wind'", "name=index"]),
    ("risk twice", ["--risk", "wind=0.1,wind=0.2"], ["--risk", "wind twice"]),
    ("risk empty", ["--risk", ""], ["--risk", "''"]),
    ("target unknown", ["--target", "x"], ["--target", "'x'", "splice-outer, splice-inner"]),
    ("vehicle missing", ["--vehicle", "no.yaml"], ["no.yaml", "no such file"]),
    ("vehicle is a site", ["--vehicle", str(SHIPPED)], [str(SHIPPED)]),
    ("maps to stdout", ["--maps", "-"], ["--maps", "'-'", "--json"]),
    ("plot to stdout", ["--plot", "-"], ["--plot", "'-'", "--json"]),
    ("plot of unknown kind", ["--plot", "a.gif"], ["--plot", "'a.gif'", ".png"]),
    ("trade-off to stdout", ["--pareto", "-"], ["--pareto", "'-'", "--json"]),
    ("trade-off of unknown kind", ["--pareto-plot", "a.gif"], ["--pareto-plot", "'a.gif'", ".png"]),
    ("json without a directory", ["--json", "no/a.json"], ["--json", "no/a.json", "directory"]),
    ("json is a directory", ["--json", "/"], ["--json", "'/'", "directory"]),
    ("json empty", ["--json", ""], ["--json", "''"]),
    ("two outputs, one file", ["--maps", "a", "--json", "./a"], ["--maps", "'a'", "--json"]),
    ("output over the site", ["--json", "site.yaml"], ["--json", "site.yaml", "the site"]),
    ("limit negative", ["--within", "-3"], ["--within", "'-3'", "positive number, in s"]),
    ("limit in another unit", ["--energy", "3 J"], ["--energy", "'3 J'", "Wh"]),
    ("two limits", ["--within", "9", "--energy", "3"], ["--energy", "--within"]),
    ("limit and risk", ["--within", "9", "--risk", "wind=1"], ["--within", "'9'", "--risk"]),
    ("preference alone", ["--safest"], ["--safest", "limit", "--within"]),
    ("option unknown", ["--speed", "3"], ["--speed"]),
    ("value missing", ["--start"], ["--start", "expected one argument"]),
]


@pytest.mark.parametrize(
    ("options", "words"), [case[1:] for case in REFUSED], ids=[c[0] for c in REFUSED]
)
def test_bad_input_is_one_line_status_2_and_no_file(
    options, words, site, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    before = Path(site).read_bytes()
    plot = [] if "--plot" in options else ["--plot", "p.png"]
    argv = ["plan", site, "--mission", "inspection", *plot, *options]
    line = one_line(argv, 2, capsys)
    assert [word for word in words if word not in line] == []
    assert [file.name for file in tmp_path.iterdir()] == ["site.yaml"]
    assert Path(site).read_bytes() == before


@pytest.mark.parametrize("target", ["3", "2", "-1", "0.5", "splice-outer", ""])
def test_a_landing_point_that_does_not_exist_is_refused(site, target, capsys):
    assert cli.main(["plan", site, "--mission", "evacuation", "--target", target]) == 2
    err = capsys.readouterr().err
    assert f"--target: is '{target}', must be the index of a landing point" in err
    assert "0 at (-10, 2.5), 1 at (40, 2.5)" in err


@pytest.mark.parametrize(
    ("mission", "changes", "key"),
    [
        ("inspection", {"targets": None}, "targets"),
        ("exit", {"landing": None}, "landing.exit"),
    ],
)
def test_a_site_without_the_mission_is_refused(mission, changes, key, tmp_path, capsys):
    file = variant(tmp_path / "less.yaml", **changes)
    assert cli.main(["plan", file, "--mission", mission]) == 2
    assert f"less.yaml: {key}: has none" in capsys.readouterr().err


def test_a_landing_point_that_no_cell_sees_is_named(tmp_path, capsys):
    wall = [[32, -60], [33, -60], [33, 90], [32, 90]]
    file = variant(
        tmp_path / "wall.yaml",
        obstacles=[{"polygon": {"name": "wall", "vertices_m": wall}}],
        targets=None,
        landing={"exit": [{"x_m": 40.0, "z_m": 0.0}]},
    )
    out_file = tmp_path / "plan.json"
    assert cli.main(["plan", file, "--mission", "exit", "--json", str(out_file)]) == 2
    assert "(40, 0)" in capsys.readouterr().err
    assert not out_file.exists()


def test_a_file_that_cannot_be_written_loses_no_other(site, tmp_path, monkeypatch, capsys):
    def full(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("moar_companion.commands.plan.write_maps", full)
    old = tmp_path / "maps.npz"
    old.write_bytes(b"old")
    words = ["--json", str(tmp_path / "a.json"), "--maps", str(old)]
    words += ["--plot", str(tmp_path / "a.png")]
    assert cli.main(["plan", site, "--mission", "exit", *words]) == 1
    out, err = capsys.readouterr()
    assert "found" in out
    assert err == f"moar-companion: --maps: {old}: No space left on device\n"
    assert old.read_bytes() == b"old"
    assert {file.name for file in tmp_path.iterdir()} == {
        "site.yaml",
        "maps.npz",
        "a.json",
        "a.png",
    }


def test_the_target_of_a_symbolic_link_is_replaced_with_its_permissions(site, tmp_path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    assert cli.main(["plan", site, "--mission", "exit", "--json", str(link)]) == 0
    assert link.is_symlink()
    assert json.loads(real.read_text())["status"] == "found"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


def test_a_new_file_has_the_permissions_of_any_new_file(site, tmp_path):
    (tmp_path / "plain").touch()
    assert cli.main(["plan", site, "--mission", "exit", "--json", str(tmp_path / "new")]) == 0
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_device_is_written_and_not_replaced(site):
    words = ["--json", os.devnull, "--maps", os.devnull, "--plot", os.devnull]
    assert cli.main(["plan", site, "--mission", "exit", *words]) == 0
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


def test_a_directory_without_write_permission_is_refused(site, tmp_path, monkeypatch, capsys):
    # The answer of the system is replaced: root may run the tests, and may write anywhere.
    monkeypatch.setattr("os.access", lambda path, _mode: str(path) != str(tmp_path))
    assert cli.main(["plan", site, "--mission", "exit", "--json", str(tmp_path / "a")]) == 2
    assert f"nothing may be written in {tmp_path}" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_a_denial_as_flown_names_the_part_of_the_margin_that_causes_it(tmp_path, capsys):
    near = variant(
        tmp_path / "near.yaml",
        targets={"near": {"conductor": "right-middle", "standoff_m": 3.0, "side": "right"}},
    )
    status = cli.main(["plan", near, "--mission", "inspection", "--as-flown"])
    assert status == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert "the margin of 2.55 m beyond keep-outs leaves no path" in err
    assert "there is one without tracking error 1.15 m" in err
