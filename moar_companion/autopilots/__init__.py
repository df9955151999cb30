"""Differences between PX4 and ArduPilot: their fences and their failsafe actions.

A third autopilot begins with one more file (the rest: `.github/CONTRIBUTING.md`).
Pure: parameters in, `Failsafes` out.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..types import AutopilotKind
from . import ardupilot, px4
from .failsafe_actions import Failsafes

_FILES = {AutopilotKind.PX4: px4, AutopilotKind.ARDUPILOT: ardupilot}


def failsafe_parameters(kind: AutopilotKind) -> tuple[str, ...]:
    """Names of the parameters that decide an autopilot's failsafe actions."""
    return tuple(_FILES[kind].DEFAULTS) if kind in _FILES else ()


def failsafes_of(kind: AutopilotKind, parameters: Mapping[str, float | None]) -> Failsafes | None:
    """Failsafes of an autopilot; None while a parameter is awaited, or for an unknown kind.

    A parameter that was never reported has the autopilot's default, and is listed in `untold`.
    """
    names = failsafe_parameters(kind)
    if not names or not set(names) <= parameters.keys():
        return None
    told = {name: value for name in names if (value := parameters[name]) is not None}
    values = {**_FILES[kind].DEFAULTS, **told}
    return Failsafes(
        actions=tuple(_FILES[kind].actions(values)),
        untold=tuple(name for name in names if name not in told),
    )
