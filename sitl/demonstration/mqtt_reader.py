"""A reader of an MQTT broker without the companion's code: paho, as any ground system."""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

_TOPICS = "moar/#"


class MqttReader:
    """Writes every message to a file, a line each: time_s, topic, retained, payload."""

    def __init__(self, file: Path) -> None:
        self._name = file.name
        self._lines = file.open("w", encoding="utf-8")
        self._counts = Counter[str]()
        self._bytes = self._unreadable = 0
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = self._subscribe
        self._client.on_message = self._handle

    def start(self, port: int) -> None:
        """Connect, and read in a thread."""
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def close(self) -> None:
        """Disconnect, and close the file."""
        self._client.disconnect()
        self._client.loop_stop()
        self._lines.close()

    def summary(self) -> str:
        """One line of a message."""
        topics, total = len(self._counts), sum(self._counts.values())
        unreadable = f", {self._unreadable} UNREADABLE" if self._unreadable else ""
        size_kb = self._bytes / 1e3
        return (
            f"MQTT: {total} messages on {topics} topics, {size_kb:.0f} kB{unreadable}: {self._name}"
        )

    def _subscribe(self, client: paho.Client, *_: Any) -> None:
        client.subscribe(_TOPICS, qos=1)

    def _handle(self, _client: paho.Client, _userdata: Any, message: paho.MQTTMessage) -> None:
        self._counts[message.topic] += 1
        self._bytes += len(message.payload)
        try:
            payload = json.loads(message.payload, parse_constant=_refuse)
        except ValueError:
            self._unreadable += 1
            return
        line = {
            "time_s": time.time(),
            "topic": message.topic,
            "retained": message.retain,
            "payload": payload,
        }
        self._lines.write(json.dumps(line) + "\n")


def _refuse(word: str) -> None:
    """NaN and infinities are no JSON."""
    raise ValueError(word)
