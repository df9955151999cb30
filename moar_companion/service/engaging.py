"""Under `engage`: when the companion itself asks for its mode, or for LAND."""

from __future__ import annotations

import math

from ..config import Authority
from ..mavlink.session import Session, Severity
from ..mission.states import IN_CONTROL, MissionState
from ..mission.values import MissionStatus
from ..types import AutopilotKind, AutopilotStatus, Telemetry
from .autopilot_failsafe import took_mode
from .reports import Reports
from .surroundings import grounded

_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""
_OFFERING = {MissionState.PLANNING, MissionState.READY}
"""What an order is in until its flight begins."""
_FRESH_S = 0.1
"""A mode that was told longer ago may not be the mode any more: PX4 tells it once a second."""
_AGAIN_S = 1.0
"""Both autopilots answer within milliseconds, and PX4 tells its mode once a second."""
_MOST_REQUESTS = 3
_LAND = "LAND"
_LAND_AGAIN_S = 3.0
"""A landing that the link has carried is told by the heartbeat of the next second."""
_MOST_LANDINGS = 3
"""Asked for so often in vain, it is the pilot's."""


class Engaging:
    """Asks only while a heartbeat has just shown the mode that may be taken.

    For its mode once, and twice more while nothing answers, since the link may lose it. An order
    may take the mode that it was given in, and no other; not out of a failsafe, a return or a
    landing, which both autopilots would let it end; and not from a pilot who has taken over from us
    or from a failsafe, until he has given the mode himself or has landed. A release that ends an
    offered hold takes nothing over: the mode was the pilot's all along. Whoever orders where the
    mode will not be asked for is told so.

    For LAND a few times, since the link may lose it; not while the plan of another order is
    awaited, nor after one was carried out, a hold too.
    """

    def __init__(
        self, authority: Authority, session: Session, reports: Reports, *, pilot_flies: bool
    ) -> None:
        """pilot_flies: whether he may have taken over before this process began."""
        self._allowed = authority is Authority.ENGAGE
        self._session = session
        self._reports = reports
        self._in_mode: str | None = None
        self._requests = 0
        """For the mode of the order, the last of them at `_requested_s`."""
        self._requested_s = -math.inf
        self._pilot_flies = pilot_flies
        self._had_control = False
        """Whether the mission has been in control since the aircraft was last on the ground."""
        self._autopilots = False
        """Whether a failsafe, a return or a landing was seen since then while nothing was flown."""
        self._landing_due = False
        self._landing_asked_s: float | None = None
        """In the last thought, which may not have been sent."""
        self._landing_sent_s = -math.inf
        self._landings_sent = 0
        self._lands = False
        """The landing that we asked for has begun, and has not been flown to its end."""

    def is_landing(self, autopilot: AutopilotStatus | None, now_s: float) -> bool:
        """Whether the autopilot begins the landing that we asked for."""
        asked = self._landings_sent > 0 and now_s - self._landing_sent_s <= _LAND_AGAIN_S
        return asked and autopilot is not None and autopilot.mode == _LAND

    def note_order(
        self, autopilot: AutopilotStatus | None, before: MissionState, now_s: float
    ) -> None:
        """A mission was ordered and is being planned. before: the state in which it was."""
        self._requests, self._requested_s = 0, -math.inf
        self._pilot_flies = self._pilot_flies or before is MissionState.OVERRIDDEN
        may = self._allowed and not self._pilot_flies
        fit = autopilot is not None and not took_mode(autopilot) and not autopilot.homeward
        self._in_mode = autopilot.mode if may and fit and autopilot is not None else None
        if self._allowed and self._in_mode is None:
            self._tell_waiting(autopilot, now_s)

    def _tell_waiting(self, autopilot: AutopilotStatus | None, now_s: float) -> None:
        """Tell people that our mode will not be asked for: they must give it."""
        if autopilot is None or autopilot.ours:
            return
        own = "OFFBOARD" if autopilot.kind is AutopilotKind.PX4 else "GUIDED"
        reason = f"{autopilot.mode} is kept"
        self._reports.say(Severity.WARNING, reason, now_s, action=f"waiting for {own}", news=True)

    def note_landing(self) -> None:
        """The mission ends above its landing point."""
        self._landing_due = self._allowed

    def forget_landing(self) -> None:
        """An operator's order is carried out: whoever gave it wants no landing now."""
        self._landing_due = False

    def note_sent(self) -> None:
        """What the last thought asked for has left."""
        if self._landing_asked_s is not None:
            self._landing_sent_s, self._landing_asked_s = self._landing_asked_s, None
            self._landings_sent += 1

    def act(
        self, status: MissionStatus, telemetry: Telemetry, *, at_end: bool, now_s: float
    ) -> None:
        """Look at who flies, and ask for what is due; at the end of every thought.

        at_end: whether the aircraft is where its mission ends.
        """
        autopilot = telemetry.autopilot
        self._landing_asked_s = None
        self._lands = self._lands or self.is_landing(autopilot, now_s)
        if status.state not in _OFFERING:
            self._in_mode = None
        if status.state is not MissionState.HOLDING:
            self._landing_due, self._landings_sent = False, 0
        if autopilot is None:
            return
        pilots = not (autopilot.ours or autopilot.homeward or took_mode(autopilot))
        in_control = status.state in IN_CONTROL
        if status.state is MissionState.OVERRIDDEN:
            self._pilot_flies = True
        elif status.state in _OFFERING or status.state is MissionState.RELEASED or self._lands:
            released = status.state not in _OFFERING or self._lands
            self._autopilots = self._autopilots or not (pilots or autopilot.ours)
            taken_over = self._autopilots or (released and self._had_control)
            self._pilot_flies = self._pilot_flies or (pilots and taken_over)
        if in_control or grounded(telemetry):
            self._pilot_flies = self._lands = self._autopilots = False
            self._had_control = in_control
        if now_s - autopilot.received_s > _FRESH_S:
            return
        if self._landing_due and autopilot.ours and at_end and status.sought is None:
            self._ask_for_landing(now_s)
        if self._may_take(status, autopilot, now_s):
            self._requests, self._requested_s = self._requests + 1, now_s
            self._session.request_own_mode()

    def _ask_for_landing(self, now_s: float) -> None:
        """Ask for LAND, and again where the link may have lost it; at last tell people."""
        if self._landings_sent and now_s - self._landing_sent_s < _LAND_AGAIN_S:
            return
        if self._landings_sent < _MOST_LANDINGS:
            self._landing_asked_s = now_s if self._session.request_land() else None
            return
        self._landing_due = False
        words = "the landing has not begun, choose LAND"
        self._reports.say(Severity.WARNING, words, now_s)

    def _may_take(self, status: MissionStatus, autopilot: AutopilotStatus, now_s: float) -> bool:
        """Whether to ask for our mode now: once for an order, and again while none answers."""
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
        fit = (same or took_off) and not took_mode(autopilot) and not self._pilot_flies
        waits = now_s - self._requested_s < _AGAIN_S
        answered = self._requests > 0 and not self._session.mode_unanswered
        if answered or not fit or (self._requests == _MOST_REQUESTS and not waits):
            self._in_mode = None
            if not answered:
                self._tell_waiting(autopilot, now_s)
            return False
        return not waits
