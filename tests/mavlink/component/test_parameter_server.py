"""Parameters of the component: requests, values in both encodings, refusals, copies of packets."""

from __future__ import annotations

import random
import struct
from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import Sender
from moar_companion.mavlink.component.component_service import Asker
from moar_companion.mavlink.component.parameter_server import (
    ParameterRefused,
    ParameterServer,
    ParameterSet,
)
from moar_companion.mavlink.component.services import ComponentServices
from moar_companion.mavlink.dialect import create
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.flight_parameters import FlightParameters, flight_parameters
from moar_companion.settings.link_config import LinkRole
from moar_companion.settings.vehicle import VehicleFile

_X500 = shipped_configs() / "vehicles" / "x500.yaml"
PARAMETERS = FlightParameters.of(VehicleFile.load(_X500), CompanionConfig(vehicle=_X500))
NAMES = list(flight_parameters())
LINK, OTHER = "udp:127.0.0.1:14540", "udp:127.0.0.1:14550"
SENDER = Sender(link=LINK, system_id=255, component_id=190)
LINKS = dict.fromkeys((LINK, OTHER), LinkRole.AUTOPILOT)
REAL32, REAL64, INT32 = 9, 10, 6


class Station:
    """A ground station beside the server, whose packets keep their numbers."""

    def __init__(self, kind="px4", objection=None, sender=SENDER, links=LINKS):
        self.server = ParameterServer(PARAMETERS, links, lambda: kind)
        self.codec = Codec(system_id=sender.system_id, component_id=sender.component_id)
        self.asker = Asker(sender=sender, objection=objection, on_board=False)
        self.now_s = 0.0

    def packet(self, name, **fields):
        return self.codec.encode(create(name, target_system=1, **fields))

    def receive(self, packet, link=LINK):
        (message,) = Codec(system_id=1, component_id=195).receive(packet)
        ids = {"system_id": message.get_srcSystem(), "component_id": message.get_srcComponent()}
        asker = replace(self.asker, sender=Sender(link=link, **ids))
        return self.server.handle(message, asker, self.now_s)

    def ask(self, name, target_component=195, **fields):
        return self.receive(self.packet(name, target_component=target_component, **fields))

    def due(self, link=LINK):
        """Answers on a link until none is due, one cycle after the other."""
        answers = []
        while (message := self.server.next_answer(link, 280, self.now_s)) is not None:
            answers.append(message)
            self.now_s += 0.02
        self.now_s += 0.02
        return answers

    def set_packet(self, name, value, kind=REAL32):
        return self.packet(
            "PARAM_SET",
            target_component=195,
            param_id=name.encode(),
            param_value=value,
            param_type=kind,
        )

    def set(self, name, value, kind=REAL32):
        assert self.receive(self.set_packet(name, value, kind)) == []
        return self.due()

    def set_extended(self, name, packed, kind=REAL32):
        value = packed.ljust(128, b"\0")
        self.ask("PARAM_EXT_SET", param_id=name.encode(), param_value=value, param_type=kind)
        return self.due()


def bytewise(integer):
    return struct.unpack("<f", struct.pack("<i", integer))[0]


@pytest.mark.parametrize("component", [195, 0])
def test_a_list_has_each_parameter_once_in_order(component):
    station = Station()
    assert station.ask("PARAM_REQUEST_LIST", component) == []
    values = station.due()
    assert [value.param_id for value in values] == NAMES
    assert [value.param_index for value in values] == list(range(len(NAMES)))
    assert {value.param_count for value in values} == {len(NAMES)}


def test_a_list_that_is_requested_again_meanwhile_is_sent_whole_once_more():
    station = Station()
    station.ask("PARAM_REQUEST_LIST")
    first = [station.server.next_answer(LINK, 280, 0.0).param_id for _ in range(10)]
    station.ask("PARAM_REQUEST_LIST")
    assert [value.param_id for value in station.due()] == [*NAMES[10:], *first]


