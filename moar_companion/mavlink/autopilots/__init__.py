"""Differences between autopilots: one file, and so one `Profile`, for each. Pure.

A new autopilot is one more file like `px4`, its row in `_ROWS`, and its name in
`types.AUTOPILOTS`. All other modules use `profile`.
"""

from __future__ import annotations

from ...types import UNKNOWN, AutopilotKind
from ..telemetry import Telemetry
from . import ardupilot, px4, unknown
from .profile import Profile

_ROWS = (
    px4.PROFILE,
    ardupilot.PROFILE,
)

PROFILES: dict[AutopilotKind, Profile] = {row.kind: row for row in _ROWS}
"""Profiles of the autopilots that can be flown, by kind."""


def profile(kind: AutopilotKind | None) -> Profile:
    """Profile of a kind of autopilot; for any without one that of an unknown autopilot."""
    return unknown.PROFILE if kind is None else PROFILES.get(kind, unknown.PROFILE)


def profile_of(telemetry: Telemetry) -> Profile:
    """Profile of the received autopilot; of an unknown one before its first heartbeat."""
    return profile(None if telemetry.autopilot is None else telemetry.autopilot.kind)


def kind_of(mav_autopilot: int) -> AutopilotKind:
    """Kind of an autopilot by MAV_AUTOPILOT of its heartbeat."""
    kinds = (row.kind for row in PROFILES.values() if row.mav_autopilot == mav_autopilot)
    return next(kinds, UNKNOWN)
