"""Flights on signed links: the same flight as without signing; unsigned packets have no effect."""

from __future__ import annotations

import json

import pytest

from moar_companion.companion.status import LatestDecisions
from moar_companion.mavlink.signing import SigningRefusal
from sitl.wire import packets
from tests.thorough import sampled

from ..flights.lockstep import COMPANION_LINK, hovering
from ..flights.operator import EXIT, INSPECTION, RELEASE, Manner
from ..mavlink.peer import Peer
from ..mavlink.signed import OTHER_SECRET, SECRET, SignedPeer, found_in


@pytest.mark.slow
@pytest.mark.parametrize("manner", sampled([Manner.ARDUPILOT], list(Manner)))
def test_an_inspection_is_flown_on_signed_links_and_no_output_contains_the_key(manner):
    flight = hovering(manner=manner, secret=SECRET)
    flight.begin(INSPECTION, 0)
    flight.run_until_state("at_target", 120.0)
    flight.operator.mission(EXIT)
    flight.run_until_state("holding", 120.0)
    companion = flight.companion
    assert not any(companion.signing.packets_refused[COMPANION_LINK].values())
    assert all(data[2] == 1 for _, data in flight.to_autopilot)
    received = [packet for _, packet in companion.received_packets()]
    assert received
    latest = LatestDecisions()
    latest.note(flight.decisions, companion.telemetry.link)
    status = latest.status_of(companion, flight.now_s, clock_offset_s=0.0, recorder=None)
    texts = [
        *received,
        *(data for _, data in flight.to_autopilot),
        repr(flight.config).encode(),
        repr(flight.decisions).encode(),
        json.dumps([decision.data for decision in flight.decisions]).encode(),
        json.dumps(status).encode(),
    ]
    assert found_in(b"\n".join(texts)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stranger", "reason"),
    [
        (Peer(255, 190), SigningRefusal.UNSIGNED),
        (SignedPeer(255, 190, secret=OTHER_SECRET), SigningRefusal.WRONG),
    ],
    ids=["unsigned", "another key"],
)
def test_a_stranger_can_neither_command_nor_pose_as_the_autopilot(stranger, reason):
    flight = hovering(secret=SECRET)
    flight.begin(INSPECTION, 0)
    received = len(flight.operator.received)
    telemetry = flight.companion.telemetry.autopilot
    flight.handle(stranger.command(31010, RELEASE))
    flight.handle(stranger.command(31010, 0))
    stranger._packer.srcSystem = stranger._packer.srcComponent = 1
    flight.handle(stranger.heartbeat(custom_mode=4 << 16 | 3 << 24))
    assert flight.companion.telemetry.autopilot == telemetry
    flight.run(1.0)
    assert flight.state == "flying"
    assert flight.companion.signing.packets_refused[COMPANION_LINK][reason] == 3
    texts = [m.text for m in flight.operator.received[received:] if m.get_type() == "STATUSTEXT"]
    assert texts.count(f"MOAR: 3 packets refused: {reason.value}") == 1
    assert not [m for m in flight.operator.received[received:] if m.get_type() == "COMMAND_ACK"]


@pytest.mark.slow
def test_a_replayed_order_has_no_effect():
    flight = hovering(secret=SECRET)
    recorded = []
    handle = flight.handle

    def listen(data):
        recorded.append(data)
        handle(data)

    flight.handle = listen
    flight.begin(INSPECTION, 0)
    flight.operator.mission(RELEASE)
    flight.run_until_state("released", 2.0)
    flight.handle = handle
    flight.run(40.0)
    for data in recorded:
        flight.handle(data)
    refused = flight.companion.signing.packets_refused[COMPANION_LINK]
    assert refused[SigningRefusal.OLD] == sum(len(list(packets(data))) for data in recorded)
    flight.run(2.0)
    assert flight.state == "released"


def test_an_autopilot_that_does_not_sign_is_not_received_on_a_signed_link():
    flight = hovering(secret=SECRET)
    companion = flight.new_companion()
    companion.tick(0.0)
    autopilot = Peer(1, 1)
    for second in range(3):
        companion.receive(COMPANION_LINK, autopilot.heartbeat(), float(second))
        companion.tick(float(second))
    assert companion.telemetry.autopilot is None
    texts = [item.data["text"] for item in companion.decisions() if item.kind == "text"]
    assert texts == ["MOAR: 2 packets refused: unsigned"]
    sent = [data for _, data in companion.data_to_send()]
    assert sent
    assert all(data[2] == 1 for data in sent)
