"""Unauthorised senders and floods of commands, with the whole companion."""

from __future__ import annotations

import pytest

from moar_companion.settings.config import Commands

from ..mavlink.peer import Peer
from .commands import LINKS, OPERATOR_LINK, answers, carried_out, hovering, results
from .desk import (
    DENIED,
    HOLD,
    INSPECTION,
    LINK,
    PAUSE_CONTINUE,
    RELEASE,
    TEMPORARILY_REJECTED,
    USER_1,
    Desk,
)


def texts_on(desk, link):
    return [m.text for _, on, m in desk.sent if m.get_type() == "STATUSTEXT" and on == link]


@pytest.mark.parametrize("mission", [INSPECTION, RELEASE])
def test_a_stranger_is_denied_with_the_reason_on_its_own_link_alone(mission):
    desk, stranger = hovering(), Peer(42, 1)
    desk.handle(stranger.command(USER_1, mission, -1.0), OPERATOR_LINK).run(0.5)
    assert answers(desk) == [(OPERATOR_LINK, (42, 1), USER_1, DENIED)]
    assert texts_on(desk, OPERATOR_LINK)[-1] == "MOAR: system 42 may not command, denied"
    assert not any("denied" in text for text in texts_on(desk, LINK))
    assert carried_out(desk) == []
    assert desk.state == "idle"


@pytest.mark.parametrize("words", [(USER_1, HOLD), (PAUSE_CONTINUE, 0)])
def test_any_sender_can_stop_the_aircraft_in_flight_but_not_resume_the_flight(words):
    desk, stranger = Desk(commands=Commands(systems=(255,))).come_to("flying"), Peer(42, 1)
    desk.run(2.0).handle(stranger.command(*words)).run(1.0)
    assert desk.state == "holding"
    place = desk.position_ned_m
    desk.handle(stranger.command(PAUSE_CONTINUE, 1)).handle(stranger.command(USER_1, RELEASE)).run(
        2.0
    )
    assert (desk.state, results(desk)[-2:]) == ("holding", [DENIED, DENIED])
    assert desk.position_ned_m == pytest.approx(place)
    desk.go_on().run(0.5)
    assert desk.state == "flying"


@pytest.mark.slow
def test_a_strangers_hold_does_not_end_the_supervisors_escape_route():
    desk, stranger = Desk().come_to("flying"), Peer(42, 1)
    desk.run(2.0).set(battery_percent=12).run_until_requested("exit")
    desk.run(2.0)
    assert desk.companion.status.task.mission.value == "exit"
    desk.handle(stranger.command(USER_1, HOLD)).run(2.0)
    assert desk.companion.status.task.mission.value == "exit"
    assert desk.state == "flying"
    desk.order(HOLD).run(2.0)  # an operator who has received the text on the battery
    assert desk.state == "holding"


def test_an_order_that_the_site_denies_is_reported_on_its_senders_link_alone():
    desk = hovering()
    desk.handle(desk.operator.command(USER_1, INSPECTION, 99.0), OPERATOR_LINK).run(0.5)
    assert results(desk) == [DENIED]
    assert any("no target 99" in text for text in texts_on(desk, OPERATOR_LINK))
    assert not any("no target 99" in text for text in texts_on(desk, LINK))


def bytes_per_second(words=None, seconds=3.0):
    """Sent bytes per second on each link while an operator sends 200 commands a second."""
    desk, number = Desk(links=LINKS).run(3.0), 0
    counted = {LINK: 0, OPERATOR_LINK: 0}
    send = desk.companion.data_to_send

    def data_to_send():
        sent = send()
        for link, data in sent:
            counted[link] += len(data)
        return sent

    desk.companion.data_to_send = data_to_send
    for _ in range(round(seconds / 0.02)):
        for _ in range(4 if words else 0):
            number += 1
            desk.handle(desk.operator.command(*words(number)), OPERATOR_LINK)
        desk.step()
    return {link: count / seconds for link, count in counted.items()}


