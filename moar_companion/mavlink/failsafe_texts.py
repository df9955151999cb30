"""Failsafes from ArduPilot's texts: STATUSTEXT to `Telemetry`. Pure.

HEARTBEAT reports only that a failsafe is active; the text names it. One text reports its end, and a
link may lose that text. So each failsafe also ends some time after its last sign, except that of
the battery, which does not recover. Texts of ArduCopter 4.6.3 (events.cpp, ekf_check.cpp,
fence.cpp, AP_BattMonitor.cpp). The first is too long for one chunk; its first chunk identifies it.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

from ..telemetry import Estimator, Failsafe, Telemetry
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
_LASTS_S = {
    Failsafe.BATTERY: math.inf,
    Failsafe.REMOTE_CONTROL: 60.0,
    Failsafe.GROUND_STATION: 60.0,
    Failsafe.ESTIMATOR: 5.0,
    Failsafe.DEAD_RECKONING: 5.0,
    Failsafe.FENCE: 60.0,
}
"""Duration after the last sign. ArduPilot ends an estimator failsafe 1 s after its cause ends."""
_FRESH_S = 2.5
"""Maximum age of HEARTBEAT, EKF_STATUS_REPORT (2 Hz) and GPS_RAW_INT: one may be lost."""
_MOST_INNOVATION = 0.8
"""Default of FS_EKF_THRESH; ArduPilot's flags stay good while innovations are above it."""
_FIX_3D = 3
"""Fix type required beside an absolute position, which dead reckoning by the wind reports, too."""


def read(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with the failsafe that a text begins or ends."""
    text, told = message.text, telemetry.failsafes_told
    begun = {failsafe: now_s for words, failsafe in _BEGINS if words.match(text)}
    left = {failsafe: sign_s for failsafe, sign_s in told.items() if failsafe != _ENDS.get(text)}
    after = {**left, **begun}
    return telemetry if after == told else replace(telemetry, failsafes_told=after)


def lasting(telemetry: Telemetry, now_s: float) -> dict[Failsafe, float]:
    """Reported failsafes that are still active, with the times of their last signs.

    Called at each heartbeat. A doubtful position is a sign of an estimator failsafe.
    """
    autopilot, gnss = telemetry.autopilot, telemetry.gnss
    sure = (
        autopilot is not None
        and now_s - autopilot.received_s <= _FRESH_S
        and _position_sure(telemetry.estimator, now_s)
    )
    fixed = gnss is not None and now_s - gnss.received_s <= _FRESH_S and gnss.fix_type >= _FIX_3D
    signs = {Failsafe.ESTIMATOR: not sure, Failsafe.DEAD_RECKONING: not (sure and fixed)}
    return {
        failsafe: now_s if signs.get(failsafe) else sign_s
        for failsafe, sign_s in telemetry.failsafes_told.items()
        if signs.get(failsafe) or now_s - sign_s <= _LASTS_S[failsafe]
    }


def _position_sure(estimator: Estimator | None, now_s: float) -> bool:
    if estimator is None or now_s - estimator.received_s > _FRESH_S:
        return False
    innovations = (
        estimator.velocity_innovation,
        estimator.position_innovation,
        estimator.compass_innovation,
    )
    usual = all(value is None or value < _MOST_INNOVATION for value in innovations)
    return estimator.horizontal_position_ok and usual
