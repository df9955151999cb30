"""A command to a component, repeated until it is acknowledged. No I/O.

Source: https://mavlink.io/en/services/command.html: a repeat has the next `confirmation`.
"""

from __future__ import annotations

import math

from .commands import CommandResult
from .dialect import Message
from .translate_outgoing import command_message

_PERIOD_S = 0.7
"""Time until a repeat: a link with delays of 0.2 s each way has answered."""
_MOST = 4
"""Of four on a link that loses 30 % each way, one is answered except for one time in 15."""
_PROGRESS_S = 5.0
"""Wait after IN_PROGRESS, from the last such answer."""


class SentCommand:
    """COMMAND_LONG to a system and component id.

    result: of its last answer; None while there is none.
    """

    def __init__(
        self, target: tuple[int, int], command: int, *parameters: float, most: int = _MOST
    ) -> None:
        self.target = target
        self.command = command
        self.parameters = parameters
        self.result: CommandResult | None = None
        self.first_s: float | None = None
        """Time of its first packet; None before that."""
        self.answered_s = -math.inf
        self._most = most
        self._sent = 0
        self._due_s = -math.inf

    def due(self, now_s: float) -> list[Message]:
        """The packet that is due now, or none."""
        if self.result is not None or self._sent == self._most or now_s < self._due_s:
            return []
        message = command_message(
            target=self.target,
            command=self.command,
            parameters=self.parameters,
            confirmation=self._sent,
        )
        self.first_s = now_s if self.first_s is None else self.first_s
        self._sent += 1
        self._due_s = now_s + _PERIOD_S
        return [message]

    def unanswered(self, now_s: float) -> bool:
        """True once no answer came to the last packet, or to IN_PROGRESS no final one."""
        if self.result is CommandResult.IN_PROGRESS:
            return now_s >= self.answered_s + _PROGRESS_S
        return self.result is None and self._sent == self._most and now_s >= self._due_s

    def answered(self, message: Message, ours: tuple[int, int], now_s: float) -> bool:
        """Takes a COMMAND_ACK; True if it answers this command of the companion."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        addressed = (message.target_system, message.target_component) in {(0, 0), ours}
        open_ = self.result in {None, CommandResult.IN_PROGRESS} and self._sent > 0
        if not (open_ and addressed and source == self.target and message.command == self.command):
            return False
        try:
            self.result = CommandResult(message.result)
        except ValueError:
            self.result = CommandResult.FAILED  # MAV_RESULT has grown since
        self.answered_s = now_s
        return True
