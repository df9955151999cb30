"""A hundred vehicles on one MQTT broker: `.venv/bin/python -m tests.benchmarks.fleet`.

The publishers are those of the service, a thread each, with the status of a flight and moving
times. The reader is paho in its own process and reads all topics. The delay counts from the making
of a status to the reader, and includes up to 0.1 s of waiting in the publisher. Three parts: alone;
with slow subscribers, each of which reads 2 kB/s of all topics; and with a restart of the broker.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import json
import multiprocessing
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import paho.mqtt.client as paho
import psutil
from paho.mqtt.enums import CallbackAPIVersion

from moar_companion.service.mqtt_publisher import MqttPublisher, open_publisher
from moar_companion.settings.config import CompanionConfig
from moar_companion.settings.mqtt_config import Mqtt
from sitl.demonstration.broker import broker_name, free_tcp_port, running_broker
from tests.mqtt.statuses import flying, status_of

TURN_S = 0.02
SLOW_BYTES_PER_S = 2000
AWAY_S = 3.0
SLOW_CONNECT = bytes.fromhex("100d 0004 4d515454 04 02 0000 0001")
SLOW_SUBSCRIBE = bytes.fromhex("820b 0001 0006") + b"moar/#" + b"\x00"


def read(
    port: int, queue: multiprocessing.Queue[list[tuple[float, float, str]]], ended: Any
) -> None:
    """Everything that is published: when it was read, its delay, its vehicle."""
    received: list[tuple[float, float, str]] = []

    def handle(_client: paho.Client, _userdata: object, message: paho.MQTTMessage) -> None:
        now_s = time.time()
        if not message.retain and b'"time_s"' in message.payload[:12]:
            reported_s = json.loads(message.payload)["time_s"]
            received.append((now_s, now_s - reported_s, message.topic.split("/")[1]))

    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.on_connect = lambda client, *_: client.subscribe("moar/#", qos=1)
    client.on_message = handle
    client.reconnect_delay_set(1, 1)
    client.connect("127.0.0.1", port)
    client.loop_start()
    ended.wait()
    client.disconnect()
    queue.put(received)


class Fleet(threading.Thread):
    """The control loops of all vehicles, in one thread."""

    def __init__(self, port: int, count: int) -> None:
        super().__init__(daemon=True)
        self._status = status_of(flying())
        self.publishers: list[MqttPublisher] = []
        for number in range(count):
            settings = Mqtt(url=f"mqtt://127.0.0.1:{port}", vehicle=f"v{number:03d}")
            publisher = open_publisher(CompanionConfig(vehicle=Path(), mqtt=settings))
            assert publisher is not None
            self.publishers.append(publisher)
        self._closing = threading.Event()

    def run(self) -> None:
        began_s = time.monotonic()
        while not self._closing.wait(TURN_S):
            now_s = time.monotonic() - began_s
            for number, publisher in enumerate(self.publishers):
                # Not all in the same instant; each has new texts every 10 s.
                said = f"MOAR: {(now_s + number) // 10:.0f}"
                publisher.publish_due(now_s + 0.005 * number, lambda said=said: self._now(said))

    def _now(self, said: str) -> dict[str, Any]:
        status = copy.copy(self._status)
        status["time_s"] = time.time()
        status["mission"] = {**status["mission"], "text": said, "for_s": None, "text_age_s": None}
        return status

    def connected(self) -> int:
        return sum(publisher._client.connected for publisher in self.publishers)

    def close(self) -> None:
        self._closing.set()
        self.join()
        for publisher in self.publishers:
            publisher._client._closing.set()
        for publisher in self.publishers:
            publisher.close()


@contextlib.contextmanager
def slow_readers(port: int, count: int) -> Iterator[None]:
    """Subscribers to everything that take a fraction of it."""
    sockets, ended = [], threading.Event()
    for number in range(count):
        item = socket.create_connection(("127.0.0.1", port))
        item.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        item.sendall(SLOW_CONNECT + bytes([97 + number]) + SLOW_SUBSCRIBE)
        sockets.append(item)

    def sip() -> None:
        while not ended.wait(0.5):
            for item in sockets:
                with contextlib.suppress(OSError):
                    item.recv(SLOW_BYTES_PER_S // 2, socket.MSG_DONTWAIT)

    thread = threading.Thread(target=sip)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        for item in sockets:
            item.close()


def row(
    name: str, received: list[tuple[float, float, str]], span_s: tuple[float, float], cpu: str
) -> str:
    delays_ms = 1e3 * np.array([delay for at, delay, _ in received if span_s[0] <= at < span_s[1]])
    rate_hz = len(delays_ms) / (span_s[1] - span_s[0])
    median, p99, most = np.percentile(delays_ms, [50, 99, 100])
    return f"| {name} | {rate_hz:.0f} | {median:.0f} | {p99:.0f} | {most:.0f} | {cpu} |"


def used(process: psutil.Process, seconds: float) -> tuple[float, float]:
    """CPU of a process (% of a core) over a time, and its resident memory in the end (MB)."""
    before = process.cpu_times()
    time.sleep(seconds)
    after = process.cpu_times()
    share = (after.user + after.system - before.user - before.system) / seconds
    return 100.0 * share, process.memory_info().rss / 1e6


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--slow", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    load = f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores"
    sys.stdout.write(f"{broker_name()}, {given.vehicles} vehicles; {load}\n\n")
    spawning = multiprocessing.get_context("spawn")
    queue, ended, rows, spans = spawning.Queue(), spawning.Event(), [], []
    with contextlib.ExitStack() as stack, contextlib.ExitStack() as first:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        port = free_tcp_port()
        broker = first.enter_context(running_broker(folder, port))
        reader = spawning.Process(target=read, args=(port, queue, ended))
        reader.start()
        fleet = Fleet(port, given.vehicles)
        fleet.start()
        stack.callback(fleet.close)
        while fleet.connected() < given.vehicles:
            time.sleep(0.1)
        time.sleep(5.0)
        process = psutil.Process(broker._process.pid)
        for name, slow in (("alone", 0), (f"{given.slow} slow readers", given.slow)):
            with slow_readers(port, slow):
                began_s = time.time()
                cpu, memory_mb = used(process, given.seconds)
                spans.append((name, (began_s, time.time()), f"{cpu:.1f} %, {memory_mb:.0f} MB"))
        stopped_s = time.time()
        first.close()
        time.sleep(AWAY_S)
        with running_broker(folder, port) as broker:
            started_s = time.time()
            while fleet.connected() < given.vehicles:
                time.sleep(0.01)
            back_s = time.time()
            process = psutil.Process(broker._process.pid)
            cpu, memory_mb = used(process, given.seconds)
            spans.append(
                ("after the restart", (back_s, time.time()), f"{cpu:.1f} %, {memory_mb:.0f} MB")
            )
            ended.set()
            received = queue.get()
            reader.join()
    rows = [row(name, received, span_s, cpu) for name, span_s, cpu in spans]
    sys.stdout.write("| | messages/s | delay p50, ms | p99 | greatest | broker: CPU, memory |\n")
    sys.stdout.write("|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n\n")
    back = {vehicle: at for at, _, vehicle in reversed(received) if at >= started_s}
    later_s = np.array(list(back.values())) - started_s
    sys.stdout.write(
        f"restart: away for {started_s - stopped_s:.1f} s; all {len(back)} vehicles connected "
        f"{back_s - started_s:.1f} s after it listened, read after {np.median(later_s):.1f} s "
        f"(median), {later_s.max():.1f} s (last)\n"
    )


if __name__ == "__main__":
    main()
