"""Life of the link to the autopilot: how old its last packet, its mode and a position are. Pure.

Any packet shows that the autopilot lives; its mode and its armed state have ages of their own.
"""

from __future__ import annotations

from ..config import Supervision
from ..types import LinkStatistics, Telemetry


def silence(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Returns for how long no packet of the autopilot has come; None while that is allowed."""
    autopilot = telemetry.autopilot
    if autopilot is None:
        return "no heartbeat is heard"
    packet_s = autopilot.received_s
    if telemetry.link is not None:
        packet_s = max(packet_s, telemetry.link.received_s)
    age_s = now_s - packet_s
    return f"autopilot silent for {age_s:.1f} s" if age_s > limits.heartbeat_timeout_s else None


def mode_unconfirmed(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Returns for how long mode or armed state have not been told; None while that is allowed."""
    autopilot = telemetry.autopilot
    if autopilot is None:
        return None
    age_s = now_s - autopilot.received_s
    if age_s > limits.mode_timeout_s:
        return f"mode not told for {age_s:.1f} s"
    age_s = 0.0 if autopilot.armed_s is None else now_s - autopilot.armed_s
    return f"armed state not told for {age_s:.1f} s" if age_s > limits.armed_timeout_s else None


def delay_s(link: LinkStatistics | None, late_s: float) -> float:
    """Time that a position was under way, at most; 0 where that is not known.

    late_s: how much later than the fastest position it has come, by the clock in it. A link is
    taken to be equally slow in both directions at its best. Whatever a question and its answer
    take longer than that may be the way back alone; but the position is no later than its clock
    says.
    """
    if link is None or link.round_trip_s is None:
        return 0.0
    best_s = 0.5 * link.shortest_round_trip_s
    return min(link.round_trip_s - best_s, best_s + late_s)
