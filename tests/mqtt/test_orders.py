"""Signed orders: which are taken, and what becomes of them in the companion."""

import json
import math
import secrets

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.commands import ORDERS, CommandResult
from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.order_link import OrderLink
from moar_companion.service import mqtt_orders
from moar_companion.service.mqtt.orders import OrderChecks, RefusedOrder, signed_order
from moar_companion.service.mqtt.payloads import OrderPayload
from moar_companion.service.mqtt_orders import MqttOrders
from moar_companion.settings.config import Commands
from moar_companion.settings.mqtt_config import ORDER_LINK, Mqtt, MqttCommands

from ..companion.desk import ACCEPTED, IN_PROGRESS, USER_1, Desk
from ..companion.scripted_autopilot import AUTO_RTL

KEY, OTHER_KEY = b"k" * 32, b"o" * 32
START_S = 1.8e9
WINDOW_S = 10.0


def order(nonce="0123456789abcdef", *, mission="inspection", target=None, time_s=START_S + 5.0):
    return OrderPayload(mission=mission, target=target, time_s=time_s, nonce=nonce)


def checks(vehicle="a1"):
    return OrderChecks(vehicle, KEY, WINDOW_S, START_S)


def test_the_words_of_an_order_are_those_of_the_commands():
    schema = OrderPayload.model_json_schema()["properties"]["mission"]
    assert set(schema["enum"]) == set(ORDERS)


def refused(checked):
    assert isinstance(checked, RefusedOrder)
    return checked.reason


def test_an_order_that_is_signed_fresh_and_new_is_taken():
    given = order(target=1)
    assert checks().check(signed_order(given, "a1", KEY), START_S + 6.0) == given


@pytest.mark.parametrize(
    ("vehicle", "key"), [("a1", OTHER_KEY), ("a2", KEY)], ids=["another key", "another vehicle"]
)
def test_a_signature_of_another_key_or_for_another_vehicle_is_wrong(vehicle, key):
    answer = checks().check(signed_order(order(), vehicle, key), START_S + 6.0)
    assert answer == RefusedOrder(reason="wrong signature")


def test_any_change_of_a_signed_order_makes_its_signature_wrong():
    envelope = json.loads(signed_order(order(), "a1", KEY))
    text = envelope["order"]
    for place in range(len(text)):
        changed = text[:place] + chr(ord(text[place]) ^ 1) + text[place + 1 :]
        payload = json.dumps(envelope | {"order": changed}).encode()
        assert refused(checks().check(payload, START_S + 6.0)) == "wrong signature"


def test_an_order_is_taken_once():
    taking, payload = checks(), signed_order(order(), "a1", KEY)
    assert isinstance(taking.check(payload, START_S + 6.0), OrderPayload)
    for later_s in (6.0, 8.0, 14.9):
        assert refused(taking.check(payload, START_S + later_s)) == "given before"
    assert "ago" in refused(taking.check(payload, START_S + 15.1))


@pytest.mark.parametrize(
    ("given_s", "now_s", "reason"),
    [
        (100.0, 110.5, "given 10 s ago (limit 10 s)"),
        (100.0, 89.0, "given 11 s ahead of this clock"),
        (-1.0, 2.0, "given before the companion's start"),
    ],
)
def test_an_order_out_of_the_window_or_of_before_the_start_is_refused(given_s, now_s, reason):
    payload = signed_order(order(time_s=START_S + given_s), "a1", KEY)
    assert refused(checks().check(payload, START_S + now_s)) == reason


def test_a_clock_that_is_set_back_makes_no_old_order_fresh():
    taking, payload = checks(), signed_order(order(), "a1", KEY)
    taking.check(payload, START_S + 6.0)
    for number in range(3):
        later = order(f"{number:016d}", time_s=START_S + 3600.0)
        assert taking.check(signed_order(later, "a1", KEY), START_S + 3600.0) == later
    assert "ago" in refused(taking.check(payload, START_S + 6.0))


