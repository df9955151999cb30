"""A service that is not scheduled: after the pause it sends only data from after the pause."""

from __future__ import annotations

import math
import random
import re

import pytest

from tests.real_time import real_time

from .rig import COMPANION, PAUSE_CONTINUE
from .tap import OLDEST_S, clock_s

pytestmark = pytest.mark.xdist_group("pauses")

LET_GO_S = 0.5
"""supervision.position_timeout_s"""


def longest_pause_s(rig):
    """Duration of the pause that the service reports; None if it continues.

    A busy machine may delay the service for longer than the test does. The behaviour after a pause
    of any length is tested exactly in lockstep (`tests/companion/test_supervision.py`).
    """
    stalled = re.search(r"MOAR: control loop stalled ([\d.]+) s", rig.said())
    return None if stalled is None else float(stalled[1])


@real_time
@pytest.mark.parametrize(("pause_s", "goes_on"), [(0.3, True), (1.0, False), (3.0, False)])
def test_after_a_pause_no_old_setpoint_is_sent(rig, pause_s, goes_on):
    rig.fly()
    before = rig.tap.setpoints[-1]
    with rig.service.stopped() as stopped_s:
        rig.watch(pause_s)
    woken_s = stopped_s + pause_s
    rig.watch(2.0)
    after = rig.tap.since(woken_s)
    stood_s = longest_pause_s(rig)
    assert not [item for item in rig.tap.since(stopped_s + 0.01) if item.sent_s < woken_s]
    assert all(item.cycle_s >= woken_s - 0.001 for item in after)
    assert max(item.age_s for item in rig.tap.setpoints) < OLDEST_S
    if not goes_on:
        assert after == []
        assert stood_s is not None
        assert stood_s >= pause_s - 0.05
    elif stood_s is None:
        assert after
        jump_m = math.dist(before.position_ned_m, after[0].position_ned_m)
        assert jump_m < 1.2 * before.speed_mps * (after[0].sent_s - before.sent_s) + 0.1


@real_time
def test_a_service_paused_at_any_moment_of_a_cycle_sends_no_old_setpoint(rig):
    rig.fly()
    moments = random.Random(3)
    for _ in range(20):
        with rig.service.stopped():
            rig.watch(0.3)
        rig.watch(moments.uniform(0.1, 0.3))
    assert max(item.age_s for item in rig.tap.setpoints) < OLDEST_S
    assert rig.tap.since(clock_s() - 0.5) or longest_pause_s(rig) >= LET_GO_S


@real_time
def test_continue_after_a_pause_flies_the_rest_of_the_mission(rig):
    rig.fly()
    with rig.service.stopped():
        rig.watch(3.0)
    rig.watch(8.0)
    assert longest_pause_s(rig) >= LET_GO_S
    rig.operator.texts.clear()
    rig.operator.command("continue", PAUSE_CONTINUE, 1, component=COMPANION)
    rig.engage()
