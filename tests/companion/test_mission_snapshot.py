"""The mission snapshot: the part that can still be flown, the text."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission.state_machine import MissionState, Task
from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.types import Mission

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
TARGETS = tuple(target.name for target in SITE.targets)
INSPECTION = Task(mission=Mission.INSPECTION, stops=TARGETS)
EXIT = Task(mission=Mission.EXIT, landing=0)


def memory(state=MissionState.FLYING, task=INSPECTION, **changes):
    values = {"state": state, "since_s": 100.0, "task": task, "site": SITE.name}
    return MissionSnapshot(**(values | changes))


@pytest.mark.parametrize(
    ("case", "remembered", "rest"),
    [
        ("in flight", memory(), INSPECTION),
        ("held by an operator", memory(MissionState.HOLDING), INSPECTION),
        ("ready, the mode not yet given", memory(MissionState.READY), INSPECTION),
        ("on the escape route", memory(task=EXIT), EXIT),
        ("every target done", memory(MissionState.HOLDING, Task(mission=Mission.INSPECTION)), None),
        ("the pilot had taken over", memory(MissionState.OVERRIDDEN), None),
        ("released by a passing cause", memory(MissionState.RELEASED), INSPECTION),
        ("released by an operator", memory(MissionState.RELEASED, None), None),
        ("its continuation planned", memory(MissionState.PLANNING), INSPECTION),
        ("its continuation denied", memory(MissionState.IDLE), INSPECTION),
        ("nothing was flown", memory(MissionState.IDLE, None), None),
        ("another site", memory(site="another"), None),
        (
            "a target that the site has no more",
            memory(task=Task(mission=Mission.INSPECTION, stops=("gone",))),
            None,
        ),
        (
            "a landing point that it has no more",
            memory(task=Task(mission=Mission.EXIT, landing=9)),
            None,
        ),
    ],
)
def test_an_interrupted_mission_that_still_fits_the_site_can_be_continued(case, remembered, rest):
    assert remembered.rest(SITE) == rest
    assert remembered.rest(None) is None


def test_a_snapshot_has_a_text_for_operators():
    assert memory().words(112.4) == f"flying inspection (to {TARGETS[0]}, begun 12 s ago)"
    assert memory(task=EXIT).words(100.0) == "flying exit (begun 0 s ago)"
    assert memory().words(99.0) == f"flying inspection (to {TARGETS[0]})"
