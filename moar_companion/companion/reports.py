"""Reports to operators and to the record: texts, risk indices and weights, decisions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from ..mavlink.commands import CommandResult, result_words
from ..mavlink.identity import AutopilotConflict
from ..mavlink.own_ids import ComponentConflict
from ..mavlink.peers import AutopilotElsewhere, PeerRefused
from ..mavlink.session import CommandAnswered, Event, Session, Severity
from ..mavlink.signing import SignedLinks
from ..mavlink.telemetry import Telemetry
from ..texts import pilot_texts, service_texts
from ..texts.text_format import pilot_text
from ..types import RiskIndices, Weights
from .estimation.pose import Pose
from .mission_states import MissionState
from .safety.file_faults import FileFault, FileFaultTexts
from .signing_report import SigningReport


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
            case ComponentConflict(component_id=component_id):
                text = service_texts.TWO_COMPANIONS(id=component_id, detail="see component_id")
                self.send_text(Severity.ERROR, text, now_s)
            case PeerRefused(link=link, address=(host, port, *_), system_id=system_id):
                detail = f"{host}:{port} on {link}; commands.systems"
                text = pilot_texts.SYSTEM_MAY_NOT(id=system_id, detail=detail)
                self.send_text(Severity.NOTICE, text, now_s, action="not served")
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

    def report_values(
        self,
        state: MissionState,
        risk: RiskIndices,
        weights: Weights,
        pose: Pose | None,
        now_s: float,
    ) -> None:
        """Sends risk indices and weights as NAMED_VALUE_FLOAT; records the status."""
        for name, value in (
            ("RISK_WIND", risk.wind),
            ("RISK_COMM", risk.communication),
            ("RISK_LOC", risk.localization),
            ("RISK_BATT", risk.battery),
            ("K_SAFETY", weights.safety),
            ("K_TIME", weights.time),
            ("K_ENERGY", weights.energy),
        ):
            self._session.send_named_value(name, value, now_s)
        self.record(
            "status",
            now_s,
            state=state.value,
            risk=risk.as_dict(),
            weights=asdict(weights),
            position_m=None if pose is None else list(pose.position_m),
        )

    def record(self, kind: str, now_s: float, **data: Any) -> None:
        """Keeps a decision, for the record only."""
        self._decisions.append(Decision(time_s=now_s, kind=kind, data=data))

    def decisions(self) -> list[Decision]:
        """Returns the decisions since the last call."""
        decisions, self._decisions = self._decisions, []
        return decisions
