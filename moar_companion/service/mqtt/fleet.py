"""State of the fleet from MQTT: topics and payloads in, a row per vehicle out. Pure.

A payload that does not fit its model, of another program or a later version, is left out and
counted. Vehicles beyond the limit are left out, too: an open broker takes messages from any sender.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Any

from pydantic import ValidationError

from ...settings.mqtt_config import VEHICLE_NAME
from .payloads import Online, Payload, read
from .topics import ONLINE, ROOT, TOPICS

SUBSCRIPTION = f"{ROOT}/+/+"
"""Topics of two levels below the root; deeper topics such as `risk/inputs` are not in a row."""
_MOST_VEHICLES = 1000
_MODELS: dict[str, type[Payload | Online]] = {topic.name: topic.payload for topic in TOPICS}
_MODELS[ONLINE] = Online
_NAME = re.compile(VEHICLE_NAME)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Last state of a vehicle.

    online: None until a birth or will is received. received_s: receiver's clock at the last message
    that was not retained; reported_s: latest `time_s` of all messages. payloads: by topic.
    """

    vehicle: str
    online: bool | None = None
    received_s: float | None = None
    reported_s: float | None = None
    payloads: dict[str, Any] = field(default_factory=dict)

    def age_s(self, now_s: float, wall_s: float) -> float | None:
        """Age of the newest message; for retained messages by the vehicle's own clock."""
        if self.received_s is not None:
            return now_s - self.received_s
        return None if self.reported_s is None else max(0.0, wall_s - self.reported_s)


class Fleet:
    """Rows by vehicle."""

    def __init__(self) -> None:
        self._rows: dict[str, Row] = {}
        self.unreadable = 0
        """Number of messages that were left out."""

    def rows(self) -> list[Row]:
        """All rows, by the vehicles' names."""
        return [self._rows[name] for name in sorted(self._rows)]

    def take(self, topic: str, payload: bytes, now_s: float, *, retained: bool) -> None:
        """Takes a message; never raises."""
        root, _, rest = topic.partition("/")
        vehicle, _, name = rest.partition("/")
        model = _MODELS.get(name)
        if root != ROOT or model is None:
            return
        row = self._rows.get(vehicle)
        if row is None and (not _NAME.match(vehicle) or len(self._rows) >= _MOST_VEHICLES):
            self.unreadable += 1
            return
        try:
            content = read(model, payload)
        except ValidationError:
            self.unreadable += 1
            return
        self._rows[vehicle] = _updated(
            row or Row(vehicle=vehicle), name, content, None if retained else now_s
        )


def _updated(row: Row, name: str, content: Payload | Online, received_s: float | None) -> Row:
    if isinstance(content, Online):
        # The broker sends a last will: the will does not make the vehicle's own messages newer.
        return replace(row, online=content.online)
    return replace(
        row,
        received_s=received_s if received_s is not None else row.received_s,
        reported_s=max(filter(None, (row.reported_s, content.time_s)), default=None),
        payloads={**row.payloads, name: content},
    )
