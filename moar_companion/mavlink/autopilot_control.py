"""Control of the autopilot: setpoints, mode requests, and the answers to these. No I/O."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..types import Vector
from . import modes, translate_outgoing
from .commands import CommandResult
from .dialect import Message, mavlink
from .outbox import Outbox
from .telemetry_receiver import TelemetryReceiver

_DO_SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
_ANSWER_S = 3.0
"""Time after which an answer counts as another sender's: both autopilots answer within
milliseconds, PX4 twice. `companion/mode_requester` repeats its request earlier."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswered:
    """COMMAND_ACK of the autopilot to a requested mode.

    Not final: PX4 sends ACCEPTED and 4 ms later TEMPORARILY_REJECTED for OFFBOARD without a
    stream. The mode in the heartbeat is final.
    """

    command: int
    result: int


class AutopilotControl:
    """Sends setpoints and mode requests, while there is exactly one autopilot to control.

    Matches answers to the requests: an autopilot may broadcast others' answers.
    """

    def __init__(self, receiver: TelemetryReceiver, outbox: Outbox) -> None:
        self._receiver = receiver
        self._outbox = outbox
        self._requested_s = -math.inf
        self.unanswered = False
        """True from a mode request until a COMMAND_ACK answers it."""

    @property
    def allowed(self) -> bool:
        """True while there is exactly one autopilot to control."""
        identity = self._receiver.identity
        return identity.autopilot is not None and identity.conflict is None

    def send_setpoint(
        self, position_ned_m: Vector, velocity_ned_mps: Vector, yaw_rad: float, now_s: float
    ) -> bool:
        """Queues one setpoint to the autopilot; returns False if there is none to control.

        During a conflict a setpoint at rest is still sent, as the last setpoint to the controlled
        autopilot. It carries that autopilot's ids, so that others ignore it (measured). A second
        autopilot with the same ids comes to rest, too, if earlier setpoints have moved it.

        Raises ValueError if a value is not finite.
        """
        autopilot = self._receiver.autopilot
        message = translate_outgoing.setpoint_message(
            target=autopilot.ids if autopilot else (0, 0),
            position_ned_m=position_ned_m,
            velocity_ned_mps=velocity_ned_mps,
            yaw_rad=yaw_rad,
            now_s=now_s,
        )
        if autopilot is None or (any(velocity_ned_mps) and not self.allowed):
            return False
        self._outbox.send(autopilot.link, message)
        return True

    def request_own_mode(self, now_s: float) -> bool:
        """Requests OFFBOARD or GUIDED once; returns False if there is no autopilot to control.

        Never repeated automatically: both autopilots accept it in a failsafe, and cancel that.
        """
        return self._request_mode(modes.own_mode_parameters, now_s)

    def request_land(self, now_s: float) -> bool:
        """Requests the autopilot's LAND mode once; returns False if there is none to control."""
        return self._request_mode(modes.land_parameters, now_s)

    def _request_mode(
        self, parameters_of: Callable[..., tuple[int, int, int] | None], now_s: float
    ) -> bool:
        autopilot = self._receiver.autopilot
        status = self._receiver.telemetry.autopilot
        if autopilot is None or not self.allowed:
            return False
        parameters = parameters_of(autopilot.kind, armed=status is not None and status.armed)
        if parameters is None:
            return False
        self._outbox.send_command(autopilot, _DO_SET_MODE, *parameters)
        self._requested_s = now_s
        self.unanswered = True
        return True

    def answered(self, message: Message, now_s: float) -> CommandAnswered | None:
        """Returns the answer in a COMMAND_ACK addressed to the companion or to all; None: other."""
        ours = message.command == _DO_SET_MODE and now_s - self._requested_s <= _ANSWER_S
        self.unanswered = self.unanswered and not ours
        if not ours or message.result == CommandResult.IN_PROGRESS:
            return None
        return CommandAnswered(command=_DO_SET_MODE, result=message.result)


def commands_motion(message: Message) -> bool:
    """Returns True for a setpoint or a mode request."""
    name: str = message.get_type()
    asks_for_mode = name == "COMMAND_LONG" and message.command == _DO_SET_MODE
    return asks_for_mode or name == "SET_POSITION_TARGET_LOCAL_NED"
