"""Traces of flights: repeatable; a difference is found with its time."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.copies import copy_of
from tests.flights.lockstep import hovering
from tests.flights.operator import INSPECTION
from tests.traces.command import FOLDER, main
from tests.traces.flights import FLIGHTS, KINDS, SEEDS, drawn
from tests.traces.trace import CHANNELS, difference, trace_of


@pytest.fixture(scope="module")
def flight():
    """Some seconds of an inspection. The tests change copies."""
    flight = hovering(vehicle="x500")
    flight.begin(INSPECTION)
    flight.run(4.0)
    return flight


def found(before, after, renamed=None):
    """The differences of the flights by channel."""
    then, now = trace_of(before, {}), trace_of(after, renamed or {})
    differences = {name: difference(name, then, now) for name in CHANNELS}
    return {name: text for name, text in differences.items() if text}


@pytest.mark.slow
def test_a_flight_that_is_flown_twice_has_the_same_trace(flight):
    again = hovering.__wrapped__(vehicle="x500")
    again.begin(INSPECTION)
    again.run(4.0)
    assert again is not flight
    assert len(flight.setpoints) > 100
    assert found(flight, again) == {}


@pytest.mark.slow
def test_only_the_setpoint_that_differs_is_found_with_its_time(flight):
    changed = copy_of(flight)
    changed.setpoints = list(changed.setpoints)
    index = max(i for i, item in enumerate(changed.setpoints) if item.time_s < 22.99)
    item = changed.setpoints[index]
    message = copy.copy(item.message)
    message.x += 0.5
    packet = message.pack(mavlink.MAVLink(None))
    changed.setpoints[index] = replace(item, packet=packet)
    differences = found(flight, changed)
    assert set(differences) == {"setpoints"}
    assert "setpoints differ from second 22 on" in differences["setpoints"]
    assert f"was at {item.time_s:.2f} s: x {item.message.x:.2f} " in differences["setpoints"]
    assert f"is at {item.time_s:.2f} s: x {message.x:.2f} " in differences["setpoints"]


@pytest.mark.slow
def test_a_setpoint_that_differs_by_less_than_the_printed_digits_is_found(flight):
    changed = copy_of(flight)
    item = changed.setpoints[-10]
    message = copy.copy(item.message)
    message.x += 1e-6
    packet = message.pack(mavlink.MAVLink(None))
    changed.setpoints[-10] = replace(item, packet=packet)
    differences = found(flight, changed)["setpoints"]
    assert differences.endswith("by less than the lines are rounded to")


def changed_decision(flight, kind, **data):
    """A copy of a flight with other data in the first decision of a kind; its time."""
    changed = copy_of(flight)
    index = next(i for i, item in enumerate(changed.decisions) if item.kind == kind)
    item = changed.decisions[index]
    changed.decisions[index] = replace(item, data=item.data | data)
    return changed, item.time_s


def test_a_decision_that_differs_is_found_with_its_time(flight):
    changed, time_s = changed_decision(flight, "state", state="released")
    differences = found(flight, changed)
    assert set(differences) == {"decisions"}
    assert f'is at {time_s:.2f} s: state {{"state": "released"' in differences["decisions"]


def test_texts_that_differ_are_listed_separately_from_decisions(flight):
    changed, time_s = changed_decision(flight, "condition", reason="in other words")
    differences = found(flight, changed)
    assert set(differences) == {"texts"}
    assert f"is at {time_s:.2f} s: condition: in other words" in differences["texts"]


def test_a_condition_that_was_renamed_on_purpose_is_no_difference(flight):
    name = next(item.data["name"] for item in flight.decisions if item.kind == "condition")
    changed = copy_of(flight)
    for index, item in enumerate(changed.decisions):
        if item.kind == "condition" and item.data["name"] == name:
            changed.decisions[index] = replace(item, data=item.data | {"name": "quite_another"})
    assert set(found(flight, changed)) == {"decisions"}
    assert found(flight, changed, {"quite_another": name}) == {}


def test_each_flight_has_a_trace_and_all_are_small():
    files = {file.name.removesuffix(".json.xz"): file for file in FOLDER.iterdir()}
    assert set(files) == set(FLIGHTS)
    assert sum(file.stat().st_size for file in files.values()) < 200_000


def test_the_random_flights_have_each_of_their_kinds_and_are_whole():
    flights = [drawn(seed) for seed in SEEDS]
    assert {fault.kind for each in flights for fault in each.faults} == set(KINDS)
    assert all(each.whole and not each.lidar and not each.signed for each in flights)


def test_an_unknown_flight_name_is_an_error(capsys):
    with pytest.raises(SystemExit):
        main(["compare", "--only", "nothing"])
    assert "no flight is named 'nothing'" in capsys.readouterr().err
