"""The meter: what the aircraft takes of its batteries, and what they have left, as measured.

One factor on the powers of the vehicle file is measured: they keep their ratios, so that a minute
in the air is enough for all of them. Measured is, in this order,

    current   sum of U I of all batteries, where the file has their capacity
    charge    the flight between two steps of the charge that the autopilot tells

A charge that falls clearly faster than the current says goes before it. A drain is believed however
great it is, up to a limit where it is clamped: to ignore it would promise time that is not there.
What is left is the charge of the emptiest battery: packs in parallel empty alike, and of two that
do not one has failed. One that tells it no more is counted down by what is flown. Inputs: telemetry
and time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from ..types import Battery, LandedState, LocalPosition, Telemetry
from .model import S_PER_H, PowerModel

BATTERY_MAX_AGE_S = 15.0
"""BATTERY_STATUS comes at 0.5 Hz, on a slow link once in 12 s. In 15 s a multirotor spends about a
hundredth of its charge."""
_VELOCITY_MAX_AGE_S = 0.5
"""LOCAL_POSITION_NED comes at 10 Hz or more: 5 periods."""
_FLIGHT_VOLTAGE_MIN_V = 5.0
"""Below, the autopilot is fed by USB and claims a full battery; two empty cells have 6 V."""
_CELL_FULL_V = 4.05
"""Lithium-polymer under load; PX4's BAT1_V_CHARGED."""
_MEASURING_S = 10.0
"""When the measured power and the one before count alike. By then the current has settled, and a
step of the charge, seen 2 s late at worst, is known to a fifth: as well as the file."""
_FORGETTING_S = 120.0
"""Longer than a leg, so that all phases are in the mean; shorter than a battery. While much more is
taken than that mean, what was before is forgotten as fast as a new power is measured."""
_MARKS_S = 300.0
_MOST_MARKS = 100
_RECENT_S = 20.0
_RECENT_MARKS = 4
"""A drain that has begun shows in so many steps and so long, at least: one late step or a small
correction is no drain."""
_DRAINS = 1.5
"""Of the recent steps over all, where those go first."""
_LEAST_RATIO = 0.2
"""Measured over the file's power. Below, a sensor is dead."""
_GREATEST_RATIO = 20.0
"""Above, it is clamped: what flies at all has a file that is less wrong, and one wrong reading does
not empty a battery by itself."""
_SUDDEN_RATIO = 5.0
"""Of one step of the charge over what was measured before: a charge was corrected. More such steps
in a row than _MOST_SUDDEN are no corrections, and count."""
_MOST_SUDDEN = 2
"""One more may be a step that the one before it was late for."""
_AT_ODDS = 2.0
"""Of one measure over another, where the greater goes first: a gauge may have another capacity, or
follow a voltage, but not by so much unless a battery fails."""
_SWAPPED = 0.05
"""A charge that rises by more is another battery's; by less it wavers, as where the autopilot
takes it from a voltage."""
_MEAN_CURRENT_S = 10.0
_LONGEST_STEP_S = 1.0
"""After a pause nothing is known of the time between."""


@dataclass(frozen=True, slots=True)
class _Mark:
    """A step down of a battery's charge. flown_wh: until then, as the file has it.

    sudden: how many in a row may be corrections; nothing is measured up to the last of them.
    """

    charge: float
    flown_wh: float
    sudden: int = 0


@dataclass(frozen=True, slots=True)
class _Pack:
    """A battery by its last word on its charge, less what was flown since.

    heard_s: of that word. most: what its voltage allows. told: the charge that the autopilot told,
    the least while it wavers; None where only a voltage tells it. marks: the steps down of that.
    """

    heard_s: float
    charge: float
    most: float
    told: float | None = None
    marks: tuple[_Mark, ...] = ()

    @property
    def left(self) -> float:
        """Of its charge: below the range of good voltages what is claimed is not there."""
        return max(0.0, min(self.charge, self.most))


