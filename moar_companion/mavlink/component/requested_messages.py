"""Messages that the companion sends on request. No I/O.

Answers to TIMESYNC and PING. Source: https://mavlink.io/en/services/timesync.html and ping.html.
"""

from __future__ import annotations

from ..dialect import Message, create, mavlink

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PING = int(mavlink.MAVLINK_MSG_ID_PING)
CLOCK_IDS = frozenset({_TIMESYNC, _PING})
"""Messages whose answers measure a round trip: sent at once."""

_ALL = (0, 0)


def clock_answer(
    message: Message, *, ours: tuple[int, int], is_autopilots: bool, now_s: float
) -> Message | None:
    """Returns the answer to TIMESYNC or PING; None if none is due.

    ours: system and component id of the companion. Answered are TIMESYNC requests (tc1 = 0) to the
    companion, the autopilot's to all, and PING without a target.
    """
    source = {
        "target_system": message.get_srcSystem(),
        "target_component": message.get_srcComponent(),
    }
    target = (message.target_system, message.target_component)
    if message.get_msgId() == _PING:
        if target != _ALL:
            return None
        return create("PING", time_usec=message.time_usec, seq=message.seq, **source)
    if message.tc1 != 0 or not (target == ours or (target == _ALL and is_autopilots)):
        return None
    return create("TIMESYNC", tc1=max(1, int(now_s * 1e9)), ts1=message.ts1, **source)
