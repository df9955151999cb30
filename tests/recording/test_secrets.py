"""Recordings contain no received key, and all other data byte for byte."""

import random

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.service.recording.calls import Call
from moar_companion.service.recording.channels import Cycle
from moar_companion.service.recording.secrets import Blanking, blanked

KEY = bytes(range(1, 33))
CODEC = Codec(system_id=255, component_id=190)
SETUP = CODEC.encode(
    create(
        "SETUP_SIGNING",
        target_system=1,
        target_component=1,
        secret_key=list(KEY),
        initial_timestamp=77,
    )
)
AUTH = CODEC.encode(create("AUTH_KEY", key=b"A phrase that nobody may know"))
HEARTBEAT = CODEC.encode(
    create(
        "HEARTBEAT",
        type=6,
        autopilot=8,
        base_mode=0,
        custom_mode=0,
        system_status=4,
        mavlink_version=3,
    )
)


def cycles_of(portions, address=None):
    return [
        Cycle(now_s=0.02 * index, calls=[Call(method="take_in", arguments=(arrived, 0.02 * index))])
        for index, arrived in enumerate([[(0.0, "link", data, address)] for data in portions])
    ]


def bytes_of(cycles):
    return [arrived[2] for cycle in cycles for call in cycle.calls for arrived in call.arguments[0]]


@pytest.mark.parametrize("packet", [SETUP, AUTH], ids=["SETUP_SIGNING", "AUTH_KEY"])
def test_a_key_is_blanked_and_the_packet_still_counts(packet):
    blank, _ = blanked(HEARTBEAT + packet + HEARTBEAT, final=True)
    assert KEY[:4] not in blank
    assert b"phrase" not in blank
    codec = Codec(system_id=1, component_id=1)
    assert len(codec.receive(blank)) == 3
    assert codec.dropped_bytes == 0
    assert blank.startswith(HEARTBEAT)
    assert blank.endswith(HEARTBEAT)


@pytest.mark.parametrize("size", [1, 3, 7, 50])
def test_a_key_in_pieces_waits_until_it_is_whole(size):
    stream = HEARTBEAT + SETUP + HEARTBEAT
    portions = [stream[at : at + size] for at in range(0, len(stream), size)]
    blanking, recorded = Blanking(), []
    middle = len(portions) // 2
    for part, last in ((portions[:middle], False), (portions[middle:], False), ([], True)):
        recorded += bytes_of(blanking.ready(cycles_of(part), last=last))
        assert all(byte not in b"".join(recorded) for byte in (KEY[:3], KEY[-3:]))
    assert [len(data) for data in recorded] == [len(data) for data in portions]
    whole, _ = blanked(stream, final=True)
    assert b"".join(recorded) == whole


def test_a_key_that_is_cut_short_is_blanked_as_far_as_it_goes():
    blanking = Blanking()
    assert blanking.ready(cycles_of([SETUP[:30]])) == []
    (data,) = bytes_of(blanking.ready(cycles_of([])))
    assert data[:10] == SETUP[:10]
    assert not any(data[10:])


def test_a_damaged_packet_with_a_key_is_blanked_too():
    damaged = SETUP[:-1] + bytes([SETUP[-1] ^ 1])
    blank, _ = blanked(damaged, final=True)
    assert KEY[:4] not in blank


def test_datagrams_never_wait():
    recorded = Blanking().ready(cycles_of([HEARTBEAT + b"\xfd"], ("10.0.0.1", 1)))
    assert bytes_of(recorded) == [HEARTBEAT + b"\xfd"]


def test_the_head_of_a_packet_with_a_key_in_a_sound_packet_is_no_key():
    look_alike = SETUP[:40]
    inside = CODEC.encode(
        create(
            "FILE_TRANSFER_PROTOCOL",
            target_network=0,
            target_system=1,
            target_component=1,
            payload=list(look_alike.ljust(251, b"\x07")),
        )
    )
    assert blanked(inside, final=True)[0] == inside


def test_noise_is_recorded_as_it_is():
    noise = random.Random(1).randbytes(50_000)
    assert blanked(noise, final=True)[0] == noise
