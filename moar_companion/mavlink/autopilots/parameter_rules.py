"""Rules by which `check` judges parameters: value in, level and text out. Pure.

The file of each autopilot has its table. Only reported values are judged: a parameter that was not
reported is unknown, and never taken for its default.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from .failsafe_actions import AutopilotAction
from .offboard_loss import OffboardLoss, follows
from .parameter_names import Parameters

CLIMBS = "which climbs first, perhaps through conductors"
CLIMBING = f"return, {CLIMBS}"
UNTIL_IT_FALLS = (
    "the companion flies the exit before; without it the aircraft flies on until it falls"
)
_SHORT_S = 0.5
"""Offboard time-out that the manual requires, in s."""
_LONG_S = 2.0
"""Longest one of PX4 with which a companion failure was flown."""


class Level(enum.IntEnum):
    """Severity of a finding, the least first."""

    OK = 0
    NOTE = 1
    """Information only."""
    WARNING = 2
    """The flight is possible if the operator understands the finding."""
    NO_GO = 3
    """Must be fixed before the flight."""

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")

    @classmethod
    def of_risk(cls, risk: float) -> Level:
        """Level of a risk in [0, 1], as the risk indices have them."""
        if risk <= 0.0:
            return cls.OK
        if risk >= 1.0:
            return cls.NO_GO
        return cls.NOTE if risk < _WORRYING_RISK else cls.WARNING


_WORRYING_RISK = 0.5
"""Middle between the value at which an input begins to count and its worst value."""


class Case(NamedTuple):
    """Context of a judgement: the autopilot's parameters, the vehicle file, what is received."""

    parameters: Parameters
    loss: OffboardLoss
    """Offboard loss by these parameters."""
    objection: Level
    """Level of an objection to an offboard loss in flight, as configured."""
    ground_station_received: bool
    speeds_mps: tuple[float, float, float]
    """Greatest speeds of the vehicle level, upwards and downwards."""
    max_speed_mps: float
    acceleration_mps2: float
    """Acceleration of the setpoints."""
    cells: int | None
    """Cells of the pack in series; None if the vehicle file has no number."""
    battery_full: float
    """Charge at which the companion's battery risk is full."""

    def has_bit(self, name: str, bit: int) -> bool:
        """True if a parameter is known to have a bit set."""
        value = self.parameters.get(name)
        return value is not None and bool(int(value) >> bit & 1)


Verdict = tuple[Level, str]
"""A level, and the value as text."""
Judge = Callable[[float, Case], Verdict]


class Rule(NamedTuple):
    """Judgement of one parameter, its meaning, and the remedy."""

    parameter: str
    """Its key; the report has its name in the connected firmware."""
    judge: Judge
    meaning: str
    remedy: str | Callable[[Case], str] = ""
    """Shown from a warning on."""
    unknown: Level = Level.WARNING
    """Level of a parameter that was not reported: a no-go if its value may be one."""
    advised: float | Callable[[float, Case], float | None] | None = None
    """Value that `setup` offers from a warning on, one that is judged better, in our unit; by the
    present one and the context where it depends on these. None: a person has to choose."""


class Reaction(NamedTuple):
    """Reaction of the autopilot by a value of a parameter: its action, and the report's words."""

    action: AutopilotAction
    words: str


NOTHING = Reaction(AutopilotAction.NONE, "nothing")
LANDS = Reaction(AutopilotAction.LAND, "land")
RETURNS = Reaction(AutopilotAction.RETURN, CLIMBING)
FALLS = Reaction(AutopilotAction.FALL, "motors off: the aircraft falls")


def reaction(
    table: Mapping[int, Reaction],
    *,
    none: Level = Level.OK,
    returns: Level = Level.WARNING,
    falls: Level = Level.NO_GO,
) -> Judge:
    """Judges by the reaction to a value; none, returns, falls: levels of these actions.

    A hold and a landing are OK. Other actions have no level: KeyError.
    """
    levels = {
        AutopilotAction.NONE: none,
        AutopilotAction.HOLD: Level.OK,
        AutopilotAction.LAND: Level.OK,
        AutopilotAction.RETURN: returns,
        AutopilotAction.FALL: falls,
    }
    return choice({value: (levels[row.action], row.words) for value, row in table.items()})


def choice(verdicts: Mapping[int, Verdict]) -> Judge:
    """Judges by the value of an enumeration."""

    def judge(value: float, _: Case) -> Verdict:
        level, word = verdicts.get(int(value), (Level.WARNING, "unknown value"))
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
        *first, last = others
        zero = f"{', '.join(first)} and {last} are 0" if first else f"{last} is 0"
        return level_of(level), f"{text}, {words}: {zero}"

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
    """Rule of bit 2: both autopilots ignore a loss in our mode if it is set."""
    return Rule(
        parameter=parameter,
        judge=bits(0b100, clear=(Level.OK, "active"), is_set=(Level.NOTE, "ignored")),
        meaning=f"reaction to a lost {source} in {mode}",
    )


