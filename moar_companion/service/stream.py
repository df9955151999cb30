"""The stream: setpoints in the autopilot's frame, and the mode that makes them count."""

from __future__ import annotations

from ..config import Authority
from ..frames import PlaneToLocal
from ..mavlink.session import Session
from ..mission.machine import MissionState, MissionStatus
from ..types import AutopilotStatus, Vector
from .flight import Setpoint

_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""


class Stream:
    """Sends setpoints, and remembers the last one for the farewell."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._last_sent: tuple[Vector, float] | None = None

    def send(self, setpoint: Setpoint, plane: PlaneToLocal, now_s: float) -> None:
        """A setpoint of the site's frame, as SET_POSITION_TARGET_LOCAL_NED."""
        position_ned_m = plane.position_to_ned(setpoint.position_m)
        velocity_ned_mps = plane.velocity_to_ned(setpoint.velocity_mps)
        self._last_sent = (position_ned_m, setpoint.yaw_rad)
        self._session.send_setpoint(position_ned_m, velocity_ned_mps, setpoint.yaw_rad, now_s)

    def send_farewell(self, now_s: float) -> None:
        """The last setpoint before silence: where the one before was, at rest."""
        if self._last_sent is not None:
            position_ned_m, yaw_rad = self._last_sent
            self._session.send_setpoint(position_ned_m, (0.0, 0.0, 0.0), yaw_rad, now_s)


class Engaging:
    """Under `engage`: when the companion itself may ask for its mode.

    An order may take the mode that it was given in, and no other; not from a pilot who has
    overridden us, and not out of a failsafe: there the mode must be given, whatever is ordered.
    """

    def __init__(self, authority: Authority) -> None:
        self._allowed = authority is Authority.ENGAGE
        self._in_mode: str | None = None

    def note_order(self, autopilot: AutopilotStatus | None, status: MissionStatus) -> None:
        """A mission was ordered."""
        self._in_mode = (
            autopilot.mode
            if self._allowed
            and autopilot is not None
            and not autopilot.failsafe
            and status.state is not MissionState.OVERRIDDEN
            else None
        )

    def is_due(
        self, autopilot: AutopilotStatus | None, status: MissionStatus, now_s: float
    ) -> bool:
        """Whether to ask now; at most once for an order."""
        if (
            self._in_mode is None
            or autopilot is None
            or status.state is not MissionState.READY
            or now_s - status.since_s < _ENGAGE_AFTER_S
        ):
            return False
        # After a take-off PX4 goes over to HOLD by itself, and says so up to a second later.
        same = autopilot.mode == self._in_mode
        took_off = (self._in_mode, autopilot.mode) == ("TAKEOFF", "HOLD")
        self._in_mode = None
        return (same or took_off) and not autopilot.failsafe
