"""Marks: the autopilots with which a scenario is flown."""

from __future__ import annotations

import pytest

from ..flights.operator import Manner

BOTH = pytest.mark.parametrize("manner", Manner)


def _first(manner):
    """With one of them by tests/run, with the other by .ci/run, too."""
    (other,) = set(Manner) - {manner}
    return pytest.mark.parametrize("manner", [manner, pytest.param(other, marks=pytest.mark.slow)])


PX4_FIRST = _first(Manner.PX4)
ARDUPILOT_FIRST = _first(Manner.ARDUPILOT)
