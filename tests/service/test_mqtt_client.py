"""Publishing beside a real broker: one that works, is away, hangs, comes back, or is another's."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import signal
import socket
import time

import aiomqtt
import pytest

from moar_companion.service import mqtt_client, mqtt_publisher
from moar_companion.service.mqtt.orders import signed_order
from moar_companion.service.mqtt.payloads import OrderPayload
from moar_companion.service.mqtt.topics import TOPICS
from moar_companion.service.mqtt_publisher import open_publisher
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.mqtt_config import ORDER_LINK, Mqtt, MqttCommands
from sitl.demonstration.broker import Certificates, free_tcp_port, running_broker
from tests.processes import companion

from ..companion.desk import Desk
from ..mqtt.brokers import CERTIFICATES, Reader, hanging, private, wait_until
from ..mqtt.statuses import flying, status_of

CONNACK = b"\x20\x02\x00\x00"


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    """A broker for all tests; each has vehicles and readers of its own."""
    number = free_tcp_port()
    with running_broker(tmp_path_factory.mktemp("broker"), number):
        yield number


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    monkeypatch.setattr(mqtt_client, "_FIRST_S", 0.1)
    monkeypatch.setattr(mqtt_client, "_LONGEST_S", 0.2)
    monkeypatch.setattr(mqtt_client, "_TIMEOUT_S", 0.5)
    monkeypatch.setattr(mqtt_client, "_PERIOD_S", 0.01)


@contextlib.contextmanager
def publishing(url, folder, **settings):
    config = CompanionConfig(vehicle=folder, mqtt=Mqtt(url=url, vehicle="a1", **settings))
    with contextlib.closing(open_publisher(config)) as publisher:
        yield Loop(publisher)


class Loop:
    """The control loop's side, by its own clock: half a second of it whenever it is asked to."""

    def __init__(self, publisher):
        self.client = publisher._client
        self._publisher = publisher
        self._now_s = 0.0
        self.made = 0
        self.longest_s = 0.0

    def turn(self):
        self._now_s += 0.5
        began_s = time.monotonic()
        self._publisher.publish_due(self._now_s, self._status)
        self.longest_s = max(self.longest_s, time.monotonic() - began_s)
        return self.made

    def _status(self):
        self.made += 1
        return {**status_of(flying()), "time_s": 1e9 + self.made}


@pytest.fixture
def reader(port):
    with contextlib.closing(Reader(port)) as made:
        yield made


def test_another_programs_reader_gets_birth_every_topic_and_the_end(port, reader, tmp_path):
    with publishing(f"mqtt://127.0.0.1:{port}", tmp_path) as loop:
        wait_until(loop.turn)
        wait_until(lambda: all(reader.of(topic.name) for topic in TOPICS))
        reported = {
            name.removeprefix("moar/a1/"): quality for name, _, quality, _ in reader.messages
        }
        # amqtt delivers with the reader's quality of service, where that is the better one.
        assert all(reported[topic.name] >= topic.qos for topic in TOPICS)
        assert set(reported) == {topic.name for topic in TOPICS} | {"online"}
        assert reader.of("online")[-1]["online"]
        assert reader.of("mission")[-1]["state"] == "flying"
    wait_until(lambda: not reader.of("online")[-1]["online"])
    with contextlib.closing(Reader(port)) as late:
        kept = {topic.name for topic in TOPICS if topic.retain} | {"online"}
        wait_until(lambda: len(late.messages) >= len(kept))
        assert {name.removeprefix("moar/a1/") for name, *_ in late.messages} == kept
        assert all(retained for *_, retained in late.messages)


def test_a_reader_that_reads_nothing_delays_no_other(port, reader, tmp_path, monkeypatch):
    later_s = itertools.count(0.0, 10.0)
    monkeypatch.setattr(mqtt_publisher, "clock_s", lambda: next(later_s))
    with (
        socket.create_connection(("127.0.0.1", port)) as slow,
        publishing(f"mqtt://127.0.0.1:{port}", tmp_path) as loop,
    ):
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.sendall(bytes.fromhex("100d 0004 4d515454 04 02 003c 0001 73"))
        slow.sendall(bytes.fromhex("820b 0001 0006") + b"moar/#" + b"\x00")
        wait_until(lambda: loop.client.connected)
        before = len(reader.messages)
        wait_until(lambda: loop.turn() and len(reader.messages) > before + 300)
        assert loop.client.connected


def test_an_absent_broker_delays_no_call_and_is_logged_in_one_line(tmp_path, caplog):
    with (
        caplog.at_level(logging.INFO, logger="moar_companion"),
        publishing(f"mqtt://127.0.0.1:{free_tcp_port()}", tmp_path) as loop,
    ):
        wait_until(lambda: caplog.messages)
        time.sleep(0.5)
        assert loop.turn() == 0
        assert loop.longest_s < 0.1
    assert len(caplog.messages) == 1
    assert caplog.messages[0].endswith(": Connection refused; flying on, trying again")


