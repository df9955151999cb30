"""`moar-companion plan --target all`: the tour, what it writes, and what it refuses."""

from __future__ import annotations

import itertools
import json

import pytest
import yaml
from matplotlib.image import imread

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line

from .test_plan import PLAN_KEYS, SHIPPED

VIEWS = [
    {"standoff_m": 4.0, "side": "right", "pictures": 2},
    {"x_m": 26.0, "z_m": 14.0, "video_s": 8.0},
]


def variant(folder, **changes):
    content = yaml.safe_load(SHIPPED.read_text()) | changes
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


def tour(capsys, *options, site=SHIPPED, status=0):
    words = ["plan", str(site), "--mission", "inspection", "--target", "all", *options]
    assert cli.main([*words, "--json", "-"]) == status
    return json.loads(capsys.readouterr().out)


def test_the_json_of_a_tour_extends_the_contract(capsys):
    answer = tour(capsys)
    assert set(answer) >= PLAN_KEYS
    assert (answer["target"], answer["status"]) == ("all", "found")
    legs, order = answer["tour"]["legs"], answer["tour"]["order"]
    assert [leg["target"] for leg in legs] == [*order, None]
    assert answer["cost"]["total"] == pytest.approx(sum(leg["cost"]["total"] for leg in legs))
    assert answer["cost"]["total"] <= answer["tour"]["file_cost"]["total"]
    assert answer["tour"]["file_order"] == ["splice-outer", "splice-inner"]
    assert answer["tour"]["exact"]
    times_s = [point["time_s"] for point in answer["waypoints"]]
    assert all(before <= after for before, after in itertools.pairwise(times_s))
    assert times_s[-1] == pytest.approx(answer["metrics"]["duration_s"])
    assert len(answer["waypoints"]) == sum(len(leg["waypoints"]) for leg in legs)


@pytest.mark.slow
def test_a_tour_visits_every_view_and_reports_its_energy(tmp_path, capsys):
    targets = {
        "splice": {"conductor": "right-middle", "views": VIEWS},
        "far": {"x_m": 11.3, "z_m": 11.0},
    }
    site = variant(tmp_path, targets=targets)
    answer = tour(capsys, site=site)
    assert sorted(answer["tour"]["order"]) == ["far", "splice/1", "splice/2"]
    energy = answer["tour"]["energy"]
    assert energy["held_s"] > 5.0 + 8.0
    assert energy["flown_s"] > answer["metrics"]["duration_s"]
    assert 0.0 < energy["energy_wh"] < energy["capacity_wh"]
    assert (energy["fitting"], answer["tour"]["left_out"]) == (3, [])


@pytest.mark.slow
def test_stops_that_do_not_fit_into_a_full_battery_are_named(tmp_path, capsys):
    vehicle = yaml.safe_load((shipped_configs() / "vehicles/linedrone_flight.yaml").read_text())
    # The first stop and the way out fit, and the second does not.
    vehicle["power"] = {**vehicle.get("power", {}), "hover_w": 400.0, "capacity_wh": 18.0}
    file = tmp_path / "vehicle.yaml"
    file.write_text(yaml.safe_dump(vehicle))
    answer = tour(capsys, "--vehicle", str(file))
    order = answer["tour"]["order"]
    assert answer["tour"]["left_out"] == order[1:]
    words = ["plan", str(SHIPPED), "--mission", "inspection", "--target", "all"]
    assert cli.main([*words, "--vehicle", str(file)]) == 0
    assert f"left out   {order[1]}: a full battery does not suffice" in capsys.readouterr().out


@pytest.mark.slow
def test_a_tour_is_drawn_and_summed_up(tmp_path, capsys):
    picture = tmp_path / "tour.png"
    words = ["plan", str(SHIPPED), "--mission", "inspection", "--target", "all", "--as-flown"]
    assert cli.main([*words, "--plot", str(picture), "--maps", str(tmp_path / "maps.npz")]) == 0
    out = capsys.readouterr().out
    assert "inspection of all, 2 stops: found" in out
    assert "the file's order" in out
    assert imread(picture).std() > 0.1


def test_a_stop_without_a_path_is_the_reason_and_last(tmp_path, capsys):
    targets = {"inside": {"x_m": 9.17, "z_m": 3.7}, "free": {"x_m": 26.0, "z_m": 14.0}}
    site = variant(tmp_path, targets=targets)
    words = ["plan", site, "--mission", "inspection", "--target", "all", "--json", "-"]
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert answer["status"] == "target_occupied"
    assert (answer["cost"], answer["metrics"], answer["states"]) == (None, None, [])
    assert answer["tour"]["order"] == ["free", "inside"]
    assert answer["tour"]["energy"] is None
    assert "target inside at (9.17, 3.7) is too close to an obstacle" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("option", [["--refine"], ["--explain"], ["--within", "30"]])
def test_options_of_one_path_are_refused(option, capsys):
    words = ["plan", str(SHIPPED), "--mission", "inspection", "--target", "all", *option]
    problem = f"--target: is 'all', but {option[0]} is of one path: name a target"
    assert one_line(words, 2, capsys) == problem


def test_a_target_named_all_is_that_target(tmp_path, capsys):
    site = variant(tmp_path, targets={"all": {"x_m": 26.0, "z_m": 14.0}})
    answer = tour(capsys, site=site)
    assert answer["target"] == "all"
    assert "tour" not in answer


def test_a_site_without_targets_has_no_tour(tmp_path, capsys):
    site = variant(tmp_path, targets={})
    words = ["plan", site, "--mission", "inspection", "--target", "all"]
    assert "targets: has none, an inspection needs one" in one_line(words, 2, capsys)
