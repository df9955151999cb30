"""A connection to an MQTT broker, in a thread of its own that reconnects after each loss.

The only module with aiomqtt. The thread has its own event loop: a broker that is absent, slow or
hostile does not delay the control loop. Only replies to orders are queued. All other messages are
made when they can be sent, so that the newest is sent: at most one per topic at a time.
"""

from __future__ import annotations

import asyncio
import logging
import random
import re
import threading
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, Protocol

import aiomqtt

from ..mavlink.link_basics import clock_s
from .mqtt.topics import Message
from .mqtt_settings import Broker

_FIRST_S, _LONGEST_S = 1.0, 30.0
_STEADY_S = 30.0
"""Length of a connection after which the pauses begin again with the shortest."""


class Backoff:
    """Pauses between attempts: doubled each time, up to 30 s, each shortened at random."""

    def __init__(self) -> None:
        self._next_s = _FIRST_S

    def pause_s(self, random: float, connected_s: float) -> float:
        """Pause after an attempt.

        random: in [0, 1); the pause is between its half and the whole, so that a hundred vehicles
        do not return to a restarted broker at once. connected_s: length of the connection.
        """
        if connected_s >= _STEADY_S:
            self._next_s = _FIRST_S
        pause_s = self._next_s * (0.5 + 0.5 * random)
        self._next_s = min(_LONGEST_S, 2.0 * self._next_s)
        return pause_s


class ConnectionLog:
    """One line per change: connected, lost with its reason, another reason of the outage."""

    def __init__(self, broker: str) -> None:
        self._broker = broker
        self._reasons: set[str] = set()
        self._connected = False

    def connected(self) -> str:
        """The line of a new connection."""
        self._reasons.clear()
        self._connected = True
        return f"MQTT: connected to {self._broker}"

    def lost(self, reason: str) -> str | None:
        """Line of a failed attempt, or of a connection's end; None if already written."""
        how = "lost" if self._connected else "no connection"
        self._connected = False
        if reason in self._reasons:
            return None
        self._reasons.add(reason)
        return f"MQTT: {how}: {self._broker}: {reason}; flying on, trying again"


_PERIOD_S = 0.1
"""Period of the search for messages to be sent."""
_KEEPALIVE_S = 15
"""The broker publishes the last will after 1.5 times this silence."""
_TIMEOUT_S = 10.0
"""Longest wait for the broker: for its greeting, and for its acknowledgements."""
_LAST_MESSAGES_S = 1.0
_CLOSE_S = 2.0
"""Longest wait for the thread in the end; a broker that does not answer delays no more."""
_NUMBERS = re.compile(r"\[[^\]]*\] ?| ?\(_ssl\.c:\d+\)")
_TEXTS = {"Unspecified error": "the broker ended the connection"}
_MOST_INCOMING = 64
"""Received messages that wait; more are dropped."""

_logger = logging.getLogger(__name__)
_quiet = logging.getLogger(f"{__name__}.library")
_quiet.setLevel(logging.CRITICAL)