@dataclass(frozen=True, slots=True, kw_only=True)
class Meter:
    """What was measured until `updated_s`; `metered` makes the next one.

    left_wh: in real Wh or, without a capacity in the file, in those of the file; None: unknown.
    factor: measured over the file's power; source: `current`, `charge`, or the `vehicle file`.
    What is told no more, or makes no sense, changes neither, but that what is flown goes on.
    """

    updated_s: float | None = None
    left_wh: float | None = None
    factor: float = 1.0
    source: str = "vehicle file"
    prior: float = 1.0
    """The factor before what it is measured by now."""
    flies: bool = False
    flown_wh: float = 0.0
    """In the air, as the file has it."""
    recent_wh: float = 0.0
    """The same while the current was known, with what was long ago forgotten; of one flight."""
    drawn_wh: float = 0.0
    """By the current, likewise."""
    mean_current_a: Mapping[int, float] = field(default_factory=dict)
    packs: Mapping[int, _Pack] = field(default_factory=dict)
    """All batteries whose charge was ever known."""
    heard_s: float | None = None
    """When the charge of the emptiest battery was last told."""

    def flight_s(self, model: PowerModel) -> float | None:
        """How long what is left lasts, hovering; None where that is not known."""
        if self.left_wh is None:
            return None
        return self.left_wh / (self.factor * model.hover_w) * S_PER_H

    def until_s(self, model: PowerModel, charge: float) -> float | None:
        """How long, hovering, until a charge in [0, 1] is left; None where that is not known."""
        if self.left_wh is None:
            return None
        usable_wh = max(0.0, self.left_wh - charge * model.capacity_wh)
        return usable_wh / (self.factor * model.hover_w) * S_PER_H

    def left_after_s(self, model: PowerModel, need_wh: float | None) -> float | None:
        """How long what is left then lasts, hovering. need_wh: as the file has it."""
        flight_s = self.flight_s(model)
        if flight_s is None or need_wh is None:
            return None
        return flight_s - need_wh / model.hover_w * S_PER_H


def metered(meter: Meter, telemetry: Telemetry, now_s: float, model: PowerModel) -> Meter:
    """The meter after a look at the telemetry; made to be called at about 10 Hz."""
    elapsed_s = 0.0 if meter.updated_s is None else now_s - meter.updated_s
    elapsed_s = min(_LONGEST_STEP_S, max(0.0, elapsed_s))
    batteries = {
        number: battery
        for number, battery in sorted(telemetry.batteries.items())
        if is_powered(battery) and now_s - battery.received_s <= BATTERY_MAX_AGE_S
    }
    landed = telemetry.landed
    flies, gone = meter.flies if landed is None else in_the_air(telemetry), set[int]()
    if on_the_ground(telemetry):
        gone = meter.packs.keys() - telemetry.batteries.keys()  # taken out
        meter = replace(meter, prior=meter.factor, recent_wh=0.0, drawn_wh=0.0)
    flight_w = _flight_w(telemetry.local_position, now_s, model) if flies else 0.0
    flown_wh = meter.flown_wh + flight_w * elapsed_s / S_PER_H
    before = {number: mean for number, mean in meter.mean_current_a.items() if number not in gone}
    currents = _mean_currents(before, batteries, elapsed_s)
    drawn_w = _drawn_w(batteries, currents) if model.capacity_known else None
    # The factor learns late of a power that has risen.
    used_w = max(meter.factor * flight_w, min(drawn_w or 0.0, _GREATEST_RATIO * flight_w))
    used = used_w * elapsed_s / S_PER_H / model.capacity_wh
    packs = {
        number: _Pack(pack.heard_s, pack.charge - used, pack.most - used, pack.told, pack.marks)
        for number, pack in meter.packs.items()
        if number not in gone
    }
    for number, battery in batteries.items():
        counts = flies and number in currents and model.capacity_known
        mean_a = currents.get(number)
        pack = _heard(packs.get(number), battery, model, mean_a, flown_wh, counts=counts)
        if pack is not None:
            packs[number] = pack
    emptiest = min(packs.values(), key=lambda pack: pack.left, default=None)
    by_charge = _by_charge(packs, flown_wh, model)
    measured = _measured(meter, drawn_w, by_charge, flight_w, elapsed_s, model)
    factor, source, prior, recent_wh, drawn_wh = measured
    return Meter(
        updated_s=now_s,
        left_wh=None if emptiest is None else emptiest.left * model.capacity_wh,
        factor=factor,
        source=source,
        prior=prior,
        flies=flies,
        flown_wh=flown_wh,
        recent_wh=recent_wh,
        drawn_wh=drawn_wh,
        mean_current_a=currents,
        packs=packs,
        heard_s=None if emptiest is None else emptiest.heard_s,
    )


def is_powered(battery: Battery) -> bool:
    """Whether the autopilot is fed by this battery, so that its word on it means something."""
    return battery.voltage_v is None or battery.voltage_v >= _FLIGHT_VOLTAGE_MIN_V


def in_the_air(telemetry: Telemetry) -> bool:
    """Whether it is known to fly, and not to take off or to land."""
    landed = telemetry.landed
    return landed is not None and landed.state is LandedState.IN_AIR


