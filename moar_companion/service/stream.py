"""The stream: setpoints in the autopilot's frame, and the mode that makes them count."""

from __future__ import annotations

from dataclasses import replace

from ..config import Authority
from ..frames import PlaneToLocal
from ..mavlink.session import Session
from ..mission.machine import IN_CONTROL, MissionState, MissionStatus
from ..types import AutopilotStatus, Vector
from .flight import Setpoint

_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""


class Stream:
    """Sends setpoints, and remembers the last one for the farewell."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._last: Setpoint | None = None

    def send(self, setpoint: Setpoint, plane: PlaneToLocal, now_s: float) -> None:
        """A setpoint of the site's frame, as SET_POSITION_TARGET_LOCAL_NED."""
        self._last = setpoint
        self._session.send_setpoint(
            plane.position_to_ned(setpoint.position_m),
            plane.velocity_to_ned(setpoint.velocity_mps),
            setpoint.yaw_rad,
            now_s,
        )

    def shift(self, jump_m: Vector) -> None:
        """The aircraft's position has jumped: what was sent last jumps with it."""
        if self._last is not None:
            x_m, y_m, z_m = (
                old + step for old, step in zip(self._last.position_m, jump_m, strict=True)
            )
            self._last = replace(self._last, position_m=(x_m, y_m, z_m))

    def send_farewell(self, plane: PlaneToLocal | None, now_s: float) -> None:
        """The last setpoint before silence: where the one before was, at rest."""
        if self._last is not None and plane is not None:
            self.send(replace(self._last, velocity_mps=(0.0, 0.0, 0.0)), plane, now_s)


class Engaging:
    """Under `engage`: when the companion itself may ask for its mode.

    An order may take the mode that it was given in, and no other; not out of a failsafe; and not
    from a pilot who has overridden us, until he has given the mode himself or has landed.
    """

    def __init__(self, authority: Authority) -> None:
        self._allowed = authority is Authority.ENGAGE
        self._in_mode: str | None = None
        self._pilot_flies = False

    def look(self, status: MissionStatus, *, grounded: bool) -> None:
        """Notice a pilot who has taken over, and that he has given back."""
        if status.state is MissionState.OVERRIDDEN:
            self._pilot_flies = True
        elif status.state in IN_CONTROL or grounded:
            self._pilot_flies = False

    def note_order(self, autopilot: AutopilotStatus | None) -> None:
        """A mission was ordered and is being planned."""
        may = self._allowed and not self._pilot_flies
        fit = autopilot is not None and not autopilot.failsafe
        self._in_mode = autopilot.mode if may and fit and autopilot is not None else None

    def is_due(
        self, autopilot: AutopilotStatus | None, status: MissionStatus, now_s: float
    ) -> bool:
        """Whether to ask now; at most once for an order."""
        if (
            self._in_mode is None
            or autopilot is None
            or status.state is not MissionState.READY
            or status.held
            or now_s - status.since_s < _ENGAGE_AFTER_S
        ):
            return False
        # After a take-off PX4 goes over to HOLD by itself, and says so up to a second later.
        same = autopilot.mode == self._in_mode
        took_off = (self._in_mode, autopilot.mode) == ("TAKEOFF", "HOLD")
        self._in_mode = None
        return (same or took_off) and not autopilot.failsafe
