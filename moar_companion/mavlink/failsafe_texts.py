"""Failsafes by ArduPilot's own texts: STATUSTEXT to `Telemetry`. Pure.

HEARTBEAT tells only that there is a failsafe; its text says which. Texts of ArduCopter 4.6.3
(events.cpp, ekf_check.cpp, fence.cpp, AP_BattMonitor.cpp), the first of which is too long for one
chunk: the words that matter are in the first chunk.
"""

from __future__ import annotations

import re
from dataclasses import replace

from ..types import Failsafe, Telemetry
from .dialect import Message

_BEGINS = (
    (re.compile(r"Battery (\d+ is (low|critical)|Failsafe)"), Failsafe.BATTERY),
    (re.compile(r"Radio Failsafe(?! Cleared)"), Failsafe.REMOTE_CONTROL),
    (re.compile(r"GCS Failsafe(?! Cleared)"), Failsafe.GROUND_STATION),
    (re.compile(r"EKF (variance|Failsafe(?! Cleared))"), Failsafe.ESTIMATOR),
    (re.compile(r"Dead Reckoning started"), Failsafe.DEAD_RECKONING),
    (re.compile(r".*[Ff]ence breached"), Failsafe.FENCE),
)
_ENDS = {
    "Radio Failsafe Cleared": Failsafe.REMOTE_CONTROL,
    "GCS Failsafe Cleared": Failsafe.GROUND_STATION,
    "EKF Failsafe Cleared": Failsafe.ESTIMATOR,
    "Dead Reckoning stopped": Failsafe.DEAD_RECKONING,
}


def read(telemetry: Telemetry, message: Message, _now_s: float) -> Telemetry:
    """The telemetry with the failsafe that a text begins or ends."""
    text, told = message.text, telemetry.failsafes_told
    ended = _ENDS.get(text)
    if ended is not None:
        told -= {ended}
    else:
        told |= {failsafe for words, failsafe in _BEGINS if words.match(text)}
    return (
        telemetry if told == telemetry.failsafes_told else replace(telemetry, failsafes_told=told)
    )
