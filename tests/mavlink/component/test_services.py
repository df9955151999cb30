"""The hook of the services: order, room and limits of answers."""

from __future__ import annotations

from moar_companion.mavlink.commands import Sender
from moar_companion.mavlink.component.component_service import Asker
from moar_companion.mavlink.component.services import ComponentServices
from moar_companion.mavlink.dialect import create
from moar_companion.settings.link_config import LinkRole

OURS, LINK = (1, 195), "serial:/dev/ttyTHS1:57600"
SENDER = Sender(link=LINK, system_id=255, component_id=190)
ASKER = Asker(sender=SENDER, objection=None, on_board=False)


class Echo:
    """A service that answers each request once, and sends a list of so many."""

    MESSAGE_IDS = frozenset({20})

    def __init__(self, listed=0):
        self.handled, self.left = [], listed

    def handle(self, message, _asker, _now_s):
        self.handled.append(message)
        return [create("PARAM_VALUE", **VALUE)]

    def next_answer(self, _link, _most_bytes, _now_s):
        self.left -= 1
        return create("PARAM_VALUE", **VALUE | {"param_index": 7}) if self.left >= 0 else None


VALUE = {"param_id": b"A", "param_value": 1.0, "param_type": 9, "param_count": 1, "param_index": 0}


def services_with(*services):
    made = ComponentServices({LINK: LinkRole.AUTOPILOT}, component_id=195)
    made._services = made._paced = services
    return made


def asked(services, now_s=0.0, target=OURS):
    read = {"param_id": b"A", "param_index": -1}
    message = create(
        "PARAM_REQUEST_READ", target_system=target[0], target_component=target[1], **read
    )
    return services.receive(message, ASKER, ours=OURS, is_autopilots=False, now_s=now_s)


def sent(services, duration_s):
    cycles = [services.due(cycle * 0.02) for cycle in range(round(duration_s / 0.02))]
    assert max(map(len, cycles)) <= 1  # never two behind which a setpoint would wait
    return [message for due in cycles for _, message in due]


def test_answers_keep_within_the_budget_of_a_slow_line():
    assert 22 <= len(sent(services_with(Echo(listed=1000)), 1.0)) <= 30


def test_a_short_answer_and_a_list_take_turns():
    services = services_with(Echo(listed=1000))
    asked(services)
    asked(services)
    assert [message.param_index for message in sent(services, 0.5)][:5] == [0, 7, 0, 7, 7]


def test_two_lists_take_turns():
    first, second = Echo(listed=100), Echo(listed=100)
    sent(services_with(first, second), 2.0)
    assert abs(first.left - second.left) <= 1


def test_a_flood_of_requests_gets_no_more_answers_than_wait():
    echo = Echo()
    services = services_with(echo)
    for _ in range(10_000):
        asked(services)
    assert len(echo.handled) == 64


def test_a_request_to_another_component_is_none_of_ours():
    echo = Echo()
    for target in ((1, 1), (2, 195), (1, 195), (0, 0)):
        asked(services_with(echo), target=target)
    assert [(m.target_system, m.target_component) for m in echo.handled] == [(1, 195), (0, 0)]
