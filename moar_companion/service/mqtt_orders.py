"""Orders over MQTT, between the client's thread, which checks them, and the control loop.

The loop receives them as packets of a link, judged as those of a ground station; answers are
published. Both directions are bounded: a flood of orders is refused in the thread.
"""

from __future__ import annotations

import logging
import time
from collections import deque

from ..mavlink.commands import CommandResult
from ..mavlink.link_basics import clock_s
from ..mavlink.rate_limits import RateLimit
from .mqtt.orders import OrderChecks
from .mqtt.payloads import OrderPayload, Reply
from .mqtt.topics import ORDER, REPLY, Message, topic_name
from .order_queue import OrderQueue

_MOST_REPLIES = 64
_MOST_GIVEN = 64
"""Number of the latest orders whose repeats get the same answer."""

_logger = logging.getLogger(__name__)


class MqttOrders:
    """The orders of one vehicle. queue: the link on which its control loop has them."""

    def __init__(self, vehicle: str, checks: OrderChecks, component_id: int) -> None:
        self.topic = topic_name(vehicle, ORDER)
        self._reply_topic = topic_name(vehicle, REPLY)
        self._checks = checks
        self.queue = OrderQueue(component_id)
        self._given: dict[bytes, str] = {}
        """Nonces of the latest orders taken, by payload."""
        self._answers: dict[str, Reply] = {}
        """Their last replies, by nonce."""
        self._replies: deque[Reply] = deque(maxlen=_MOST_REPLIES)
        self._unpublished: deque[Message] = deque(maxlen=_MOST_REPLIES)
        self._refusals = RateLimit(burst=10, rate_hz=1.0)
        self._reported: set[str] = set()

    # The client's thread

    def receive(self, payload: bytes, *, retained: bool) -> None:
        """Takes a message of the order topic. One that is delivered again gets the same answer."""
        if payload in self._given:
            self._answer_again(self._given[payload])
            return
        found = self._checks.check(payload, time.time(), retained=retained)
        if not isinstance(found, OrderPayload):
            self._refuse(found.nonce, found.reason)
            return
        self._given[payload] = found.nonce
        while len(self._given) > _MOST_GIVEN:
            self._answers.pop(self._given.pop(next(iter(self._given))), None)
        if not self.queue.give(found.nonce, found.mission, found.target):
            reason = "too many orders at once"
            self._answer(found.nonce, CommandResult.TEMPORARILY_REJECTED, reason)

    def replies(self) -> list[Message]:
        """Replies to be published; the same ones again until `published` is called."""
        while self._replies:
            payload = self._replies.popleft().model_dump_json().encode()
            self._unpublished.append(
                Message(topic=self._reply_topic, payload=payload, qos=1, retain=False)
            )
        return list(self._unpublished)

    def published(self) -> None:
        """Removes the replies that the last call of `replies` returned."""
        self._unpublished.clear()

    def _answer_again(self, nonce: str) -> None:
        """Repeats the last reply to an order; one without a reply yet gets its own later."""
        reply = self._answers.get(nonce)
        if reply is not None and self._refusals.allows(None, clock_s()):
            self._replies.append(reply)

    def _refuse(self, nonce: str | None, reason: str) -> None:
        """Replies to a refused order, but not to a flood of them."""
        if not self._refusals.allows(None, clock_s()):
            return
        self._reply(nonce, CommandResult.DENIED, reason)
        level = (
            logging.DEBUG
            if reason in self._reported or len(self._reported) > 10
            else logging.WARNING
        )
        self._reported.add(reason)
        _logger.log(level, "MQTT: an order was refused: %s", reason)

    # The control loop

    def answer(self) -> None:
        """Replies to the orders that the packets of this cycle answer."""
        for answer in self.queue.answers():
            self._answer(answer.order_id, answer.result, answer.reason)

    def _answer(self, nonce: str, result: CommandResult, reason: str) -> None:
        """Replies to an order that was taken; keeps the reply for its repeats."""
        self._answers[nonce] = self._reply(nonce, result, reason)

    def _reply(self, nonce: str | None, result: CommandResult, reason: str) -> Reply:
        final = result is not CommandResult.IN_PROGRESS
        reply = Reply.model_validate(
            {
                "time_s": time.time(),
                "nonce": nonce,
                "result": result.name,
                "final": final,
                "reason": reason,
            }
        )
        self._replies.append(reply)
        return reply
