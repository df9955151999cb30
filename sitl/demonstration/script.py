"""The operator's script: take-off, inspection of every target, and each landing point in turn.

From a landing point the flight to the next begins with a take-off of its own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from .manners import Manner
from .operator import INSPECTION, Operator, OperatorError
from .processes import Process

_LOW_BATTERY_PERCENT: Final = 35
_BELOW_M: Final = 0.5
"""An aircraft this much below the height of its take-off has almost reached it."""
_CLIMB_S_PER_M: Final = 2.0
_IN_AIR: Final = 2
_SETTLE_S: Final = 3.0
_TURNED_DEG: Final = 3.0
_LONGEST_TURN_S: Final = 30.0
_STREAM_FIRST_S: Final = 1.5
"""PX4 accepts OFFBOARD once a stream has run for a second."""
_START_S: Final = 30.0
"""Time within which both processes are received; real seconds, as they do not start faster."""
_PLANNER_S: Final = 600.0
"""Longest compilation of the planner, where no cache may be written; real seconds."""
_LONGEST_TO_TARGET_S: Final = 300.0
_LONGEST_HOLD_S: Final = 60.0
_LONGEST_EXIT_S: Final = 300.0
_LONGEST_LANDING_S: Final = 60.0
_MOST_LAG_S: Final = 2.0
"""Real seconds that a machine may lose; the simulator makes up for half a second by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingPoint:
    """End of a flight: the order for it, and how high above the ground its leg ends.

    index: -1 for any of the mission's. above_m: to there a later take-off from it climbs.
    """

    name: str
    mission: int
    index: int
    above_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Script:
    """Flights, step by step; each may raise OperatorError. print_text: prints to the user.

    height_m: of the first take-off. heading_deg: of the turn after it; None: no turn. dwells_s: of
    each target. battery_falls: in the scenario; the first exit then waits for that.
    """

    operator: Operator
    manner: Manner
    processes: tuple[Process, ...]
    speed: float
    height_m: float
    heading_deg: float | None = None
    dwells_s: tuple[float, ...]
    landings: tuple[LandingPoint, ...]
    battery_falls: bool
    planner_ready: Callable[[], bool]
    print_text: Callable[[str], None]

    def fly(self) -> None:
        """From two processes that have just been started to the last landing."""
        self._start()
        self._take_off(self.height_m)
        if self.heading_deg is not None:
            self._turn(self.heading_deg)
        self._inspect()
        operator, first = self.operator, self.landings[0]
        battery = f"battery at {operator.battery_percent} %, {operator.battery_v} V"
        self.print_text(f"{battery}: order the {first.name}")
        operator.order(first.name, first.mission, first.index)
        self._land(first)
        for before, after in itertools.pairwise(self.landings):
            self._wait_until(lambda: False, _SETTLE_S)
            self._take_off(before.above_m)
            self._begin(after.name, after.mission, after.index)
            self._land(after)

    def _start(self) -> None:
        operator, start_s = self.operator, _START_S * self.speed
        self.print_text("waiting for autopilot and companion")
        self._wait_for("the autopilot", lambda: operator.autopilot_received, start_s)
        operator.request_messages()
        self._wait_for("the companion", lambda: operator.companion_received, start_s)
        ready_s = max(start_s, self.manner.ready_timeout_s)
        self._wait_for("ready to arm", lambda: operator.ready_to_arm, ready_s)
        self._wait_for("the planner", self.planner_ready, _PLANNER_S * self.speed)

    def _take_off(self, height_m: float) -> None:
        operator = self.operator
        self.print_text("arm, take off")
        operator.take_off(height_m)
        done_m, longest_s = height_m - _BELOW_M, 20.0 + _CLIMB_S_PER_M * height_m
        self._wait_for("in the air", lambda: operator.landed_state == _IN_AIR, 20.0)
        self._wait_for("take-off done", lambda: operator.altitude_m > done_m, longest_s)
        self._wait_until(lambda: False, _SETTLE_S)

    def _turn(self, heading_deg: float) -> None:
        operator = self.operator
        self.print_text(f"turn to {heading_deg:g} degrees")
        operator.turn(heading_deg)
        self._wait_for(
            "turned",
            lambda: abs(math.remainder(operator.heading_deg - heading_deg, 360.0)) < _TURNED_DEG,
            _LONGEST_TURN_S,
        )

    def _begin(self, name: str, mission: int, index: int) -> None:
        """Order a mission and give the companion its mode."""
        operator = self.operator
        self.print_text(f"order the {name}, give {self.manner.given_mode}")
        operator.order(name, mission, index)
        self._wait_until(lambda: False, _STREAM_FIRST_S)
        operator.give_mode()
        self._wait_for("flying", lambda: operator.has_received(f"MOAR: flying {name}"), 5.0)
        self.print_text("flying")

    def _inspect(self) -> None:
        operator = self.operator
        self._begin("inspection", INSPECTION, -1)
        self._wait_for(
            "the end of the inspection",
            lambda: operator.has_received("MOAR: every target is done") or self._battery_is_low(),
            sum(self.dwells_s) + len(self.dwells_s) * _LONGEST_TO_TARGET_S,
        )
        if self._battery_is_low():
            self.print_text("the battery is low before every target is done")
        elif self.battery_falls:
            self.print_text("every target is done; holding until the battery falls")
            self._wait_until(self._battery_is_low, _LONGEST_HOLD_S)

    def _land(self, landing: LandingPoint) -> None:
        """From an escape route that is flown to the ground."""
        operator = self.operator
        self._wait_for(
            f"the end of the {landing.name}",
            lambda: operator.has_received("MOAR: above the landing point"),
            _LONGEST_EXIT_S,
        )
        self.print_text("above the landing point: LAND")
        operator.land()
        longest_s = _LONGEST_LANDING_S + _CLIMB_S_PER_M * landing.above_m
        self._wait_for("landed and disarmed", lambda: not operator.armed, longest_s)
        self.print_text("landed")

    def _battery_is_low(self) -> bool:
        percent = self.operator.battery_percent
        return percent is not None and percent <= _LOW_BATTERY_PERCENT

    def _wait_for(self, what: str, condition: Callable[[], bool], timeout_s: float) -> None:
        self.operator.wait_for(what, lambda: self._all_is_well() and condition(), timeout_s)

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        self.operator.wait_until(lambda: self._all_is_well() and condition(), timeout_s)

    def _all_is_well(self) -> bool:
        """True; OperatorError when the flight cannot continue."""
        for process in self.processes:
            ended = process.ended()
            if ended is not None:
                raise OperatorError(ended)
        if self.operator.lag_s > _MOST_LAG_S:
            raise OperatorError(f"the simulator has fallen {self.operator.lag_s:.1f} s behind")
        for text in self.operator.texts:
            if text.endswith(("released", "overridden")) and not self.operator.landing:
                raise OperatorError(f"the companion let go: {text}")
        return True
