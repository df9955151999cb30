"""The gimbal, by the gimbal protocol v2: found, control taken and given back, pointed. No I/O.

Its manager is the autopilot (PX4's gimbal module, ArduPilot's mount), or a component of its own.
Control is taken from nobody: while another holds it, as a camera operator's ground station, the
companion sends nothing. Managers differ in this: PX4 obeys the holder alone, ArduPilot everybody.
ArduPilot does not report a pilot who moves its mount by the remote control.

Angles of yaw are sent relative to the aircraft's heading: all gimbals have this frame, and PX4's
servo output turns an angle from north into it only with MNT_DO_STAB. Roll and pitch stay level.

Source: https://mavlink.io/en/services/gimbal_v2.html; AP_Mount (4.6), PX4's gimbal module (v1.17).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .commands import CommandResult
from .dialect import Message, mavlink
from .sent_command import SentCommand

_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_COMMAND_ACK = int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
_INFORMATION = int(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION)
_STATUS = int(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS)
_ATTITUDE = int(mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS)
MESSAGE_IDS = frozenset({_INFORMATION, _STATUS, _ATTITUDE})
"""Messages that are read of gimbals alone."""
RATES_HZ = {_STATUS: 2.0, _ATTITUDE: 10.0}
"""Wanted rates while views are flown; unasked PX4 sends them at 0.5 and 1 Hz."""

GIMBAL_IDS = frozenset(
    {
        mavlink.MAV_COMP_ID_GIMBAL,
        *range(mavlink.MAV_COMP_ID_GIMBAL2, mavlink.MAV_COMP_ID_GIMBAL6 + 1),
    }
)
_REQUEST_MESSAGE = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_SET_INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_CONFIGURE = int(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE)
_PITCH_YAW = int(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW)
_LEVEL = float(mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK)
_UNCHANGED, _RELEASED = -1.0, -3.0
"""Ids in DO_GIMBAL_MANAGER_CONFIGURE: control stays as it is; is given back, if it is ours."""

_HEARTBEATS_S = 2.5
"""Wait for a gimbal's heartbeat at 1 Hz, of which one may be lost; then the autopilot is asked."""
_STATUS_MAX_AGE_S = 4.0
"""Age of GIMBAL_MANAGER_STATUS above which its holder is unknown: two periods of PX4's own rate."""
_ASK_PERIOD_S = 1.0
_ATTITUDE_MAX_AGE_S = 2.0
"""Age above which the attitude is unknown: two periods of PX4's own rate."""
_POINT_PERIOD_S = 0.2
_POINT_AGAIN_S = 1.0
_UNIT_TOLERANCE = 0.05
_TURNED_RAD = math.radians(0.2)
"""Change of the angles that is sent at once; a smaller one with the next repeat."""


class Control(enum.Enum):
    """Holder of the gimbal, as far as the companion is concerned."""

    UNKNOWN = "unknown"
    """The search has not ended, or its manager is silent."""
    NO_GIMBAL = "no gimbal"
    FREE = "free"
    OURS = "ours"
    OTHERS = "others"


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalAttitude:
    """Direction of the camera. yaw_rad: to the right of the aircraft's nose, or from north.

    by_servos: True where the autopilot drives the gimbal. ArduPilot's mount of servos, and PX4's
    with MNT_DO_STAB, then report the angles of the servos, from the body and not from the horizon.
    """

    received_s: float
    pitch_rad: float
    yaw_rad: float
    from_north: bool
    by_servos: bool = False

    def heading_rad(self, aircraft_yaw_rad: float) -> float:
        """Heading of the camera from north."""
        return self.yaw_rad if self.from_north else self.yaw_rad + aircraft_yaw_rad


