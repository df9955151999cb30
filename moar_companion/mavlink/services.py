"""What any component answers at once when it is asked: TIMESYNC and PING. Pure.

Sources: https://mavlink.io/en/services/timesync.html and .../ping.html.
"""

from __future__ import annotations

from .dialect import Message, create, mavlink
from .limits import SenderLimit

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PING = int(mavlink.MAVLINK_MSG_ID_PING)

MESSAGE_IDS: frozenset[int] = frozenset({_TIMESYNC, _PING})
"""The messages that may be answered."""

_ALL = (0, 0)


def answer_limit() -> SenderLimit:
    """Limit of the answers to all but the autopilot: 5 a second for a sender, 20 for a link."""
    return SenderLimit(burst=5, rate_hz=5.0, link_burst=20, link_rate_hz=20.0)


def answer(
    message: Message, *, ours: tuple[int, int], autopilot: tuple[int, int] | None, now_s: float
) -> Message | None:
    """The answer to a request, for the link it came on; None when none is due.

    ours, autopilot: system and component ids. Answered are TIMESYNC requests (tc1 = 0) to us, and
    the autopilot's to all; PING without a target.
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