def test_orders_are_taken_again_when_a_clock_that_was_ahead_is_set_right():
    taking, wrong_s = checks(), START_S + 3600.0
    assert "ago" in refused(taking.check(signed_order(order(), "a1", KEY), wrong_s))
    later = order("1" * 16, time_s=START_S + 8.0)
    assert taking.check(signed_order(later, "a1", KEY), START_S + 8.5) == later


def test_a_hold_of_a_clock_that_is_behind_is_taken_after_an_order_of_one_that_is_ahead():
    taking, now_s = checks(), START_S + 100.0
    ahead = order("1" * 16, time_s=now_s + WINDOW_S)
    behind = order("2" * 16, mission="hold", time_s=now_s - WINDOW_S)
    assert taking.check(signed_order(ahead, "a1", KEY), now_s) == ahead
    assert taking.check(signed_order(behind, "a1", KEY), now_s) == behind


def test_no_order_that_is_not_stored_any_more_is_taken_again():
    taking = checks()
    for number in range(100):
        time_s = START_S + 1.0 + number
        payload = signed_order(order(f"{number:016d}", time_s=time_s), "a1", KEY)
        assert isinstance(taking.check(payload, time_s), OrderPayload)
        for earlier in range(number + 1):
            given_s = START_S + 1.0 + earlier
            again = signed_order(order(f"{earlier:016d}", time_s=given_s), "a1", KEY)
            assert isinstance(taking.check(again, given_s), RefusedOrder)
    assert len(taking._taken) < 25


ALL_ORDERS = ("inspection", "exit", "evacuation", "hold", "release", "pause", "continue")


def arrival(taking, word, given_s, key=KEY):
    """The answer to a new order of a time after the start, which arrives 9 s after the start."""
    given = order(secrets.token_urlsafe(16), mission=word, time_s=START_S + given_s)
    return taking.check(signed_order(given, "a1", key), START_S + 9.0)


@pytest.mark.parametrize("newer", ALL_ORDERS)
@pytest.mark.parametrize("delayed", ["inspection", "exit", "evacuation", "continue"])
def test_a_delayed_order_that_moves_the_aircraft_is_refused_after_a_newer_order(delayed, newer):
    taking = checks()
    assert isinstance(arrival(taking, newer, 5.0), OrderPayload)
    assert refused(arrival(taking, delayed, 4.9)) == "given before the newest order"
    assert isinstance(arrival(taking, delayed, 5.0), OrderPayload)


@pytest.mark.parametrize("newer", ALL_ORDERS)
@pytest.mark.parametrize("delayed", ["hold", "pause", "release"])
def test_a_delayed_order_that_moves_nothing_is_taken_after_a_newer_order(delayed, newer):
    taking = checks()
    assert isinstance(arrival(taking, newer, 5.0), OrderPayload)
    assert isinstance(arrival(taking, delayed, 1.0), OrderPayload)


def test_the_newest_order_is_neither_the_last_arrival_nor_one_that_was_refused():
    taking = checks()
    arrival(taking, "hold", 5.0)
    arrival(taking, "pause", 1.0)
    refused(arrival(taking, "hold", 8.0, OTHER_KEY))
    assert refused(arrival(taking, "exit", 3.0)) == "given before the newest order"
    assert isinstance(arrival(taking, "exit", 6.0), OrderPayload)


def test_an_order_that_the_broker_kept_is_refused():
    answer = checks().check(signed_order(order(), "a1", KEY), START_S + 6.0, retained=True)
    assert refused(answer) == "is retained by the broker"


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        ({"mission": "land"}, "mission: "),
        ({"target": -1}, "target: "),
        ({"target": 1.5}, "target: "),
        ({"time_s": "now"}, "time_s: "),
        ({"nonce": "short"}, "nonce: "),
        ({"speed": 3}, "speed: "),
    ],
)
def test_a_signed_payload_that_is_no_order_is_refused_with_the_field(change, reported):
    content = json.loads(order().model_dump_json()) | change
    assert refused(checks().check(signed_text(json.dumps(content)), START_S + 6.0)).startswith(
        reported
    )


def signed_text(text):
    """A signed text, whatever it is."""

    class Text:
        def model_dump_json(self):
            return text

    return signed_order(Text(), "a1", KEY)