def speed_limits(
    autopilot: str,
    names: tuple[str, str, str],
    *,
    unknown: Level = Level.WARNING,
) -> tuple[Rule, ...]:
    """Rules of the parameters that limit the speed level, upwards and downwards, in m/s."""
    return tuple(
        Rule(
            parameter=name,
            judge=_covers(axis),
            meaning=f"greatest speed of {autopilot} {direction}",
            remedy="set it higher, or the speed of the vehicle file lower",
            unknown=unknown,
            advised=_asked_speed(axis),
        )
        for axis, (name, direction) in enumerate(
            zip(names, ("level", "upwards", "downwards"), strict=True)
        )
    )


def shown(unit: str) -> Judge:
    """Judges any value as a note."""
    return lambda value, _: (Level.NOTE, f"{value:g} {unit}")


def time_on_last_setpoint(value: float, case: Case) -> Verdict:
    """Judges the seconds without new setpoints, with the stopping distance."""
    speed_mps, loss = case.max_speed_mps, case.loss
    stopping_m = float(loss.stopping_m(np.array(speed_mps)))
    words = (
        f"{value:g} s, and up to {stopping_m:.1f} m at {speed_mps:g} m/s until the aircraft stops"
    )
    # PX4 keeps the setpoint: its time does not stretch the stop, and the flight does not read it.
    too_long = loss.timeout_s is None and value > _LONG_S
    if too_long or (loss.timeout_s is not None and loss.objection_anywhere is not None):
        return case.objection, words
    return (Level.OK if value <= _SHORT_S else Level.WARNING), words


def follows_setpoints(autopilot: str, names: tuple[tuple[str, str], ...]) -> tuple[Rule, ...]:
    """Rules of parameters that limit the acceleration, in m/s^2, by name and direction.

    Below that of our setpoints the service objects as to an offboard loss.
    """

    def judge(value: float, case: Case) -> Verdict:
        asked_mps2 = case.acceleration_mps2
        words = f"{value:g} m/s2, the vehicle file requires {asked_mps2:g}"
        return (Level.OK if follows(value, asked_mps2) else case.objection), words

    def remedy(case: Case) -> str:
        settings = case.loss.follows_remedy(case.acceleration_mps2)
        return f"{settings}, or guidance.acceleration_mps2 of the vehicle file lower"

    return tuple(
        Rule(
            parameter=name,
            judge=judge,
            meaning=f"acceleration limit of {autopilot} for our setpoints {direction}",
            remedy=remedy,
            unknown=Level.NO_GO,
            advised=lambda _, case: case.acceleration_mps2,
        )
        for name, direction in names
    )


def _covers(axis: int) -> Judge:
    """Judges a speed limit in m/s, which must not be below that of the vehicle file."""

    def judge(value: float, case: Case) -> Verdict:
        asked_mps = case.speeds_mps[axis]
        words = f"{value:g} m/s, the vehicle file requires {asked_mps:g}"
        return (Level.OK if value >= asked_mps - 1e-3 else Level.WARNING), words

    return judge


def volts_a_cell(cell_v: float) -> Callable[[float, Case], float | None]:
    """Advice of a voltage of the whole pack; None while the number of cells is not known."""
    return lambda _, case: None if case.cells is None else round(case.cells * cell_v, 2)


def _asked_speed(axis: int) -> Callable[[float, Case], float | None]:
    return lambda _, case: case.speeds_mps[axis]


def landing_speed(least_mps: float) -> Judge:
    """Judges the speed of a landing in m/s, with whose least value its energy is forecast."""

    def judge(value: float, _: Case) -> Verdict:
        words = f"{value:g} m/s, its energy is forecast with {least_mps:g}"
        return (Level.OK if value >= least_mps - 1e-3 else Level.WARNING), words

    return judge


def cell_voltage(least_v: float) -> Judge:
    """Judges a threshold of the whole pack, which must not be below `least_v` for one cell."""

    def judge(value: float, case: Case) -> Verdict:
        cells = case.cells
        if value <= 0.0:
            return Level.NOTE, f"{value:g} (none)"
        if cells is None:
            return Level.NOTE, f"{value:g} V, the number of cells is not in the vehicle file"
        words = f"{value:g} V, {value / cells:.2f} V a cell"
        return (Level.OK if value / cells >= least_v else Level.WARNING), words

    return judge
