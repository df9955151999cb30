"""Every text for pilots with its longest values fits into one STATUSTEXT, whole, with its action.

The longest values are those of the product: the names of modes of both autopilots, names of
targets as long as a site file may have them, the greatest numbers.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

import moar_companion
from moar_companion.companion.mission.state_changes import state_words
from moar_companion.companion.mission.values import Order, Task, Verdict
from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.safety.condition_types import filled
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.mavlink import modes
from moar_companion.mavlink.autopilots import PROFILES, profile
from moar_companion.mavlink.autopilots.failsafe_actions import LINKS, AutopilotAction, Trigger
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.mavlink.commands import result_words
from moar_companion.mavlink.signing import SigningRefusal
from moar_companion.settings.yaml_schema import Name
from moar_companion.texts.pilot_texts import TEXTS
from moar_companion.texts.text_format import (
    coordinate,
    distance,
    limit_text,
    pilot_text,
    seconds,
    short_name,
)
from moar_companion.texts.text_patterns import FIELDS, NAMES
from moar_companion.types import UNKNOWN, Mission, RiskIndices
from tests.condition_actions import all_actions

EACH = pytest.mark.parametrize("name", TEXTS)
SOURCES = Path(moar_companion.__file__).parent


def assert_is_whole(reason, action):
    text = pilot_text(reason, action)
    assert text == f"MOAR: {reason}, {action}" if action else f"MOAR: {reason}"
    assert len(text) <= 50
    assert not re.search(r"(?<!\d)0\.0+(?!\d)", text)


@EACH
def test_a_text_with_its_longest_values_is_sent_whole_with_each_action(name):
    text = TEXTS[name]
    for action in text.actions:
        assert_is_whole(text.longest, action)
    for field in NAMES.intersection(text.fields):
        shown = short_name(FIELDS[field][1], 4)
        assert shown[:2] in text.longest  # of a name too long its beginning


@pytest.mark.parametrize("row", CONDITIONS, ids=lambda row: row.name)
def test_a_condition_with_its_longest_values_is_sent_whole_with_each_action(row):
    for text in row.texts:
        for action in all_actions(row):
            assert_is_whole(filled(text, longest=True), action)


@EACH
def test_a_text_is_used_and_has_known_fields_and_a_meaning(name):
    text = TEXTS[name]
    assert FIELDS.keys() >= set(text.fields)
    assert text.meaning
    uses = [
        path for path in SOURCES.rglob("*.py") if re.search(rf"_texts\.{name}\b", path.read_text())
    ]
    assert uses


def test_no_text_is_written_in_two_places():
    patterns = [text.pattern for text in TEXTS.values()]
    assert len(patterns) == len(set(patterns))


def longest(words):
    return max(map(len, words))


def mode_names():
    numbers = {main << 16 | sub << 24 for main in range(16) for sub in range(16)} | {*range(64)}
    return sorted(
        {
            modes.mode_name(kind, number, vehicle_type)
            for kind, row in PROFILES.items()
            for vehicle_type in (2, *row.mode_enums)
            for number in numbers
        }
    )


def fence_names():
    for row in PROFILES.values():
        parameters = dict.fromkeys(row.fence_parameters, 10_000.0) | {"FENCE_TYPE": 15.0}
        yield from row.fence(Parameters(parameters), ()).names
    yield "exclusion polygon 999"


PRODUCT = {
    "mission": [mission.value for mission in Mission],
    "mode": mode_names(),
    "own_mode": [row.own_mode for row in (*PROFILES.values(), profile(UNKNOWN))],
    "fence": list(fence_names()),
    "order": [order.value for order in (Order.HOLD, Order.RELEASE)],
    "risk": list(RiskIndices().as_dict()),
    "trigger": [trigger.noun for trigger in Trigger],
    "link": [trigger.noun for trigger in LINKS],
    "reaction": [
        action.noun
        for action in set(AutopilotAction) - {AutopilotAction.NONE, AutopilotAction.HOLD}
    ],
    "result": [result_words(result) for result in range(256)],
    "refusal": [refusal.value for refusal in SigningRefusal],
    "s": [seconds(1e9)],
    "m": [distance(value) for value in (1e-9, 0.04, 99.96, 1e9)],
    "limit": [limit_text(value) for value in (0.5, 12.345, 99_999.0)],
    "before": [
        state_words(state, Task(mission=mission, stops=("M" * 16,)))
        for state in (MissionState.AT_TARGET, MissionState.LANDING_LEG, MissionState.HOLDING)
        for mission in Mission
    ],
}


@pytest.mark.parametrize("field", PRODUCT)
def test_no_value_of_the_product_is_longer_than_the_longest_of_the_table(field):
    assert longest(PRODUCT[field]) <= len(FIELDS[field][1])


def test_the_longest_name_is_that_of_a_site_file():
    limits = [item.max_length for item in Name.__metadata__ if hasattr(item, "max_length")]
    assert limits == [len(FIELDS["target"][1])] == [len(FIELDS["obstacle"][1])]


def test_the_longest_mode_of_a_multirotor_is_in_the_texts_of_conditions():
    (taken,) = (row.texts for row in CONDITIONS if row.name == "failsafe_took_mode")
    assert f"|{max(mode_names(), key=len)}}}" in "".join(taken)


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (-0.04, "0"), (0.04, "0"), (0.05, "0.1"), (-9.96, "-10.0")]
)
def test_a_coordinate_of_zero_has_no_decimals_and_no_sign(value, text):
    assert coordinate(value) == text


def test_a_name_that_fits_is_kept_whole_and_a_longer_one_loses_its_end():
    close = TEXTS["TARGET_CLOSE"]
    assert close(target="splice-1", detail="why") == "splice-1 too near obstacles (why)"
    assert close(target="the third splice of the line") == "the third sp.. too near obstacles"
    assert close(target="splice {1}") == "splice {1} too near obstacles"


def test_the_mode_of_each_autopilot_is_one_that_the_companion_waits_for():
    assert TEXTS["MODE_KEPT"].actions == tuple(
        f"waiting for {row.own_mode}" for row in PROFILES.values()
    )


def test_answers_to_orders_end_with_their_verdict():
    words = {verdict.value.rpartition(" ")[2] for verdict in Verdict}
    for name in ("NOTHING_HELD", "NO_SITE", "REPLACED", "PLACE_LEFT"):
        assert words.intersection(TEXTS[name].actions)


def test_no_text_of_a_pilot_is_written_elsewhere():
    """Reports are made of named texts: no `send_text(…, "literal")`."""
    found = subprocess.run(
        ["grep", "-rnE", r"reports\.send_text\([A-Za-z.]+, f?\"", str(SOURCES)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert not found.stdout