def test_a_parameter_is_read_by_name_and_by_index():
    station = Station()
    (by_name,) = station.ask("PARAM_REQUEST_READ", param_id=b"SAFE_D_MAX", param_index=-1)
    (by_index,) = station.ask(
        "PARAM_REQUEST_READ", param_id=b"", param_index=NAMES.index("SAFE_D_MAX")
    )
    for value in (by_name, by_index):
        assert (value.param_id, value.param_value, value.param_type) == ("SAFE_D_MAX", 3.0, REAL32)


@pytest.mark.parametrize(("name", "index"), [(b"NO_SUCH", -1), (b"", 9999), (b"", -2)])
def test_what_does_not_exist_gets_an_error(name, index):
    (error,) = Station().ask("PARAM_REQUEST_READ", param_id=name, param_index=index)
    assert error.get_type() == "PARAM_ERROR"
    assert (error.target_system, error.target_component, error.error) == (255, 190, 1)
    assert (error.param_id, error.param_index) == (name.decode(), index)


def test_of_all_components_only_a_list_is_answered():
    station = Station()
    read = {"param_id": b"NO_SUCH", "param_index": -1}
    assert station.ask("PARAM_REQUEST_READ", target_component=0, **read) == []
    fields = {"param_id": b"SAFE_D_MIN", "param_value": 2.0, "param_type": REAL32}
    station.ask("PARAM_SET", target_component=0, **fields)
    assert station.due() == []
    assert station.server.parameters is PARAMETERS


def test_a_value_is_set_once_and_reported_on_every_link():
    station = Station()
    (value,) = station.set("SAFE_D_MIN", 1.5)
    assert (value.param_id, value.param_value) == ("SAFE_D_MIN", 1.5)
    assert station.server.events_received() == [
        ParameterSet(name="SAFE_D_MIN", value=1.5, before=1.2, sender=SENDER)
    ]
    assert [each.param_value for each in station.due(OTHER)] == [1.5]


@pytest.mark.parametrize(("kind", "sent"), [("px4", bytewise(1)), ("ardupilot", 1.0), (None, 1.0)])
def test_integers_are_encoded_as_the_autopilot_does(kind, sent):
    station = Station(kind)
    (value,) = station.set("ADAPTATION", sent, INT32)
    assert (value.param_value, value.param_type) == (sent, INT32)
    assert station.server.parameters.changed == {"ADAPTATION": 1.0}


def test_a_number_as_a_real_sets_an_integer_in_both_encodings():
    for kind in ("px4", "ardupilot"):
        station = Station(kind)
        station.set("ADAPTATION", 1.0, REAL32)
        assert station.server.parameters.changed == {"ADAPTATION": 1.0}


@pytest.mark.parametrize(
    ("name", "value"),
    [("SAFE_D_MIN", 3.5), ("LIM_WIND", float("nan")), ("LIM_WIND", float("inf"))],
)
def test_a_wrong_value_gets_an_error_and_the_value_that_stays(name, value):
    station = Station()
    error, stays = station.set(name, value)
    assert (error.get_type(), error.param_id, error.error) == ("PARAM_ERROR", name, 2)
    assert stays.param_value == pytest.approx(PARAMETERS.value(name))
    (event,) = station.server.events_received()
    assert isinstance(event, ParameterRefused)
    assert name in event.reason
    assert station.server.parameters is PARAMETERS


def test_a_sender_that_may_not_command_reads_but_sets_nothing():
    station = Station(objection="system 42 may not command")
    assert len(station.ask("PARAM_REQUEST_READ", param_id=b"SAFE_D_MIN", param_index=-1)) == 1
    error, stays = station.set("SAFE_D_MIN", 1.5)
    assert error.error == 3
    assert stays.param_value == pytest.approx(1.2)
    assert station.server.parameters is PARAMETERS


def test_refusals_without_end_have_few_texts():
    station = Station()
    for _ in range(50):
        assert len(station.set("SAFE_D_MIN", 99.0)) == 2
    assert len(station.server.events_received()) <= 6