def test_for_a_broker_that_takes_nothing_only_the_newest_status_is_kept(
    tmp_path, caplog, monkeypatch
):
    monkeypatch.setattr(mqtt_client, "_TIMEOUT_S", 30.0)
    with (
        hanging(CONNACK) as (port, taken),
        publishing(f"mqtt://127.0.0.1:{port}", tmp_path) as loop,
    ):
        # The birth message is never acknowledged: no status is even made.
        wait_until(lambda: taken)
        for _ in range(200):
            loop.turn()
        assert loop.made == 0
        assert loop.longest_s < 0.1
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 3.0, "the end waits for no broker"


@pytest.mark.parametrize("greeting", [b"", CONNACK], ids=["at once", "after its greeting"])
def test_a_broker_that_stops_answering_is_disconnected_and_tried_again(tmp_path, caplog, greeting):
    with (
        caplog.at_level(logging.INFO, logger="moar_companion"),
        hanging(greeting) as (port, taken),
        publishing(f"mqtt://127.0.0.1:{port}", tmp_path),
    ):
        wait_until(lambda: len(taken) >= 2)
        taken[0].settimeout(5.0)
        while taken[0].recv(4096):
            """It is closed, and not kept for each attempt."""
    where = f"mqtt://127.0.0.1:{port}"
    reported = f"MQTT: no connection: {where}: Operation timed out; flying on, trying again"
    assert caplog.messages == [reported]


@pytest.mark.slow
def test_after_a_restart_of_the_broker_every_topic_is_published_again(tmp_path, caplog):
    port = free_tcp_port()
    with (
        caplog.at_level(logging.INFO, logger="moar_companion"),
        publishing(f"mqtt://127.0.0.1:{port}", tmp_path) as loop,
    ):
        for number in (1, 2):
            folder = tmp_path / str(number)
            folder.mkdir()
            with running_broker(folder, port), contextlib.closing(Reader(port)) as reader:
                wait_until(lambda: loop.turn() and all(reader.of(item.name) for item in TOPICS))
                assert reader.of("online")[-1]["online"]
            wait_until(lambda: not loop.client.connected)
    lines = [line.partition(": mqtt")[0].partition(" to mqtt")[0] for line in caplog.messages]
    assert any("the broker ended the connection" in line for line in caplog.messages)
    assert lines.count("MQTT: connected") == lines.count("MQTT: lost") == 2


def test_a_connection_that_ends_while_no_thread_can_be_started_is_tried_again(
    port, tmp_path, monkeypatch
):
    async def no_thread(_loop, *_):
        raise RuntimeError("can't start new thread")

    def lost():
        raise OSError("Connection reset by peer")

    with publishing(f"mqtt://127.0.0.1:{port}", tmp_path) as loop:
        wait_until(lambda: loop.client.connected)
        with monkeypatch.context() as patched:
            patched.setattr(asyncio.BaseEventLoop, "shutdown_default_executor", no_thread)
            patched.setattr(loop.client._traffic, "outgoing", lost)
            wait_until(lambda: not loop.client.connected, 10.0)
            wait_until(lambda: loop.client.state.endswith(": can't start new thread"), 10.0)
        wait_until(lambda: loop.client.connected)


def test_a_reply_whose_publication_fails_is_published_after_the_reconnection(
    port, reader, tmp_path, monkeypatch
):
    publish, failed = mqtt_client._publish, []

    async def fail_once(client, messages):
        if not failed and any(message.topic.endswith("/reply") for message in messages):
            failed.append(messages)
            raise aiomqtt.MqttError("Operation timed out")
        await publish(client, messages)

    monkeypatch.setattr(mqtt_client, "_publish", fail_once)
    key = tmp_path / "orders.key"
    key.write_bytes(b"k" * 32)
    key.chmod(0o400)
    commands = MqttCommands(accept=True, key_file=key)
    with publishing(f"mqtt://127.0.0.1:{port}", tmp_path, commands=commands) as loop:
        wait_until(lambda: loop.client.connected)
        reader.publish("moar/a1/order", b"no order")
        wait_until(lambda: failed)
        wait_until(lambda: loop.client.connected)
        wait_until(lambda: reader.of("reply"), 10.0)
    assert [reply["reason"] for reply in reader.of("reply")] == ["wrong signature"]


def test_an_answer_of_the_last_cycle_is_published(port, reader, tmp_path):
    key = tmp_path / "orders.key"
    key.write_bytes(b"k" * 32)
    key.chmod(0o400)
    commands = MqttCommands(accept=True, key_file=key)
    with publishing(f"mqtt://127.0.0.1:{port}", tmp_path, commands=commands) as loop:
        wait_until(lambda: loop.client.connected)
        given = OrderPayload(mission="inspection", time_s=time.time() + 1.0, nonce="n" * 16)
        orders = loop._publisher.orders
        reader.publish("moar/a1/order", signed_order(given, "a1", b"k" * 32))
        wait_until(lambda: orders.queue._waiting)
        desk = Desk(mqtt=Mqtt(url="mqtt://a", vehicle="a1", commands=MqttCommands(accept=True)))
        desk.run(1.0)
        for packet in orders.queue.take():
            desk.handle(packet, ORDER_LINK)
        desk.companion.shut_down(desk.now_s)
        for link, data in desk.companion.data_to_send():
            if link == ORDER_LINK:
                orders.queue.send(data, 0.0, ())
    wait_until(lambda: reader.of("online") and not reader.of("online")[-1]["online"])
    assert [(reply["result"], reply["reason"]) for reply in reader.of("reply")] == [
        ("FAILED", "MOAR: the service ends, failed")
    ]


