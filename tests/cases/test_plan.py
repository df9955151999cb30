"""What `moar-companion plan` says of safety, of the margin, and of what it does not plan."""

from __future__ import annotations

import json
import re

import pytest

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs

SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")


@pytest.fixture
def lines(capsys):
    """The summary of a plan, line by line."""

    def run(mission, *options):
        assert cli.main(["plan", SITE, "--mission", mission, *options]) == 0
        out, err = capsys.readouterr()
        assert err == ""
        return out.splitlines()

    return run


@pytest.mark.slow
def test_alternatives_show_how_safe_they_are_and_why_a_risk_keeps_the_path(lines):
    found = lines("inspection", "--target", "splice-inner", "--alternatives")
    listed = [
        line for line in found if re.search(r"(wind|risk|battery|localization) ?[\d.]*: ", line)
    ]
    assert len(listed) == 7
    for line in listed:
        assert re.search(r"safety cost \d\.\d\d, clearance \S+ m on average, \S+ m at least", line)
    assert found[-1].strip() == (
        "wind, communication and localization do not move the path: the safest has safety cost "
        "3.59 (this 3.67), takes 39.1 s (37.4 s), needs energy 2.21 (1.56)"
    )
    assert "do not move" not in "".join(
        lines("inspection", "--target", "splice-inner", "--alternatives", "--as-flown")
    )


def test_the_margin_that_a_plan_keeps_or_lacks_is_named(lines):
    for options, words in (
        ((), "none; the service keeps 2.55 m more from obstacles (--as-flown)"),
        (("--as-flown",), "2.55 m for the flight's errors, as the service keeps"),
    ):
        assert f"  margin     {words}" in lines("inspection", *options)


def test_the_landing_leg_and_the_other_targets_are_named(lines):
    words = "".join(lines("exit"))
    assert "of these the landing leg, not in the cost: 10.3 m in 15.9 s" in words
    assert "targets" not in words
    others = "  targets    the first alone; --target all: the tour with 1 more, as it is flown"
    assert others in lines("inspection")
    assert others not in lines("inspection", "--target", "splice-outer")


@pytest.mark.slow
def test_a_mission_for_qgroundcontrol_takes_off_lands_and_has_the_speed_of_each_part(tmp_path):
    out = tmp_path / "site.plan"
    assert cli.main(["site", "show", SITE, "--qgc-plan", str(out)]) == 0
    items = json.loads(out.read_text())["mission"]["items"]
    commands = [item["command"] for item in items]
    assert (commands[0], commands[-1]) == (22, 21)
    assert set(commands[1:-1]) == {16, 178}
    assert items[-1]["Altitude"] == pytest.approx(212.5)
    speeds_mps = [item["params"][1] for item in items if item["command"] == 178]
    assert len(set(speeds_mps)) > 1
    assert max(speeds_mps) <= 0.7
