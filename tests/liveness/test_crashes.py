"""A service that is killed, stopped or restarted while the aircraft flies."""

from __future__ import annotations

import contextlib
import json
import math
import random
import signal
import time

import pytest

from moar_companion.commands.replay_mcap import McapRecording, replay_exactly
from tests.real_time import real_time

from .rig import COMPANION, HOLD, PAUSE_CONTINUE
from .tap import clock_s

pytestmark = pytest.mark.xdist_group("crashes")


@real_time
def test_a_service_killed_in_flight_waits_for_an_order_after_its_restart(rig):
    rig.fly()
    rig.service.end(signal.SIGKILL)
    killed_s = clock_s()
    rig.operator.wait_for("the autopilot's hold", lambda: rig.operator.custom_mode == HOLD, 5.0)
    assert rig.service.remembered() == "flying"
    rig.start()
    rig.wait_for_text("MOAR: restarted, was flying inspection")
    rig.wait_for_text("order continue to fly the rest")
    rig.watch(3.0)
    assert rig.tap.since(killed_s) == []
    rig.operator.command("continue", PAUSE_CONTINUE, 1, component=COMPANION)
    rig.engage()
    rig.watch(1.0)
    assert len(rig.tap.since(killed_s)) > 40


@real_time
def test_the_recording_of_a_killed_service_is_complete_to_the_last_second_and_replays_exactly(
    rig, capsys
):
    rig.fly()
    rig.watch(2.0)
    killed_s = time.time()
    rig.service.end(signal.SIGKILL)
    newest = str(max(rig.recordings.iterdir()) / "flight.mcap")
    last_s = max(wall_s for wall_s, _ in McapRecording(newest).cycles())
    assert killed_s - 1.0 < last_s
    assert replay_exactly(newest, None) == 0
    assert "no difference" in capsys.readouterr().out
    rig.start()


@real_time
def test_a_service_that_its_manager_stops_ends_with_a_setpoint_at_rest(rig):
    rig.fly()
    before = rig.tap.setpoints[-1]
    assert rig.service.end(signal.SIGTERM) == 0
    rig.watch(0.2)
    *_, last_moving, last = rig.tap.setpoints
    assert before.speed_mps > 0.0
    assert last.speed_mps == 0.0
    assert math.dist(last.position_ned_m, last_moving.position_ned_m) < 0.1
    assert rig.service.remembered() == "flying"


@real_time
def test_a_service_that_is_stopped_while_paused_sends_nothing(rig):
    rig.fly()
    with rig.service.stopped() as stopped_s:
        rig.service.process.terminate()
        rig.watch(1.0)
    assert rig.service.process.wait(20) == 0
    assert rig.tap.since(stopped_s + 0.01) == []


@real_time
def test_the_snapshot_of_a_service_killed_at_any_moment_is_complete_or_absent(rig):
    rig.service.end(signal.SIGKILL)
    began_s = clock_s()
    rig.start()
    start_s = clock_s() - began_s
    rig.service.end(signal.SIGKILL)
    folder = rig.service.state.parent
    moments = random.Random(7)
    remembered = set()
    for waits in [False, True] * 4:
        rig.operator.companion_received = False
        rig.service.start()
        moment_s = 30.0 if waits else moments.uniform(0.0, 2.0 * start_s)
        received = rig.operator.wait_until(lambda: rig.operator.companion_received, moment_s)
        if received:
            rig.watch(moments.uniform(0.0, 2.0))
            rig.ask_for_inspection()
            rig.watch(moments.uniform(0.0, 0.4))
        rig.service.end(signal.SIGKILL)
        with contextlib.suppress(FileNotFoundError):
            remembered.add(json.loads(rig.service.state.read_bytes())["memory"]["state"])
    assert remembered
    assert not list(folder.glob("*.broken"))
    assert "put aside" not in rig.service.log()
