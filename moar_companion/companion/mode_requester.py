"""The mode requester: under `engage`, the companion itself requests its mode, or LAND."""

from __future__ import annotations

import math

from ..mavlink.autopilots import profile
from ..mavlink.session import Session, Severity
from ..mavlink.telemetry import AutopilotStatus, Telemetry
from ..settings.config import Authority
from ..texts import pilot_texts
from .estimation.landed_state import grounded
from .mission.values import MissionStatus
from .mission_states import IN_CONTROL, MissionState
from .reports import Reports
from .safety.autopilot_failsafe import took_mode

_ENGAGE_AFTER_S = 1.2
"""PX4 accepts OFFBOARD after a stream of one second."""
_OFFERING = {MissionState.PLANNING, MissionState.READY}
"""States of an order until its flight begins."""
_FRESH_S = 0.1
"""Maximum age of a mode report: the mode may change, and PX4 reports it once a second."""
_AGAIN_S = 1.0
"""Both autopilots answer within milliseconds, and PX4 reports its mode once a second. At most
`mavlink/autopilot_control._ANSWER_S`: a later answer counts as another sender's."""
_MOST_REQUESTS = 3
_LAND_AGAIN_S = 3.0
"""A LAND request that arrived shows in the heartbeat of the next second."""
_MOST_LANDINGS = 3
"""Number of requests without effect after which the pilot must land."""


class ModeRequester:
    """Requests modes, only while a fresh heartbeat shows a mode that may be replaced.

    Own mode: one request, and two more without an answer, since the link may lose it. An order may
    replace only the mode in which it was given. It replaces no failsafe, return or landing, though
    both autopilots would permit that. It replaces no mode of a pilot who has taken over from the
    companion or a failsafe, until the pilot gives the mode or lands. A release that ends an offered
    hold is no takeover: the mode was the pilot's all along. The operator is informed when an order
    does not request the mode.

    LAND: a few requests, since the link may lose one. None while another order's plan is awaited,
    nor after an order was executed, a hold included.
    """

    def __init__(
        self, authority: Authority, session: Session, reports: Reports, *, pilot_flies: bool
    ) -> None:
        """pilot_flies: the pilot may have taken over before this process began."""
        self._allowed = authority is Authority.ENGAGE
        self._session = session
        self._reports = reports
        self._in_mode: str | None = None
        self._requests = 0
        """Number of mode requests for the order, the last of them at `_requested_s`."""
        self._requested_s = -math.inf
        self._pilot_flies = pilot_flies
        self._had_control = False
        """True if the mission has been in control since the aircraft was last on the ground."""
        self._autopilots = False
        """True if a failsafe, a return or a landing occurred since then, out of our control."""
        self.landing_due = False
        """True while LAND is requested above the landing point, until the landing begins."""
        self._landing_asked_s: float | None = None
        """Time of a LAND request in the last cycle, which may not have been sent."""
        self._landing_sent_s = -math.inf
        self._landings_sent = 0
        self._lands = False
        """True while the requested landing has begun, and has not ended."""

    def is_landing(self, autopilot: AutopilotStatus | None, now_s: float) -> bool:
        """True if the autopilot begins the requested landing."""
        if autopilot is None or self._landings_sent == 0:
            return False
        recent = now_s - self._landing_sent_s <= _LAND_AGAIN_S
        return recent and autopilot.mode == profile(autopilot.kind).land_mode

    def note_order(
        self, autopilot: AutopilotStatus | None, before: MissionState, now_s: float
    ) -> None:
        """Notes an order whose mission is in planning. before: the state at the order."""
        self._requests, self._requested_s = 0, -math.inf
        self._pilot_flies = self._pilot_flies or before is MissionState.OVERRIDDEN
        may = self._allowed and not self._pilot_flies
        fit = autopilot is not None and not took_mode(autopilot) and not autopilot.homeward
        self._in_mode = autopilot.mode if may and fit and autopilot is not None else None
        if self._allowed and self._in_mode is None:
            self._report_waiting(autopilot, now_s)

    def _report_waiting(self, autopilot: AutopilotStatus | None, now_s: float) -> None:
        """Reports that our mode is not requested: the operator must select it."""
        if autopilot is None or autopilot.ours:
            return
        own = profile(autopilot.kind).own_mode
        reason = pilot_texts.MODE_KEPT(mode=autopilot.mode)
        self._reports.send_text(
            Severity.WARNING, reason, now_s, action=f"waiting for {own}", is_new=True
        )

    def note_landing(self) -> None:
        """Notes that the mission ends above its landing point: LAND is due."""
        self.landing_due = self._allowed

    def forget_landing(self) -> None:
        """Cancels the LAND request when an operator's order is executed."""
        self.landing_due = False

    def note_sent(self) -> None:
        """Notes that the requests of the last cycle were sent."""
        if self._landing_asked_s is not None:
            self._landing_sent_s, self._landing_asked_s = self._landing_asked_s, None
            self._landings_sent += 1

    def act(
        self, status: MissionStatus, telemetry: Telemetry, *, at_end: bool, now_s: float
    ) -> None:
        """Updates the control state, and requests the modes that are due; at each cycle's end.

        at_end: the aircraft is at its mission's end.
        """
        autopilot = telemetry.autopilot
        self._landing_asked_s = None
        self._lands = self._lands or self.is_landing(autopilot, now_s)
        if status.state not in _OFFERING:
            self._in_mode = None
        if status.state is not MissionState.HOLDING:
            self.landing_due, self._landings_sent = False, 0
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
        if self.landing_due and autopilot.ours and at_end and status.requested is None:
            self._ask_for_landing(now_s)
        if self._may_take(status, autopilot, now_s):
            self._requests, self._requested_s = self._requests + 1, now_s
            self._session.request_own_mode(now_s)

    def _ask_for_landing(self, now_s: float) -> None:
        """Requests LAND, again where the link may have lost it; at last warns the operator."""
        if self._landings_sent and now_s - self._landing_sent_s < _LAND_AGAIN_S:
            return
        if self._landings_sent < _MOST_LANDINGS:
            self._landing_asked_s = now_s if self._session.request_land(now_s) else None
            return
        self.landing_due = False
        self._reports.send_text(Severity.WARNING, pilot_texts.NO_LANDING(), now_s)

    def _may_take(self, status: MissionStatus, autopilot: AutopilotStatus, now_s: float) -> bool:
        """True if our mode is to be requested now: once for an order, again without an answer."""
        if (
            self._in_mode is None
            or status.state is not MissionState.READY
            or status.hold_ordered
            or now_s - status.since_s < _ENGAGE_AFTER_S
        ):
            return False
        # After a take-off PX4 changes to HOLD by itself, and reports that up to a second later.
        same = autopilot.mode == self._in_mode
        follows = profile(autopilot.kind).follow_up_modes.get(self._in_mode) == autopilot.mode
        fit = (same or follows) and not took_mode(autopilot) and not self._pilot_flies
        waits = now_s - self._requested_s < _AGAIN_S
        answered = self._requests > 0 and not self._session.mode_unanswered
        if answered or not fit or (self._requests == _MOST_REQUESTS and not waits):
            self._in_mode = None
            if not answered:
                self._report_waiting(autopilot, now_s)
            return False
        return not waits