@pytest.mark.uncounted
@given(st.binary(max_size=300) | st.text(max_size=100).map(signed_text))
def test_no_payload_raises(payload):
    refused(checks().check(payload, START_S))


def test_a_payload_with_half_a_character_does_not_raise():
    payload = b'{"order": "\\ud800", "signature": "\\ud800"}'
    assert refused(checks().check(payload, START_S)) == "wrong signature"


# In the companion


def taking_orders(**config):
    settings = Mqtt(url="mqtt://a", vehicle="a1", commands=MqttCommands(accept=True))
    return Desk(mqtt=settings, **config)


def give(desk, link, nonce, word, index=None):
    return desk.handle(link.packet(nonce, word, index), ORDER_LINK)


def answers(desk, link):
    """The answers on the order's link since the last call, as (order, result, reason)."""
    packets = [bytes(message.get_msgbuf()) for _, url, message in desk.sent if url == ORDER_LINK]
    desk.sent.clear()
    return [(item.order_id, item.result.name, item.reason) for item in link.answers(packets)]


def test_an_mqtt_order_is_flown_and_answered_like_an_order_of_a_ground_station():
    desk, link = taking_orders().run(2.0), OrderLink(195)
    give(desk, link, "first", "inspection").run_until("ready")
    assert answers(desk, link) == [("first", "ACCEPTED", "")]
    desk.run(1.1).send_heartbeat(desk.ours).run_until("flying", 0.1)
    give(desk, link, "second", "pause").run_until("holding", 1.0)
    assert answers(desk, link) == [("second", "ACCEPTED", "")]
    give(desk, link, "third", "continue").run_until("flying", 2.0)
    assert answers(desk, link)[-1] == ("third", "ACCEPTED", "")


def test_a_denied_order_is_answered_with_the_reason():
    desk, link = taking_orders().run(2.0), OrderLink(195)
    give(desk, link, "far", "inspection", 99).run(0.2)
    ((nonce, result, reason),) = answers(desk, link)
    assert (nonce, result) == ("far", "DENIED")
    assert reason.startswith("MOAR: no target 99")


@pytest.mark.parametrize("words", [("hold", "continue"), ("continue", "hold")])
def test_answers_of_one_cycle_have_each_its_own_reason(words):
    desk, link = taking_orders().run(2.0), OrderLink(195)
    for word in words:
        give(desk, link, word, word)
    desk.run(0.1)
    assert {nonce: reason for nonce, _, reason in answers(desk, link)} == {
        "hold": "MOAR: nothing is flown, rejected",
        "continue": "MOAR: nothing is held, rejected",
    }


def test_two_refusals_for_the_same_reason_have_it_both():
    desk, link = taking_orders(), OrderLink(195)
    desk.landed_state = 4
    desk.mode = AUTO_RTL
    desk.run(2.0)
    for word in ("exit", "evacuation"):
        give(desk, link, word, word).run(0.1)
        assert answers(desk, link) == [(word, "TEMPORARILY_REJECTED", "MOAR: landing, rejected")]


def test_the_rules_for_mavlink_senders_do_not_block_orders_signed_with_the_key():
    rules = Commands(systems=(42,), components=(7,), links=("udp:a",), signed_only=True)
    desk, link = taking_orders(commands=rules).run(2.0), OrderLink(195)
    give(desk, link, "signed", "inspection").run_until("ready")
    assert answers(desk, link) == [("signed", "ACCEPTED", "")]


def test_an_order_that_another_overtakes_is_cancelled():
    desk, link = taking_orders(plan_delay_s=None).run(2.0), OrderLink(195)
    give(desk, link, "first", "inspection").run(0.5)
    assert answers(desk, link) == [("first", "IN_PROGRESS", "")]
    give(desk, link, "second", "hold").run(0.5)
    reported = {nonce: result for nonce, result, _ in answers(desk, link)}
    assert reported == {"first": "CANCELLED", "second": "ACCEPTED"}


def test_by_default_there_is_no_link_for_orders():
    desk = Desk()
    assert ORDER_LINK not in {link for _, link, _ in desk.run(2.0).sent}
    assert not Mqtt(url="mqtt://a", vehicle="a1").takes_orders


# Between the threads


