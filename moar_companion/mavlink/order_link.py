"""Link for orders that arrive outside MAVLink, as packets made from them. No I/O.

Such an order is judged, recorded and answered as one of a ground station. Its answer is a
COMMAND_ACK, and a STATUSTEXT with the reason.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from .codec import Codec
from .commands import ORDERS, CommandResult
from .dialect import create, mavlink

_SYSTEM, _COMPONENT = 255, int(mavlink.MAV_COMP_ID_UDP_BRIDGE)
"""Ids of a ground station that differ from those of ground stations with a display."""
_ANY = -1.0
_WANTED = frozenset(
    {int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK), int(mavlink.MAVLINK_MSG_ID_STATUSTEXT)}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderAnswer:
    """Answer to an order. order_id: as given to `packet`. reason: empty where none was sent."""

    order_id: str
    result: CommandResult
    reason: str = ""


class OrderLink:
    """Orders to packets, and the companion's packets to answers.

    An acknowledgement carries the number of the command alone: it is for the last order of that
    number. The earlier one then has no answer, and is CANCELLED.
    """

    def __init__(self, component_id: int) -> None:
        self._target = component_id
        self._codec = Codec(system_id=_SYSTEM, component_id=_COMPONENT, wanted=_WANTED)
        self._open: dict[int, str] = {}
        """Last order by the number of its command."""
        self._superseded: list[OrderAnswer] = []

    def packet(self, order_id: str, word: str, index: int | None) -> bytes:
        """Packet of an order. word: a mission, hold, release, pause or continue."""
        command, param1 = ORDERS[word]
        before = self._open.get(command)
        if before is not None:
            cancelled = CommandResult.CANCELLED
            reason = "another order came before its answer"
            self._superseded.append(OrderAnswer(order_id=before, result=cancelled, reason=reason))
        self._open[command] = order_id
        message = create(
            "COMMAND_LONG",
            target_system=0,
            target_component=self._target,
            command=command,
            confirmation=0,
            param1=param1,
            param2=_ANY if index is None else float(index),
            **{f"param{number}": 0.0 for number in range(3, 8)},
        )
        return self._codec.encode(message)

    def answers(self, packets: Iterable[bytes]) -> list[OrderAnswer]:
        """Answers in the packets of a cycle; a reason comes in the same cycle, after its answer."""
        answers, self._superseded = self._superseded, []
        without_reason: list[int] = []
        """Places of the answers whose reason has not come yet, in the order of arrival."""
        for message in self._codec.receive(b"".join(packets)):
            if message.get_msgId() == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                text = message.text.rstrip("\0")
                place = next((at for at in without_reason if _ends(text, answers[at].result)), None)
                if place is not None:
                    answers[place] = replace(answers[place], reason=text)
                    without_reason.remove(place)
            elif (message.target_system, message.target_component) == (_SYSTEM, _COMPONENT):
                command, result = message.command, CommandResult(message.result)
                progress = result is CommandResult.IN_PROGRESS
                order_id = self._open.get(command) if progress else self._open.pop(command, None)
                if order_id is not None:
                    without_reason.append(len(answers))
                    answers.append(OrderAnswer(order_id=order_id, result=result))
        return answers


def _ends(text: str, result: CommandResult) -> bool:
    """True if a text ends in the result's word, as `OperatorCommands.report_reason` writes it."""
    return text.endswith(f", {result.name.rpartition('_')[2].lower()}")