def test_a_copy_and_an_overtaken_packet_set_nothing():
    station = Station()
    packets = [station.set_packet("SAFE_D_MIN", value) for value in (1.3, 1.4)]
    for packet in (packets[1], packets[0], packets[1]):
        station.receive(packet)
    station.due()
    assert [event.value for event in station.server.events_received()] == [1.4]


@pytest.mark.parametrize("link", [LINK, OTHER])
def test_a_copy_after_another_senders_value_or_over_another_link_sets_nothing(link):
    station, second = Station(), Station(sender=replace(SENDER, component_id=191))
    first = station.set_packet("SAFE_D_MIN", 1.3)
    station.receive(first)
    station.receive(first, OTHER)
    station.due(OTHER)
    station.due()
    station.receive(second.set_packet("SAFE_D_MIN", 1.4))
    station.due()
    station.receive(first, link)
    station.due(link)
    assert [event.value for event in station.server.events_received()] == [1.3, 1.4]


def test_packets_of_any_number_of_senders_take_bounded_memory():
    station = Station()
    for number in range(1_100):
        sender = replace(SENDER, system_id=1 + number % 250, component_id=1 + number // 250)
        station.codec = Codec(system_id=sender.system_id, component_id=sender.component_id)
        station.set("LIM_WIND", 5.0 + number % 2)
    assert len(station.server.events_received()) == 1_100
    assert len(station.server._last) <= 1_000


def test_a_value_that_is_sent_again_is_answered_and_is_no_second_setting():
    station = Station()
    assert [len(station.set("SAFE_D_MIN", 1.3)) for _ in range(3)] == [1, 1, 1]
    assert len(station.server.events_received()) == 1


def test_of_many_values_at_once_one_is_set_in_a_cycle():
    station = Station()
    for value in range(10):
        station.receive(station.set_packet("LIM_WIND", 5.0 + value))
    for set_so_far in range(10):
        while station.server.next_answer(LINK, 280, station.now_s) is not None:
            pass
        station.now_s += 0.02
        assert len(station.server.events_received()) == 1, set_so_far
    assert station.server.parameters.value("LIM_WIND") == 14.0


def test_the_extended_protocol_lists_reads_and_sets_the_same_values():
    station = Station()
    station.ask("PARAM_EXT_REQUEST_LIST")
    assert [value.param_id for value in station.due()] == NAMES
    acknowledged, changed = station.set_extended("SAFE_D_MIN", struct.pack("<f", 1.5))
    assert (acknowledged.get_type(), acknowledged.param_result) == ("PARAM_EXT_ACK", 0)
    for each in (changed, *station.due(OTHER)):
        assert (each.get_type(), each.param_value) == ("PARAM_VALUE", 1.5)
    (value,) = station.ask("PARAM_EXT_REQUEST_READ", param_id=b"SAFE_D_MIN", param_index=-1)
    packet = Codec(system_id=1, component_id=195).encode(value)
    assert struct.pack("<f", 1.5) in packet
    station.set_extended("ADAPTATION", struct.pack("<i", 1), INT32)
    assert station.server.parameters.value("ADAPTATION") == 1.0
    (acknowledged,) = station.set_extended("SAFE_D_MIN", struct.pack("<d", 99.0), REAL64)
    assert acknowledged.param_result == 1
    assert station.server.parameters.value("SAFE_D_MIN") == 1.5


@given(
    st.sampled_from(NAMES) | st.text(max_size=16),
    st.binary(min_size=8) | st.floats().map(lambda value: struct.pack("<d", value)),
    st.integers(0, 255) | st.sampled_from((REAL32, REAL64)),
)
@example("LIM_WIND", b"\xff\xff\x7f\x7f", REAL32)
@example("LIM_WIND", b"\xff\xff\x7f\xff", REAL32)
@example("LIM_WIND", b"\x00\x00\xc0\xff", REAL32)
@example("LIM_WIND", struct.pack("<d", 46.37611578667585), REAL64)
def test_any_value_of_any_type_is_set_or_changes_nothing(name, packed, kind):
    station = Station()
    real = struct.unpack("<f", packed[:4])[0]
    encoded = name.encode()[:16]
    station.ask("PARAM_SET", param_id=encoded, param_value=real, param_type=kind)
    fields = {"param_value": packed[:128].ljust(128, b"\0"), "param_type": kind}
    station.ask("PARAM_EXT_SET", param_id=encoded, **fields)
    station.due()
    for event in station.server.events_received():
        if isinstance(event, ParameterSet):
            assert station.server.parameters.value(event.name) is not None
            station.server.parameters.apply(CompanionConfig(vehicle=_X500))


def test_on_a_bad_link_a_list_is_complete_and_each_value_set_once():
    """30 % of the packets are lost, 30 % come twice, all up to 0.3 s late and out of order."""
    chance = random.Random(3)
    station = Station()
    services = ComponentServices(dict.fromkeys((LINK, OTHER), LinkRole.OPERATOR), 195)
    services._services = services._paced = (station.server,)
    known, wanted, set_events = {}, dict.fromkeys(NAMES), []
    under_way = []

    def send(to_server, packet, now_s):
        for _ in range(1 + (chance.random() < 0.3)):
            if chance.random() >= 0.3:
                under_way.append(
                    (now_s + chance.uniform(0.0, 0.3), len(under_way), to_server, packet)
                )

    targets = {"target_component": 195}
    send(True, station.packet("PARAM_REQUEST_LIST", **targets), 0.0)
    ours = Codec(system_id=1, component_id=195)
    decoder = Codec(system_id=1, component_id=195)
    for cycle in range(50 * 120):
        now_s = cycle * 0.02
        due = sorted(item for item in under_way if item[0] <= now_s)
        under_way = [item for item in under_way if item[0] > now_s]
        for _, _, to_server, packet in due:
            (message,) = decoder.receive(packet)
            if to_server:
                services.receive(
                    message, station.asker, ours=(1, 195), is_autopilots=False, now_s=now_s
                )
            elif message.get_type() == "PARAM_VALUE":
                known[message.param_id] = message.param_value
        for link, message in services.due(now_s):
            if link == LINK:
                send(False, ours.encode(message), now_s)
        set_events += station.server.events_received()
        if cycle % 50 == 25:  # once a second what is missing is requested, and one value set
            for name in list(wanted)[:20]:
                if name not in known:
                    read = {"param_id": name.encode(), "param_index": -1}
                    send(True, station.packet("PARAM_REQUEST_READ", **targets, **read), now_s)
                else:
                    del wanted[name]
            if known.get("LIM_WIND") != 9.0:
                send(True, station.set_packet("LIM_WIND", 9.0), now_s)
    assert sorted(known) == sorted(NAMES)
    assert [(event.name, event.value) for event in set_events] == [("LIM_WIND", 9.0)]
    assert known["LIM_WIND"] == 9.0


@pytest.mark.parametrize(
    ("baud", "role", "fastest_hz"),
    [
        (57600, LinkRole.AUTOPILOT, 55),
        (38400, LinkRole.AUTOPILOT, 50),  # of the file: it may be set again, or lowered
        (9600, LinkRole.OPERATOR, 100),
        (921600, LinkRole.AUTOPILOT, 100),
    ],
)
def test_setpoints_are_set_no_faster_than_the_line_to_the_autopilot_carries(baud, role, fastest_hz):
    station = Station(links=LINKS | {f"serial:/dev/ttyTHS1:{baud}": role})
    for rate_hz in range(50, 102):
        station.set("SETPOINT_RATE", rate_hz)
    assert station.server.parameters.value("SETPOINT_RATE") == fastest_hz


def test_a_rate_that_the_line_does_not_carry_is_told_with_what_it_carries():
    station = Station(links=LINKS | {"serial:/dev/ttyTHS1:57600": LinkRole.AUTOPILOT})
    error, stays = station.set("SETPOINT_RATE", 100.0)
    assert (error.get_type(), error.error, stays.param_value) == ("PARAM_ERROR", 2, 50.0)
    (event,) = station.server.events_received()
    assert event.reason == "SETPOINT_RATE is 100, the line carries 55"
