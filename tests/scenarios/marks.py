"""Which autopilots a story is flown with."""

from __future__ import annotations

import pytest

from ..flights.operator import Manner
from ..thorough import sampled

BOTH = pytest.mark.parametrize("manner", Manner)


def _first(manner):
    """With one of them, and with MOAR_THOROUGH=1 with the other, where they hardly differ."""
    return pytest.mark.parametrize("manner", sampled([manner], list(Manner)))


PX4_FIRST = _first(Manner.PX4)
ARDUPILOT_FIRST = _first(Manner.ARDUPILOT)