class GimbalClient:
    """Finds the gimbal's manager once it is wanted, and points the gimbal while it has control."""

    def __init__(self) -> None:
        self.manager: tuple[str, tuple[int, int]] | None = None
        """Link and ids of the manager; None while none is known."""
        self.holder: tuple[int, int] | None = None
        """System and component that have control; zeros: nobody. None while unknown."""
        self._attitude: GimbalAttitude | None = None
        self._wanted_s: float | None = None
        self._heard: dict[int, str] = {}
        """Links of the gimbals that were received, by component id."""
        self._asked: SentCommand | None = None
        self._none = False
        self._device_id = 0
        self._status_s = -math.inf
        self._ask_s = -math.inf
        self._configure: SentCommand | None = None
        self._takes = False
        """True while control is wanted."""
        self._autopilot: tuple[int, int] | None = None
        self._angles_deg: tuple[float, float] | None = None
        self._sent_deg: tuple[float, float] | None = None
        self._sent_s = -math.inf

    def want(self, now_s: float) -> None:
        """Starts the search for a gimbal; again where a gimbal was received since."""
        if self._wanted_s is None or (self._none and self._heard):
            self._wanted_s, self._asked, self._none = now_s, None, False

    def control(self, ours: tuple[int, int], now_s: float) -> Control:
        """Holder of the gimbal."""
        if self._none:
            return Control.NO_GIMBAL
        if self.holder is None or now_s > self._status_s + _STATUS_MAX_AGE_S:
            return Control.UNKNOWN
        if self.holder == ours:
            return Control.OURS
        return Control.OTHERS if any(self.holder) else Control.FREE

    def attitude(self, now_s: float) -> GimbalAttitude | None:
        """Direction of the camera; None while it is not reported."""
        known = self._attitude
        if known is None or now_s > known.received_s + _ATTITUDE_MAX_AGE_S:
            return None
        return known

    # Orders

    def take(self) -> None:
        """Takes control as soon as nobody has it."""
        self._takes = True

    def point(self, pitch_rad: float, yaw_rad: float) -> None:
        """Points the camera, while the companion has control.

        pitch_rad: up from the horizon. yaw_rad: to the right of the aircraft's nose.
        """
        self._angles_deg = (math.degrees(pitch_rad), math.degrees(yaw_rad))

    def rest(self) -> None:
        """Leaves the camera as it points."""
        self._angles_deg = self._sent_deg = None

    def give_back(self) -> None:
        """Gives control back, if it is ours; repeated until it is acknowledged."""
        self.rest()
        if self._takes and self.manager is not None:
            self._configure = self._configuration(_RELEASED, _RELEASED)
        self._takes = False

    # In

    def handle(self, message: Message, link: str, ours: tuple[int, int], now_s: float) -> None:
        """Takes a message of any component of the autopilot's system."""
        message_id, component = message.get_msgId(), message.get_srcComponent()
        source = (message.get_srcSystem(), component)
        if message_id == _HEARTBEAT:
            if component in GIMBAL_IDS:
                self._heard[component] = link
        elif message_id == _INFORMATION:
            if self._asked is not None and source == self._asked.target and not self._none:
                self.manager, self._device_id = (link, source), message.gimbal_device_id
        elif message_id == _COMMAND_ACK:
            for command in (self._asked, self._configure):
                if command is not None and command.answered(message, ours, now_s):
                    self._ask_s = -math.inf  # of the holder, at once
        elif message_id == _ATTITUDE and component in self._devices:
            self._take_attitude(message, now_s)
        elif message_id == _STATUS and self.manager is not None and source == self.manager[1]:
            self.holder = (message.primary_control_sysid, message.primary_control_compid)
            self._status_s = now_s

    @property
    def _devices(self) -> set[int]:
        """Component ids that report the attitude: of the manager, and of the device it names."""
        return set() if self.manager is None else {self.manager[1][1], self._device_id}

    def _take_attitude(self, message: Message, now_s: float) -> None:
        if not abs(math.hypot(*message.q) - 1.0) <= _UNIT_TOLERANCE:
            return  # no number, or zeros: not known
        pitch_rad, yaw_rad = _pitch_and_yaw_rad(message.q)
        self._attitude = GimbalAttitude(
            received_s=now_s,
            pitch_rad=pitch_rad,
            yaw_rad=yaw_rad,
            from_north=_is_from_north(message.flags),
            by_servos=self.manager is not None and self.manager[1] == self._autopilot,
        )

    # Out

    def due(
        self, autopilot: tuple[str, tuple[int, int]], ours: tuple[int, int], now_s: float
    ) -> Iterable[tuple[str, Message]]:
        """Packets that are due now, each with its link. autopilot: its link and ids."""
        self._autopilot = autopilot[1]
        if self._wanted_s is None or self._none:
            return []
        if self.manager is None:
            return self._search(autopilot, now_s)
        link, ids = self.manager
        messages: list[Message] = []
        if now_s >= self._ask_s + _ASK_PERIOD_S and now_s > self._status_s + _ASK_PERIOD_S:
            self._ask_s = now_s
            messages += SentCommand(ids, _REQUEST_MESSAGE, float(_STATUS)).due(now_s)
            if ids != autopilot[1]:
                for message_id, rate_hz in RATES_HZ.items():
                    interval_us = round(1e6 / rate_hz)
                    rate = SentCommand(ids, _SET_INTERVAL, float(message_id), float(interval_us))
                    messages += rate.due(now_s)
        control = self.control(ours, now_s)
        if self._takes and control is Control.FREE and self._may_configure(now_s):
            self._configure = self._configuration(float(ours[0]), float(ours[1]))
        elif not self._takes and control is Control.OURS and self._may_configure(now_s):
            # The order to give it back was lost, or the companion was restarted meanwhile.
            self._configure = self._configuration(_RELEASED, _RELEASED)
        if self._configure is not None:
            messages += self._configure.due(now_s)
        if control is Control.OURS:
            messages += self._pointing(ids, now_s)
        return [(link, message) for message in messages]

    def _may_configure(self, now_s: float) -> bool:
        """True where control may be asked for: not while an answer is awaited, or just came."""
        asked = self._configure
        if asked is None:
            return True
        return asked.unanswered(now_s) or now_s >= asked.answered_s + _ASK_PERIOD_S > 0.0

    def _pointing(self, ids: tuple[int, int], now_s: float) -> list[Message]:
        angles, sent = self._angles_deg, self._sent_deg
        if angles is None:
            return []
        turned = sent is None or math.dist(angles, sent) > math.degrees(_TURNED_RAD)
        if now_s < self._sent_s + (_POINT_PERIOD_S if turned else _POINT_AGAIN_S):
            return []
        self._sent_deg, self._sent_s = angles, now_s
        device = float(self._device_id)
        rates = (math.nan, math.nan)
        return SentCommand(ids, _PITCH_YAW, *angles, *rates, _LEVEL, 0.0, device).due(now_s)

    def _search(
        self, autopilot: tuple[str, tuple[int, int]], now_s: float
    ) -> list[tuple[str, Message]]:
        """Asks the gimbal with the lowest id, else the autopilot, for its manager's information."""
        assert self._wanted_s is not None
        if self._asked is None:
            if now_s < self._wanted_s + _HEARTBEATS_S and not self._heard:
                return []
            self._asked = self._question(autopilot, own=bool(self._heard))
        asked = self._asked
        of_autopilot = asked.target == autopilot[1]
        if self._is_denied(asked, now_s):
            if of_autopilot:
                self._none = True
                return []
            self._asked = asked = self._question(autopilot, own=False)
            of_autopilot = True
        link = autopilot[0] if of_autopilot else self._heard[asked.target[1]]
        return [(link, message) for message in asked.due(now_s)]

    def _question(self, autopilot: tuple[str, tuple[int, int]], *, own: bool) -> SentCommand:
        ids = (autopilot[1][0], min(self._heard)) if own else autopilot[1]
        return SentCommand(ids, _REQUEST_MESSAGE, float(_INFORMATION))

    @staticmethod
    def _is_denied(asked: SentCommand, now_s: float) -> bool:
        """True if no information will come: denied, silent, or accepted and lost.

        A denial may be that of another message: the autopilot answers alike to all requests.
        """
        if asked.result in {None, CommandResult.IN_PROGRESS}:
            return asked.unanswered(now_s)
        return now_s >= asked.answered_s + _ASK_PERIOD_S

    def _configuration(self, system: float, component: float) -> SentCommand:
        assert self.manager is not None
        return SentCommand(
            self.manager[1],
            _CONFIGURE,
            system,
            component,
            _UNCHANGED,
            _UNCHANGED,
            0.0,
            0.0,
            float(self._device_id),
        )


def _pitch_and_yaw_rad(q: Sequence[float]) -> tuple[float, float]:
    """Pitch and yaw of the x axis of a quaternion (w, x, y, z), in a frame with z down."""
    w, x, y, z = q
    forward = (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y + w * z),
        2.0 * (x * z - w * y),
    )
    return math.atan2(-forward[2], math.hypot(*forward[:2])), math.atan2(forward[1], forward[0])


def _is_from_north(flags: int) -> bool:
    """True if the attitude's yaw is from north.

    Gimbals that name no frame tell it by the lock of their yaw.
    """
    if flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME:
        return False
    if flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME:
        return True
    return bool(flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK)
