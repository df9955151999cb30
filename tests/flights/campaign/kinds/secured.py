"""Faults of signed links, and orders by MQTT: forged, repeated, late, of another vehicle."""

from __future__ import annotations

from dataclasses import replace

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.order_link import OrderLink
from moar_companion.service.mqtt.orders import OrderChecks, RefusedOrder, signed_order
from moar_companion.service.mqtt.payloads import OrderPayload
from moar_companion.settings.mqtt_config import ORDER_LINK
from tests.mavlink.signed import OTHER_SECRET, SECRET

from .. import packets
from .table import kind

_STAMPS_PER_S = 200
"""The fake counts a stamp on with each packet that it signs."""
_WALL_S = 1.8e9
_VEHICLE, _WINDOW_S = "a1", 10.0


def signed(drawn, _):
    """All links are signed."""
    return replace(drawn, signed=True)


def _signing(flight):
    return flight.autopilot._links["companion"]._parser.signing


@kind("unsigned packets, or with another key, tell other places and modes", prepare=signed)
def signed_link_forged(flight, rng):
    off_m, has_key = rng.uniform(1.0, 10.0), rng.random() < 0.5
    flight.note(off_m=off_m, has_key=has_key)
    signing = _signing(flight)
    px4 = flight.drawn.manner.value == "px4"

    def make(_):
        nav = flight.autopilot.manner.navigation
        boot_ms = round(nav.since_boot_s * 1000)
        messages = (
            mavlink.MAVLink_local_position_ned_message(
                boot_ms, nav.x + off_m, nav.y, nav.z, 0.0, 0.0, 0.0
            ),
            mavlink.MAVLink_heartbeat_message(2, 12 if px4 else 3, 217, 0, 4, 3),
        )
        other = packets.Signature(OTHER_SECRET, signing.link_id, signing.timestamp + 1)
        return [
            packets.packed(message, signature=other if has_key else None) for message in messages
        ]

    return flight.filter(packets.insert(make, 0.1))


@kind("packets of 2 to 20 s before are heard again on a signed link", prepare=signed)
def signed_link_replayed(flight, rng):
    late_s = rng.uniform(2.0, 20.0)
    flight.note(late_s=late_s)
    ids = {packets.LOCAL_POSITION, packets.ATTITUDE, packets.HEARTBEAT, packets.CURRENT_MODE}
    return flight.filter(packets.replay(late_s, ids))


@kind("the time stamps of the autopilot's signatures fall back by 0.2 to 10 s", prepare=signed)
def signing_clock_back(flight, rng):
    back_s = rng.uniform(0.2, 10.0)
    flight.note(back_s=back_s)
    signing = _signing(flight)
    signing.timestamp = max(0, signing.timestamp - round(back_s * _STAMPS_PER_S))


@kind("the autopilot signs with another key", lasts_s=(0.3, 10.0), prepare=signed)
def signing_key_changed(flight, rng):
    signing = _signing(flight)
    signing.secret_key = OTHER_SECRET

    def undo():
        signing.secret_key = SECRET

    return undo


def _by_mqtt(drawn, _):
    return replace(drawn, orders_by_mqtt=True)


@kind(
    "orders by MQTT, every 0.2 to 2 s: right, forged, repeated, late, of another vehicle",
    lasts_s=(5.0, 20.0),
    prepare=_by_mqtt,
)
def orders_by_mqtt(flight, rng):
    checks = OrderChecks(_VEHICLE, SECRET, _WINDOW_S, _WALL_S)
    link, due, earlier = OrderLink(flight.config.component_id), [0.0], []

    def send(_):
        if flight.now_s < due[0]:
            return
        due[0] = flight.now_s + rng.uniform(0.2, 2.0)
        wall_s = _WALL_S + flight.now_s
        how = rng.choice(("right", "right", "forged", "repeated", "late", "other", "cut"))
        if how == "repeated" and not earlier:
            how = "right"
        order = OrderPayload(
            mission=rng.choice(("inspection", "exit", "evacuation", "pause", "continue")),
            target=None,
            time_s=wall_s - (_WINDOW_S + 1.0 if how == "late" else 0.0),
            nonce=f"{rng.randrange(2**64):016x}",
        )
        payload = signed_order(
            order,
            "a2" if how == "other" else _VEHICLE,
            OTHER_SECRET if how == "forged" else SECRET,
        )
        if how == "repeated":
            payload = rng.choice(earlier)
        elif how == "cut":
            payload = payload[: rng.randrange(len(payload))]
        found = checks.check(payload, wall_s)
        if isinstance(found, RefusedOrder):
            return
        if how == "right":
            flight.note_order()
            flight.missions_s.append(flight.now_s)
            earlier.append(payload)
        else:
            flight.forbidden.append((flight.now_s, f"order by MQTT: {how}"))
        packet = link.packet(found.nonce, found.mission, found.target)
        flight.companion.receive(ORDER_LINK, packet, flight.now_s)

    return flight.each_step(send)
