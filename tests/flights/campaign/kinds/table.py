"""The table of faults and its rows: name, effect, duration, broken part of the promise.

A kind begins on a flight with its own random numbers, and returns a function that ends it, or None.
"""

from __future__ import annotations

import enum
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...operator import Manner

Undo = Callable[[], None]


class Breaks(enum.Flag):
    """Parts of the promise that a fault breaks from its begin on, without being measurable."""

    NOTHING = 0
    AIRCRAFT = enum.auto()
    WORDS = enum.auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One row of the table. begin: (flight, random numbers) -> function that ends it, or None.

    prepare: (drawn flight, random numbers) -> the flight that the fault needs; None: any.
    """

    name: str
    what: str
    begin: Callable[[object, random.Random], Undo | None]
    lasts_s: tuple[float, float]
    breaks: Breaks
    manners: frozenset[Manner]
    prepare: Callable[[Any, random.Random], Any] | None


KINDS: dict[str, Kind] = {}


def kind(
    what: str,
    *,
    lasts_s: tuple[float, float] = (3.0, 20.0),
    breaks: Breaks = Breaks.NOTHING,
    manners: frozenset[Manner] = frozenset(Manner),
    prepare: Callable[[Any, random.Random], Any] | None = None,
):
    """Add a function to the table, under its own name."""

    def enter(begin):
        KINDS[begin.__name__] = Kind(
            name=begin.__name__,
            what=what,
            begin=begin,
            lasts_s=lasts_s,
            breaks=breaks,
            manners=manners,
            prepare=prepare,
        )
        return begin

    return enter


def set_conditions(flight, **values) -> Undo:
    """Set conditions of the world; returns the function that restores them."""
    conditions = flight.autopilot.conditions
    before = {name: getattr(conditions, name) for name in values}
    flight.note(**values)

    def put(these):
        for name, value in these.items():
            setattr(conditions, name, value)

    put(values)
    return lambda: put(before)


def set_parameters(flight, **values) -> Undo:
    """Set parameters by the ground station; returns the function that restores them."""
    before = {name: flight.autopilot.parameter(name) for name in values}
    flight.note(**values)

    def put(these):
        for name, value in these.items():
            flight.autopilot.set_parameter(name, value)

    put(values)
    return lambda: put(before)
