from __future__ import annotations

import math

import pytest

from moar_companion.mavlink import dialect
from moar_companion.mavlink.codec import Codec, checksum
from moar_companion.mavlink.dialect import create, mavlink

EXTENSIONS = {
    ("TIMESYNC", "target_system"),
    ("TIMESYNC", "target_component"),
    ("MISSION_COUNT", "mission_type"),
    ("MISSION_COUNT", "opaque_id"),
}


@pytest.mark.parametrize("definition", dialect._DEFINITIONS, ids=lambda d: d.name)
def test_the_check_byte_of_each_message_follows_from_its_name_and_fields(definition):
    text = f"{definition.name} ".encode()
    for type_name, name, length in definition.fields:
        if (definition.name, name) not in EXTENSIONS:
            text += f"{type_name} {name} ".encode() + (bytes([length]) if length else b"")
    value = checksum(text)
    assert value & 0xFF ^ value >> 8 == definition.crc_extra


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("LINK_NODE_STATUS", 36),
        ("MISSION_COUNT", 9),
        ("COMMAND_CANCEL", 4),
        ("TIMESYNC", 18),
        ("ESC_STATUS", 57),
        ("PROTOCOL_VERSION", 22),
        ("COMPONENT_INFORMATION", 212),
        ("COMPONENT_METADATA", 108),
        ("EVENT", 53),
        ("CURRENT_EVENT_SEQUENCE", 3),
        ("REQUEST_EVENT", 6),
        ("RESPONSE_EVENT_ERROR", 7),
        ("AVAILABLE_MODES", 46),
        ("CURRENT_MODE", 9),
    ],
)
def test_each_message_is_in_the_map_with_its_size_on_the_wire(name, size):
    (message_class,) = [c for c in mavlink.mavlink_map.values() if c.msgname == name]
    assert message_class.unpacker.size == size


def test_a_message_of_pymavlink_is_not_replaced():
    assert mavlink.mavlink_map[436] is mavlink.MAVLink_current_mode_message


def test_an_added_message_is_encoded_and_decoded_unchanged():
    message = create(
        "ESC_STATUS",
        time_usec=123456789,
        rpm=[1000, -2, 3, 4],
        voltage=[15.5, 0.0, 0.0, 16.25],
        current=[1.0, 2.0, 3.0, 4.0],
        index=4,
    )
    codec = Codec(system_id=1, component_id=1)
    (received,) = codec.receive(codec.encode(message))
    assert received.get_type() == "ESC_STATUS"
    assert received.rpm == [1000, -2, 3, 4]
    assert received.voltage == [15.5, 0.0, 0.0, 16.25]
    assert received.index == 4
    assert str(received).startswith("ESC_STATUS {time_usec : 123456789")


def test_a_text_field_ends_at_its_first_nul():
    message = create("COMPONENT_METADATA", time_boot_ms=1, file_crc=2, uri=b"mftp:/x\x00junk")
    assert message.uri == "mftp:/x"


def test_a_message_with_a_field_too_few_is_refused():
    with pytest.raises(TypeError, match="REQUEST_EVENT has the fields first_sequence"):
        create("REQUEST_EVENT", first_sequence=1)


@pytest.mark.recordings
def test_px4s_own_messages_are_read_with_plausible_values(recording):
    codec = Codec(system_id=9, component_id=9)
    messages = [
        message
        for _, packet in recording("px4/a1_boot_offboard_takeoff.companion.tlog")
        for message in codec.receive(packet)
    ]
    by_type = {message.get_type(): message for message in messages}
    status = by_type["LINK_NODE_STATUS"]
    assert 10_000 < status.tx_rate < 30_000
    assert status.messages_lost == 0
    modes = {m.custom_mode for m in messages if m.get_type() == "CURRENT_MODE"}
    assert 0x00060000 in modes
    events = [m for m in messages if m.get_type() == "EVENT"]
    assert len(events) == 31
    assert events[0].id == 0x01125BEF
    assert [m.sequence for m in events[:4]] == [65526, 65527, 65528, 65529]
    requests = [m for m in messages if m.get_type() == "TIMESYNC"]
    assert {m.target_system for m in requests} == {0}


@pytest.mark.recordings
def test_px4_v118_reports_its_motor_outputs(recording):
    codec = Codec(system_id=9, component_id=9, wanted={291})
    messages = [
        message
        for _, packet in recording("px4/c1_wind_v118.companion.tlog")
        for message in codec.receive(packet)
    ]
    assert len(messages) == 654
    assert all(math.isfinite(value) for m in messages for value in (*m.voltage, *m.current))
    assert {m.index for m in messages} == {0}
