"""One satellite receiver or two: the one that counts, and its faults.

Inputs: the receivers' reports and the autopilot's choice between them, as far as known. Outputs:
the risk inputs of the receiver used for navigation, and the number of lost receivers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from ..mavlink.telemetry import Gnss, Telemetry
from ..settings.risk_model import RiskModel
from .input_reports import InputReport, certain, source_at, source_of

_MAX_AGE_S = 3.0
"""Maximum age of GPS_RAW_INT: 5 to 8 Hz, at 1 Hz while PX4's receiver is silent: 3 periods."""
_FROZEN_S = 1.5
"""Time without a new measurement after which a receiver counts as stopped. A receiver measures at
least once a second; ArduPilot repeats the data of a failed one for 4 s."""
_NO_RECEIVER = 0
"""GPS_FIX_TYPE_NO_GPS: ArduPilot reports it of a first receiver that does not exist, too."""
_FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX; better fixes have greater numbers."""
_FIXES = {0: "no receiver", 1: "no fix", 2: "2D"}
"""GPS_FIX_TYPE below 3."""
_MEASURES = {
    "satellites": ("satellites", ""),
    "hdop": ("hdop", ""),
    "vdop": ("vdop", ""),
    "horizontal_accuracy_m": ("receiver accuracy", "m"),
    "vertical_accuracy_m": ("receiver height accuracy", "m"),
}
"""Measures of a receiver: input name and unit, by the name of field and threshold."""
_ACCURACIES = ("horizontal_accuracy_m", "vertical_accuracy_m")
RECEIVER_ACCURACY = _MEASURES["horizontal_accuracy_m"][0]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverMemory:
    """Memory of one receiver.

    receiver_s, since_s: its clock, and the first reception of that reading. known: its latest
    report, completed by earlier values; without a fix no more accurate than before. seen: True
    once a receiver was there.
    """

    receiver_s: float | None = None
    since_s: float = 0.0
    known: Gnss | None = None
    seen: bool = False

    def read(self, gnss: Gnss | None) -> ReceiverMemory:
        """Memory updated by the receiver's latest report."""
        if gnss is None:
            return self
        moved = gnss.receiver_s != self.receiver_s
        kept: dict[str, Any] = {
            name: value
            for name in _MEASURES
            if (value := self._counting(gnss, name)) != getattr(gnss, name)
        }
        return ReceiverMemory(
            receiver_s=gnss.receiver_s,
            since_s=gnss.received_s if moved else self.since_s,
            known=replace(gnss, **kept) if kept else gnss,
            seen=self.seen or gnss.fix_type > _NO_RECEIVER,
        )

    def _counting(self, gnss: Gnss, name: str) -> float | None:
        """Value of a measure that counts after the receiver's latest report."""
        reported = _reported(gnss, name)
        before: float | None = None if self.known is None else getattr(self.known, name)
        if reported is None or before is None:
            return before if reported is None else reported
        dark = name in _ACCURACIES and gnss.fix_type < _FIX_3D
        return max(reported, before) if dark else reported

    def stopped_s(self, gnss: Gnss) -> float | None:
        """Time for which the receiver has repeated this reading; None: it reports no time."""
        if gnss.receiver_s is None or gnss.receiver_s != self.receiver_s:
            return None
        return gnss.received_s - self.since_s


Memories = tuple[ReceiverMemory, ReceiverMemory]
"""Memories of the first and of the second receiver."""


def trouble(telemetry: Telemetry, memories: Memories, now_s: float) -> str | None:
    """Fault of the receiver that the autopilot navigates by; None: no fault, or unknown.

    If the autopilot takes the better of two, there is a fault only if both have one.
    """
    faults = [_fault(gnss, memory, now_s) for gnss, memory in _candidates(telemetry, memories)]
    return faults[0] if faults and None not in faults else None


