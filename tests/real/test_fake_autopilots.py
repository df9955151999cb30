"""The scenarios of the real autopilots on the fake ones, with the same figures."""

from __future__ import annotations

import itertools

import pytest

from tests.real_time import real_time
from tests.thorough import sampled

from .figures import flown_once
from .kinds import KINDS
from .scenarios import SCENARIOS


@real_time
@pytest.mark.parametrize(
    ("scenario", "name"),
    sampled(
        [("takeover_by_mode", "fake-ardupilot")],
        list(itertools.product(("nominal", "takeover_by_mode"), ("fake-px4", "fake-ardupilot"))),
    ),
)
def test_a_fake_autopilot_flies(scenario, name, tmp_path):
    row = flown_once(KINDS[name], SCENARIOS[scenario], tmp_path)
    assert row.faults == []
    assert row.keep_out_margin_m is not None
    assert row.error_mean_m < 1.0
    assert (row.takeover_s is not None) is (scenario == "takeover_by_mode")
