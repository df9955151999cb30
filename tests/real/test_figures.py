"""Faults found in a flight's figures, and rows of the table."""

from __future__ import annotations

import pytest

from sitl.demonstration.real import RealError, autopilot_at

from .figures import Row, table
from .kinds import KINDS
from .scenarios import SCENARIOS
from .table import keep

FLOWN = Row(
    "real-px4",
    "nominal",
    2.0,
    None,
    clearance_m=1.2,
    keep_out_margin_m=0.3,
    error_mean_m=0.5,
    error_p95_m=0.9,
    error_max_m=1.1,
    speed_max_mps=3.0,
    state="idle",
    landed=True,
)


def changed(**values):
    return Row(**{**{name: getattr(FLOWN, name) for name in FLOWN.__dataclass_fields__}, **values})


def test_a_good_flight_has_no_faults():
    assert FLOWN.faults == []


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        ({"keep_out_margin_m": -0.1}, "inside its keep-out"),
        ({"let_go": "MOAR: position age 0.6 s > 0.5, released"}, "let go"),
        ({"expected_let_go": True}, "was to let go"),
        ({"takeover_s": 0.9}, "noticed after 0.90 s"),
        ({"landed": False}, "did not land"),
        ({"problem": "flying: not within 5 s"}, "not within"),
    ],
)
def test_a_fault_of_a_flight_is_reported(values, fault):
    (reported,) = changed(**values).faults
    assert fault in reported


def test_a_detected_takeover_is_no_fault_of_the_companion():
    assert (
        changed(
            let_go="MOAR: autopilot in HOLD, overridden",
            expected_let_go=True,
            takeover_s=0.1,
        ).faults
        == []
    )


def test_a_mode_switch_of_ardupilot_counts_without_its_debounce():
    turned = {"scenario": "takeover_by_sticks", "takeover_s": 0.21, "expected_let_go": False}
    assert changed(kind="real-ardupilot", **turned).faults == []
    assert changed(kind="real-px4", **turned).faults == ["the takeover was noticed after 0.21 s"]
    turned["takeover_s"] = 0.41
    assert changed(kind="real-ardupilot", **turned).faults != []


def test_the_table_has_a_line_for_each_flight_and_lists_flights_that_were_not_flown():
    lines = table([FLOWN, changed(unable="no wind")]).splitlines()
    assert len(lines) == 4
    assert {line.count("|") for line in lines} == {lines[0].count("|")}
    assert "not flown: no wind" in lines[3]


def test_a_flight_that_is_flown_again_replaces_its_row(tmp_path):
    keep(tmp_path, FLOWN)
    keep(tmp_path, changed(kind="fake-px4"))
    keep(tmp_path, changed(clearance_m=0.4))
    rows = (tmp_path / "table.md").read_text().splitlines()[2:]
    assert ["fake-px4" in row for row in rows] == [True, False]
    assert "0.40 m" in rows[1]


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_the_parameters_of_every_scenario_are_numbers(kind):
    for scenario in SCENARIOS.values():
        assert all(isinstance(value, int | float) for value in scenario.parameters(kind).values())


def test_every_scenario_is_flown_on_every_kind_but_where_a_simulator_cannot():
    reasons = {
        (kind.name, scenario.name): scenario.unable(kind)
        for kind in KINDS.values()
        for scenario in SCENARIOS.values()
    }
    assert {key: reason for key, reason in reasons.items() if reason is not None} == {
        ("real-px4", "wind_and_calm"): "PX4 v1.17's own simulator has no wind",
    }


def test_a_path_without_an_autopilot_is_named_in_the_error(tmp_path):
    with pytest.raises(RealError, match=str(tmp_path)):
        autopilot_at(tmp_path)
