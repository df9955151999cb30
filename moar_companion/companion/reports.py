"""Reports to operators and to the record: texts, risk indices and weights, decisions.

`Reports` sends them. The others keep what their texts depend on: of adopted plans `PlanReports`, at
the start `StartReport`, of signed links `SigningReport`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..mavlink.commands import Command, CommandResult, holds, result_words, stops
from ..mavlink.component.parameter_server import ParameterRefused
from ..mavlink.component.path_mission import MissionRefused
from ..mavlink.identity import AutopilotConflict
from ..mavlink.own_ids import ComponentConflict
from ..mavlink.peers import AutopilotElsewhere, PeerRefused
from ..mavlink.session import CommandAnswered, Event, Session, Severity
from ..mavlink.signing import SignedLinks, SigningRefusal
from ..mavlink.telemetry import Telemetry
from ..planner.adaptation import Adaptation
from ..planner.comparison import path_difference
from ..planner.plan_values import Plan
from ..planner.regions import narrowest
from ..planner.site import PlanePoint, Site
from ..risk import RiskEstimate
from ..risk.explain import risk_section, weights_section
from ..risk.power.cells import misread
from ..settings.vehicle import Vehicle
from ..status_values import json_dict
from ..texts import pilot_texts, service_texts
from ..texts.text_format import coordinate, distance, limit_text, pilot_text, plural, seconds
from ..types import Mission, RiskIndices, Weights
from .estimation.landed_state import airborne, grounded
from .estimation.pose import Pose
from .mission_snapshot import MissionSnapshot
from .mission_states import MissionState
from .plan_requests import Awaited
from .safety.file_faults import FileFault, FileFaultTexts


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A decision of the companion, for the record: its kind and data fit for JSON."""

    time_s: float
    kind: str
    data: dict[str, Any]


