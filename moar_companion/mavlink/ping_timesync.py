"""Immediate answers of any component: TIMESYNC and PING. Pure.

Sources: https://mavlink.io/en/services/timesync.html and .../ping.html.
"""

from __future__ import annotations

from .dialect import Message, create, mavlink
from .rate_limits import SenderLimit

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PING = int(mavlink.MAVLINK_MSG_ID_PING)

MESSAGE_IDS: frozenset[int] = frozenset({_TIMESYNC, _PING})
"""Messages that may get an answer."""

_ALL = (0, 0)


def answer_limit() -> SenderLimit:
    """Limit of answers, except to the autopilot: 5 a second for a sender, 20 for a link."""
    return SenderLimit(burst=5, rate_hz=5.0, link_burst=20, link_rate_hz=20.0)


def answer(
    message: Message, *, ours: tuple[int, int], autopilot: tuple[int, int] | None, now_s: float
) -> Message | None:
    """Returns the answer to a request, for its link; None if none is due.

    ours (the companion's), autopilot: system and component ids. Answered are TIMESYNC requests
    (tc1 = 0) to the companion, the autopilot's to all, and PING without a target.
    """
    source = (message.get_srcSystem(), message.get_srcComponent())
    message_id = message.get_msgId()
    if message_id == _TIMESYNC and message.tc1 == 0:
        target = (message.target_system, message.target_component)
        if target == ours or (target == _ALL and source == autopilot):
            return create(
                "TIMESYNC",
                tc1=max(1, int(now_s * 1e9)),
                ts1=message.ts1,
                target_system=source[0],
                target_component=source[1],
            )
    if message_id == _PING and (message.target_system, message.target_component) == _ALL:
        return create(
            "PING",
            time_usec=message.time_usec,
            seq=message.seq,
            target_system=source[0],
            target_component=source[1],
        )
    return None
