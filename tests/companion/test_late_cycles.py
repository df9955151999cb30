"""Late cycles and pauses of the shell: packets that command motion are dropped."""

from __future__ import annotations

import math
from functools import partial

import pytest

from moar_companion.settings.config import Authority

from .desk import ACCEPTED, EXIT, HOLD, INSPECTION, RELEASE, STEP_S, Desk
from .scripted_autopilot import AUTO_HOLD, CRITICAL, POSCTL


def come_late(desk):
    """Makes every cycle from now on too long."""
    desk.companion.data_to_send = partial(desk.companion.data_to_send, control=False)


def test_a_late_cycle_sends_no_setpoint_but_answers_operators():
    desk = Desk().come_to("flying", then_s=1.0)
    come_late(desk)
    sent = len(desk.setpoints())
    desk.order(HOLD).run(0.1)
    assert len(desk.setpoints()) == sent
    assert desk.answers()[-1] == ACCEPTED
    assert desk.said("MOAR: holding inspection")


def test_the_next_cycle_makes_up_for_one_late_cycle():
    desk = Desk().come_to("flying", then_s=1.0)
    sent = len(desk.setpoints())
    in_time = desk.companion.data_to_send
    come_late(desk)
    desk.step()
    desk.companion.data_to_send = in_time
    desk.run(0.2)
    assert len(desk.setpoints()) == sent + 10
    assert desk.state == "flying"


def test_when_every_cycle_is_late_control_is_released():
    desk = Desk().come_to("flying", then_s=1.0)
    come_late(desk)
    desk.run_until("released", 1.0)
    assert desk.said("MOAR: control loop stalled 0.5 s")


def test_the_shell_takes_control_packets_before_the_others():
    desk = Desk().come_to("flying", then_s=1.0)
    desk.companion.tick(desk.now_s + STEP_S)
    ((_, setpoint),) = desk.companion.control_to_send()
    assert setpoint[7:10] == (84).to_bytes(3, "little")  # SET_POSITION_TARGET_LOCAL_NED
    assert desk.companion.control_to_send() == []
    assert all(data[7:10] != setpoint[7:10] for _, data in desk.companion.data_to_send())


def test_a_late_cycle_requests_no_mode():
    desk = Desk(authority=Authority.ENGAGE)
    desk.mode = AUTO_HOLD
    desk.run(1.2).order(INSPECTION).run_until("ready").run(1.2 - 2 * STEP_S)
    come_late(desk)
    assert desk.run(0.3).mode_requests() == []


@pytest.mark.slow
def test_a_landing_requested_in_a_late_cycle_is_requested_again_once():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT)
    desk.companion.state.mode_requester.forget_landing()
    desk.run(4.0).run_to_heartbeat()
    in_time = desk.companion.data_to_send
    asked_s = desk.now_s
    desk.companion.state.mode_requester.note_landing()
    come_late(desk)
    assert desk.run(0.1).mode_requests(asked_s) == []
    desk.companion.data_to_send = in_time
    (request,) = desk.run(2.0).mode_requests(asked_s)
    assert (request.param2, request.param3) == (4, 6)  # PX4's AUTO.LAND


# The last setpoint ------------------------------------------------------------------------------


def released_late(cycles):
    """A flight that is released in the first of `cycles` late cycles."""
    desk = Desk().come_to("flying", then_s=4.0).run_to_position()
    before = desk.setpoints()[-1]
    assert any((before.vx, before.vy, before.vz))
    in_time = desk.companion.data_to_send
    come_late(desk)
    desk.order(RELEASE).run(cycles * STEP_S)
    desk.companion.data_to_send = in_time
    assert (desk.state, desk.setpoints()[-1]) == ("released", before)
    return desk


@pytest.mark.parametrize("cycles", [1, 5])
def test_a_last_setpoint_of_a_late_cycle_is_sent_by_the_next_cycle(cycles):
    desk = released_late(cycles)
    count = len(desk.setpoints())
    *_, before, last = desk.run(1.0).setpoints()
    assert len(desk.setpoints()) == count + 1
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert math.dist((last.x, last.y, last.z), (before.x, before.y, before.z)) < 1e-6


def test_a_last_setpoint_of_a_later_cycle_is_not_part_of_the_next_stream():
    desk = released_late(1).step()
    assert desk.companion.state.setpoints._last is None


def test_a_last_setpoint_in_time_is_sent_once():
    desk = Desk().come_to("flying", then_s=4.0)
    count = len(desk.setpoints())
    assert len(desk.order(RELEASE).run(1.0).setpoints()) == count + 1


AFTER_ALL = {
    "the pilot has taken the mode": lambda desk: desk.send_heartbeat(POSCTL),
    "a failsafe has taken the mode": lambda desk: desk.send_heartbeat(AUTO_HOLD, CRITICAL),
    "the aircraft is far away by now": lambda desk: desk.step(0.6),
}


@pytest.mark.parametrize("case", AFTER_ALL)
def test_a_late_last_setpoint_is_not_repeated_after_a_change(case):
    desk = released_late(1)
    count = len(desk.setpoints())
    AFTER_ALL[case](desk)
    assert len(desk.run(1.0).setpoints()) == count


def test_after_a_jump_the_late_last_setpoint_moves_with_the_jump():
    desk = released_late(2)
    before = desk.setpoints()[-1]
    desk.jump(0.0, 0.0, -2.0)
    last = desk.run(0.2).setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert last.z - before.z == pytest.approx(-2.0, abs=0.05)


@pytest.mark.parametrize("state", ["ready", "flying", "at_target"])
def test_after_a_pause_of_the_shell_no_setpoint_is_sent(state):
    desk = Desk().come_to(state)
    began = desk.now_s
    desk.step(1.5)  # data that waited in the sockets is old, but looks new
    desk.run(5.0)
    assert desk.state == "released"
    assert desk.said("control loop stalled 1.5 s")
    assert not desk.setpoints(began)


def test_a_late_shell_does_not_make_the_setpoint_jump():
    desk = Desk().come_to("flying", then_s=4.0)
    before = desk.setpoints()[-1]
    desk.now_s += 0.4  # the process was delayed
    desk.step()
    after = desk.setpoints()[-1]
    moved = math.dist((before.x, before.y, before.z), (after.x, after.y, after.z))
    assert moved <= 0.7 * 0.1 + 1e-6
