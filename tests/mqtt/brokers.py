"""Real brokers, a reader that is not ours (paho), and what stands in for a broker that hangs."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import threading
import time
from pathlib import Path

import paho.mqtt.client as paho

PATIENCE_S = 60.0
CERTIFICATES = Path(__file__).parents[1] / "data" / "mqtt"


def wait_until(condition, timeout_s=PATIENCE_S):
    """Waits for something that other threads and programs do; returns its value."""
    deadline_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, "not in time"
        time.sleep(0.01)
    return value


class Reader:
    """A subscriber in a thread of its own. messages: (topic, payload, quality, retained)."""

    def __init__(self, port, topic="moar/#", **tls):
        self.messages = []
        self._subscribed = threading.Event()
        self._client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe(topic, qos=1)
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_message = self._handle
        if tls:
            self._client.tls_set(**tls)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        assert self._subscribed.wait(PATIENCE_S)

    def _handle(self, _client, _userdata, message):
        self.messages.append((message.topic, message.payload, message.qos, message.retain))

    def publish(self, topic, payload, *, retain=False):
        self._client.publish(topic, payload, qos=1, retain=retain).wait_for_publish(PATIENCE_S)

    def of(self, name, vehicle="a1"):
        """Payloads of a vehicle's topic, the oldest first."""
        topic = f"moar/{vehicle}/{name}"
        return [json.loads(payload) for at, payload, *_ in [*self.messages] if at == topic]

    def close(self):
        self._client.disconnect()
        self._client.loop_stop()


@contextlib.contextmanager
def hanging(greeting=b"", *, reads=False):
    """A port that takes connections, greets, and then does nothing; reads: it takes data.

    Yields the port and the list of connections.
    """
    taken, ended = [], threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0.05)

        def serve():
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    connection, _ = listener.accept()
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                    taken.append(connection)
                    connection.sendall(greeting)
                for connection in taken if reads else ():
                    connection.setblocking(False)
                    with contextlib.suppress(BlockingIOError):
                        connection.recv(65536)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield listener.getsockname()[1], taken
        finally:
            ended.set()
            thread.join()
            for connection in taken:
                connection.close()


def private(folder, name):
    """A copy of a file that its owner alone can read, as git does not keep it."""
    copy = folder / name
    shutil.copy(CERTIFICATES / name, copy)
    copy.chmod(0o400)
    return copy
