"""A companion of raw pymavlink on a UDP port, which answers an operator's commands by a rule."""

from __future__ import annotations

import contextlib
import socket
import threading

from pymavlink.dialects.v20 import all as mavlink

USER_1, PAUSE_CONTINUE = 31010, 193
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
OPERATOR = (245, 190)
COMPANION, AUTOPILOT = 195, 1
FLYING = 3
"""The number of the mission state."""


class Aircraft:
    """A system on a UDP port: its components heartbeat, and commands are answered by a rule.

    answer: a function from a command to the companion to the answers, as (component, message).
    MAVSDK requests the autopilot's version; that request is not answered.
    """

    def __init__(self, answer=lambda _: [], *, components=(COMPANION,), messages=()):
        self.commands = []
        self._answer, self._components, self._messages = answer, components, messages
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self._codecs = {
            component: mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
            for component in (COMPANION, AUTOPILOT)
        }
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.url = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self):
        parser, peer = mavlink.MAVLink(None), None
        while not self._ended.is_set():
            with contextlib.suppress(TimeoutError):
                data, peer = self._socket.recvfrom(4096)
                for message in parser.parse_buffer(data) or []:
                    if getattr(message, "target_component", None) == COMPANION:
                        self.commands.append(message)
                        self._send(peer, self._answer(message))
            if peer is not None:
                self._send(peer, [(each, heartbeat(each)) for each in self._components])
                self._send(peer, self._messages)

    def _send(self, peer, reply):
        for component, message in reply:
            codec = self._codecs[component]
            self._socket.sendto(message.pack(codec), peer)
            codec.seq = (codec.seq + 1) % 256


def heartbeat(component):
    if component == AUTOPILOT:
        return mavlink.MAVLink_heartbeat_message(2, 12, 209, 0x00060000, 4, 3)
    return mavlink.MAVLink_heartbeat_message(18, 8, 0, FLYING, 4, 3)


def acknowledgement(result, *, command=USER_1, to=OPERATOR, component=COMPANION):
    return component, mavlink.MAVLink_command_ack_message(command, result, 0, 0, *to)


def text(words, *, component=COMPANION, chunk=(0, 0)):
    return component, mavlink.MAVLink_statustext_message(4, words.encode(), *chunk)


def always(*reply):
    return lambda _: list(reply)
