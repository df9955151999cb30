"""Marks: the autopilots with which a scenario is flown."""

from __future__ import annotations

import pytest

from ..flights.operator import Manner
from ..thorough import sampled

BOTH = pytest.mark.parametrize("manner", Manner)


def _first(manner):
    """One autopilot, and with MOAR_THOROUGH=1 both, where they hardly differ."""
    return pytest.mark.parametrize("manner", sampled([manner], list(Manner)))


PX4_FIRST = _first(Manner.PX4)
ARDUPILOT_FIRST = _first(Manner.ARDUPILOT)