@pytest.fixture(scope="module")
def tls_port(tmp_path_factory):
    number = free_tcp_port()
    files = {
        "ca": CERTIFICATES / "authority.pem",
        "certificate": CERTIFICATES / "broker.pem",
        "key": CERTIFICATES / "broker.key",
    }
    folder = tmp_path_factory.mktemp("tls")
    with running_broker(folder, number, certificates=Certificates(**files)):
        yield number


# paho closes no socket after a handshake that failed: the garbage collector closes it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("authority", "name", "reported"),
    [
        ("authority", "vehicle", "MQTT: connected to"),
        ("stranger", "vehicle", "certificate verify failed: "),
        ("authority", "intruder", ""),
    ],
    ids=["right", "the broker's is of another authority", "ours is of another authority"],
)
def test_certificates_have_to_match(tls_port, tmp_path, caplog, authority, name, reported):
    with (
        caplog.at_level(logging.INFO, logger="moar_companion"),
        publishing(
            f"mqtts://127.0.0.1:{tls_port}",
            tmp_path,
            ca_file=CERTIFICATES / f"{authority}.pem",
            certificate_file=CERTIFICATES / f"{name}.pem",
            key_file=private(tmp_path, f"{name}.key"),
        ) as loop,
    ):
        wait_until(lambda: caplog.messages)
        assert reported in caplog.messages[0]
        if "connected" not in reported:
            time.sleep(0.5)
            assert loop.turn() == 0
            assert caplog.messages[0].startswith("MQTT: no connection: ")


def configured(tmp_path, port):
    path = tmp_path / "companion.yaml"
    path.write_text(
        f"vehicle: {shipped_configs() / 'vehicles' / 'x500.yaml'}\n"
        "links: [{url: 'udpout:127.0.0.1:9', role: autopilot}]\n"
        f"mqtt: {{url: 'mqtt://127.0.0.1:{port}', vehicle: a2}}\n"
    )
    return "--config", path


def with_model(running, reader, vehicle):
    """The mission that a service has published; the service has to run."""
    assert running.poll() is None, running.stderr.read()
    return reader.of("mission", vehicle)


def test_the_service_publishes_and_when_it_is_killed_its_last_will_is_published(
    port, reader, tmp_path
):
    with companion(*configured(tmp_path, port)) as running:
        wait_until(lambda: with_model(running, reader, "a2"))
        assert reader.of("mission", "a2")[-1]["state"] == "idle"
        assert reader.of("online", "a2")[-1]["online"]
        running.kill()
    wait_until(lambda: not reader.of("online", "a2")[-1]["online"])


@pytest.mark.slow
def test_a_broker_that_hangs_does_not_delay_the_end(tmp_path):
    with hanging() as (port, taken), companion(*configured(tmp_path, port)) as running:
        wait_until(lambda: taken)
        began_s = time.monotonic()
        running.send_signal(signal.SIGTERM)
        _, errors = running.communicate(timeout=10)
        assert running.returncode == 0
        assert time.monotonic() - began_s < 6.0
        assert "Traceback" not in errors


@pytest.mark.slow
def test_signed_orders_reach_the_machine_once_and_are_answered(port, tmp_path):
    key = tmp_path / "orders.key"
    key.write_bytes(b"k" * 32)
    key.chmod(0o400)
    path = tmp_path / "companion.yaml"
    path.write_text(
        f"vehicle: {shipped_configs() / 'vehicles' / 'x500.yaml'}\n"
        "links: [{url: 'udpout:127.0.0.1:9', role: autopilot}]\n"
        f"mqtt:\n  url: mqtt://127.0.0.1:{port}\n  vehicle: a3\n"
        f"  commands: {{accept: true, key_file: {key}, window_s: 60}}\n"
    )
    with (
        contextlib.closing(Reader(port, "moar/a3/#")) as reader,
        companion("--config", path) as running,
    ):
        wait_until(lambda: with_model(running, reader, "a3"))
        given = OrderPayload(mission="inspection", time_s=time.time(), nonce="n" * 16)
        right, wrong = (signed_order(given, "a3", secret) for secret in (b"k" * 32, b"o" * 32))
        for payload in (wrong, right):
            reader.publish("moar/a3/order", payload)
        wait_until(lambda: len(reader.of("reply", "a3")) >= 2)
        reader.publish("moar/a3/order", right)
        wait_until(lambda: len(reader.of("reply", "a3")) >= 3)
        reported = [
            (reply["nonce"], reply["result"], reply["reason"]) for reply in reader.of("reply", "a3")
        ]
    assert set(reported) == {
        (None, "DENIED", "wrong signature"),
        ("n" * 16, "DENIED", "MOAR: no site is loaded, denied"),
    }
