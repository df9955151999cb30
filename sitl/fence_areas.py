"""The fence that is uploaded by the mission protocol: its items, and the areas they enclose.

Inputs: MISSION messages of type fence. Outputs: the answers; whether a place is outside. Both
autopilots keep it over a restart. Other types of missions are empty and cannot be uploaded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from sitl.commands import source
from sitl.geodesy import around_deg

FENCE: Final = 1
"""MAV_MISSION_TYPE_FENCE."""
_ACCEPTED, _UNSUPPORTED, _INVALID_SEQUENCE = 0, 3, 13
_IN_POLYGON, _OUT_OF_POLYGON, _IN_CIRCLE, _OUT_OF_CIRCLE = range(5001, 5005)
_M_PER_DEG: Final = math.radians(6_371_000.0)
Answer = tuple[str, dict[str, Any]]
"""A message's name and its fields, without the target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One item; `value` is its param1: a polygon's number of vertices, or a circle's radius."""

    command: int
    value: float
    latitude_deg: float
    longitude_deg: float


class FenceAreas:
    """The stored items, and the exchange with a ground station."""

    def __init__(self) -> None:
        """Start without any."""
        self.items: tuple[Item, ...] = ()
        self._uploaded: list[Item] = []
        self._expected = 0

    def answer(self, message: Any) -> Answer | None:
        """Take a MISSION message; return the answer."""
        name, kind = message.get_type(), message.mission_type
        if name == "MISSION_REQUEST_LIST":
            return "MISSION_COUNT", {"count": len(self.items) if kind == FENCE else 0}
        if name == "MISSION_ACK":
            return None
        if kind != FENCE:
            return "MISSION_ACK", {"type": _UNSUPPORTED}
        if name == "MISSION_REQUEST_INT":
            if message.seq >= len(self.items):
                return "MISSION_ACK", {"type": _INVALID_SEQUENCE}
            return "MISSION_ITEM_INT", self._item(message.seq)
        if name == "MISSION_COUNT":
            self._uploaded, self._expected = [], message.count
        elif name == "MISSION_ITEM_INT" and message.seq == len(self._uploaded):
            self._uploaded.append(
                Item(
                    command=message.command,
                    value=message.param1,
                    latitude_deg=message.x / 1e7,
                    longitude_deg=message.y / 1e7,
                )
            )
        if len(self._uploaded) < self._expected:
            return "MISSION_REQUEST_INT", {"seq": len(self._uploaded)}
        self.items = tuple(self._uploaded)
        return "MISSION_ACK", {"type": _ACCEPTED}

    def _item(self, number: int) -> dict[str, Any]:
        item = self.items[number]
        return {
            "seq": number,
            "command": item.command,
            "param1": item.value,
            "x": round(item.latitude_deg * 1e7),
            "y": round(item.longitude_deg * 1e7),
        }

    def outside(self, latitude_deg: float, longitude_deg: float, *, union: bool = False) -> bool:
        """Return True if a place is outside. `union`: one inclusion is enough."""
        place = (latitude_deg, longitude_deg)
        inclusions = []
        at = 0
        while at < len(self.items):
            item = self.items[at]
            circle = item.command in (_IN_CIRCLE, _OUT_OF_CIRCLE)
            length = 1 if circle else max(1, int(item.value))
            part, at = self.items[at : at + length], at + length
            inside = _in_circle(place, item) if circle else _in_polygon(place, part)
            if item.command in (_IN_CIRCLE, _IN_POLYGON):
                inclusions.append(inside)
            elif inside and item.command in (_OUT_OF_CIRCLE, _OUT_OF_POLYGON):
                return True
        if not inclusions:
            return False
        return not (any(inclusions) if union else all(inclusions))


def _in_circle(place: tuple[float, float], item: Item) -> bool:
    north_m = (place[0] - item.latitude_deg) * _M_PER_DEG
    east_m = (
        around_deg(place[1] - item.longitude_deg) * _M_PER_DEG * math.cos(math.radians(place[0]))
    )
    return math.hypot(north_m, east_m) < item.value


def _in_polygon(place: tuple[float, float], vertices: Sequence[Item]) -> bool:
    latitude, longitude = place  # longitudes count from it
    inside = False
    before = vertices[-1]
    for vertex in vertices:
        low, high = (around_deg(each.longitude_deg - longitude) for each in (before, vertex))
        if (low >= 0.0) != (high >= 0.0):
            part = -low / (high - low)
            crossing = before.latitude_deg + part * (vertex.latitude_deg - before.latitude_deg)
            inside ^= latitude <= crossing
        before = vertex
    return inside


def payload_fields(names: Sequence[str], answer: Answer, message: Any) -> dict[str, Any]:
    """Return all fields of an answer to a message, those not given 0."""
    system, component = source(message)
    target = {
        "target_system": system,
        "target_component": component,
        "mission_type": message.mission_type,
    }
    return dict.fromkeys(names, 0) | target | answer[1]
