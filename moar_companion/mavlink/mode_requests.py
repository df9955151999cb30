"""Asking the autopilot for a mode, once, and whose its answer is. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .commands import CommandResult
from .dialect import Message, mavlink

DO_SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
_ANSWER_S = 3.0
"""Both autopilots answer within milliseconds, PX4 twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswered:
    """The autopilot's COMMAND_ACK to a mode that was requested.

    Not the last word: PX4 sends ACCEPTED and 4 ms later TEMPORARILY_REJECTED for OFFBOARD without
    a stream. The mode in the heartbeat is.
    """

    command: int
    result: int


class ModeRequests:
    """Knows which answers are to a request of ours: an autopilot may broadcast another's."""

    def __init__(self) -> None:
        self._requested_s = -math.inf
        self.unanswered = False
        """Whether no COMMAND_ACK has come to the last request."""

    def note_request(self, now_s: float) -> None:
        """A mode is asked for now."""
        self._requested_s = now_s
        self.unanswered = True

    def answered(self, message: Message, now_s: float) -> CommandAnswered | None:
        """What a COMMAND_ACK that was addressed to us, or to everybody, says of the mode."""
        ours = message.command == DO_SET_MODE and now_s - self._requested_s <= _ANSWER_S
        self.unanswered = self.unanswered and not ours
        if not ours or message.result == CommandResult.IN_PROGRESS:
            return None
        return CommandAnswered(command=DO_SET_MODE, result=message.result)
