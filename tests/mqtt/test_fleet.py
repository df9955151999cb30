"""The fleet of `watch`: messages in, a row per vehicle out, and the table."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from moar_companion.commands.fleet_view import FleetView, lines_of
from moar_companion.service.mqtt.fleet import Fleet
from moar_companion.service.mqtt.payloads import written
from moar_companion.service.mqtt.topics import Publication

from .statuses import flying, status_of

WALL_S = 2e9


def fleet_of(*vehicles, retained=False, received_s=10.0):
    fleet = Fleet()
    for vehicle in vehicles:
        fleet.take(f"moar/{vehicle}/online", b'{"online": true}', received_s, retained=True)
        for message in Publication(vehicle).due(status_of(flying()), 0.0):
            fleet.take(message.topic, message.payload, received_s, retained=retained)
    return fleet


def table(fleet, *, now_s=10.0, wall_s=WALL_S, size=(150, 30), terminal=True):
    console = Console(
        width=size[0], height=size[1], force_terminal=terminal, color_system=None, file=None
    )
    with console.capture() as captured:
        console.print(FleetView(fleet.rows(), "connected", now_s=now_s, wall_s=wall_s))
    return captured.get()


def test_a_row_shows_state_risks_battery_and_age():
    (line,) = [text for text in table(fleet_of("a1"), now_s=10.3).splitlines() if "a1" in text]
    status = status_of(flying())
    assert f"flying inspection {flying().site.targets[0].name}"[:20] in line
    assert status["autopilot"]["mode"] in line
    for index in status["risk"].values():
        assert f"{index['value']:.2f}" in line
    assert f"{100 * status['batteries'][0]['remaining']:.0f} %" in line
    assert line.rstrip().endswith("0.3 s")


def test_an_unknown_risk_is_marked_and_missing_parts_are_no_zeros():
    fleet = Fleet()
    fleet.take("moar/a1/online", b'{"online": true}', 1.0, retained=False)
    (line,) = [text for text in table(fleet).splitlines() if "a1" in text]
    assert "0.0" not in line
    assert line.split()[1:] == ["?"] * 10


def test_a_last_will_shows_offline_and_the_last_state():
    fleet = fleet_of("a1")
    fleet.take("moar/a1/online", b'{"online": false}', 20.0, retained=False)
    (row,) = fleet.rows()
    assert (row.online, row.received_s) == (False, 10.0)
    assert "offline, was flying" in table(fleet, now_s=80.0)


def test_a_retained_message_has_its_age_by_the_vehicles_clock():
    (row,) = fleet_of("a1", retained=True).rows()
    assert row.received_s is None
    assert row.age_s(1e6, row.reported_s + 90.0) == pytest.approx(90.0)


def test_rows_are_ordered_and_those_without_room_are_counted():
    fleet = fleet_of(*(f"v{number:02d}" for number in range(40)))
    shown = [text.split()[0] for text in table(fleet, size=(120, 25)).splitlines() if "v" in text]
    rows = [word for word in shown if word.startswith("v") and word[1:].isdigit()]
    assert rows == [f"v{number:02d}" for number in range(20)]
    assert "and 20 more" in table(fleet, size=(120, 25))
    assert len(list(lines_of(fleet.rows(), now_s=10.0, wall_s=WALL_S))) == 40


@settings(max_examples=30)
@given(topic=st.text(max_size=30), payload=st.binary(max_size=60))
def test_any_message_is_taken_without_an_error(topic, payload):
    fleet = Fleet()
    fleet.take(topic, payload, 0.0, retained=False)
    for name in ("mission", "risk", "online", "battery"):
        fleet.take(f"moar/a1/{name}", payload, 0.0, retained=False)
    table(fleet)


def test_unknown_senders_cannot_fill_the_memory_nor_move_the_cursor():
    fleet = Fleet()
    for number in range(3000):
        fleet.take(f"moar/v{number}/online", b'{"online": true}', 0.0, retained=False)
    fleet.take("moar/\x1b[2J/online", b'{"online": true}', 0.0, retained=False)
    assert len(fleet.rows()) == 1000
    assert fleet.unreadable == 2001
    fleet = fleet_of("a1")
    mission = json.loads(written(fleet.rows()[0].payloads["mission"]))
    mission["mode"] = "\x1b[2J\a"
    fleet.take("moar/a1/mission", json.dumps(mission).encode(), 0.0, retained=False)
    assert not set("\x1b\a") & set(table(fleet))
