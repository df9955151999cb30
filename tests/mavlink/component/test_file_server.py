"""The FTP server: replies as the protocol has them, and never the wrong file."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.component.file_server import FileServer, file_crc32
from tests.thorough import sampled

from .ftp_client import (
    ACK,
    BURST,
    CRC32,
    LIST,
    NAK,
    NONE,
    OPEN,
    READ,
    RESET,
    TERMINATE,
    Client,
    asker,
    request,
)

FILES = {
    "general.json.xz": bytes(range(200)),
    "parameter.json.xz": bytes(number * 7 % 256 for number in range(1000)),
}
SIZE, SESSION, SESSIONS, EOF, UNKNOWN, PROTECTED, MISSING = 3, 4, 5, 6, 7, 9, 10


@pytest.fixture
def client():
    return Client(FileServer(FILES))


def test_a_file_is_opened_read_in_one_burst_and_closed(client):
    opened = client.open()
    assert (opened.session, opened.data) == (0, struct.pack("<I", 1000))
    packets = client.ask(BURST, size=239)
    assert [packet.sequence for packet in packets] == [3, 4, 5, 6, 7]
    assert [packet.offset for packet in packets] == [0, 239, 478, 717, 956]
    assert [packet.burst_complete for packet in packets] == [0, 0, 0, 0, 1]
    assert b"".join(packet.data for packet in packets) == FILES["parameter.json.xz"]
    assert client.one(BURST, size=239, offset=1000).error == EOF
    assert client.one(TERMINATE).opcode == ACK
    assert client.one(READ, size=10).error == SESSION


def test_a_read_gives_the_bytes_asked_for_and_fewer_at_the_end(client):
    client.open()
    assert client.one(READ, size=80, offset=500).data == FILES["parameter.json.xz"][500:580]
    assert client.one(READ, size=80, offset=990).data == FILES["parameter.json.xz"][990:]
    assert client.one(READ, size=80, offset=1000).error == EOF
    assert client.one(READ, size=80, offset=2**32 - 1).error == EOF


@pytest.mark.parametrize(("most_bytes", "size"), [(100, 80), (115, 80), (150, 110), (280, 239)])
def test_a_slow_link_gets_pieces_of_its_size_but_not_less_than_pymavlink_asks_for(
    client, most_bytes, size
):
    client.most_bytes = most_bytes
    client.open()
    assert client.one(READ, size=239).size == size
    packets = client.ask(BURST, size=239)
    assert {packet.size for packet in packets[:-1]} == {size}
    assert b"".join(packet.data for packet in packets) == FILES["parameter.json.xz"]


def test_reads_that_wait_for_room_are_eight_at_most(client):
    client.open()
    for number in range(20):
        message = request(3 + 2 * number, READ, size=10, offset=number)
        assert client.server.handle(message, client.asker, client.now_s) == []
    assert [packet.offset for packet in client.rest()] == list(range(8))


def test_the_list_has_all_files_with_their_sizes_and_then_ends(client):
    entries = client.one(LIST, data=b"/")
    assert entries.data == b"Fgeneral.json.xz\t200\0Fparameter.json.xz\t1000\0"
    assert client.one(LIST, data=b"/", offset=1).data == b"Fparameter.json.xz\t1000\0"
    assert client.one(LIST, data=b"/", offset=2).error == EOF
    assert client.one(LIST, data=b"/etc").error == MISSING


def test_a_list_that_is_too_long_for_a_packet_goes_on_at_the_next_entry():
    names = [f"file number {number}.json.xz" for number in range(20)]
    client = Client(FileServer(dict.fromkeys(names, b"")))
    listed = []
    while (entries := client.one(LIST, data=b"/", offset=len(listed))).opcode == ACK:
        assert entries.size <= 239
        listed += [entry.split("\t")[0][1:] for entry in entries.data.decode().split("\0")[:-1]]
    assert listed == sorted(names)


@pytest.mark.parametrize(
    "path", [b"general.json.xz", b"/general.json.xz", b"//general.json.xz", b"/general.json.xz\0"]
)
def test_a_path_is_found_as_each_ground_station_writes_it(client, path):
    assert client.open(path).data == struct.pack("<I", 200)


@pytest.mark.parametrize(
    "path", [b"", b"/", b"/etc/passwd", b"../general.json.xz", b"general.json", b"\xff\xfe"]
)
def test_nothing_but_the_files_is_opened(client, path):
    assert client.open(path).error == MISSING
    assert client.one(CRC32, data=path).error == MISSING
    assert client.one(READ, size=10).error == SESSION


@pytest.mark.parametrize("opcode", range(6, 14))
def test_nothing_is_written(client, opcode):
    assert client.one(opcode, data=b"/general.json.xz").error == PROTECTED


@pytest.mark.parametrize("opcode", [16, 127, 130, 255])
def test_an_unknown_request_is_refused_so_that_clients_ask_otherwise(client, opcode):
    assert client.one(opcode).error == UNKNOWN


def test_too_large_a_size_is_refused(client):
    client.open()
    assert client.one(READ, size=240).error == SIZE


def test_a_reply_is_never_answered_nor_a_request_to_all_components(client):
    assert client.ask(ACK) == client.ask(NAK) == []
    assert client.ask(RESET, target=(1, 0)) == client.ask(OPEN, target=(0, 195)) == []
    assert client.one(NONE).opcode == ACK


def bitwise_crc32(data):
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


@given(st.binary(max_size=300))
def test_the_checksum_is_that_of_mavlink(data):
    assert file_crc32(data) == bitwise_crc32(data)


def test_the_checksum_of_a_file_is_given(client):
    crc = client.one(CRC32, data=b"/general.json.xz").data
    assert struct.unpack("<I", crc) == (bitwise_crc32(FILES["general.json.xz"]),)


# Requests that are repeated, doubled or late


def test_a_repeated_request_gets_the_same_reply(client):
    opened = client.open()
    assert client.open(sequence=1) == opened
    read = client.one(READ, size=80, offset=7)
    assert client.one(READ, size=80, offset=7, sequence=2) == read
    ended = client.one(TERMINATE)
    assert client.one(TERMINATE, sequence=3) == ended


def test_a_late_copy_of_an_open_request_does_not_bring_the_file_before_back(client):
    client.open(b"/general.json.xz")
    client.open(b"/parameter.json.xz")
    assert client.ask(OPEN, data=b"/general.json.xz", sequence=1) == []
    assert client.one(READ, size=10, offset=300).data == FILES["parameter.json.xz"][300:310]


def test_a_copy_of_an_open_request_does_not_open_the_closed_file_again(client):
    opened = client.open()
    assert client.one(TERMINATE).opcode == ACK
    client.now_s += 0.2
    assert client.open(sequence=1) == opened
    assert client.one(READ, size=10, sequence=9).error == SESSION
    client.now_s += 0.2  # a client that has started again, with the same numbers
    assert client.open(sequence=1) == opened
    assert client.one(READ, size=10).data == FILES["parameter.json.xz"][:10]


@pytest.mark.parametrize("opcode", [TERMINATE, RESET])
def test_a_late_copy_of_an_end_does_not_close_the_next_file(client, opcode):
    client.open(b"/general.json.xz")
    client.one(opcode)
    client.open(b"/parameter.json.xz")
    assert client.one(opcode, sequence=2).opcode == ACK
    assert client.one(READ, size=10).data == FILES["parameter.json.xz"][:10]


def test_an_end_that_the_next_open_request_has_overtaken_does_not_close_that_file(client):
    client.open(b"/general.json.xz")
    client.open(b"/parameter.json.xz", sequence=3)
    assert client.one(TERMINATE, sequence=2).opcode == ACK
    assert client.one(READ, size=10, sequence=4).data == FILES["parameter.json.xz"][:10]
    client.now_s += 2.1  # no packet is so late: the numbers are those of a new client
    assert client.one(TERMINATE, sequence=2).opcode == ACK
    assert client.one(READ, size=10, sequence=5).error == SESSION


def test_a_client_that_ended_with_a_file_open_reads_another_two_seconds_after(client):
    client.open(b"/general.json.xz", sequence=40)
    client.one(RESET, sequence=0)
    assert client.open(b"/general.json.xz", sequence=1).opcode == ACK
    assert client.ask(OPEN, data=b"/parameter.json.xz", sequence=2) == []
    client.now_s += 2.1
    client.open(b"/parameter.json.xz", sequence=2)
    assert client.one(READ, size=10, sequence=3).data == FILES["parameter.json.xz"][:10]


def test_a_client_that_starts_again_with_the_same_numbers_gets_its_file(client):
    for _ in range(3):
        client.sequence = 0
        client.one(RESET)
        assert client.open().error is None
        assert client.one(READ, size=10).data == FILES["parameter.json.xz"][:10]
        client.one(TERMINATE)


def test_a_doubled_burst_request_does_not_begin_the_burst_again(client):
    client.open()
    message = request(2, BURST, size=239)
    for _ in range(2):
        assert client.server.handle(message, client.asker, client.now_s) == []
        client.now_s += 0.05
        client.server.next_answer(client.asker.sender.link, 280, client.now_s)
    assert [packet.offset for packet in client.rest()] == [478, 717, 956]


def test_a_burst_is_asked_for_again_with_the_same_number_from_where_it_ended(client):
    client.open()
    client.ask(BURST, size=80, sequence=2)
    again = client.ask(BURST, size=80, sequence=2, offset=800)
    assert [(packet.sequence, packet.offset) for packet in again] == [(3, 800), (4, 880), (5, 960)]


def test_the_numbers_of_a_burst_begin_again_after_the_last(client):
    client.open()
    packets = client.ask(BURST, size=239, sequence=0xFFFE)
    assert [packet.sequence for packet in packets] == [0xFFFF, 0, 1, 2, 3]


# Several ground stations


def test_two_ground_stations_read_two_files_at_once_and_close_their_own(client):
    other = Client(client.server, asker(component_id=191))
    client.open(b"/general.json.xz")
    other.open(b"/parameter.json.xz")
    other.one(RESET)
    assert client.one(READ, size=10).data == FILES["general.json.xz"][:10]
    assert other.one(READ, size=10).error == SESSION


def test_bursts_of_two_ground_stations_take_turns(client):
    first, other = client, Client(client.server, asker(component_id=191))
    for each in (first, other):
        each.open()
    for each in (first, other):
        each.server.handle(request(2, BURST, size=239), each.asker, each.now_s)
    turns = [
        client.server.next_answer(client.asker.sender.link, 280, client.now_s).target_component
        for _ in range(6)
    ]
    assert turns == [190, 191] * 3


def test_a_burst_goes_to_the_link_of_its_ground_station_alone(client):
    client.open()
    client.server.handle(request(2, BURST, size=239), client.asker, client.now_s)
    assert client.server.next_answer("serial:/dev/ttyTHS1:57600", 115, client.now_s) is None
    assert len(client.rest()) == 5


def test_a_ground_station_reads_several_files_in_sessions_of_its_own_numbers(client):
    opened = [client.open(f"/{name}".encode(), session=100 + at) for at, name in enumerate(FILES)]
    assert [reply.session for reply in opened] == [100, 101]
    for at, file in enumerate(FILES.values()):
        read = client.one(READ, size=10, offset=5, session=100 + at)
        assert (read.session, read.data) == (100 + at, file[5:15])
    client.one(TERMINATE, session=100)
    assert client.one(READ, size=10, session=100).error == SESSION
    assert client.one(READ, size=10, session=101).error is None
    assert client.one(RESET, session=7).opcode == ACK
    assert client.one(READ, size=10, session=101).error == SESSION


def test_a_ground_station_has_five_files_open_at_most_and_may_close_one(client):
    assert [client.open(session=number).error for number in range(6)] == [None] * 5 + [SESSIONS]
    client.one(TERMINATE, session=2)
    assert client.open(session=9).error is None


def test_sixteen_files_are_open_at_most_and_a_silent_ground_station_makes_room(client):
    others = [Client(client.server, asker(component_id=number)) for number in range(16)]
    assert {other.open().error for other in others} == {None}
    assert client.open().error == SESSIONS
    others[0].one(TERMINATE)
    assert client.open().error is None
    late = Client(client.server, asker(component_id=99), now_s=131.0)
    assert late.open().error is None
    assert Client(client.server, asker(component_id=1), now_s=131.0).one(READ).error == SESSION


def test_a_file_is_closed_after_thirty_seconds_without_a_request(client):
    client.open()
    client.now_s += 30.0
    assert client.one(READ, size=10).size == 10
    client.now_s += 30.1
    assert client.one(READ, size=10).error == SESSION


# Any input

PAYLOADS = st.builds(
    request,
    st.integers(0, 6),
    st.one_of(st.sampled_from(range(17)), st.integers(0, 255)),
    session=st.sampled_from([0, 0, 0, 1, 2, 3, 4, 5, 255]),
    size=st.integers(0, 255),
    offset=st.sampled_from([0, 0, 1, 199, 200, 999, 1000, 2**32 - 1]),
    data=st.one_of(
        st.sampled_from([b"", b"/", *(f"/{name}".encode() for name in FILES)]),
        st.binary(max_size=239),
    ),
)


@settings(max_examples=sampled(100, 3000))
@given(st.lists(st.tuples(PAYLOADS, st.integers(0, 20), st.floats(0.0, 20.0)), max_size=30))
def test_any_requests_get_one_reply_each_and_data_only_of_the_files(requests):
    server, now_s = FileServer(FILES), 0.0
    for message, component_id, step_s in requests:
        now_s += step_s
        client = Client(server, asker(component_id=component_id), now_s)
        replies = server.handle(message, client.asker, now_s)
        assert len(replies) <= 1
        for packet in client.rest():
            assert packet.opcode == ACK
            assert any(file[packet.offset :].startswith(packet.data) for file in FILES.values())
    assert len(server._sessions) <= 16
