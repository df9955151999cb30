"""Reports to operators and to the record: texts, risk indices and weights, decisions."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..mavlink.session import Session, Severity
from ..mavlink.statustext import pilot_text
from ..types import RiskIndices, Weights


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

    def say(
        self,
        severity: Severity,
        reason: str,
        now_s: float,
        *,
        action: str = "",
        news: bool = False,
        link: str | None = None,
    ) -> None:
        """Sends a STATUSTEXT of a reason and the companion's action; records the whole reason.

        link: the only link that receives it; None: all links.
        """
        text = pilot_text(reason, action)
        self._session.send_text(severity, text, now_s, news=news, link=link)
        self.record("text", now_s, text=text, reason=reason)

    def send_values(self, risk: RiskIndices, weights: Weights, now_s: float) -> None:
        """Sends risk indices and weights as NAMED_VALUE_FLOAT (contract)."""
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

    def record_status(
        self,
        state: str,
        risk: RiskIndices,
        weights: Weights,
        position_m: tuple[float, ...] | None,
        now_s: float,
    ) -> None:
        """Records the status."""
        self.record(
            "status",
            now_s,
            state=state,
            risk=risk.as_dict(),
            weights=asdict(weights),
            position_m=None if position_m is None else list(position_m),
        )

    def record(self, kind: str, now_s: float, **data: Any) -> None:
        """Keeps a decision, for the record only."""
        self._decisions.append(Decision(time_s=now_s, kind=kind, data=data))

    def decisions(self) -> list[Decision]:
        """Returns the decisions since the last call."""
        decisions, self._decisions = self._decisions, []
        return decisions
