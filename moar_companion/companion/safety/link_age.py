"""State of the link to the autopilot: ages of its last packet, its mode and a position. Pure.

Any packet shows that the autopilot works; its mode and its armed state have ages of their own.
"""

from __future__ import annotations

from ...mavlink.telemetry import LinkStatistics, Telemetry
from ...settings.config import Supervision


def silence(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Returns the reason when no packet of the autopilot arrived for too long; None otherwise."""
    autopilot = telemetry.autopilot
    if autopilot is None:
        return "no heartbeat is received"
    packet_s = autopilot.received_s
    if telemetry.link is not None:
        packet_s = max(packet_s, telemetry.link.received_s)
    age_s = now_s - packet_s
    return f"autopilot silent for {age_s:.1f} s" if age_s > limits.heartbeat_timeout_s else None


def mode_unconfirmed(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Returns the reason when mode or armed state are too old; None while they are not."""
    autopilot = telemetry.autopilot
    if autopilot is None:
        return None
    age_s = now_s - autopilot.received_s
    if age_s > limits.mode_timeout_s:
        return f"mode unknown for {age_s:.1f} s"
    age_s = 0.0 if autopilot.armed_s is None else now_s - autopilot.armed_s
    return f"armed state unknown for {age_s:.1f} s" if age_s > limits.armed_timeout_s else None


def delay_s(link: LinkStatistics | None, late_s: float) -> float:
    """Upper bound of a position's transmission delay; 0 if it is unknown.

    late_s: delay of this position relative to the fastest one, by its own clock. The shortest
    round trip is taken as equal in both directions. Any longer part of a round trip may lie in
    the direction to the companion alone. The position's clock limits that part to late_s.
    """
    if link is None or link.round_trip_s is None:
        return 0.0
    best_s = 0.5 * link.shortest_round_trip_s
    return min(link.round_trip_s - best_s, best_s + late_s)
