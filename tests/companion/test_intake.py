"""Data that a cycle reads when more arrives than it has time for."""

from __future__ import annotations

import pytest

from moar_companion.companion.intake import (
    BUDGET_BYTES,
    LEAST_BYTES,
    LONGEST_S,
    RATE_BYTES_PS,
    Intake,
)
from moar_companion.mavlink import codec as codec_module
from moar_companion.mavlink.peers import Precedence
from moar_companion.texts.text_format import pilot_text

from ..mavlink.peer import Peer
from .commands import OPERATOR_LINK, hovering
from .desk import HOLD, LINK, USER_1

AUTOPILOT, STATION, FLOODER = ("10.0.0.2", 14580), ("10.0.0.3", 14550), ("10.0.0.66", 4242)
RANKS = {AUTOPILOT: Precedence.AUTOPILOT, STATION: Precedence.PEER, FLOODER: Precedence.PEER}


def selected(intake, *arrived, now_s=0.0):
    def precedence(_link, address):
        return Precedence.AUTOPILOT if address is None else RANKS.get(address, Precedence.STRANGER)

    items = [(time_s, LINK, *rest) for time_s, *rest in arrived]
    return intake.selected(items, precedence, now_s)


def test_all_data_within_the_budget_is_read_in_the_order_of_arrival():
    items = [(3.0, b"c", STATION), (1.0, b"a", ("other", 1)), (2.0, b"b", AUTOPILOT)]
    intake = Intake()
    assert [item[2] for item in selected(intake, *items)] == [b"a", b"b", b"c"]
    assert intake.texts(9.0) == []


def test_the_autopilot_and_streams_have_no_budget_and_take_none():
    much = bytes(10 * BUDGET_BYTES)
    items = [(1.0, much, AUTOPILOT), (2.0, much, None), (3.0, bytes(BUDGET_BYTES), STATION)]
    assert len(selected(Intake(), *items)) == 3


def test_all_other_addresses_share_one_budget_however_many_they_are():
    items = [(number, bytes(100), ("10.0.1.1", number)) for number in range(1000)]
    assert len(selected(Intake(), *items)) == BUDGET_BYTES // 100
    empty = [(number, b"", ("10.0.1.1", number)) for number in range(1000)]
    assert len(selected(Intake(), *empty)) == BUDGET_BYTES // LEAST_BYTES


@pytest.mark.parametrize(
    ("since_s", "bytes_read"),
    [(0.02, BUDGET_BYTES), (0.1, 6_400), (0.25, 16_000), (0.5, 32_000), (60.0, 32_000)],
)
def test_after_a_pause_the_budget_is_larger_once_and_bounded(since_s, bytes_read):
    intake, flood = Intake(), [(number, bytes(64), FLOODER) for number in range(1000)]
    selected(intake, now_s=0.0)
    assert len(selected(intake, *flood, now_s=since_s)) == bytes_read // 64
    assert len(selected(intake, *flood, now_s=since_s + 0.02)) == BUDGET_BYTES // 64


def test_a_peer_is_read_before_strangers_and_a_quiet_peer_before_one_that_floods():
    flood = [(number, bytes(1472), FLOODER) for number in range(100)]
    strangers = [(number, bytes(64), ("10.0.1.1", number)) for number in range(100)]
    quiet = [(200.0, bytes(100), STATION), (201.0, bytes(50), STATION)]
    intake = Intake()
    kept = selected(intake, *flood, *strangers, *quiet)
    assert [item[0] for item in kept if item[3] == STATION] == [200.0, 201.0]
    assert sum(item[3] == FLOODER for item in kept) == 1
    assert sum(max(64, len(item[2])) for item in kept) <= BUDGET_BYTES


def test_dropped_data_is_reported_at_once_and_then_every_half_minute():
    intake, much = Intake(), bytes(BUDGET_BYTES + 1)
    selected(intake, (1.0, much, FLOODER))
    assert intake.texts(1.0) == [f"1 datagram too many ({LINK})"]
    selected(intake, (2.0, much, FLOODER), (2.0, much, FLOODER))
    assert intake.texts(30.9) == []
    (words,) = intake.texts(31.0)
    assert pilot_text(words, "dropped") == "MOAR: 2 datagrams too many, dropped"
    assert intake.texts(99.0) == []


