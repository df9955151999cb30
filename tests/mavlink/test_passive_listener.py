"""Telemetry of a passive listener, from the packets of all senders."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.commands import CommandResult, MissionCommand, PauseContinue
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from moar_companion.mavlink.passive_listener import AnswerReceived, PassiveListener, TextReceived
from moar_companion.mavlink.statustext import ReceivedText
from moar_companion.types import PX4

from .messages import message_of
from .peer import Peer

INSPECTION = (31010, 1.0, -1.0)


class Scene:
    """A passive listener and its senders; the autopilot is received from the start."""

    def __init__(self, system_id=1, **heartbeat):
        self.listener = PassiveListener()
        self.autopilot = Peer(system_id, 1)
        self.companion = Peer(system_id, 195)
        self.ground = Peer(255, 190)
        self.now_s = 0.0
        self.found = self.handle(self.autopilot.heartbeat(**heartbeat))

    def handle(self, packet):
        self.now_s += 0.1
        return self.listener.handle(packet, self.now_s)


def text(content, *, severity=6, number=0, chunk=0):
    return message_of("STATUSTEXT", severity=severity, text=content, id=number, chunk_seq=chunk)


def test_the_first_autopilot_is_latched_for_any_system_id():
    scene = Scene(system_id=42)
    (found,) = scene.found
    assert isinstance(found, AutopilotFound)
    assert (found.autopilot.system_id, found.autopilot.kind) == (42, PX4)
    assert scene.listener.vehicle_type == "quadrotor"
    (other,) = scene.handle(Peer(7, 1).heartbeat())
    assert isinstance(other, AutopilotConflict)
    assert scene.handle(Peer(7, 1).attitude(1.0)) == []
    assert scene.listener.telemetry.attitude is None


def test_telemetry_is_unknown_without_a_heartbeat():
    listener = PassiveListener()
    assert listener.handle(Peer(1, 1).attitude(1.0), 0.0) == []
    assert listener.telemetry.attitude is None
    assert listener.autopilot is None
    assert listener.sources[1, 1].received == 1


def test_sources_of_telemetry_are_counted():
    scene = Scene()
    for boot_s in (1.0, 1.1, 1.2):
        scene.handle(scene.autopilot.attitude(boot_s))
    scene.handle(scene.ground.ground_heartbeat())
    inputs = scene.listener.inputs
    assert (inputs["attitude"].messages, inputs["attitude"].last_s) == (3, pytest.approx(0.4))
    assert inputs["autopilot"].messages == inputs["ground_station"].messages == 1
    assert (inputs["gps"].messages, inputs["gps"].last_s) == (0, None)


def test_lost_packets_are_counted_at_a_tick():
    scene = Scene()
    scene.autopilot.skip(3)
    scene.handle(scene.autopilot.attitude(1.0))
    scene.listener.tick(1.0)
    link = scene.listener.telemetry.link
    assert (link.packets_received, link.packets_lost) == (2, 3)


def test_a_clock_that_goes_back_is_a_restart():
    scene = Scene()
    scene.handle(scene.autopilot.attitude(100.0))
    for boot_s in (1.0, 1.1, 1.2):
        assert scene.handle(scene.autopilot.attitude(boot_s)) == []
    scene.now_s += 0.05
    (restarted,) = scene.handle(scene.autopilot.attitude(1.35))
    assert isinstance(restarted, AutopilotRestarted)


def test_texts_of_autopilot_and_companion_are_received_whole():
    scene = Scene()
    assert scene.handle(scene.autopilot.pack(text(b"Arming\tmotors\x1b"))) == [
        TextReceived(ours=False, text=ReceivedText(severity="info", text="Arming motors"))
    ]
    parts = b"a" * 50, b"b" * 50, b"c\x00"
    for chunk, part in enumerate(parts[:2]):
        message = text(part, severity=4, number=9, chunk=chunk)
        assert scene.handle(scene.companion.pack(message)) == []
    end = scene.companion.pack(text(parts[2], severity=4, number=9, chunk=2))
    whole = ReceivedText(severity="warning", text="a" * 50 + "b" * 50 + "c")
    assert scene.handle(end) == [TextReceived(ours=True, text=whole)]
    assert scene.handle(scene.ground.pack(text(b"a ground station's"))) == []


def test_a_text_whose_end_is_lost_ends_at_the_next_text():
    scene = Scene()
    scene.handle(scene.autopilot.pack(text(b"a" * 50, number=1)))
    texts = scene.handle(scene.autopilot.pack(text(b"next")))
    assert [item.text.text for item in texts] == ["a" * 50, "next"]


def test_commands_to_the_companion_and_its_answers_are_received():
    scene = Scene()
    (order,) = scene.handle(scene.ground.command(*INSPECTION))
    assert isinstance(order, MissionCommand)
    assert (order.sender.system_id, order.index) == (255, None)
    assert scene.handle(scene.ground.command(*INSPECTION, confirmation=1)) == []
    (pause,) = scene.handle(scene.ground.command(193, 0.0, target=(1, 0)))
    assert isinstance(pause, PauseContinue)
    (answer,) = scene.handle(scene.companion.acknowledge(31010, 4, target=(255, 190)))
    assert answer == AnswerReceived(command=31010, result=CommandResult.FAILED)


def test_commands_and_answers_of_others_are_ignored():
    scene = Scene()
    assert scene.handle(scene.ground.command(400, 1.0, target=(1, 1))) == []
    assert scene.handle(scene.ground.command(*INSPECTION, target=(1, 1))) == []
    assert scene.handle(scene.ground.command(*INSPECTION, target=(9, 195))) == []
    assert scene.handle(scene.autopilot.acknowledge(31010, 3)) == []
    assert scene.handle(scene.companion.acknowledge(31010, 99)) == []


@pytest.mark.parametrize(
    ("vehicle", "word", "leans"),
    [
        (mavlink.MAV_TYPE_HEXAROTOR, "hexarotor", True),
        (mavlink.MAV_TYPE_FIXED_WING, "fixed wing", False),
        (mavlink.MAV_TYPE_SUBMARINE, "submarine", False),
        (200, "type 200", False),
    ],
)
def test_only_a_hovering_vehicle_leans_against_the_wind(vehicle, word, leans):
    scene = Scene(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, vehicle=vehicle)
    assert (scene.listener.vehicle_type, scene.listener.leans) == (word, leans)


def test_a_companion_under_the_autopilots_ids_does_not_change_the_vehicle():
    scene = Scene()
    scene.handle(
        scene.autopilot.heartbeat(
            autopilot=mavlink.MAV_AUTOPILOT_INVALID, vehicle=mavlink.MAV_TYPE_ONBOARD_CONTROLLER
        )
    )
    assert scene.listener.vehicle_type == "quadrotor"


def test_a_radio_of_another_system_is_received():
    scene = Scene()
    for name in ("RADIO_STATUS", "RADIO"):
        fields = {"rssi": 200, "remrssi": 190, "txbuf": 90, "noise": 50, "remnoise": 60}
        message = create(name, **fields, rxerrors=0, fixed=0)
        scene.handle(Peer(51, 68).pack(message, mavlink1=True))
        assert scene.listener.telemetry.radio.rssi == 200
    assert scene.listener.inputs["radio"].messages == 2