@pytest.fixture
def waiting(monkeypatch):
    now_s = START_S + 6.0
    monkeypatch.setattr(mqtt_orders.time, "time", lambda: now_s)
    monkeypatch.setattr(mqtt_orders, "clock_s", lambda: 0.0)
    return MqttOrders("a1", checks(), 195)


def acknowledgement(command, result):
    """A packet of the companion that answers an order."""
    ids = {"target_system": 255, "target_component": mavlink.MAV_COMP_ID_UDP_BRIDGE}
    message = create("COMMAND_ACK", command=command, result=result, **ids)
    return message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=195))


def replies(orders):
    return [json.loads(message.payload) for message in orders.replies()]


def test_a_doubled_order_gets_the_same_answer_and_is_given_once(waiting):
    """MQTT delivers with quality of service 1 at least once."""
    payload = signed_order(order(mission="hold"), "a1", KEY)
    waiting.receive(payload, retained=False)
    waiting.receive(payload, retained=False)
    assert (len(waiting.queue.take()), replies(waiting)) == (1, [])
    waiting.queue.send(acknowledgement(USER_1, ACCEPTED), 0.0, ())
    waiting.answer()
    (first,) = replies(waiting)
    assert (first["result"], first["final"]) == ("ACCEPTED", True)
    waiting.published()
    for retained in (False, True):
        waiting.receive(payload, retained=retained)
        assert replies(waiting) == [first]
        waiting.published()
    assert waiting.queue.take() == []


def test_a_doubled_order_that_is_not_decided_is_answered_by_its_decision(waiting):
    payload = signed_order(order(), "a1", KEY)
    waiting.receive(payload, retained=False)
    waiting.queue.take()
    waiting.queue.send(acknowledgement(USER_1, IN_PROGRESS), 0.0, ())
    waiting.answer()
    waiting.receive(payload, retained=False)
    assert {reply["result"] for reply in replies(waiting)} == {"IN_PROGRESS"}


def test_another_order_with_a_nonce_given_before_is_refused(waiting):
    waiting.receive(signed_order(order(), "a1", KEY), retained=False)
    waiting.receive(signed_order(order(mission="exit"), "a1", KEY), retained=False)
    assert [(reply["result"], reply["reason"]) for reply in replies(waiting)] == [
        ("DENIED", "given before")
    ]
    assert len(waiting.queue.take()) == 1


def test_more_orders_than_a_cycle_takes_are_rejected_for_now(waiting):
    for number in range(20):
        given = order(f"{number:016d}", mission="hold")
        waiting.receive(signed_order(given, "a1", KEY), retained=False)
    reported = replies(waiting)
    assert len(waiting.queue.take()) == 8
    assert [reply["nonce"] for reply in reported] == [f"{number:016d}" for number in range(8, 20)]
    assert {(reply["result"], reply["final"]) for reply in reported} == {
        ("TEMPORARILY_REJECTED", True)
    }


def test_replies_stay_until_they_are_published_and_the_newest_ones_beyond_a_limit(waiting):
    def refuse(number):
        waiting._reply(f"{number:016d}", CommandResult.DENIED, "no")

    refuse(0)
    assert len(replies(waiting)) == 1
    refuse(1)
    assert [reply["nonce"] for reply in replies(waiting)] == [f"{n:016d}" for n in (0, 1)]
    waiting.published()
    assert replies(waiting) == []
    for number in range(100):
        refuse(number)
        replies(waiting)
    assert [reply["nonce"] for reply in replies(waiting)] == [f"{n:016d}" for n in range(36, 100)]


def test_a_flood_of_wrong_orders_is_neither_answered_nor_logged_for_long(waiting, caplog):
    wrong = signed_order(order(), "a1", OTHER_KEY)
    for _ in range(1000):
        waiting.receive(wrong, retained=False)
    assert waiting.queue.take() == []
    assert len(replies(waiting)) == 10
    assert caplog.messages == ["MQTT: an order was refused: wrong signature"]


def test_no_payload_of_an_order_holds_a_number_that_is_not_finite():
    with pytest.raises(ValueError, match="finite"):
        order(time_s=math.nan)
