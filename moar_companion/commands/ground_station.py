"""A ground station on one link by MAVSDK: messages of a companion, and commands to it.

It has MAVSDK's own ids (245, component 190) and sends heartbeats as a ground station. While it
runs, PX4's ground station failsafe and the companion's communication risk count it. If it is the
only ground station, its end is a ground station loss. As 245 it takes no answers from a
QGroundControl (255) beside it. ArduPilot's failsafe watches 255 alone and does not count it.
"""

from __future__ import annotations

import json
import queue
import socket
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from ..errors import LinkError
from ..mavlink.statustext import ReceivedTexts
from ..mavlink.urls import LinkAddress, LinkKind

COMPANION = 195
"""The companion's component id."""
_HEARD = ("HEARTBEAT", "COMMAND_ACK", "STATUSTEXT", "NAMED_VALUE_FLOAT")
_LOG_ERROR = 3
"""mavsdk.LogLevel.ERROR."""
_POLL_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedMessage:
    """A message from the companion's system."""

    name: str
    component: int
    fields: Mapping[str, Any]
    text: str | None = None
    """Complete text of the companion, whose last part is this message."""


class GroundStation:
    """A ground station by MAVSDK, on one link. Raises LinkError when it cannot be opened."""

    def __init__(self, address: LinkAddress) -> None:
        import mavsdk  # noqa: PLC0415
        from mavsdk.plugins import mavlink_direct  # noqa: PLC0415

        url = mavsdk_url(address)
        self.system_id = 0
        """The aircraft's system id; 0 until the companion is found."""
        self._address = address
        self._received: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._texts = ReceivedTexts()
        self._complaint = ""
        self._plugin: Any = mavlink_direct
        self._direct: Any = None
        mavsdk.log_subscribe(self._log)
        configuration = mavsdk.Configuration.create_with_component_type(
            mavsdk.ComponentType.GROUND_STATION
        )
        self._ids = (configuration.system_id, configuration.component_id)
        self._mavsdk = mavsdk.Mavsdk(configuration)
        result = self._mavsdk.add_any_connection(url)
        if result != mavsdk.ConnectionResult.SUCCESS:
            self.close()
            raise self._failed(result.name)

    def close(self) -> None:
        """End MAVSDK's threads."""
        self._mavsdk.destroy()

    def _failed(self, what: str) -> LinkError:
        """Error with MAVSDK's description of the failure on the link."""
        return LinkError(f"{self._address}: {self._complaint or what.lower().replace('_', ' ')}")

    def find_companion(self, timeout_s: float) -> None:
        """Waits for the first companion; LinkError with the systems received when none appears."""
        until_s = time.monotonic() + timeout_s
        while True:
            received = {item: item.component_ids() for item in self._mavsdk.get_systems()}
            for system, components in received.items():
                if COMPANION in components:
                    self.system_id = system.get_system_id()
                    self._direct = self._plugin.MavlinkDirect(system)
                    for name in _HEARD:
                        self._direct.subscribe_message(
                            name, lambda message, _: self._received.put(message)
                        )
                    return
            if time.monotonic() >= until_s:
                raise LinkError(self._none_found(received, timeout_s))
            time.sleep(_POLL_S)

    def _none_found(self, received: Mapping[Any, list[int]], timeout_s: float) -> str:
        others = "; ".join(
            f"system {system.get_system_id()} with components {', '.join(map(str, components))}"
            for system, components in received.items()
        )
        return (
            f"no companion (component {COMPANION}) received on {self._address} "
            f"for {timeout_s:g} s: "
            f"{others or self._complaint or 'nothing is received'}"
        )

    def send_command(self, command: int, *parameters: float, confirmation: int) -> None:
        """A COMMAND_LONG to the companion; LinkError when it cannot be sent."""
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        fields = {
            "target_system": self.system_id,
            "target_component": COMPANION,
            "command": command,
            "confirmation": confirmation,
            **{f"param{place}": value for place, value in enumerate(padded, start=1)},
        }
        message = self._plugin.MavlinkMessage(
            message_name="COMMAND_LONG",
            target_system_id=self.system_id,
            target_component_id=COMPANION,
            fields_json=json.dumps(fields),
        )
        try:
            self._direct.send_message(message)
        except self._plugin.MavlinkDirectError as error:
            raise self._failed(error.result.name) from error

    def listen(self, seconds: float) -> Iterator[ReceivedMessage]:
        """Messages received from the companion's system within a time."""
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            try:
                message = self._received.get(timeout=left_s)
            except queue.Empty:
                return
            fields = json.loads(message.fields_json)
            name, component = message.message_name, message.component_id
            if component == COMPANION and name == "STATUSTEXT":
                for text in self._texts.handle(SimpleNamespace(**fields)):
                    yield ReceivedMessage(
                        name=name, component=component, fields=fields, text=text.text
                    )
            else:
                yield ReceivedMessage(name=name, component=component, fields=fields)

    def is_answer(self, message: ReceivedMessage, command: int) -> bool:
        """Returns True for the companion's acknowledgement of a command of this ground station."""
        fields = message.fields
        return (
            message.name == "COMMAND_ACK"
            and message.component == COMPANION
            and fields["command"] == command
            and (fields["target_system"], fields["target_component"]) == self._ids
        )

    def _log(self, level: int, message: str, _file: str | None, _line: int) -> bool:
        """Receives MAVSDK's log, which it would print; keeps the last error for LinkError."""
        if level >= _LOG_ERROR:
            self._complaint = message
        return True


def mavsdk_url(address: LinkAddress) -> str:
    """The address as MAVSDK's URL; LinkError for a host that has no IPv4 address."""
    if address.kind is LinkKind.SERIAL:
        return f"serial://{address.device}:{address.baud}"
    try:
        host = socket.gethostbyname(address.host)
    except OSError as error:
        raise LinkError(f"{address}: {error.strerror}") from error
    scheme = "tcpout" if address.kind is LinkKind.TCP else address.kind.value
    return f"{scheme}://{host}:{address.port}"
