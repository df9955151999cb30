"""Signed orders: made by an operator's program, checked by the companion. Pure.

    topic    moar/VEHICLE/order
    payload  {"order": TEXT, "signature": HEX}

TEXT is the JSON of a `payloads.OrderPayload`. HEX is the HMAC-SHA256, with the configured key, of
three lines with line feeds between them: `moar-order-1`, the vehicle's name, and TEXT. The name
binds an order to one vehicle, also in a fleet with one key.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import math
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, ValidationError

from .payloads import OrderPayload, error_words

_PURPOSE = "moar-order-1"
_LONGEST_BYTES = 2048
_MOST_NONCES = 10_000
"""Number of stored orders; at the limit new orders are refused, and no stored order is dropped."""
_ALWAYS_TAKEN = frozenset({"hold", "pause", "release"})
"""Orders that are also taken after a newer one. All others begin a flight."""


class _Envelope(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")

    order: str
    signature: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedOrder:
    """Reason why an order is refused. nonce: None unless the order is signed."""

    reason: str
    nonce: str | None = None


def signed_order(order: OrderPayload, vehicle: str, key: bytes) -> bytes:
    """Payload of an order for a vehicle."""
    text = order.model_dump_json()
    return json.dumps({"order": text, "signature": _signature(text, vehicle, key)}).encode()


def _signature(text: str, vehicle: str, key: bytes) -> str:
    signed = f"{_PURPOSE}\n{vehicle}\n{text}".encode(errors="surrogatepass")
    return hmac.new(key, signed, hashlib.sha256).hexdigest()


class OrderChecks:
    """Takes an order if it is signed, fresh, and received for the first time.

    Fresh: its time differs from this computer's clock by the window at most, and is after the
    start, since earlier orders are not stored. A clock that is set back makes no taken order fresh;
    orders that a wrong clock has refused bar no later ones.
    An order that begins a flight is also refused if it is older than one taken before.
    """

    def __init__(self, vehicle: str, key: bytes, window_s: float, wall_s: float) -> None:
        self._vehicle = vehicle
        self._key = key
        self._window_s = window_s
        self._started_s = wall_s
        self._taken: dict[str, float] = {}
        """Time of each order by its nonce, the oldest arrival first."""
        self._forgotten_s = -math.inf
        """Orders before this time are not stored any more, and refused."""

    def check(
        self, payload: bytes, wall_s: float, *, retained: bool = False
    ) -> OrderPayload | RefusedOrder:
        """Returns the order, or the reason for refusal; never raises."""
        text = self._signed_text(payload)
        if text is None:
            return RefusedOrder(reason="wrong signature")
        try:
            order = OrderPayload.model_validate_json(text)
        except ValidationError as error:
            return RefusedOrder(reason=error_words(error))
        reason = "is retained by the broker" if retained else self._objection(order, wall_s)
        if reason is not None:
            return RefusedOrder(reason=reason, nonce=order.nonce)
        self._taken[order.nonce] = order.time_s
        return order

    def _signed_text(self, payload: bytes) -> str | None:
        if len(payload) > _LONGEST_BYTES:
            return None
        try:
            envelope = _Envelope.model_validate_json(payload)
        except ValidationError:
            return None
        expected = _signature(envelope.order, self._vehicle, self._key)
        right = hmac.compare_digest(
            expected.encode(), envelope.signature.lower().encode(errors="replace")
        )
        return envelope.order if right else None

    def _objection(self, order: OrderPayload, wall_s: float) -> str | None:
        oldest_s = max(wall_s - self._window_s, self._forgotten_s)
        if order.time_s > wall_s + self._window_s:
            return f"given {order.time_s - wall_s:.0f} s ahead of this clock"
        if order.time_s < oldest_s:
            age_s = oldest_s + self._window_s - order.time_s
            return f"given {age_s:.0f} s ago (limit {self._window_s:g} s)"
        if order.time_s < self._started_s:
            return "given before the companion's start"
        if order.nonce in self._taken:
            return "given before"
        newest_s = max(self._taken.values(), default=order.time_s)
        if order.time_s < newest_s and order.mission not in _ALWAYS_TAKEN:
            return "given before the newest order"
        # An order's time is a window ahead at most: none that is fresh is as old as these.
        forgotten_s = max(newest_s, order.time_s) - 2.0 * self._window_s
        self._forgotten_s = max(self._forgotten_s, forgotten_s)
        for nonce in [nonce for nonce, time_s in self._taken.items() if time_s < forgotten_s]:
            del self._taken[nonce]
        return "too many orders" if len(self._taken) >= _MOST_NONCES else None
