"""Tables of pages name tests that exist; that of sitl/README.md as many parameters as there are."""

import re
from pathlib import Path

import pytest

from sitl.manners import KINDS

ROOT = Path(__file__).parents[2]
README = (ROOT / "sitl" / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "least"), [("sitl/README.md", 100), ("configs/SECURITY.md", 15)])
def test_every_test_that_a_row_names_exists(page, least):
    modules = list((ROOT / "tests").rglob("test_*.py"))
    there = {path.stem for path in modules}.union(
        *(re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE) for path in modules)
    )
    named = set(re.findall(r"`(test_\w+)`", (ROOT / page).read_text(encoding="utf-8")))
    assert len(named) > least
    assert named <= there


@pytest.mark.parametrize(("kind", "title"), [("px4", "PX4"), ("ardupilot", "ArduPilot")])
def test_the_numbers_of_parameters_are_those_of_the_row(kind, title):
    row = re.search(rf"\| (\d+) of {title}'s \d+, and (\d+) SIM_ ones", README)
    names = KINDS[kind].parameters({}, KINDS[kind].firmware).values
    simulated = sum(name.startswith("SIM_") for name in names)
    assert [int(number) for number in row.groups()] == [len(names) - simulated, simulated]