def on_the_ground(telemetry: Telemetry) -> bool:
    """Whether it is known to stand there: a battery that is not told then was taken out."""
    landed = telemetry.landed
    return landed is not None and landed.state is LandedState.ON_GROUND


def cell_v(battery: Battery, model: PowerModel, mean_current_a: float | None) -> float | None:
    """The voltage of a cell at the mean load, so that a short pull empties no battery.

    None without the number of cells. mean_current_a: of the last seconds.
    """
    if battery.voltage_v is None or model.cells is None or not is_powered(battery):
        return None
    sag_v = 0.0
    if battery.current_a is not None and mean_current_a is not None:
        sag_v = model.cell_resistance_ohm * (battery.current_a - mean_current_a)
    return battery.voltage_v / model.cells + sag_v


def _flight_w(local: LocalPosition | None, now_s: float, model: PowerModel) -> float:
    """The power of flying as it flies now; of hovering where that is not known."""
    if local is None or now_s - local.received_s > _VELOCITY_MAX_AGE_S:
        return model.hover_w
    north_mps, east_mps, down_mps = local.velocity_ned_mps
    if not all(map(math.isfinite, local.velocity_ned_mps)):
        return model.hover_w
    level_mps = math.hypot(north_mps, east_mps)
    return model.power_w(level_mps, -down_mps)


def _mean_currents(
    means: Mapping[int, float], batteries: Mapping[int, Battery], elapsed_s: float
) -> Mapping[int, float]:
    part = -math.expm1(-elapsed_s / _MEAN_CURRENT_S)
    after = dict(means)
    for number, battery in batteries.items():
        if battery.current_a is not None:
            before = after.get(number, battery.current_a)
            after[number] = before + part * (battery.current_a - before)
    return after


def _heard(
    pack: _Pack | None,
    battery: Battery,
    model: PowerModel,
    mean_current_a: float | None,
    flown_wh: float,
    *,
    counts: bool,
) -> _Pack | None:
    """A battery with its word of now; None while its charge was never known.

    counts: whether, where only a voltage tells its charge, that is better counted down.
    """
    if pack is not None and pack.heard_s == battery.received_s:
        return pack
    volts = cell_v(battery, model, mean_current_a)
    most = math.inf if pack is None else pack.most
    if volts is not None:
        most = 1.0 - model.cell_voltage_v.fraction(volts)
    told = battery.remaining
    if told is not None:
        least, marks = _steps(pack, told, flown_wh, model)
        return _Pack(battery.received_s, told, most, least, marks)
    if pack is not None and pack.told is not None:
        return replace(pack, most=most)
    if pack is not None and counts:
        return replace(pack, heard_s=battery.received_s, most=most)
    charge = _by_voltage(battery, model)
    return pack if charge is None else _Pack(battery.received_s, charge, most)


def _by_voltage(battery: Battery, model: PowerModel) -> float | None:
    volts, empty_v = cell_v(battery, model, None), model.cell_voltage_v.high
    if volts is None:
        return None
    return min(1.0, max(0.0, (volts - empty_v) / (_CELL_FULL_V - empty_v)))


def _steps(
    pack: _Pack | None, told: float, flown_wh: float, model: PowerModel
) -> tuple[float, tuple[_Mark, ...]]:
    """The least charge told, and the steps down to it, without those that others flew."""
    if pack is None or pack.told is None or told > pack.told + _SWAPPED:
        return told, ()
    if told >= pack.told:
        return pack.told, pack.marks
    mark, marks = _Mark(told, flown_wh), pack.marks
    if marks:
        last, first = marks[-1], marks[0]
        measured = 1.0
        if last.flown_wh > first.flown_wh:
            used_wh = (first.charge - last.charge) * model.capacity_wh
            measured = max(1.0, used_wh / (last.flown_wh - first.flown_wh))
        used_wh = (last.charge - told) * model.capacity_wh
        sudden = used_wh > _SUDDEN_RATIO * measured * (flown_wh - last.flown_wh)
        if sudden and last.sudden < _MOST_SUDDEN:
            return told, (replace(mark, sudden=last.sudden + 1),)
    oldest_wh = flown_wh - model.hover_wh(_MARKS_S)
    return told, (*(old for old in marks[1 - _MOST_MARKS :] if old.flown_wh >= oldest_wh), mark)


