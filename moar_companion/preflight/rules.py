"""Judgement of the autopilot's parameters: a value in, a finding out.

The tables are `px4_parameters` and `ardupilot_parameters`. Only reported values are judged: a
parameter that was not reported is unknown, and never taken for its default.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..safety.offboard_loss import OffboardLoss
from ..types import AutopilotKind
from ..vehicle import Vehicle
from .findings import Finding, Level

CLIMBS = "which climbs first, perhaps through conductors"
CLIMBING = f"return, {CLIMBS}"
FALLING = "motors off: it falls"
UNTIL_IT_FALLS = "the companion leads out before; without one it flies on until it falls"
_SHORT_S = 0.5
"""As the manual requires."""
_NOT_TOLD = "check again over a better link, or look it up in the ground station"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Context of a judgement."""

    vehicle: Vehicle
    parameters: Mapping[str, float | None]
    ground_station_heard: bool
    objection: Level = Level.NO_GO
    """Level of an objection to an offboard loss in flight, as configured."""

    def has_bit(self, name: str, bit: int) -> bool:
        """True if a parameter is known to have a bit set."""
        value = self.parameters.get(name)
        return value is not None and bool(int(value) >> bit & 1)


Verdict = tuple[Level, str]
"""A level, and the value as text."""
Judge = Callable[[float, Case], Verdict]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Judgement of one parameter, its meaning, and the remedy."""

    parameter: str
    judge: Judge
    meaning: str
    remedy: str = ""
    """Shown from a warning on."""
    unknown: Level = Level.WARNING
    """Level of a parameter that was not reported: a no-go if its value may be one."""


def parameter_findings(rules: Iterable[Rule], case: Case) -> list[Finding]:
    """Returns one finding for each rule."""
    return [_finding(rule, case) for rule in rules]


def _finding(rule: Rule, case: Case) -> Finding:
    value = case.parameters.get(rule.parameter)
    if value is None:
        return Finding(
            level=rule.unknown,
            subject=rule.parameter,
            text=f"unknown, there is no such parameter or no answer: {rule.meaning}",
            remedy="" if rule.unknown is Level.NOTE else _NOT_TOLD,
        )
    level, words = rule.judge(value, case)
    return Finding(
        level=level,
        subject=rule.parameter,
        text=f"{words}: {rule.meaning}",
        remedy=rule.remedy if level >= Level.WARNING else "",
    )


def choice(verdicts: Mapping[int, Verdict]) -> Judge:
    """Judges by the value of an enumeration."""

    def judge(value: float, _: Case) -> Verdict:
        level, word = verdicts.get(int(value), (Level.WARNING, "not known here"))
        return level, f"{value:g} ({word})"

    return judge


def where_zero(
    judge: Judge, others: tuple[str, ...], level_of: Callable[[Level], Level], words: str
) -> Judge:
    """Judges at another level, with more text, if other parameters are all known to be 0."""

    def judging(value: float, case: Case) -> Verdict:
        level, text = judge(value, case)
        if any(case.parameters.get(name) != 0.0 for name in others):
            return level, text
        are = "is 0" if len(others) == 1 else "are 0"
        return level_of(level), f"{text}, {words}: {' and '.join(others)} {are}"

    return judging


def excepted(judge: Judge, by: tuple[str, int], words: str) -> Judge:
    """Judges as OK if a bit of another parameter exempts our mode."""

    def excepting(value: float, case: Case) -> Verdict:
        if case.has_bit(*by):
            return Level.OK, f"{value:g} ({words}, by {by[0]})"
        return judge(value, case)

    return excepting


def bits(mask: int, *, clear: Verdict, is_set: Verdict) -> Judge:
    """Judges by any set bit of a mask."""

    def judge(value: float, _: Case) -> Verdict:
        level, words = is_set if int(value) & mask else clear
        return level, f"{value:g} ({words})"

    return judge


def switch(off: Level) -> Judge:
    """Judges 0 at the level `off`, all else as OK."""
    return lambda value, _: (Level.OK if value else off, f"{value:g}")


def excepts_us(parameter: str, source: str, mode: str) -> Rule:
    """Rule of bit 2, by which a loss does not count in our mode, in both autopilots."""
    return Rule(
        parameter=parameter,
        judge=bits(0b100, clear=(Level.OK, "it counts"), is_set=(Level.NOTE, "it does not")),
        meaning=f"whether a lost {source} counts in {mode}",
    )


def speed_limits(
    autopilot: str,
    names: tuple[str, str, str],
    *,
    scale: float = 1.0,
    unknown: Level = Level.WARNING,
) -> tuple[Rule, ...]:
    """Rules of the parameters that limit the speed level, upwards and downwards; scale: to m/s."""
    asked: tuple[tuple[str, Callable[[Vehicle], float]], ...] = (
        ("level", lambda vehicle: vehicle.speed.horizontal_mps),
        ("upwards", lambda vehicle: vehicle.speed.up_mps),
        ("downwards", lambda vehicle: vehicle.speed.down_mps),
    )
    return tuple(
        Rule(
            parameter=name,
            judge=_covers(wanted, scale),
            meaning=f"the fastest that {autopilot} flies {direction}",
            remedy="set it higher, or the speed of the vehicle file lower",
            unknown=unknown,
        )
        for name, (direction, wanted) in zip(names, asked, strict=True)
    )


def told(unit: str, scale: float = 1.0) -> Judge:
    """Judges any value as a note."""
    return lambda value, _: (Level.NOTE, f"{value * scale:g} {unit}")


def time_on_last_setpoint(kind: AutopilotKind) -> Judge:
    """Judges the seconds without new setpoints, with the stopping distance."""

    def judge(value: float, case: Case) -> Verdict:
        speed_mps, loss = case.vehicle.speed.max_mps, OffboardLoss.of(kind, case.parameters)
        assert loss is not None
        way_m = float(loss.way_m(np.array(speed_mps)))
        words = f"{value:g} s, and up to {way_m:.1f} m at {speed_mps:g} m/s until it rests"
        if loss.objection_anywhere is not None and loss.timeout_s is not None:
            return case.objection, words
        return (Level.OK if value <= _SHORT_S else Level.WARNING), words

    return judge


def follows_setpoints() -> tuple[Rule, ...]:
    """Rules of ArduPilot's acceleration: below that of our setpoints no inspection begins."""

    def judge(value: float, case: Case) -> Verdict:
        limit_mps2, asked_mps2 = 0.01 * value, case.vehicle.guidance.acceleration_mps2
        words = f"{limit_mps2:g} m/s2, the vehicle file asks for {asked_mps2:g}"
        return (Level.OK if limit_mps2 >= asked_mps2 - 1e-3 else Level.WARNING), words

    return tuple(
        Rule(
            parameter=name,
            judge=judge,
            meaning=f"how hard ArduPilot follows our setpoints {direction}",
            remedy="set it higher, or guidance.acceleration_mps2 of the vehicle file lower",
        )
        for name, direction in (("WPNAV_ACCEL", "level"), ("WPNAV_ACCEL_Z", "up and down"))
    )


def _covers(asked: Callable[[Vehicle], float], scale: float) -> Judge:
    """Judges a speed limit, which must not be below that of the vehicle file; scale: to m/s."""

    def judge(value: float, case: Case) -> Verdict:
        limit_mps, asked_mps = value * scale, asked(case.vehicle)
        words = f"{limit_mps:g} m/s, the vehicle file asks for {asked_mps:g}"
        return (Level.OK if limit_mps >= asked_mps - 1e-3 else Level.WARNING), words

    return judge


def cell_voltage(least_v: float) -> Judge:
    """Judges a threshold of the whole pack, which must not be below `least_v` for one cell."""

    def judge(value: float, case: Case) -> Verdict:
        cells = case.vehicle.risk.cells
        if value <= 0.0:
            return Level.NOTE, f"{value:g} (none)"
        if cells is None:
            return Level.NOTE, f"{value:g} V, of how many cells the vehicle file does not say"
        words = f"{value:g} V, {value / cells:.2f} V a cell"
        return (Level.OK if value / cells >= least_v else Level.WARNING), words

    return judge