@pytest.mark.parametrize(
    "words",
    [
        lambda number: (USER_1, 9.0 + number % 2),
        lambda number: (USER_1, 5.0 + number),
        lambda number: (USER_1, INSPECTION, 100.0 + number),
    ],
    ids=["two bad missions in turn", "bad missions, all different", "targets that are not there"],
)
def test_two_hundred_bad_commands_a_second_cost_the_autopilots_link_nothing(words):
    flooded, usual = bytes_per_second(words), bytes_per_second()
    assert flooded[LINK] == usual[LINK]
    assert flooded[OPERATOR_LINK] < usual[OPERATOR_LINK] + 2500.0  # a burst first, then 700


@pytest.mark.parametrize("senders", [1, 4000])
def test_five_thousand_denials_in_a_cycle_are_answered_sixty_times_at_most(senders):
    desk = hovering()
    desk.sent.clear()
    desk.decisions.clear()
    peers = [Peer(240 + n % 16, 1 + n // 16 % 255) for n in range(senders)]
    for number in range(5000):
        peer = peers[number % len(peers)]
        desk.companion.receive(OPERATOR_LINK, peer.command(USER_1, 5.0 + number), desk.now_s)
    desk.step()
    assert len(results(desk)) == (20 if senders == 1 else 60)
    assert len(desk.decisions) < 100
    ledger, texts = desk.companion.state.session.commands, desk.companion.state.session._texts
    assert len(ledger._packets) <= 64
    assert len(ledger._answers._senders._left) <= 64
    assert len(texts._sent_s) <= 256


def test_a_flood_of_bad_commands_keeps_no_other_operator_from_stopping():
    desk, flooder = Desk(links=LINKS).come_to("flying"), Peer(254, 1)
    for number in range(1000):
        desk.companion.receive(
            OPERATOR_LINK, flooder.command(USER_1, INSPECTION, number), desk.now_s
        )
    desk.handle(desk.operator.command(USER_1, HOLD), OPERATOR_LINK).run(0.5)
    assert TEMPORARILY_REJECTED in results(desk)
    assert desk.state == "holding"


def requests_of_all_kinds(peer):
    """What a ground station may ask of the companion, again and again."""
    ours = {"target_system": 1, "target_component": 195}
    yield peer.ground_heartbeat()
    yield peer.send("PARAM_REQUEST_LIST", **ours)
    yield peer.send("PARAM_REQUEST_READ", **ours, param_id=b"SPEED", param_index=-1)
    yield peer.send("PARAM_EXT_REQUEST_LIST", **ours)
    yield peer.send("MISSION_REQUEST_LIST", **ours, mission_type=0)
    yield peer.send("PING", time_usec=1, seq=1, target_system=0, target_component=0)
    yield peer.send("TIMESYNC", tc1=0, ts1=1, **ours)
    yield peer.send(
        "FILE_TRANSFER_PROTOCOL", target_network=0, **ours, payload=[1, 0, 1, 3, *[0] * 247]
    )
    for message_id in (0, 148, 300, 397, 395, 242):
        yield peer.command(512, message_id)
        yield peer.command(511, message_id, 1000.0)
    yield peer.command(USER_1, INSPECTION, 99.0)


def test_a_flood_on_another_link_changes_no_setpoint_and_no_time_of_one():
    """Ten times all requests in each cycle, by a station that may command."""
    calm, flooded = (Desk(links=LINKS).come_to("flying", then_s=1.0) for _ in range(2))
    flooder = Peer(254, 1)
    for desk in (calm, flooded):
        desk.sent.clear()
        for _ in range(50):
            if desk is flooded:
                data = b"".join(requests_of_all_kinds(flooder))
                for _ in range(10):
                    desk.companion.receive(OPERATOR_LINK, data, desk.now_s)
            desk.step()
    setpoints = [
        [
            (time_s, message.get_msgbuf()[10:-2])
            for time_s, link, message in desk.sent
            if link == LINK and message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
        ]
        for desk in (calm, flooded)
    ]
    assert len(setpoints[0]) == 50
    assert setpoints[1] == setpoints[0]
