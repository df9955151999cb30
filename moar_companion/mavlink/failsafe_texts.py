"""Failsafes from the autopilot's texts: STATUSTEXT to `Telemetry`. Pure.

HEARTBEAT reports only that a failsafe is active; the text names it. One text reports its end, and a
link may lose that text. So each failsafe also ends some time after its last sign. The texts are in
the autopilot's profile (`autopilots`).
"""

from __future__ import annotations

import math
from dataclasses import replace

from .autopilots import profile_of
from .dialect import Message
from .telemetry import Failsafe, Telemetry

_FRESH_S = 2.5
"""Maximum age of HEARTBEAT, EKF_STATUS_REPORT (2 Hz) and GPS_RAW_INT: one may be lost."""
_FIX_3D = 3
"""Fix type required beside an absolute position, which dead reckoning by the wind reports, too."""


def read(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with the failsafe that a text begins or ends."""
    text, reported = message.text, telemetry.failsafes_reported
    rows = profile_of(telemetry).failsafe_texts
    begun = {row.failsafe: now_s for row in rows if row.begins.match(text)}
    ended = {row.failsafe for row in rows if row.ends == text}
    left = {failsafe: sign_s for failsafe, sign_s in reported.items() if failsafe not in ended}
    after = {**left, **begun}
    return telemetry if after == reported else replace(telemetry, failsafes_reported=after)


def lasting(telemetry: Telemetry, now_s: float) -> dict[Failsafe, float]:
    """Reported failsafes that are still active, with the times of their last signs.

    Called at each heartbeat. A doubtful position is a sign of an estimator failsafe.
    """
    autopilot, gnss = telemetry.autopilot, telemetry.gnss
    sure = (
        autopilot is not None
        and now_s - autopilot.received_s <= _FRESH_S
        and _position_sure(telemetry, now_s)
    )
    fixed = gnss is not None and now_s - gnss.received_s <= _FRESH_S and gnss.fix_type >= _FIX_3D
    signs = {Failsafe.ESTIMATOR: not sure, Failsafe.DEAD_RECKONING: not (sure and fixed)}
    lasts_s = {row.failsafe: row.lasts_s for row in profile_of(telemetry).failsafe_texts}
    return {
        failsafe: now_s if signs.get(failsafe) else sign_s
        for failsafe, sign_s in telemetry.failsafes_reported.items()
        if signs.get(failsafe) or now_s - sign_s <= lasts_s.get(failsafe, math.inf)
    }


def _position_sure(telemetry: Telemetry, now_s: float) -> bool:
    estimator = telemetry.estimator
    if estimator is None or now_s - estimator.received_s > _FRESH_S:
        return False
    innovations = (
        estimator.velocity_innovation,
        estimator.position_innovation,
        estimator.compass_innovation,
    )
    most = profile_of(telemetry).innovation_limit
    usual = all(value is None or value < most for value in innovations)
    return estimator.horizontal_position_ok and usual