def receiver_inputs(
    telemetry: Telemetry, memories: Memories, now_s: float, model: RiskModel
) -> tuple[InputReport, ...]:
    """Inputs of the receiver that counts, and the number of lost receivers of two."""
    candidates = _candidates(telemetry, memories)
    if len(candidates) > 1:
        candidates.sort(key=lambda item: _badness(item[0], item[1], now_s, model))
    gnss, memory = candidates[0] if candidates else (None, memories[0])
    receivers = _receivers(telemetry, memories)
    lost = sum(_fault(*item, now_s) is not None for item in receivers)
    latest_s = max((gnss.received_s for gnss, _ in receivers), default=None)
    return (
        *_judged(gnss, memory, now_s, model),
        # The count includes silent receivers, so that it never grows stale.
        source_at(latest_s, now_s, math.inf).input_report(
            "receivers lost",
            lost if len(receivers) > 1 else None,
            "",
            lambda lost: 1.0 if lost == len(receivers) else model.receiver_lost * certain(lost),
        ),
    )


def _receivers(telemetry: Telemetry, memories: Memories) -> list[tuple[Gnss, ReceiverMemory]]:
    """Receivers that were ever there, in the autopilot's order; all that report if none was."""
    both = zip((telemetry.gnss, telemetry.second_gnss), memories, strict=True)
    receivers = [(gnss, memory) for gnss, memory in both if gnss is not None]
    return [item for item in receivers if item[1].seen] or receivers


def _candidates(telemetry: Telemetry, memories: Memories) -> list[tuple[Gnss, ReceiverMemory]]:
    """Receivers that the autopilot may navigate by, its first choice first."""
    receivers = _receivers(telemetry, memories)
    if telemetry.second_gnss_first:
        receivers.reverse()
    return receivers if telemetry.better_gnss_taken else receivers[:1]


def _badness(gnss: Gnss, memory: ReceiverMemory, now_s: float, model: RiskModel) -> float:
    """Worst risk of a receiver, plus 1 for a useless one, and another 1 for a silent one.

    Measures that it no longer reports count with their last values.
    """
    known = {name: _known(gnss, memory, name) for name in _MEASURES}
    risks = [
        getattr(model, name).fraction(value) for name, value in known.items() if value is not None
    ]
    useless = _fault(gnss, memory, now_s) is not None
    return max(risks, default=0.0) + useless + (now_s - gnss.received_s > _MAX_AGE_S)


def _fault(gnss: Gnss, memory: ReceiverMemory, now_s: float) -> str | None:
    """Text of the fault that makes a receiver useless; None without one."""
    age_s = now_s - gnss.received_s
    if age_s > _MAX_AGE_S:
        return f"GNSS receiver silent for {age_s:.1f} s"
    if gnss.fix_type < _FIX_3D:
        return "GNSS receiver has no 3D fix"
    stopped_s = memory.stopped_s(gnss)
    if stopped_s is not None and stopped_s > _FROZEN_S:
        return f"GNSS receiver stopped {stopped_s:.1f} s ago"
    return None


def _judged(
    gnss: Gnss | None, memory: ReceiverMemory, now_s: float, model: RiskModel
) -> tuple[InputReport, ...]:
    """Normalised inputs of one receiver."""
    source = source_of(gnss, now_s, _MAX_AGE_S)
    return (
        source.input_report(
            "fix type",
            None if gnss is None else gnss.fix_type,
            "",
            lambda fix_type: certain(fix_type < _FIX_3D),
            remark="" if gnss is None else _FIXES.get(gnss.fix_type, "3D"),
        ),
        *(
            source.input_report(
                title,
                None
                if gnss is None or _reported(gnss, name) is None
                else _known(gnss, memory, name),
                unit,
                getattr(model, name).fraction,
            )
            for name, (title, unit) in _MEASURES.items()
        ),
        source.input_report(
            "receiver clock stopped",
            None if gnss is None else memory.stopped_s(gnss),
            "s",
            lambda stopped_s: certain(stopped_s > _FROZEN_S),
        ),
    )


def _known(gnss: Gnss, memory: ReceiverMemory, name: str) -> float | None:
    return _reported(memory.known or gnss, name)


def _reported(gnss: Gnss, name: str) -> float | None:
    value: float | None = getattr(gnss, name)
    return value if value is None or value > 0.0 or name == "satellites" else None


def positive(value: float | None) -> float | None:
    """Accuracy or dilution; None for 0, the receivers' value for unknown."""
    return value if value is not None and value > 0.0 else None