# Whole cycles


@pytest.fixture
def steps(monkeypatch):
    """Number of times that the parser has looked for a packet."""
    looks, size = [], codec_module.frame_size

    def counted(*arguments):
        looks.append(1)
        return size(*arguments)

    monkeypatch.setattr(codec_module, "frame_size", counted)
    return looks


@pytest.mark.parametrize("size", [1472, 65507])
@pytest.mark.parametrize("known", [False, True], ids=["a stranger's", "a peer's"])
def test_a_flood_of_start_markers_costs_a_cycle_no_more_than_the_budget(size, known, steps):
    desk = hovering()
    if known:
        greeting = Peer(255, 77).ground_heartbeat()
        desk.companion.receive(OPERATOR_LINK, greeting, desk.now_s, FLOODER)
    for _ in range(5):
        steps.clear()
        flood = [(desk.now_s, OPERATOR_LINK, b"\xfe" * size, FLOODER)] * 512
        desk.companion.take_in(flood, desk.now_s)
        assert len(steps) <= BUDGET_BYTES
        desk.step()
    texts = [m.text for _, link, m in desk.sent if m.get_type() == "STATUSTEXT" and link == LINK]
    assert sum(text.endswith("datagrams too many, dropped") for text in texts) == 1


def test_a_flood_after_a_pause_costs_one_cycle_no_more_than_the_longest_pauses_budget(steps):
    desk, most = hovering(), []
    greeting = Peer(255, 77).ground_heartbeat()
    desk.companion.receive(OPERATOR_LINK, greeting, desk.now_s, FLOODER)
    for pause_s in (0.0, 10.0, 0.0):
        desk.now_s += pause_s
        steps.clear()
        flood = [(desk.now_s, OPERATOR_LINK, b"\xfe" * 1472, FLOODER)] * 512
        desk.companion.take_in(flood, desk.now_s)
        most.append(len(steps))
        desk.step()
    assert max(most[0], most[2]) <= BUDGET_BYTES < most[1] <= RATE_BYTES_PS * LONGEST_S


@pytest.mark.parametrize("packets_ps", [412, 824])
@pytest.mark.parametrize("stall_s", [0.05, 0.1, 0.25, 0.5])
def test_an_order_behind_a_routers_telemetry_is_carried_out_after_a_stall(packets_ps, stall_s):
    """The router forwards the autopilot's telemetry; the operator's order comes last."""
    desk = hovering()
    desk.companion.take_in([], desk.now_s)
    desk.now_s += stall_s
    telemetry = Peer(255, 190).ground_heartbeat()
    arrived = [(desk.now_s, OPERATOR_LINK, telemetry, STATION)] * int(packets_ps * stall_s)
    order = desk.operator.command(USER_1, HOLD)
    desk.companion.take_in([*arrived, (desk.now_s, OPERATOR_LINK, order, STATION)], desk.now_s)
    desk.run(0.2)
    assert [o["order"] for o in desk.decided("order")] == ["hold"]
    assert not desk.said("too many")


def test_a_strangers_datagram_ends_at_its_first_byte_that_is_no_packet(steps):
    desk = hovering()
    steps.clear()
    desk.companion.take_in([(desk.now_s, OPERATOR_LINK, b"\xfe" * 1472, FLOODER)], desk.now_s)
    assert len(steps) == 1


def test_a_ground_station_stops_the_aircraft_in_a_flood():
    desk = hovering()
    desk.run(1.0)
    command = desk.operator.command(USER_1, HOLD)
    flood = [(desk.now_s, OPERATOR_LINK, b"\xfe" * 1472, FLOODER)] * 512
    desk.companion.take_in([*flood, (desk.now_s, OPERATOR_LINK, command, STATION)], desk.now_s)
    desk.run(0.2)
    assert [o["order"] for o in desk.decided("order")] == ["hold"]
