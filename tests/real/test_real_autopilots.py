"""Real autopilots, built by the user, fly the scenarios of the fake ones (sitl/REAL.md)."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from .figures import flown
from .kinds import KINDS
from .scenarios import SCENARIOS
from .table import keep

REAL = [kind for kind in KINDS.values() if kind.real]


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.real_autopilot
@pytest.mark.parametrize("kind", REAL, ids=lambda kind: kind.name)
@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda scenario: scenario.name)
def test_a_real_autopilot_flies(scenario, kind, tmp_path):
    if kind.missing:
        pytest.skip(kind.missing)
    row = flown(kind, scenario, tmp_path)
    if table := os.environ.get("MOAR_REAL_TABLE"):
        keep(Path(table), row)
    if row.unable:
        pytest.skip(row.unable)
    assert row.faults == []
