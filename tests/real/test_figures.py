"""Faults found in a flight's figures, and rows of the table."""

from __future__ import annotations

import pytest

from sitl.demonstration.real import RealError, autopilot_at

from . import figures
from .figures import Row, spoilt, table
from .kinds import KINDS
from .scenarios import SCENARIOS
from .stalls import SIMULATOR, Stall
from .table import keep, replaced

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
        ({"expected_let_go": "failsafe chose LAND"}, "was to let go"),
        (
            {
                "let_go": "MOAR: position age 1.6 s > 0.5, released",
                "expected_let_go": "failsafe chose HOLD",
            },
            "position age 1.6 s > 0.5, released, not: failsafe chose HOLD",
        ),
        (
            {
                "let_go": "MOAR: failsafe chose HOLD, released",
                "let_go_after_s": 9.0,
                "expected_let_go": "failsafe chose HOLD",
                "expected_after_s": (0.3, 3.0),
            },
            "let go 9.00 s after the cause, not 0.3 to 3 s",
        ),
        (
            {"keep_out_margin_m": -0.35, "after_release": "right-lower -0.10 m"},
            "after the release: right-lower -0.10 m",
        ),
        ({"objections": ["continue: TEMPORARILY_REJECTED"]}, "TEMPORARILY_REJECTED"),
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
            expected_let_go="overridden",
            takeover_s=0.1,
        ).faults
        == []
    )


def test_a_mode_switch_of_ardupilot_counts_without_its_debounce():
    turned = {"scenario": "takeover_by_sticks", "takeover_s": 0.21, "expected_let_go": None}
    assert changed(kind="real-ardupilot", **turned).faults == []
    assert changed(kind="real-px4", **turned).faults == ["the takeover was noticed after 0.21 s"]
    turned["takeover_s"] = 0.41
    assert changed(kind="real-ardupilot", **turned).faults != []


def test_the_table_has_a_line_for_each_flight_and_lists_flights_that_were_not_flown():
    lines = table([FLOWN, changed(unable="no wind")]).splitlines()
    assert len(lines) == 4
    assert {line.count("|") for line in lines} == {lines[0].count("|")}
    assert "not flown: no wind" in lines[3]


def test_the_table_has_the_clearance_to_the_pilots_landing_and_over_the_whole_flight():
    row = changed(clearance_m=3.13, clearance_whole_m=0.93)
    assert "| 3.13, 0.93 |" in table([row])


def test_the_table_has_what_is_near_after_a_release():
    row = changed(
        let_go="MOAR: failsafe chose LAND, released",
        let_go_after_s=7.25,
        after_release="right-lower -0.10 m",
    )
    assert "| failsafe chose LAND, released, 7.2 s | right-lower -0.10 m |" in table([row])


def test_a_flight_outside_the_promise_is_shown_and_not_judged():
    row = changed(shown="no sensor sees the line", keep_out_margin_m=-0.3, clearance_m=-0.05)
    assert row.faults == []
    assert "not judged: no sensor sees the line" in table([row])
    assert changed(shown="no sensor sees the line", landed=False).faults == ["did not land"]


def test_a_flight_that_is_flown_again_replaces_its_row(tmp_path):
    keep(tmp_path, FLOWN)
    keep(tmp_path, changed(kind="fake-px4"))
    keep(tmp_path, changed(clearance_m=0.4))
    rows = (tmp_path / "table.md").read_text().splitlines()[2:]
    assert ["fake PX4" in row for row in rows] == [True, False]
    assert "| 0.40, " in rows[1]


def test_a_page_gets_the_new_table_in_the_place_of_the_old_one():
    page = "# Page\n\nBefore.\n\n" + table([FLOWN, FLOWN]) + "\nAfter.\n"
    new = table([changed(clearance_m=0.4)])
    assert replaced(page, new) == f"# Page\n\nBefore.\n\n{new}\nAfter.\n"


STOOD = Stall(100.0, 0.62, SIMULATOR)
AGE = {"let_go": "MOAR: position age 0.51 s > 0.5, released"}


