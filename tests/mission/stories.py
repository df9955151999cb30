"""A mission step by step: the machine, a world to change, and the effects so far."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.companion.mission import state_machine
from moar_companion.companion.mission.values import (
    Answer,
    FlightEffect,
    MissionStatus,
    Order,
    OverrideConditions,
    RequestPlan,
    SendText,
    Situation,
    Task,
)
from moar_companion.companion.mission_states import IN_CONTROL, STREAMING, MissionState
from moar_companion.companion.safety import supervisor
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.settings.config import OnFailure
from moar_companion.texts.text_format import pilot_text
from moar_companion.types import Mission

WELL = Situation(mode_ours=False, mode_received_s=0.0)
"""Hovering in a mode of the pilot's, nothing against it."""

INSPECTION = Task(mission=Mission.INSPECTION, stops=("first", "second"))
LAST = Task(mission=Mission.INSPECTION, stops=("second",))
EXIT = Task(mission=Mission.EXIT)
EVACUATION = Task(mission=Mission.EVACUATION, landing=1)

FAILSAFE = {"failsafe_took_mode": "autopilot in failsafe"}
NO_FAILSAFE = {"failsafe_took_mode": None}
ON_THE_GROUND = {"ground": "on the ground", "not_flying": "not in the air"}
IN_THE_AIR = {"ground": None, "not_flying": None}
LANDED_STATE_UNKNOWN = {"ground": None, "not_flying": "not in the air"}
STALE = {"position": "position age 0.6 s"}


class Story:
    """Feeds the supervisor and the machine, and keeps their effects."""

    def __init__(self, *, resume=False, ready_timeout_s=30.0):
        self.status = MissionStatus()
        self.world = WELL
        self.causes = {}
        self.watches = supervisor.HEALTHY
        self.landing_requested = False
        self.now_s = 100.0
        self.resume = resume
        self.ready_timeout_s = ready_timeout_s
        self.on_failure = OnFailure.HOLD
        self.effects = []
        self.last_id = 0
        self.deaf = False
        """The autopilot's heartbeats do not arrive: its mode is that of the last one."""

    @property
    def state(self):
        return self.status.state.value

    @property
    def streaming(self):
        return self.status.state in STREAMING

    def see(self, **changes):
        """Changes the world or the causes against flying; runs the machine once."""
        self.change(**changes)
        return self.tick()

    def change(self, **changes):
        """Changes the world or the causes before the next cycle."""
        names = {row.name for row in CONDITIONS}
        of_causes = {name: value for name, value in changes.items() if name in names}
        self.causes = self.causes | of_causes
        of_world = {name: value for name, value in changes.items() if name not in of_causes}
        self.world = replace(self.world, **of_world)

    def rule(self):
        """Runs the supervisor once."""
        left = self.status.state in IN_CONTROL and not self.world.mode_ours
        causes = {
            **self.causes,
            "landing": "the autopilot has left our mode"
            if left and self.landing_requested
            else None,
            "pilot": "the pilot has control" if left and not self.landing_requested else None,
        }
        self.watches, ruling = supervisor.step(self.watches, causes, self.now_s)
        self.world = replace(self.world, ruling=ruling)

    def tick(self, seconds=0.02):
        self.now_s += seconds
        if not self.deaf:
            self.world = replace(self.world, mode_received_s=self.now_s)
        self.rule()
        return self._took(
            state_machine.tick(
                self.status,
                self.world,
                ready_timeout_s=self.ready_timeout_s,
                resume=self.resume,
                on_failure=self.on_failure,
                now_s=self.now_s,
            )
        )

    def order(self, order):
        """An operator's order; its number is in `last_id`."""
        self.last_id += 1
        self.rule()
        return self._took(
            state_machine.command(self.status, order, self.last_id, self.world, self.now_s)
        )

    def plan_found(self, stops=()):
        planned = state_machine.planned(self.status, self.world, self.now_s, stops=stops)
        return self._took(planned)

    def shorten(self, fitting):
        return self._took(state_machine.shortened(self.status, fitting))

    def plan_failed(self, reason="no free path leads there", **why):
        return self._took(state_machine.unplanned(self.status, reason, self.now_s, **why))

    def strand(self):
        """Notes that the flown task has no path from here."""
        return self._took((self.status.without(self.status.task, now_s=self.now_s), ()))

    def take_back(self, order_id=None):
        number = self.last_id if order_id is None else order_id
        return self._took(state_machine.withdrawn(self.status, number, self.now_s))

    def _took(self, step):
        self.status, effects = step
        self.effects = list(effects)
        for effect in self.effects:
            if isinstance(effect, OverrideConditions):
                self.watches = supervisor.overridden(self.watches, known=effect.known)
        return self

    # Results of the last step

    @property
    def answers(self):
        """Answers as (order, verdict)."""
        return [
            (effect.order_id, effect.verdict.value)
            for effect in self.effects
            if isinstance(effect, Answer)
        ]

    @property
    def reasons(self):
        return [effect.reason for effect in self.effects if isinstance(effect, Answer)]

    @property
    def requested(self):
        return [effect.task for effect in self.effects if isinstance(effect, RequestPlan)]

    @property
    def said(self):
        texts = [effect for effect in self.effects if isinstance(effect, SendText)]
        return [pilot_text(item.text, item.action) for item in texts]

    @property
    def last_setpoint(self):
        return FlightEffect.SEND_LAST_SETPOINT in self.effects


def story(state, task=INSPECTION, **options):
    """Story that has reached a state in the usual order."""
    made = Story(**options)
    if state is MissionState.IDLE:
        return made
    made.order(task)
    if state is MissionState.PLANNING:
        return made
    made.plan_found()
    if state is MissionState.READY:
        return made
    if state is MissionState.RELEASED:
        # Long enough for an operator to be informed of it.
        return made.see(**STALE).see(position=None).tick(1.0)
    made.see(mode_ours=True)
    if state is MissionState.FLYING:
        return made
    if state is MissionState.OVERRIDDEN:
        return made.see(mode_ours=False).tick(1.0)
    if state is MissionState.AT_TARGET:
        assert task.mission is Mission.INSPECTION
        return made.see(arrived=True, dwell_s=5.0)
    if state is MissionState.HOLDING:
        return made.order(Order.HOLD)
    assert state is MissionState.LANDING_LEG
    assert task.mission is not Mission.INSPECTION
    return made.see(on_leg=True)


def any_story(state, task=None, **options):
    """As `story`, with a mission that can reach the state."""
    leg = state is MissionState.LANDING_LEG
    made = story(state, task or (EXIT if leg else INSPECTION), **options)
    assert made.status.state is state
    return made