class Reports:
    """Sends reports over the session, and keeps them for the record."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._decisions: list[Decision] = []
        self._file_faults = FileFaultTexts()
        self._refusals = SigningReport()

    def send_text(
        self,
        severity: Severity,
        reason: str,
        now_s: float,
        *,
        action: str = "",
        is_new: bool = False,
        link: str | None = None,
    ) -> None:
        """Sends a STATUSTEXT of a reason and the companion's action; records the whole reason.

        link: the only link that receives it; None: all links.
        """
        text = pilot_text(reason, action)
        self._session.send_text(severity, text, now_s, is_new=is_new, link=link)
        self.record("text", now_s, text=text, reason=reason)

    def report_event(self, event: Event, now_s: float) -> None:
        """Reports an event of the session to the operators."""
        match event:
            case CommandAnswered(result=result) if result != CommandResult.ACCEPTED:
                text = pilot_texts.MODE_REFUSED(result=result_words(result))
                self.send_text(Severity.WARNING, text, now_s)
            case AutopilotElsewhere(link=link, address=(host, port, *_)):
                detail = f"port {port}, on {link}"
                text = service_texts.AUTOPILOT_ELSEWHERE(host=host, detail=detail)
                self.send_text(Severity.WARNING, text, now_s, action="ignored")
            case MissionRefused(reason=reason, sender=sender):
                self.send_text(
                    Severity.WARNING, reason, now_s, action="denied", is_new=True, link=sender.link
                )
            case ComponentConflict(component_id=component_id):
                text = service_texts.TWO_COMPANIONS(id=component_id, detail="see component_id")
                self.send_text(Severity.ERROR, text, now_s)
            case PeerRefused(link=link, address=(host, port, *_), system_id=system_id):
                detail = f"{host}:{port} on {link}; commands.systems"
                text = pilot_texts.SYSTEM_MAY_NOT(id=system_id, detail=detail)
                self.send_text(Severity.NOTICE, text, now_s, action="not served")
            case ParameterRefused(reason=reason):
                text = pilot_texts.PARAMETER_REFUSED(refused=reason)
                self.send_text(Severity.WARNING, text, now_s)
            case AutopilotConflict(autopilot=autopilot, other=other, reason=reason):
                text = f"{reason} ({autopilot}, {other})"
                self.send_text(Severity.ERROR, text, now_s, action="no control")

    def report_file_faults(
        self, faults: Iterable[FileFault], telemetry: Telemetry, now_s: float
    ) -> None:
        """Reports file faults of the service, and their ends."""
        for fault, over in self._file_faults.texts(faults, telemetry):
            severity = Severity.NOTICE if over else Severity.WARNING
            action = "over" if over else fault.action
            self.send_text(severity, fault.reason, now_s, action=action, is_new=True)

    def report_refusals(self, signing: SignedLinks, now_s: float) -> None:
        """Reports packets that signed links have refused."""
        refused, behind_s = signing.packets_refused, signing.behind_s
        for words in self._refusals.texts(refused, behind_s, now_s, ahead_s=signing.ahead_s):
            self.send_text(Severity.WARNING, words, now_s)

    def record_status(
        self,
        state: MissionState,
        risk: RiskIndices,
        weights: Weights,
        pose: Pose | None,
        offset_m: PlanePoint,
        now_s: float,
    ) -> None:
        """Records mission state, risk indices, weights and pose.

        offset_m: of the line's frame, in which the pose is; recorded where there is one.
        """
        self.record(
            "status",
            now_s,
            state=state.value,
            risk=risk.as_dict(),
            weights=asdict(weights),
            position_m=None if pose is None else list(pose.position_m),
            **({"line_offset_m": list(offset_m)} if any(offset_m) else {}),
        )

    def record(self, kind: str, now_s: float, **data: Any) -> None:
        """Keeps a decision, for the record only."""
        self._decisions.append(Decision(time_s=now_s, kind=kind, data=data))

    def decisions(self) -> list[Decision]:
        """Returns the decisions since the last call."""
        decisions, self._decisions = self._decisions, []
        return decisions


_REPORT_PERIOD_S = 10.0
"""Minimum time between two texts about a path that a risk has moved; the record has all."""
_RISK_MOVED = 0.05
"""Minimum change of a risk since the last path to be reported as the reason for a move."""


class PlanReports:
    """Keeps the risk indices of the active path, and the time of the last text about a move."""

    def __init__(self, vehicle: Vehicle, reports: Reports) -> None:
        self.vehicle = vehicle
        """With the settings in force."""
        self._reports = reports
        self._reported_s = -math.inf
        self._flown_risk = RiskIndices()
        """Risk indices of the active path's plan."""

    def explain(
        self,
        awaited: Awaited,
        plan: Plan,
        flown: Plan | None,
        estimate: RiskEstimate,
        now_s: float,
    ) -> None:
        """Records the reason for a path; reports a path that a risk has moved.

        flown: rest of the plan before it; None where that could not stay.
        """
        adaptation = plan.request.adaptation or Adaptation.of(self.vehicle, plan.mission)
        difference = None if flown is None else path_difference(flown, plan)
        self._reports.record(
            "plan",
            now_s,
            first=awaited.first,
            plan=plan.to_dict(),
            explanation={
                "reason": awaited.reason,
                "risk": json_dict(risk_section(estimate)),
                "weights": json_dict(weights_section(adaptation, plan.request.risk)),
                "path": None if difference is None else difference.to_dict(),
            },
        )
        before, self._flown_risk = self._flown_risk.as_dict(), plan.request.risk
        after = plan.request.risk.as_dict()
        name = max(after, key=lambda name: abs(after[name] - before[name]))
        if (
            difference is not None
            and abs(after[name] - before[name]) >= _RISK_MOVED
            and now_s - self._reported_s >= _REPORT_PERIOD_S
        ):
            self._reported_s = now_s
            reason = pilot_texts.PATH_MOVED(
                risk=name,
                fraction=coordinate(after[name], 2),
                path=difference.gist(),
                detail=f"was {coordinate(before[name], 2)}",
            )
            self._reports.send_text(Severity.INFO, reason, now_s)

    def report_narrow(self, plan: Plan, site: Site, now_s: float) -> None:
        """Reports the clearance of an escape route that keeps less than the margin."""
        nearest = narrowest(site, self.vehicle, plan.waypoints.position_m)
        if nearest is not None:
            name, clearance_m, needed_m = nearest
            reason = pilot_texts.NARROW(
                low_m=distance(clearance_m), obstacle=name, least_m=limit_text(needed_m)
            )
            action = "exiting" if plan.mission is Mission.EXIT else "evacuating"
            self._reports.send_text(Severity.WARNING, reason, now_s, action=action)


_START_PATIENCE_S = 3.0
"""EXTENDED_SYS_STATE may come later than the heartbeat; ArduPilot sends it only on request."""


