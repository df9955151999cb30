"""The mission machine under any sequence of events (hypothesis): a release is final."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from moar_companion.companion.mission.values import Answer, Order, RequestPlan
from moar_companion.companion.mission_states import IN_CONTROL, STREAMING, MissionState
from moar_companion.companion.safety.condition_types import Action, Override
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.types import Mission

from .stories import EVACUATION, EXIT, FAILSAFE, IN_THE_AIR, INSPECTION, Story

_MADE = {"pilot", "landing"}
"""Set by the story, from the mode."""
CONTROL_ENDED = {MissionState.OVERRIDDEN, MissionState.RELEASED}


class Events(RuleBasedStateMachine):
    """Events of world, operator and planner, in any order."""

    def __init__(self):
        super().__init__()
        self.story = Story()
        self.commanded_since_control_ended = True
        self.open_orders = set()
        self.failsafe_known = False
        self.failsafe_new = False
        self.streamed = False

    def _after(self, *, ticked=False):
        status = self.story.status
        if self.story.last_setpoint:
            assert self.streamed
            assert status.state not in STREAMING
        self.streamed = status.state in STREAMING
        if status.state in CONTROL_ENDED:
            self.commanded_since_control_ended = False
        for effect in self.story.effects:
            if isinstance(effect, Answer):
                # One answer to each order, and to no other.
                self.open_orders.remove(effect.order_id)
        if not ticked:
            return
        ruling, causes = self.story.world.ruling, self.story.causes
        if status.order_id is not None:
            ruling = ruling.apart_from(status.known)
        failsafe = causes.get("failsafe_took_mode") is not None
        self.failsafe_known = self.failsafe_known and failsafe
        self.failsafe_new |= failsafe and not self.failsafe_known
        if status.state in STREAMING:
            assert not self.failsafe_new
            if status.state in IN_CONTROL:
                assert self.story.world.mode_ours
            for row in CONDITIONS:
                if row.action is Action.RELEASE and row.override is Override.NONE:
                    assert causes.get(row.name) is None
        if status.state in IN_CONTROL and ruling.action in {Action.HOLD, Action.LEAVE}:
            assert status.state is MissionState.HOLDING
        if status.state in IN_CONTROL and ruling.action in {Action.EXIT, Action.EVACUATION}:
            task = status.requested or status.task
            outward = task.flown or task.mission is not Mission.INSPECTION
            assert outward or status.state is MissionState.HOLDING

    def _commanded(self):
        """True if an operator's order is being planned; an active failsafe then counts as known."""
        if any(isinstance(effect, RequestPlan) for effect in self.story.effects):
            self.failsafe_known = self.story.causes.get("failsafe_took_mode") is not None
            self.failsafe_new = False
            return True
        return False

    @rule(
        causes=st.dictionaries(
            st.sampled_from([row.name for row in CONDITIONS if row.name not in _MADE]),
            st.just("trouble"),
            max_size=2,
        ),
        deaf=st.sampled_from([False, False, True]),
        landing_requested=st.sampled_from([False, False, True]),
        mode_ours=st.booleans(),
        on_leg=st.booleans(),
        arrived=st.booleans(),
        seconds=st.sampled_from([0.02, 1.0, 31.0]),
    )
    def the_world_changes(self, causes, deaf, landing_requested, seconds, **changes):
        self.story.now_s += seconds
        self.story.deaf = deaf
        self.story.landing_requested = landing_requested
        self.story.causes = causes
        self.story.see(dwell_s=1.0, **changes)
        self._after(ticked=True)

    @rule()
    def all_is_well_and_the_mode_is_ours(self):
        self.story.causes = {}
        self.story.see(mode_ours=True)
        self._after(ticked=True)

    @rule()
    def a_failsafe_begins_before_the_next_cycle(self):
        self.story.change(**FAILSAFE)

    @rule()
    def the_aircraft_takes_off_before_the_next_cycle(self):
        self.story.change(**IN_THE_AIR)

    @rule(task=st.sampled_from([INSPECTION, EXIT, EVACUATION]))
    def a_mission_is_ordered(self, task):
        self.open_orders.add(self.story.last_id + 1)
        self.story.order(task)
        if self._commanded():
            self.commanded_since_control_ended = True
        self._after()

    @rule(order=st.sampled_from(list(Order)))
    def something_else_is_ordered(self, order):
        self.open_orders.add(self.story.last_id + 1)
        before = self.story.status
        self.story.order(order)
        if self._commanded():
            assert before.task is not None
            assert not before.task.done
            assert before.hold_ordered or before.state not in STREAMING - {MissionState.HOLDING}
            assert order is Order.CONTINUE
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
    def the_order_is_cancelled(self):
        order_id = self.story.status.order_id
        self.story.take_back(order_id)
        self.open_orders.discard(order_id)
        self._after()

    @invariant()
    def no_setpoint_is_streamed_after_a_release_without_a_new_command(self):
        if not self.commanded_since_control_ended:
            assert self.story.status.state not in STREAMING

    @invariant()
    def an_order_is_open_only_while_its_plan_is_awaited(self):
        status = self.story.status
        assert self.open_orders == (set() if status.order_id is None else {status.order_id})
        if status.state is MissionState.PLANNING:
            assert status.requested is not None
        if status.state in STREAMING:
            assert status.task is not None
        if status.hold_ordered:
            assert status.state is MissionState.READY


TestEvents = Events.TestCase
TestEvents.settings = settings(
    deadline=None, max_examples=150, stateful_step_count=40, derandomize=True, database=None
)
