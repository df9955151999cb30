"""Under `engage`: when the companion itself asks for its mode, or for LAND."""

from __future__ import annotations

from ..config import Authority
from ..mavlink.session import Session
from ..mission.states import IN_CONTROL, MissionState
from ..mission.values import MissionStatus
from ..types import AutopilotStatus

_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""
_FRESH_S = 0.1
"""A mode that was told longer ago may not be the mode any more: PX4 tells it once a second."""
_LAND = "LAND"


class Engaging:
    """Asks once, and only while a heartbeat has just shown the mode that may be taken.

    An order may take the mode that it was given in, and no other; not out of a failsafe, a return
    or a landing, which both autopilots would let it end; and not from a pilot who has taken over
    from us or from a failsafe, until he has given the mode himself or has landed.
    """

    def __init__(self, authority: Authority, session: Session, *, pilot_flies: bool) -> None:
        """pilot_flies: whether he may have taken over before this process began."""
        self._allowed = authority is Authority.ENGAGE
        self._session = session
        self._in_mode: str | None = None
        self._pilot_flies = pilot_flies
        self._landing_due = False
        self._landing_asked = False
        """In the last thought, which may not have been sent."""
        self._landing_requested = False

    def is_landing(self, autopilot: AutopilotStatus | None) -> bool:
        """Whether the autopilot is in the landing that we asked for."""
        return self._landing_requested and autopilot is not None and autopilot.mode == _LAND

    def note_order(self, autopilot: AutopilotStatus | None, before: MissionState) -> None:
        """A mission was ordered and is being planned. before: the state in which it was."""
        self._pilot_flies = self._pilot_flies or before is MissionState.OVERRIDDEN
        may = self._allowed and not self._pilot_flies
        fit = autopilot is not None and not autopilot.failsafe and not autopilot.homeward
        self._in_mode = autopilot.mode if may and fit and autopilot is not None else None

    def note_landing(self) -> None:
        """The mission ends above its landing point."""
        self._landing_due = self._allowed

    def note_sent(self) -> None:
        """What the last thought asked for has left."""
        if self._landing_asked:
            self._landing_due = self._landing_asked = False
            self._landing_requested = True

    def act(
        self,
        status: MissionStatus,
        autopilot: AutopilotStatus | None,
        *,
        grounded: bool,
        now_s: float,
    ) -> None:
        """Look at who flies, and ask for what is due; at the end of every thought."""
        self._landing_asked = False
        if autopilot is None:
            return
        pilots = not (autopilot.ours or autopilot.homeward or autopilot.failsafe)
        if status.state is MissionState.OVERRIDDEN:
            self._pilot_flies = True
        elif status.state is MissionState.RELEASED:
            self._pilot_flies = self._pilot_flies or pilots
        if status.state in IN_CONTROL or grounded:
            self._pilot_flies = False
        if status.state is not MissionState.HOLDING:
            self._landing_due = self._landing_requested = False
        if now_s - autopilot.received_s > _FRESH_S:
            return
        if self._landing_due and autopilot.ours:
            self._landing_asked = self._session.request_land()
        if self._may_take(status, autopilot, now_s):
            self._session.request_own_mode()

    def _may_take(self, status: MissionStatus, autopilot: AutopilotStatus, now_s: float) -> bool:
        """Whether to ask for our mode now; at most once for an order."""
        if (
            self._in_mode is None
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