def _drawn_w(batteries: Mapping[int, Battery], currents: Mapping[int, float]) -> float | None:
    """What all batteries give by their currents; None where one does not tell: it were too small.

    currents: of all that ever told one.
    """
    drawn_w = 0.0
    for number in batteries.keys() | currents.keys():
        battery = batteries.get(number)
        if battery is None or not battery.current_a or battery.voltage_v is None:
            return None  # nor is 0 A a word of what flies
        drawn_w += battery.current_a * battery.voltage_v
    return drawn_w


def _measured(
    meter: Meter,
    drawn_w: float | None,
    by_charge: tuple[float, float, float],
    flight_w: float,
    elapsed_s: float,
    model: PowerModel,
) -> tuple[float, str, float, float, float]:
    """The factor, by the current, else by the charge, as far as it was measured.

    With its source, the one before, and by the current what was flown and drawn: as in `Meter`.

    While the current is not told, the greater of what it said and what the charge says; else the
    charge only where it says much more.
    """
    if not flight_w or not elapsed_s:
        return meter.factor, meter.source, meter.prior, meter.recent_wh, meter.drawn_wh
    recent_wh, used_wh = meter.recent_wh, meter.drawn_wh
    prior = meter.prior
    by_current = drawn_w is not None and drawn_w >= _LEAST_RATIO * flight_w
    if drawn_w is not None and by_current:
        if not recent_wh:
            prior = meter.factor
        believed_w = min(drawn_w, _GREATEST_RATIO * flight_w)
        more = believed_w * recent_wh > _AT_ODDS * flight_w * used_wh
        kept = math.exp(-elapsed_s / (_MEASURING_S if more else _FORGETTING_S))
        recent_wh = kept * recent_wh + flight_w * elapsed_s / S_PER_H
        used_wh = kept * used_wh + believed_w * elapsed_s / S_PER_H
    measures = [(used_wh, recent_wh, used_wh, "current")]
    if not by_current or by_charge[0] * recent_wh > _AT_ODDS * used_wh * by_charge[1]:
        measures.append((*by_charge, "charge"))
    found = [
        (_blended(prior, used, flown, sure, model), source)
        for used, flown, sure, source in measures
        if flown > 0.0 and used >= _LEAST_RATIO * flown
    ]
    factor, source = max(found, default=(meter.factor, meter.source))
    return factor, source, prior if found else factor, recent_wh, used_wh


def _by_charge(
    packs: Mapping[int, _Pack], flown_wh: float, model: PowerModel
) -> tuple[float, float, float]:
    """What the steps of the charge say was used, what was flown between them, what of that is sure.

    One step alone may be early or late. Of the battery that falls fastest: where they do not empty
    alike that one ends the flight.
    """
    oldest_wh = flown_wh - model.hover_wh(_MARKS_S)
    marked = [
        pack.marks
        for pack in packs.values()
        if len(pack.marks) > 1 and pack.marks[-1].flown_wh >= oldest_wh
    ]
    measured = [
        max(_over(marks, model), key=lambda of: of[0] / of[1])
        for marks in marked
        if marks[-1].flown_wh > marks[0].flown_wh
    ]
    return max(measured, key=lambda of: of[0] / of[1], default=(0.0, 0.0, 0.0))


def _over(marks: tuple[_Mark, ...], model: PowerModel) -> Iterator[tuple[float, float, float]]:
    """The same over all marks of a battery, and over the last ones where they fall much faster."""
    last, recent = marks[-1], marks[: 1 - _RECENT_MARKS]
    begins = [mark for mark in recent if last.flown_wh - mark.flown_wh >= model.hover_wh(_RECENT_S)]
    steps = [(marks[0], marks[1])]
    if begins:
        first = len(begins) - 1
        steps.append((marks[first], marks[first + 1]))
    rate = 0.0
    for begin, sure in steps:
        used_wh, flown_wh = (begin.charge - last.charge), last.flown_wh - begin.flown_wh
        if used_wh > _DRAINS * rate * flown_wh:
            rate = used_wh / flown_wh
            sure_wh = (sure.charge - last.charge) * model.capacity_wh
            yield used_wh * model.capacity_wh, flown_wh, sure_wh


def _blended(
    prior: float, used_wh: float, flown_wh: float, sure_wh: float, model: PowerModel
) -> float:
    """The factor that was measured, as far as that is known, and the one before.

    Of much that was used in a short time as much is known as of a long one. sure_wh: of that.
    """
    measured = min(_GREATEST_RATIO, used_wh / flown_wh)
    measured_s = max(flown_wh, sure_wh) / model.hover_w * S_PER_H
    part = measured_s**2 / (measured_s**2 + _MEASURING_S**2)
    return prior + part * (measured - prior)
