"""Mode requests to the autopilot, sent once, and the match of its answers. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .commands import CommandResult
from .dialect import Message, mavlink

DO_SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
_ANSWER_S = 3.0
"""Time for an answer: both autopilots answer within milliseconds, PX4 twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswered:
    """COMMAND_ACK of the autopilot to a requested mode.

    Not final: PX4 sends ACCEPTED and 4 ms later TEMPORARILY_REJECTED for OFFBOARD without a
    stream. The mode in the heartbeat is final.
    """

    command: int
    result: int


class ModeRequests:
    """Matches answers to the companion's requests: an autopilot may broadcast others' answers."""

    def __init__(self) -> None:
        self._requested_s = -math.inf
        self.unanswered = False
        """True from a request until a COMMAND_ACK answers it."""

    def note_request(self, now_s: float) -> None:
        """Records a mode request sent now."""
        self._requested_s = now_s
        self.unanswered = True

    def answered(self, message: Message, now_s: float) -> CommandAnswered | None:
        """Returns the answer in a COMMAND_ACK addressed to the companion or to all; None: other."""
        ours = message.command == DO_SET_MODE and now_s - self._requested_s <= _ANSWER_S
        self.unanswered = self.unanswered and not ours
        if not ours or message.result == CommandResult.IN_PROGRESS:
            return None
        return CommandAnswered(command=DO_SET_MODE, result=message.result)