class StartReport:
    """Reports each finding once: those of the start when an autopilot can forward the texts."""

    def __init__(self, before: MissionSnapshot | None) -> None:
        self.before = before
        """Memory of the previous process, without a task that was released or landed since."""
        self._received_s: float | None = None
        self._reported = False
        self._pack_reported = False

    def note_order(self, command: Command) -> None:
        """Takes an executed order: a release drops the task."""
        if stops(command) and not holds(command):
            self.drop_task()

    def drop_task(self) -> None:
        """Drops the task, which the mission status has only when the planner is ready."""
        if self.before is not None:
            self.before = replace(self.before, task=None)

    def texts(
        self, telemetry: Telemetry, cells: int | None, now_s: float, *, may_continue: bool
    ) -> list[str]:
        """Texts to report now. may_continue: the operator can order the rest of the task.

        cells: of the vehicle file; None while its comparison with the pack is not due.
        """
        texts = self._start_texts(telemetry, now_s, may_continue=may_continue)
        pack = None if self._pack_reported else misread(telemetry, cells)
        if pack is not None:
            self._pack_reported = True
            texts.append(pack)
        return texts

    def _start_texts(self, telemetry: Telemetry, now_s: float, *, may_continue: bool) -> list[str]:
        autopilot, before = telemetry.autopilot, self.before
        if self._reported or autopilot is None:
            return []
        if self._received_s is None:
            self._received_s = now_s
        flying = airborne(telemetry, now_s)
        if not (flying or grounded(telemetry)) and now_s - self._received_s < _START_PATIENCE_S:
            return []
        self._reported = True
        texts = []
        if before is not None and (before.streamed or flying):
            texts.append(service_texts.RESTARTED(before=before.words(now_s)))
            if may_continue:
                texts.append(service_texts.CONTINUE_POSSIBLE())
        if flying and autopilot.ours:
            texts.append(service_texts.MODE_STILL_ON(own_mode=autopilot.mode))
        return texts


_REFUSED_PERIOD_S = 30.0
"""Time between two texts of one reason, which leaves room for other texts."""

_CLOCK_AHEAD_S = 60.0
"""Tolerance for new senders: with the reference less than this ahead of our clock, the sender's
clock is wrong."""
_CLOCK_REMEDY = "set this computer's clock; where it is right delete signing.json, and restart"


class SigningReport:
    """Counts reported so far, and the times of the reports."""

    def __init__(self) -> None:
        self._reported = dict.fromkeys(SigningRefusal, 0)
        self._reported_s = dict.fromkeys(SigningRefusal, -math.inf)

    def texts(
        self,
        refused: Mapping[str, Mapping[SigningRefusal, int]],
        behind_s: Mapping[str, Mapping[int, float]],
        now_s: float,
        *,
        ahead_s: float = 0.0,
    ) -> list[str]:
        """Returns the texts due now. refused: by link and reason, since the start.

        behind_s: delay of the clocks of senders refused for that, by link and system id.
        ahead_s: lead of the reference they are judged by over this computer's clock.
        """
        texts = []
        for reason in SigningRefusal:
            count = sum(counts[reason] for counts in refused.values())
            due = now_s - self._reported_s[reason] >= _REFUSED_PERIOD_S
            if due and count > self._reported[reason]:
                number = count - self._reported[reason]
                words = service_texts.PACKETS_REFUSED(
                    large_count=number, plural=plural(number), refusal=reason.value
                )
                if reason is SigningRefusal.OLD and any(behind_s.values()):
                    slowest = _slowest(behind_s)
                    words = f"{slowest} ({words})"
                    if ahead_s > _CLOCK_AHEAD_S:
                        words = f"{_ahead(ahead_s)} ({_CLOCK_REMEDY}; {slowest})"
                texts.append(words)
                self._reported[reason], self._reported_s[reason] = count, now_s
        return texts


def _slowest(behind_s: Mapping[str, Mapping[int, float]]) -> str:
    """Text about the signer that is farthest behind."""
    most_s, system_id = max(
        (late_s, system_id) for link in behind_s.values() for system_id, late_s in link.items()
    )
    return service_texts.SIGNER_BEHIND(id=system_id, s=seconds(most_s))


def _ahead(ahead_s: float) -> str:
    """Returns the lead of the kept time stamps over the computer's clock, in few words."""
    minutes = ahead_s / 60.0
    amount = f"{minutes:.0f} min"
    if minutes >= 120.0:
        amount = f"{minutes / 60.0:.1f} h" if minutes < 2880.0 else f"{minutes / 1440.0:.0f} d"
    return service_texts.SIGNING_AHEAD(time=amount)