@pytest.mark.parametrize(
    ("values", "delays", "released_s", "least_speed", "cause"),
    [
        (AGE, [STOOD], 99.9, 1.0, "simulator 0.62 s"),
        (AGE, [STOOD], 100.4, 1.0, "simulator 0.62 s"),
        (AGE, [STOOD], 103.0, 1.0, None),
        (AGE, [STOOD], 99.0, 1.0, None),
        (AGE, [], 99.9, 1.0, None),
        (AGE, [], 99.9, 0.6, None),
        (
            {"landed": False, "autopilot_texts": ["BARO #0 failed:  TIMEOUT!\t"]},
            [],
            None,
            1.0,
            "simulator: BARO #0 failed:  TIMEOUT!",
        ),
        ({"problem": "arm: DENIED"}, [STOOD], None, 1.0, "simulator 0.62 s"),
        ({"problem": "arm: DENIED"}, [], None, 0.6, "simulator at 0.60 of its speed"),
        ({"problem": "arm: DENIED"}, [], None, 0.98, None),
        ({}, [STOOD], None, 0.6, None),
        ({**AGE, "keep_out_margin_m": -0.1}, [STOOD], 99.9, 1.0, None),
        ({"objections": ["continue: DENIED"]}, [STOOD], None, 1.0, None),
    ],
    ids=[
        "a release within the simulator's stall",
        "a release just after it",
        "a release long after it",
        "a release before it",
        "a release without a stall",
        "a slow simulator excuses no release",
        "sensors of the simulator that stopped",
        "a failed arming in a flight with a stall",
        "a failed arming on a slow simulator",
        "a failed arming without either",
        "a good flight",
        "a collision is never excused",
        "what the scenario found is never excused",
    ],
)
def test_a_flight_is_spoilt_by_delays_that_explain_its_faults(
    values, delays, released_s, least_speed, cause
):
    assert spoilt(changed(**values), delays, released_s, least_speed) == cause


def test_a_spoilt_flight_is_flown_again_a_bounded_number_of_times(tmp_path, monkeypatch):
    fair, unfair = changed(), changed(problem="the companion let go", spoilt="simulator 0.62 s")
    flights = iter([unfair, fair, unfair, unfair, unfair, fair])

    def fly(kind, scenario, folder, *, speed):
        folder.mkdir(parents=True)
        return next(flights)

    monkeypatch.setattr(figures, "flown_once", fly)
    first = figures.flown(None, None, tmp_path / "one")
    assert first.faults == []
    assert first.spoilt_before == ["the companion let go (simulator 0.62 s)"]
    assert "flight 2" in table([first])
    assert (tmp_path / "one" / "row.json").exists()
    assert (tmp_path / "one-spoilt1").is_dir()
    second = figures.flown(None, None, tmp_path / "two")
    assert len(second.spoilt_before) == figures.MOST_FLIGHTS - 1
    assert second.faults != []
    assert next(flights) is fair


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_the_parameters_of_every_scenario_are_numbers(kind):
    for scenario in SCENARIOS.values():
        assert all(isinstance(value, int | float) for value in scenario.parameters(kind).values())


def test_a_receivers_parameters_have_the_names_of_the_firmware():
    old, new = KINDS["real-ardupilot"], KINDS["real-ardupilot-4.7"]
    assert old.gps(found=False) == {"SIM_GPS_DISABLE": 1}
    assert new.gps(found=False) == {"SIM_GPS1_ENABLE": 0}
    assert list(old.gps_offset(1e-6, 2e-6, 0.0)) == [f"SIM_GPS_GLITCH_{axis}" for axis in "XYZ"]
    assert list(new.gps_offset(1e-6, 2e-6, 0.0)) == [f"SIM_GPS1_GLTCH_{axis}" for axis in "XYZ"]


def test_every_scenario_is_flown_on_every_kind_but_where_a_simulator_cannot():
    reasons = {
        (kind.name, scenario.name): scenario.unable(kind)
        for kind in KINDS.values()
        for scenario in SCENARIOS.values()
    }
    assert {key: reason for key, reason in reasons.items() if reason is not None} == {
        ("real-px4", "wind_and_calm"): "PX4 v1.17's own simulator has no wind",
        ("real-px4", "gps_drift"): "PX4 v1.17's own simulator has no offset of the receiver",
        **{
            (name, "gps_drift"): "flown in lockstep: tests/flights/campaign"
            for name in ("fake-px4", "fake-ardupilot")
        },
    }


def test_a_path_without_an_autopilot_is_named_in_the_error(tmp_path):
    with pytest.raises(RealError, match=str(tmp_path)):
        autopilot_at(tmp_path)
