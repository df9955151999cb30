"""How a parameter of the autopilot is judged: its value in, a finding out.

The tables are `px4` and `ardupilot`. Only what was told is judged: a parameter that was not told is
unknown, and never taken for its default.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..service.loss import Loss
from ..types import AutopilotKind
from ..vehicle import Vehicle
from .findings import Finding, Level

CLIMBS = "which climbs first, perhaps through conductors"
CLIMBING = f"return, {CLIMBS}"
FALLING = "motors off: it falls"
UNTIL_IT_FALLS = "the companion leads out before; without one it flies on until it falls"
_SHORT_S = 0.5
"""As the manual asks for."""
_NOT_TOLD = "check again over a better link, or look it up in the ground station"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """What a value is judged against."""

    vehicle: Vehicle
    parameters: Mapping[str, float | None]
    ground_station_heard: bool
    objection: Level = Level.NO_GO
    """What an objection to a death in flight comes to, as configured."""

    def has_bit(self, name: str, bit: int) -> bool:
        """Whether a parameter is known to have a bit set."""
        value = self.parameters.get(name)
        return value is not None and bool(int(value) >> bit & 1)


Verdict = tuple[Level, str]
"""A level, and the value in words."""
Judge = Callable[[float, Case], Verdict]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """How one parameter is judged, what it decides, and what to set."""

    parameter: str
    judge: Judge
    meaning: str
    remedy: str = ""
    """Said from a warning on."""
    unknown: Level = Level.WARNING
    """How much it matters that it was not told: a no-go where its value may be one."""


def parameter_findings(rules: Iterable[Rule], case: Case) -> list[Finding]:
    """One finding for each rule."""
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
    """By the value of an enumeration."""

    def judge(value: float, _: Case) -> Verdict:
        level, word = verdicts.get(int(value), (Level.WARNING, "not known here"))
        return level, f"{value:g} ({word})"

    return judge


def where_zero(
    judge: Judge, others: tuple[str, ...], level_of: Callable[[Level], Level], words: str
) -> Judge:
    """At another level, with a word more, where other parameters are all known to be 0."""

    def judging(value: float, case: Case) -> Verdict:
        level, text = judge(value, case)
        if any(case.parameters.get(name) != 0.0 for name in others):
            return level, text
        are = "is 0" if len(others) == 1 else "are 0"
        return level_of(level), f"{text}, {words}: {' and '.join(others)} {are}"

    return judging


def excepted(judge: Judge, by: tuple[str, int], words: str) -> Judge:
    """All is well where a bit of another parameter makes an exception of our mode."""

    def excepting(value: float, case: Case) -> Verdict:
        if case.has_bit(*by):
            return Level.OK, f"{value:g} ({words}, by {by[0]})"
        return judge(value, case)

    return excepting


def bits(mask: int, *, clear: Verdict, is_set: Verdict) -> Judge:
    """By whether any bit of a mask is set."""

    def judge(value: float, _: Case) -> Verdict:
        level, words = is_set if int(value) & mask else clear
        return level, f"{value:g} ({words})"

    return judge


def switch(off: Level) -> Judge:
    """What is wrong when it is 0."""
    return lambda value, _: (Level.OK if value else off, f"{value:g}")


def excepts_us(parameter: str, source: str, mode: str) -> Rule:
    """Bit 2 says in both autopilots that a loss does not count in our mode."""
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
    """The parameters that limit the speed level, upwards and downwards; scale: to m/s."""
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
    """Good to know, whatever it is."""
    return lambda value, _: (Level.NOTE, f"{value * scale:g} {unit}")


def time_on_last_setpoint(kind: AutopilotKind) -> Judge:
    """Seconds in which nobody steers, and how far the aircraft comes before it rests."""

    def judge(value: float, case: Case) -> Verdict:
        speed_mps, loss = case.vehicle.speed.max_mps, Loss.of(kind, case.parameters)
        assert loss is not None
        way_m = float(loss.way_m(np.array(speed_mps)))
        words = f"{value:g} s, and up to {way_m:.1f} m at {speed_mps:g} m/s until it rests"
        if loss.objection_anywhere is not None and loss.timeout_s is not None:
            return case.objection, words
        return (Level.OK if value <= _SHORT_S else Level.WARNING), words

    return judge


def follows_setpoints() -> tuple[Rule, ...]:
    """Whether ArduPilot accelerates as hard as our setpoints do; else no inspection is begun."""

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
    """A speed limit that must not be below what the vehicle file asks for; scale: to m/s."""

    def judge(value: float, case: Case) -> Verdict:
        limit_mps, asked_mps = value * scale, asked(case.vehicle)
        words = f"{limit_mps:g} m/s, the vehicle file asks for {asked_mps:g}"
        return (Level.OK if limit_mps >= asked_mps - 1e-3 else Level.WARNING), words

    return judge


def cell_voltage(least_v: float) -> Judge:
    """A threshold of the whole pack, which in volts of a cell must not be below `least_v`."""

    def judge(value: float, case: Case) -> Verdict:
        cells = case.vehicle.risk.cells
        if value <= 0.0:
            return Level.NOTE, f"{value:g} (none)"
        if cells is None:
            return Level.NOTE, f"{value:g} V, of how many cells the vehicle file does not say"
        words = f"{value:g} V, {value / cells:.2f} V a cell"
        return (Level.OK if value / cells >= least_v else Level.WARNING), words

    return judge
