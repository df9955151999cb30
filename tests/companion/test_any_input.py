"""The whole companion under any sequence of inputs (hypothesis): no forbidden packet is sent.

No sequence yields a setpoint that the gate's rules forbid, nor control after an override or a
failsafe without a new order. `judge` has an independent copy of the rules.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import replace

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    rule,
    run_state_machine_as_test,
)
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.safety.condition_types import Action
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor
from moar_companion.settings.config import Authority
from tests.thorough import sampled

from ..mavlink.peer import Peer
from .desk import (
    DO_SET_MODE,
    EVACUATION,
    EXIT,
    HOLD,
    INSPECTION,
    PAUSE_CONTINUE,
    RELEASE,
    STEP_S,
    TEMPORARILY_REJECTED,
    USER_1,
    Desk,
    usual_planner,
)
from .judge import Judge
from .scripted_autopilot import (
    ACTIVE,
    AUTO_HOLD,
    AUTO_RTL,
    BRAKE,
    CRITICAL,
    LOITER,
    PARAMETERS,
    POSCTL,
    RTL,
)

NUMBERS = st.sampled_from([0.0, 0.3, -0.6, 1.2, -4.0, 30.0, math.nan, math.inf])
MISSIONS = st.sampled_from([INSPECTION, EXIT, EVACUATION])
ORDERS = st.sampled_from(
    [
        *[(USER_1, mission) for mission in (INSPECTION, EXIT, EVACUATION, HOLD, RELEASE)],
        (PAUSE_CONTINUE, 0.0),
        (PAUSE_CONTINUE, 1.0),
    ]
)
PLACES_M = st.sampled_from(
    [
        (27.0, 2.6),  # under the start
        (25.0, 10.0),  # beside a conductor, on the path to a target
        (20.8, 5.4),  # above a conductor
        (15.0, 2.4),  # just above the least altitude
        (22.0, 3.9),  # inside a keep-out
        (29.5, 5.0),  # at the border that an exit crosses
        (0.5, 5.0),  # at the border that an evacuation crosses
    ]
)
"""(x, z) where the aircraft hovers at first."""


@functools.cache
def planner():
    """Usual planner with a least altitude inside a cell, not on a border of cells.

    Beside the landing leg of an exit stands a pole.
    """
    usual = usual_planner()
    space = replace(usual.site.workspace, min_altitude_m=2.25)
    pole = Conductor(name="pole", position_m=(35.0, 6.3), radius_m=0.0175, keep_out_m=0.9)
    site = replace(usual.site, workspace=space, obstacles=(*usual.site.obstacles, pole))
    return Planner(site, usual.vehicle)


_SILENT_STEPS = 30
_GOES_ON_S = 3.5
"""Wait after any trouble: accuracy is reported once a second, obstacles shrink after three."""

EVENTS = []
"""Possible events: (name of a method of AnyInput, its arguments by name)."""


def happens(**arguments):
    def listed(method):
        EVENTS.append(st.tuples(st.just(method.__name__), st.fixed_dictionaries(arguments)))
        return method

    return listed


class AnyInput(RuleBasedStateMachine):
    """An autopilot that reports anything, operators who order anything, a shell that pauses."""

    looked, streamed = 0, 0
    """Cycles of all examples, and those with a setpoint."""

    @initialize(
        kind=st.sampled_from([mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA]),
        authority=st.sampled_from([Authority.STREAM, Authority.ENGAGE]),
        place_m=PLACES_M,
        mission=MISSIONS,
    )
    def a_mission_is_begun(self, kind, authority, place_m, mission):
        x_m, z_m = place_m
        self.desk = Desk(
            autopilot=kind,
            authority=authority,
            planner=planner(),
            height_m=z_m,
            east_m=x_m - planner().site.start_m[0],
        ).set(reset_counter=0)
        self.well = {
            name: getattr(self.desk, name)
            for name in (
                "position_ned_m",
                "estimate_off_ned_m",
                "behind_ned_m",
                "position_boot_s",
                "mute",
                "armed",
                "landed_state",
                "wind_mps",
                "fix_type",
                "receiver_accuracy_m",
                "battery_percent",
                "charge_state",
                "height_accuracy_m",
                "plan_delay_s",
            )
        } | {"accuracy_m": 0.3}
        px4 = kind == mavlink.MAV_AUTOPILOT_PX4
        self.modes = {
            "ours": self.desk.ours,
            "pilot": POSCTL if px4 else LOITER,
            "hold": AUTO_HOLD if px4 else BRAKE,
            "return": AUTO_RTL if px4 else RTL,
        }
        self.judge = Judge(self.desk, authority)
        self.operators = 0
        self._run(0.8)
        self.all_is_well_and_it_is_flown(mission)

    def _run(self, seconds=0.1):
        """Time goes on; not for long where nothing is streamed any more."""
        silent = 0
        for _ in range(round(seconds / STEP_S)):
            self.desk.step()
            self.judge.look()
            AnyInput.looked += 1
            AnyInput.streamed += self.judge.streaming
            silent = 0 if self.judge.streaming else silent + 1
            if silent > _SILENT_STEPS:
                return

    def _order(self, command, parameter):
        """By an operator who has never ordered anything: else it might count as a repeat."""
        self.operators += 1
        self.operator = Peer(240 + self.operators % 15, 190 + self.operators // 15 % 50)
        self.last_order = (command, parameter, -1.0)
        self.desk.order(parameter, command=command, peer=self.operator)

    def _say_mode(self, word, status=ACTIVE):
        self.desk.send_heartbeat(self.modes[word], status)
        self._run()

    @happens(mission=MISSIONS)
    def all_is_well_and_it_is_flown(self, mission):
        """From any trouble back to a flight, as an operator would, by an order."""
        self.desk.set(**self.well).set_parameters(**PARAMETERS)
        self._say_mode("hold")
        self._run(0.5)
        self._order(USER_1, mission)
        self._run()
        self._say_mode("ours")

    def _see_that_it_flies(self):
        """Trouble is looked for where there is a stream that it may disturb."""
        if not self.judge.streaming:
            self.all_is_well_and_it_is_flown(INSPECTION)

    @happens()
    def all_is_well_again_and_what_is_flown_goes_on(self):
        """A flight that holds without a reported reason would hold until the battery is empty."""
        self._see_that_it_flies()
        where = ("position_ned_m", "estimate_off_ned_m")
        self.desk.set(**{name: self.well[name] for name in self.well if name not in where})
        self._run(_GOES_ON_S)
        began, states = self.desk.now_s, set()
        for _ in range(round(1.5 / STEP_S)):
            self._run(STEP_S)
            states.add(self.desk.state)
        if states <= {"flying", "landing_leg"} and self.judge.controlled:
            assert any(any((m.vx, m.vy, m.vz)) for m in self.desk.setpoints(began)), "it stands"

    @happens(
        battery_percent=st.sampled_from([90, 15]),
        by=st.sampled_from(["an accuracy", "an order that is taken back"]),
    )
    def it_is_stopped_on_its_escape_route(self, battery_percent, by):
        self._see_that_it_flies()
        self.desk.set(battery_percent=battery_percent)
        self._order(USER_1, EXIT)
        self._run(4.5)
        if by == "an accuracy":
            self.desk.set(accuracy_m=1.9)
            self._run(1.4)
        else:
            self.desk.set(plan_delay_s=0.8)
            self._order(USER_1, INSPECTION)
            self._run(1.2)
            self.desk.handle(self.operator.cancel(USER_1))
        self.all_is_well_again_and_what_is_flown_goes_on()

    @happens(
        what=st.sampled_from(
            [
                {"COM_OBL_RC_ACT": 7.0},
                {"COM_OBL_RC_ACT": 0.0, "RTL_RETURN_ALT": 12.0},
                {"COM_OBL_RC_ACT": 4.0},
                {"GUID_TIMEOUT": 4.0, "MPC_XY_P": 0.3},
                {"GUID_TIMEOUT": 0.1, "MPC_XY_P": 0.95},
                {"WPNAV_ACCEL": 50.0},
            ]
        ),
        home_m=st.sampled_from([None, 27.0, 0.0]),
    )
    def the_autopilot_would_do_something_else_without_us(self, what, home_m):
        self._see_that_it_flies()
        self.desk.set_parameters(**what)
        if home_m is not None:
            self.desk.report_home(home_m)
        self._run(0.4)

    @happens(seconds=st.sampled_from([0.1, 0.6, 1.5, 3.0]))
    def time_goes_on(self, seconds):
        self._run(seconds)

    @happens(order=ORDERS)
    def something_is_ordered(self, order):
        self._order(*order)
        self._run()

    @happens(again=st.sampled_from(["by hand", "with a confirmation", "never"]))
    def the_last_order_comes_again_or_is_taken_back(self, again):
        if again == "never":
            self.desk.handle(self.operator.cancel(self.last_order[0]))
        else:
            self._repeat(again)
        self._run()

    def _repeat(self, again):
        confirmation = int(again == "with a confirmation")
        self.desk.handle(self.operator.command(*self.last_order, confirmation=confirmation))

    @happens(
        mode=st.sampled_from(["ours", "pilot", "hold", "return"]),
        status=st.sampled_from([ACTIVE, CRITICAL]),
    )
    def the_mode_changes(self, mode, status):
        self._say_mode(mode, status)

    @happens(
        mode=st.sampled_from(["ours", "pilot", "return"]),
        status=st.sampled_from([ACTIVE, CRITICAL]),
        back=st.booleans(),
        again=st.sampled_from(["by hand", "with a confirmation", "never"]),
        order=st.sampled_from([None, (PAUSE_CONTINUE, 1.0), (USER_1, INSPECTION), (USER_1, EXIT)]),
    )
    def it_is_lost_and_our_mode_comes_back_or_not(self, mode, status, back, again, order):
        self._see_that_it_flies()
        self._say_mode(mode, status)
        if back:
            self._say_mode("ours")
        if again != "never":
            self._repeat(again)
        self._run(0.6)
        if order is not None:
            self.something_is_ordered(order)
            self._run(1.3)
            # The companion requests a mode only just after a report of the mode.
            self.desk.send_heartbeat(self.desk.mode, self.desk.system_status)
            self._run()

    @happens(
        what=st.sampled_from(
            [
                {"wind_mps": 24.0},
                {"wind_mps": 2.0},
                {"fix_type": 0},
                {"receiver_accuracy_m": 0.0},
                {"receiver_accuracy_m": 1.7},
                {"accuracy_m": 0.3},
                {"accuracy_m": 1.4},
                {"accuracy_m": 1.9},
                {"accuracy_m": 9.0},
                {"height_accuracy_m": 1.5},
                {"accuracy_m": math.nan},
                {"battery_percent": 5},
                {"charge_state": 3},
                {"landed_state": 1},
                {"landed_state": 0},
                {"armed": False},
                {"behind_ned_m": (0.0, 0.6, 0.0)},
                {"behind_ned_m": (2.5, 0.0, 0.0)},
                {"behind_ned_m": (0.0, 0.0, 0.0)},
            ]
        )
    )
    def the_autopilot_tells_something_else(self, what):
        self._see_that_it_flies()
        self.desk.set(**what)
        self._run(1.2)  # it tells most of it once a second

    @happens(
        kind=st.sampled_from(["LOCAL_POSITION_NED", "ATTITUDE", "HEARTBEAT", "its clock"]),
        seconds=st.sampled_from([0.4, 0.6, 1.2, 3.2]),
    )
    def something_is_not_heard_for_a_time(self, kind, seconds):
        self._see_that_it_flies()
        if kind == "its clock":
            self.desk.position_boot_s = self.desk.boot_s
        self.desk.mute = {kind}
        self._run(seconds)
        self.desk.set(mute=set(), position_boot_s=None)

    @happens(
        where=st.sampled_from(
            ["into a keep-out", "too low", "off the plane", "beside its leg", "a little"]
        ),
        far=st.booleans(),
        reported=st.booleans(),
    )
    def the_position_jumps(self, where, far, reported):
        self._see_that_it_flies()
        self.desk.run_to_position()
        self.judge.look()
        estimate = zip(self.desk.position_ned_m, self.desk.estimate_off_ned_m, strict=True)
        _, east_m, down_m = map(sum, estimate)
        if where == "into a keep-out":
            jump_ned_m = self._to_an_obstacle(east_m, down_m, 0.3 if far else 1.3)
        else:
            jump_ned_m = {
                "too low": (0.0, 0.0, -(1.0 if far else 2.17) - down_m),
                "off the plane": (-2.6 if far else 2.1, 0.0, 0.0),
                "beside its leg": (0.9 if far else -0.45, 0.0, 0.0),
                "a little": (0.0, -0.4 if far else 0.2, 0.2),
            }[where]
        if reported:
            self.desk.reset_counter = (self.desk.reset_counter + 1) % 256
        self.desk.estimate_off_ned_m = tuple(
            old + new for old, new in zip(self.desk.estimate_off_ned_m, jump_ned_m, strict=True)
        )
        self._run()

    def _to_an_obstacle(self, east_m, down_m, left_m):
        """The way to the nearest obstacle until so much of it is left."""
        x_m, z_m = self.desk.site.start_m[0] + east_m, -down_m
        ways = [(x - x_m, z - z_m) for x, z in (o.position_m for o in self.desk.site.obstacles)]
        along_m, up_m = min(ways, key=lambda way: math.hypot(*way))
        part = 1.0 - left_m / math.hypot(along_m, up_m)
        return 0.0, part * along_m, -part * up_m

    @happens(numbers=st.tuples(*[NUMBERS] * 6))
    def a_position_of_any_numbers_is_heard(self, numbers):
        self._see_that_it_flies()
        said = mavlink.MAVLink_local_position_ned_message(
            round(self.desk.boot_s * 1000) + 1, *numbers
        )
        self.desk.handle(self.desk.autopilot.pack(said))
        self._run()

    @happens(what=st.sampled_from(["it restarts", "the mode is refused"]))
    def the_autopilot_is_not_itself(self, what):
        self._see_that_it_flies()
        if what == "it restarts":
            self.desk.boot_s = 1.0
        else:
            refused = mavlink.MAVLink_command_ack_message(DO_SET_MODE, TEMPORARILY_REJECTED)
            self.desk.handle(self.desk.autopilot.pack(refused))
        self._run()

    @happens(delay_s=st.sampled_from([None, 0.04, 0.6]))
    def the_planner_answers_soon_late_or_not(self, delay_s):
        self.desk.plan_delay_s = delay_s

    @happens(seconds=st.sampled_from([0.15, 0.4, 0.6, 1.5]))
    def the_shell_pauses(self, seconds):
        self._see_that_it_flies()
        self.desk.step(seconds)
        self.judge.look()

    @rule(event=st.deferred(lambda: st.one_of(EVENTS)))
    def something_happens(self, event):
        """One rule for all, so that hypothesis finds all of them alike in every example."""
        name, arguments = event
        getattr(self, name)(**arguments)
        self._see_that_it_was_reported()

    def _see_that_it_was_reported(self):
        """Every reason that holds a flight, or ends its task, was reported."""
        leading = self.desk.companion.ruling.leading
        if self.judge.streaming and leading is not None and leading.condition.action > Action.SLOW:
            words = _without_numbers(leading.reason)
            assert any(
                words in _without_numbers(reported) for reported in self.desk.reported_reasons()
            ), words


def _without_numbers(words):
    """The text without its numbers, which may have changed since it was sent."""
    return re.sub(r"[-\d.]+", "#", words)


def check(examples):
    AnyInput.looked, AnyInput.streamed = 0, 0
    run_state_machine_as_test(
        AnyInput,
        settings=settings(
            deadline=None,
            max_examples=examples,
            stateful_step_count=20,
            derandomize=True,
            database=None,
        ),
    )
    assert AnyInput.streamed > 0.3 * AnyInput.looked, "orders are not carried out"


def test_no_sequence_of_inputs_makes_the_companion_send_a_forbidden_packet():
    check(3)


@pytest.mark.slow
def test_no_long_search_finds_a_sequence_that_makes_the_companion_send_a_forbidden_packet():
    check(sampled(8, 60))