class Traffic(Protocol):
    """Messages sent and received; called in the client's thread only."""

    will: Message | None
    """Published by the broker when the connection is lost."""
    subscriptions: Sequence[tuple[str, int]]
    """Topic filters and their quality of service."""

    def connected(self) -> Sequence[Message]:
        """Messages of a new connection, sent before all others."""

    def outgoing(self) -> Sequence[Message]:
        """Messages to be sent now; `published` follows when they are sent."""

    def published(self) -> None:
        """Notes that all messages of the last `outgoing` are sent."""

    def received(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Takes a received message."""

    def last_messages(self) -> Sequence[Message]:
        """Messages before the connection is closed on purpose."""


class MqttClient:
    """The thread and its connection. identifier: a broker has one client of a name at a time."""

    def __init__(self, broker: Broker, traffic: Traffic, *, identifier: str | None) -> None:
        self._broker = broker
        self._traffic = traffic
        self._identifier = identifier
        self._closing = threading.Event()
        self._log = ConnectionLog(str(broker.address))
        self._connected_s: float | None = None
        self.state = f"connecting to {broker.address}"
        """Text of the connection."""
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """True while there is a connection."""
        return self._connected_s is not None

    def close(self) -> None:
        """Publishes the last message where there is a connection; waits a limited time."""
        self._closing.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        backoff = Backoff()
        while not self._closing.is_set():
            # One loop per connection: a failed connection leaves no state.
            try:
                reason = asyncio.run(self._connection())
            except Exception as error:  # noqa: BLE001 - no descriptor or thread for a loop
                reason = _words(error)
            connected_s = 0.0 if self._connected_s is None else clock_s() - self._connected_s
            self._connected_s = None
            if self._closing.is_set():
                return
            self.state = f"no connection to {self._broker.address}: {reason}"
            line = self._log.lost(reason)
            if line is not None:
                _logger.warning("%s", line)
            self._closing.wait(backoff.pause_s(random.random(), connected_s))  # noqa: S311

    async def _connection(self) -> str:
        """Connects and carries messages until `close`; returns the reason for the connection's end.

        An error that is raised would keep its frames, and a socket, until a garbage collection.
        """
        try:
            await self._connect()
        except Exception as error:  # noqa: BLE001 - no fault here may end the thread
            return _words(error)
        return "closed"

    async def _connect(self) -> None:
        asyncio.get_running_loop().set_default_executor(_DaemonThreads())
        traffic, address = self._traffic, self._broker.address
        client = aiomqtt.Client(
            address.host,
            address.port,
            username=self._broker.username,
            password=self._broker.password,
            identifier=self._identifier,
            will=None if traffic.will is None else _will(traffic.will),
            timeout=_TIMEOUT_S,
            keepalive=_KEEPALIVE_S,
            tls_context=self._broker.tls,
            max_queued_incoming_messages=_MOST_INCOMING,
            logger=_quiet,
        )
        try:
            await self._carry(client)
        finally:
            # aiomqtt leaves it open where the broker accepts the connection and does not answer.
            left = client._client.socket()  # noqa: SLF001
            if left is not None:
                left.close()

    async def _carry(self, client: aiomqtt.Client) -> None:
        traffic = self._traffic
        async with client:
            listening = asyncio.create_task(_listen(client, traffic.received))
            try:
                await _first_end(_subscribe(client, traffic.subscriptions), listening)
                await _first_end(_publish(client, traffic.connected()), listening)
                self._connected_s = clock_s()
                self.state = f"connected to {self._broker.address}"
                _logger.info("%s", self._log.connected())
                while not self._closing.is_set():
                    await _first_end(_publish(client, traffic.outgoing()), listening)
                    traffic.published()
                    await asyncio.wait({listening}, timeout=_PERIOD_S)
                last_messages = _publish(client, traffic.last_messages())
                await asyncio.wait_for(_first_end(last_messages, listening), _LAST_MESSAGES_S)
            finally:
                listening.cancel()


async def _subscribe(client: aiomqtt.Client, subscriptions: Sequence[tuple[str, int]]) -> None:
    """Subscribes; logs a topic that the broker refuses, since all others work."""
    for topic, qos in subscriptions:
        codes = await client.subscribe(topic, qos)
        if any(getattr(code, "is_failure", False) for code in codes):
            _logger.warning("MQTT: the broker refuses the subscription to %s", topic)


async def _publish(client: aiomqtt.Client, messages: Sequence[Message]) -> None:
    """Publishes a batch; returns when all are sent, and acknowledged where that is required."""
    await asyncio.gather(
        *(
            client.publish(item.topic, item.payload, qos=item.qos, retain=item.retain)
            for item in messages
        )
    )


async def _listen(client: aiomqtt.Client, received: Callable[..., None]) -> None:
    """Takes received messages until the connection is lost, which raises MqttError."""
    async for message in client.messages:
        if isinstance(message.payload, bytes):
            received(message.topic.value, message.payload, retained=message.retain)


async def _first_end(sending: Coroutine[Any, Any, None], listening: asyncio.Task[None]) -> None:
    """Waits for the end of sending; raises when that fails or the connection is lost."""
    task = asyncio.create_task(sending)
    await asyncio.wait({task, listening}, return_when=asyncio.FIRST_COMPLETED)
    if listening.done():
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        listening.result()
    task.result()


def _will(message: Message) -> aiomqtt.Will:
    return aiomqtt.Will(message.topic, message.payload, qos=message.qos, retain=message.retain)


def _words(error: Exception) -> str:
    """Reason as text, without numbers of errors and lines of the libraries' sources."""
    words = _NUMBERS.sub("", " ".join(str(error.__cause__ or error).split()))
    return _TEXTS.get(words, words) or type(error).__name__


class _DaemonThreads(ThreadPoolExecutor):
    """A thread for each call; neither the loop nor the end of the program waits for it.

    aiomqtt connects in one: a name server or a broker that does not answer may hold it for long.
    """

    def submit(self, call: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        given = (future, partial(call, *given, **named))
        threading.Thread(target=_run, args=given, name="mqtt connect", daemon=True).start()
        return future


def _run(future: Future[Any], call: Callable[[], Any]) -> None:
    try:
        future.set_result(call())
    except BaseException as error:  # noqa: BLE001 - the future has it
        future.set_exception(error)
        del future  # otherwise the error, its frames and the future keep one another, and a socket
