"""The mission machine under any sequence of events (hypothesis): who lets go stays away."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from moar_companion.mission.machine import (
    IN_CONTROL,
    STREAMING,
    Answer,
    MissionState,
    Order,
    Seek,
)

from .stories import EVACUATION, EXIT, INSPECTION, Story

LET_GO = {MissionState.OVERRIDDEN, MissionState.RELEASED}


class Events(RuleBasedStateMachine):
    """Whatever world, operator and planner do, in any order."""

    def __init__(self):
        super().__init__()
        self.story = Story()
        self.commanded_since_let_go = True
        self.open_orders = set()
        self.failsafe_known = False
        self.failsafe_new = False
        self.streamed = False

    def _after(self, *, ticked=False):
        status = self.story.status
        if self.story.farewell:
            assert self.streamed
            assert status.state not in STREAMING
        self.streamed = status.state in STREAMING
        if status.state in LET_GO:
            self.commanded_since_let_go = False
        for effect in self.story.effects:
            if isinstance(effect, Answer):
                # One answer to each order, and to no other.
                self.open_orders.remove(effect.order_id)
        if not ticked:
            return
        world = self.story.world
        self.failsafe_known = self.failsafe_known and world.autopilot_failsafe
        self.failsafe_new |= world.autopilot_failsafe and not self.failsafe_known
        if status.state in STREAMING:
            assert world.obstruction is None
            assert not world.grounded
            assert not self.failsafe_new
            if status.state in IN_CONTROL:
                assert world.mode_ours

    def _commanded(self):
        """An operator's order is being planned: what failsafe there is, he knows of."""
        if any(isinstance(effect, Seek) for effect in self.story.effects):
            self.failsafe_known = self.story.world.autopilot_failsafe
            self.failsafe_new = False
            return True
        return False

    @rule(
        obstruction=st.sampled_from([None, None, None, "stale"]),
        reluctance=st.sampled_from([None, None, "far"]),
        landed=st.sampled_from([*[(True, False)] * 4, (False, False), (False, True)]),
        deaf=st.sampled_from([False, False, True]),
        parting=st.booleans(),
        landing_requested=st.sampled_from([False, False, True]),
        mode_ours=st.booleans(),
        failsafe=st.sampled_from([False, False, True]),
        on_leg=st.booleans(),
        arrived=st.booleans(),
        seconds=st.sampled_from([0.02, 1.0, 31.0]),
    )
    def the_world_changes(self, landed, failsafe, deaf, seconds, **changes):
        self.story.now_s += seconds
        self.story.deaf = deaf
        airborne, grounded = landed
        self.story.see(
            airborne=airborne,
            grounded=grounded,
            autopilot_failsafe=failsafe,
            dwell_s=1.0,
            **changes,
        )
        self._after(ticked=True)

    @rule()
    def all_is_well_and_the_mode_is_ours(self):
        self.story.see(
            obstruction=None,
            airborne=True,
            grounded=False,
            mode_ours=True,
            autopilot_failsafe=False,
        )
        self._after(ticked=True)

    @rule()
    def a_failsafe_begins_and_nobody_looks_yet(self):
        self.story.world = replace(self.story.world, autopilot_failsafe=True)

    @rule(task=st.sampled_from([INSPECTION, EXIT, EVACUATION]))
    def a_mission_is_ordered(self, task):
        self.open_orders.add(self.story.last_id + 1)
        self.story.order(task)
        if self._commanded():
            self.commanded_since_let_go = True
        self._after()

    @rule(order=st.sampled_from(list(Order)))
    def something_else_is_ordered(self, order):
        self.open_orders.add(self.story.last_id + 1)
        before = self.story.status
        self.story.order(order)
        if self._commanded():
            assert before.held or before.state is MissionState.HOLDING
        self._after()

    @rule()
    def a_plan_is_found(self):
        self.story.plan_found()
        self._after()

    @rule()
    def no_plan_is_found(self):
        self.story.plan_failed()
        self._after()

    @precondition(lambda self: self.story.status.order_id is not None)
    @rule()
    def the_order_is_taken_back(self):
        order_id = self.story.status.order_id
        self.story.take_back(order_id)
        self.open_orders.discard(order_id)
        self._after()

    @invariant()
    def nothing_streams_after_letting_go_without_a_new_command(self):
        if not self.commanded_since_let_go:
            assert self.story.status.state not in STREAMING

    @invariant()
    def an_order_is_open_only_while_its_plan_is_awaited(self):
        status = self.story.status
        assert self.open_orders == (set() if status.order_id is None else {status.order_id})
        if status.state is MissionState.PLANNING:
            assert status.sought is not None
        if status.state in STREAMING:
            assert status.task is not None
        if status.held:
            assert status.state is MissionState.READY


TestEvents = Events.TestCase
TestEvents.settings = settings(
    deadline=None, max_examples=300, stateful_step_count=40, derandomize=True, database=None
)
