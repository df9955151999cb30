"""Publications of the service over MQTT, from the status of its last cycles.

The control loop stores a status and returns at once. The client's thread makes messages of the
newest status when the broker takes them. Statuses in between are never sent.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
import time
from collections.abc import Callable, Sequence
from typing import Any

from ..mavlink.link_basics import clock_s
from ..settings.config import CompanionConfig
from .mqtt.orders import OrderChecks
from .mqtt.payloads import Online
from .mqtt.topics import Message, Publication, Status, online_message
from .mqtt_client import MqttClient
from .mqtt_orders import MqttOrders
from .mqtt_settings import SettingNames, read_broker, read_order_key

_PERIOD_S = 0.5
"""Period of statuses: that of the topic with the highest rate."""
_PROGRAM = "moar-companion"

_logger = logging.getLogger(__name__)


def open_publisher(config: CompanionConfig) -> MqttPublisher | None:
    """Returns the publisher of the configuration, connecting; None if it names no broker.

    Raises InputError for a certificate, key or password that cannot be used.
    """
    broker = read_broker(config.mqtt, SettingNames(source=str(config.file), section="mqtt."))
    if broker is None or config.mqtt.vehicle is None:
        return None
    vehicle = config.mqtt.vehicle
    key = read_order_key(config.mqtt, str(config.file))
    orders = None
    if key is not None:
        checks = OrderChecks(vehicle, key, config.mqtt.commands.window_s, time.time())
        orders = MqttOrders(vehicle, checks, config.component_id)
    traffic = _Traffic(vehicle, orders)
    client = MqttClient(broker, traffic, identifier=f"moar-{vehicle}")
    return MqttPublisher(traffic, client, orders)


class MqttPublisher:
    """The control loop's side: `publish_due` in each cycle."""

    def __init__(self, traffic: _Traffic, client: MqttClient, orders: MqttOrders | None) -> None:
        self.orders = orders
        """The link of orders; None if none are taken."""
        self._traffic = traffic
        self._client = client
        self._due_s = 0.0
        self._failed = False

    def publish_due(self, now_s: float, status_now: Callable[[], dict[str, Any]]) -> None:
        """Stores answers, and a status when one is due and there is a connection."""
        if self.orders is not None:
            self.orders.answer()
        if now_s < self._due_s or not self._client.connected or self._failed:
            return
        self._due_s = now_s + _PERIOD_S
        try:
            self._traffic.status = status_now()
        except Exception as error:  # noqa: BLE001 - a fault of MQTT must not end a flight
            self._failed = True
            _logger.error("MQTT ended: %s: %s", type(error).__name__, error)  # noqa: TRY400

    def close(self) -> None:
        """Publishes the last answers, and that the companion is offline; waits a limited time."""
        if self.orders is not None:
            self.orders.answer()
        self._client.close()


class _Traffic:
    """The thread's side. status: set by the control loop, the newest alone counts."""

    def __init__(self, vehicle: str, orders: MqttOrders | None) -> None:
        self.subscriptions: Sequence[tuple[str, int]] = (
            () if orders is None else ((orders.topic, 1),)
        )
        self._orders = orders
        self._vehicle = vehicle
        self._publication = Publication(vehicle)
        self._taken: Status | None = None
        self._reported: set[str] = set()
        self.status: Status | None = None
        self.will: Message | None = online_message(vehicle, Online(online=False))

    def connected(self) -> Sequence[Message]:
        """The birth message of MQTT; all topics are due again, with the next status."""
        self._publication.start_anew()
        self.status = self._taken = None
        version = None
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            version = importlib.metadata.version(_PROGRAM)
        birth = Online(online=True, since_s=time.time(), version=version)
        return [online_message(self._vehicle, birth)]

    def outgoing(self) -> Sequence[Message]:
        """Replies to orders, and messages of the newest status."""
        replies = [] if self._orders is None else self._orders.replies()
        status = self.status
        if status is None or status is self._taken:
            return replies
        self._taken = status
        messages = self._publication.due(status, clock_s())
        for topic in self._publication.unfit.keys() - self._reported:
            _logger.error("MQTT: %s not published: %s", topic, self._publication.unfit[topic])
            self._reported.add(topic)
        return [*replies, *messages]

    def published(self) -> None:
        """Removes the replies that are sent; after a failure they are sent again."""
        if self._orders is not None:
            self._orders.published()

    def received(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Takes an order."""
        if self._orders is not None and topic == self._orders.topic:
            self._orders.receive(payload, retained=retained)

    def last_messages(self) -> Sequence[Message]:
        """Last replies, and a message equal to the last will.

        A broker does not send the will after a disconnection.
        """
        replies = [] if self._orders is None else self._orders.replies()
        return [*replies, online_message(self._vehicle, Online(online=False, since_s=time.time()))]
