"""A mission told step by step: the machine, a world to change, and the effects so far."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.mission import machine
from moar_companion.mission.machine import (
    STREAMING,
    Answer,
    Do,
    MissionState,
    MissionStatus,
    Say,
    Seek,
    Situation,
    Task,
)
from moar_companion.types import Mission

WELL = Situation(
    obstruction=None,
    reluctance=None,
    airborne=True,
    grounded=False,
    mode_ours=False,
    mode_heard_s=0.0,
    autopilot_failsafe=False,
)
"""Hovering in a mode of the pilot's, nothing against it."""

INSPECTION = Task(mission=Mission.INSPECTION, stops=("first", "second"))
LAST = Task(mission=Mission.INSPECTION, stops=("second",))
EXIT = Task(mission=Mission.EXIT)
EVACUATION = Task(mission=Mission.EVACUATION, landing=1)

ON_THE_GROUND = {"airborne": False, "grounded": True}
NOBODY_KNOWS = {"airborne": False, "grounded": False}


class Story:
    """Feeds the machine and keeps what it answered."""

    def __init__(self, *, resume=False, ready_timeout_s=30.0):
        self.status = MissionStatus()
        self.world = WELL
        self.now_s = 100.0
        self.resume = resume
        self.ready_timeout_s = ready_timeout_s
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
        """The world changes, and the machine looks at it once."""
        self.world = replace(self.world, **changes)
        return self.tick()

    def tick(self, seconds=0.02):
        self.now_s += seconds
        if not self.deaf:
            self.world = replace(self.world, mode_heard_s=self.now_s)
        return self._took(
            machine.tick(
                self.status,
                self.world,
                ready_timeout_s=self.ready_timeout_s,
                resume=self.resume,
                now_s=self.now_s,
            )
        )

    def order(self, order):
        """An operator's order; its number is in `last_id`."""
        self.last_id += 1
        return self._took(machine.command(self.status, order, self.last_id, self.world, self.now_s))

    def plan_found(self):
        return self._took(machine.planned(self.status, self.now_s))

    def plan_failed(self, reason="no free way leads there"):
        return self._took(machine.unplanned(self.status, reason, self.now_s))

    def take_back(self, order_id=None):
        number = self.last_id if order_id is None else order_id
        return self._took(machine.withdrawn(self.status, number, self.now_s))

    def _took(self, step):
        self.status, effects = step
        self.effects = list(effects)
        return self

    # What the last step led to

    @property
    def answers(self):
        """(order, verdict) in words."""
        return [
            (effect.order_id, effect.verdict.value)
            for effect in self.effects
            if isinstance(effect, Answer)
        ]

    @property
    def reasons(self):
        return [effect.reason for effect in self.effects if isinstance(effect, Answer)]

    @property
    def sought(self):
        return [effect.task for effect in self.effects if isinstance(effect, Seek)]

    @property
    def said(self):
        return [effect.text for effect in self.effects if isinstance(effect, Say)]

    @property
    def farewell(self):
        return Do.FAREWELL in self.effects


def story(state, task=INSPECTION, **options):
    """A story that has come to a state by its usual way."""
    told = Story(**options)
    if state is MissionState.IDLE:
        return told
    told.order(task)
    if state is MissionState.PLANNING:
        return told
    told.plan_found()
    if state is MissionState.READY:
        return told
    if state is MissionState.RELEASED:
        # Long enough for an operator to have heard of it.
        return told.see(obstruction="the position is 0.6 s old").see(obstruction=None).tick(1.0)
    told.see(mode_ours=True)
    if state is MissionState.FLYING:
        return told
    if state is MissionState.OVERRIDDEN:
        return told.see(mode_ours=False)
    if state is MissionState.AT_TARGET:
        assert task.mission is Mission.INSPECTION
        return told.see(arrived=True, dwell_s=5.0)
    if state is MissionState.HOLDING:
        return told.order(machine.Order.HOLD)
    assert state is MissionState.LANDING_LEG
    assert task.mission is not Mission.INSPECTION
    return told.see(on_leg=True)


def any_story(state, **options):
    """As `story`, with a mission that can come to the state."""
    leg = state is MissionState.LANDING_LEG
    told = story(state, EXIT if leg else INSPECTION, **options)
    assert told.status.state is state
    return told
