"""Meter: measured power of the aircraft, and energy left in its batteries.

The meter measures one factor on the powers of the vehicle file. Their ratios stay the same, so that
a minute in the air suffices for all. Sources, in this order:

    current   sum of U I of all batteries, if the file has their capacity
    charge    the flight between two steps of the charge that the autopilot reports

A charge that falls clearly faster than by the current has precedence. Every drain counts, clamped
at a limit: without it the forecast would have too much flight time. The energy left is that of the
emptiest battery: packs in parallel empty alike, and if two differ one has failed. A battery that no
longer reports is counted down by the energy flown. Inputs: telemetry and time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ...mavlink.telemetry import Battery, LandedState, LocalPosition, Telemetry
from .cells import cell_v, is_powered
from .model import S_PER_H, PowerModel

BATTERY_MAX_AGE_S = 15.0
"""Maximum age of BATTERY_STATUS: 0.5 Hz, on a slow link once in 12 s. In 15 s a multirotor uses
about a hundredth of its charge."""
_VELOCITY_MAX_AGE_S = 0.5
"""Maximum age of LOCAL_POSITION_NED: 5 periods at 10 Hz or more."""
_CELL_FULL_V = 4.05
"""Full lithium-polymer cell under load; PX4's BAT1_V_CHARGED."""
_MEASURING_S = 10.0
"""Measuring time at which the measured factor and the prior count alike. By then the current has
settled. A step of the charge may be 2 s late: an error of a fifth, as in the vehicle file."""
_FORGETTING_S = 120.0
"""Time constant of the mean: longer than a leg, so that it covers all phases; shorter than a
battery. While the power is far above the mean, _MEASURING_S replaces it."""
_MARKS_S = 300.0
_MOST_MARKS = 100
_RECENT_S = 20.0
_RECENT_MARKS = 4
"""Least steps and duration of a drain: one late step or a small correction is no drain."""
_DRAINS = 1.5
"""Least ratio of the recent steps' rate to that of all at which the recent ones have precedence."""
_LEAST_RATIO = 0.2
"""Least ratio of the measured to the file's power; below, the sensor has failed."""
_GREATEST_RATIO = 20.0
"""Greatest such ratio; above, it is clamped. The file of a flying vehicle is less wrong, and one
wrong reading must not empty a battery."""
_SUDDEN_RATIO = 5.0
"""Ratio of one step of the charge to the measured rate that means a correction of the charge. More
such steps in a row than _MOST_SUDDEN are no corrections, and count."""
_MOST_SUDDEN = 2
"""Limit of corrections in a row; the second may be a step that follows a late one."""
_AT_ODDS = 2.0
"""Ratio of two measures at which the greater has precedence. A gauge may assume another capacity or
follow a voltage, but without a battery failure it differs by less."""
_STEP = 0.01
"""Step of a reported charge: a percent."""
_SWAPPED = 0.05
"""Rise of the charge that means another battery; smaller rises are noise, as of a charge that the
autopilot derives from a voltage."""
_MEAN_CURRENT_S = 10.0
_LONGEST_STEP_S = 1.0
"""Longest time between two updates that counts: the flight during a longer pause is unknown."""


class _Mark(NamedTuple):
    """A step down of a battery's charge. flown_wh: energy flown until then, in Wh of the file.

    sudden: number of possible corrections in a row; no measurement reaches across them.
    """

    charge: float
    flown_wh: float
    sudden: int = 0


class _Pack(NamedTuple):
    """A battery by its last reported charge, less the charge flown since.

    received_s: time of that report. most: greatest charge that its voltage allows. reported: charge
    that the autopilot reported, the least of a noisy one; None if only a voltage gives it. marks:
    decreases of `reported`. flown_wh: energy flown until its last report, in Wh of the file.
    """

    received_s: float
    charge: float
    most: float
    reported: float | None = None
    marks: tuple[_Mark, ...] = ()
    flown_wh: float = 0.0

    @property
    def left(self) -> float:
        """Charge left, limited by the voltage: a low voltage overrides the reported charge."""
        return max(0.0, min(self.charge, self.most))


@dataclass(frozen=True, slots=True, kw_only=True)
class Meter:
    """Measurements until `updated_s`; `metered` makes the next one.

    left_wh: in real Wh or, without a capacity in the file, in Wh of the file; None: unknown.
    factor: measured over the file's power; source: `current`, `charge`, or the `vehicle file`.
    Missing or implausible values change neither; the energy flown is still subtracted.
    """

    updated_s: float | None = None
    left_wh: float | None = None
    factor: float = 1.0
    source: str = "vehicle file"
    prior: float = 1.0
    """Factor before the present measurement."""
    flies: bool = False
    flown_wh: float = 0.0
    """Energy flown in the air, in Wh of the file."""
    recent_wh: float = 0.0
    """Energy flown while the current was known, with exponential forgetting; of one flight."""
    drawn_wh: float = 0.0
    """Energy drawn by the current in this time, with the same forgetting."""
    mean_current_a: Mapping[int, float] = field(default_factory=dict)
    packs: Mapping[int, _Pack] = field(default_factory=dict)
    """Batteries whose charge was ever known."""
    received_s: float | None = None
    """Time of the last report of the emptiest battery's charge."""

    def flight_s(self, model: PowerModel) -> float | None:
        """Hover time of the energy left; None if unknown."""
        if self.left_wh is None:
            return None
        return self.left_wh / (self.factor * model.hover_w) * S_PER_H

    def until_s(self, model: PowerModel, charge: float) -> float | None:
        """Hover time until a charge in [0, 1] is left; None if unknown."""
        if self.left_wh is None:
            return None
        usable_wh = max(0.0, self.left_wh - charge * model.capacity_wh)
        return usable_wh / (self.factor * model.hover_w) * S_PER_H

    def until_reported_s(self, model: PowerModel, charge: float) -> float | None:
        """Hover time until a battery's report is down to a charge in [0, 1]; None if unknown.

        The autopilot acts by that report, also where a low voltage says that less is left.
        """
        reported = [pack.charge for pack in self.packs.values() if pack.reported is not None]
        if not reported:
            return self.until_s(model, charge)
        usable_wh = max(0.0, min(reported) - charge) * model.capacity_wh
        return usable_wh / (self.factor * model.hover_w) * S_PER_H

    def left_after_s(self, model: PowerModel, need_wh: float | None) -> float | None:
        """Hover time left after using need_wh, in Wh of the file; None if unknown."""
        flight_s = self.flight_s(model)
        if flight_s is None or need_wh is None:
            return None
        return flight_s - need_wh / model.hover_w * S_PER_H


def metered(meter: Meter, telemetry: Telemetry, now_s: float, model: PowerModel) -> Meter:
    """Meter updated by the telemetry; designed for calls at about 10 Hz."""
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
        gone = meter.packs.keys() - telemetry.batteries.keys()  # removed battery
        meter = replace(meter, prior=meter.factor, recent_wh=0.0, drawn_wh=0.0)
    flight_w = _flight_w(telemetry.local_position, now_s, model) if flies else 0.0
    flown_wh = meter.flown_wh + flight_w * elapsed_s / S_PER_H
    before = {number: mean for number, mean in meter.mean_current_a.items() if number not in gone}
    currents = _mean_currents(before, batteries, elapsed_s)
    drawn_w = _drawn_w(batteries, currents) if model.capacity_known else None
    # The factor follows a risen power with a delay.
    used_w = max(meter.factor * flight_w, min(drawn_w or 0.0, _GREATEST_RATIO * flight_w))
    used = used_w * elapsed_s / S_PER_H / model.capacity_wh
    packs = {
        number: pack._replace(charge=pack.charge - used, most=pack.most - used)
        for number, pack in meter.packs.items()
        if number not in gone
    }
    for number, battery in batteries.items():
        counts = flies and number in currents and model.capacity_known
        mean_a = currents.get(number)
        pack = _received(packs.get(number), battery, model, mean_a, flown_wh, counts=counts)
        if pack is not None:
            packs[number] = pack
    emptiest = min(packs.values(), key=lambda pack: pack.left, default=None)
    by_charge = _by_charge(packs, flown_wh, meter.prior, model)
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
        received_s=None if emptiest is None else emptiest.received_s,
    )


def in_the_air(telemetry: Telemetry) -> bool:
    """Returns True if the aircraft is known to fly, not to take off or land."""
    landed = telemetry.landed
    return landed is not None and landed.state is LandedState.IN_AIR


def on_the_ground(telemetry: Telemetry) -> bool:
    """Returns True if known to be on the ground: a battery not reported then was removed."""
    landed = telemetry.landed
    return landed is not None and landed.state is LandedState.ON_GROUND


def _flight_w(local: LocalPosition | None, now_s: float, model: PowerModel) -> float:
    """Power at the present velocity; of hovering if the velocity is unknown."""
    if local is None or now_s - local.received_s > _VELOCITY_MAX_AGE_S:
        return model.hover_w
    north_mps, east_mps, down_mps = local.velocity_ned_mps
    if not all(map(math.isfinite, local.velocity_ned_mps)):
        return model.hover_w
    return model.power_w(math.hypot(north_mps, east_mps), -down_mps)


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


def _received(
    pack: _Pack | None,
    battery: Battery,
    model: PowerModel,
    mean_current_a: float | None,
    flown_wh: float,
    *,
    counts: bool,
) -> _Pack | None:
    """Battery updated by its present report; None while its charge was never known.

    counts: True if a charge known only by voltage is counted down instead of read again.
    """
    if pack is not None and pack.received_s == battery.received_s:
        return pack
    volts = cell_v(battery, model, mean_current_a)
    most = math.inf if pack is None else pack.most
    if volts is not None:
        most = 1.0 - model.cell_voltage_v.fraction(volts)
    reported = battery.remaining
    if reported is not None:
        least, marks = _steps(pack, reported, flown_wh, model)
        return _Pack(battery.received_s, reported, most, least, marks, flown_wh)
    if pack is not None and pack.reported is not None:
        return pack._replace(most=most)
    if pack is not None and counts:
        return pack._replace(received_s=battery.received_s, most=most)
    charge = _by_voltage(battery, model)
    return pack if charge is None else _Pack(battery.received_s, charge, most)


def _by_voltage(battery: Battery, model: PowerModel) -> float | None:
    volts, empty_v = cell_v(battery, model, None), model.cell_voltage_v.high
    if volts is None:
        return None
    return min(1.0, max(0.0, (volts - empty_v) / (_CELL_FULL_V - empty_v)))


def _steps(
    pack: _Pack | None, reported: float, flown_wh: float, model: PowerModel
) -> tuple[float, tuple[_Mark, ...]]:
    """Least reported charge and the steps down to it, without those of another battery."""
    if pack is None or pack.reported is None or reported > pack.reported + _SWAPPED:
        return reported, ()
    if reported >= pack.reported:
        return pack.reported, pack.marks
    mark, marks = _Mark(reported, flown_wh), pack.marks
    if marks:
        last, first = marks[-1], marks[0]
        measured = 1.0
        if last.flown_wh > first.flown_wh:
            used_wh = (first.charge - last.charge) * model.capacity_wh
            measured = max(1.0, used_wh / (last.flown_wh - first.flown_wh))
        used_wh = (last.charge - reported) * model.capacity_wh
        sudden = used_wh > _SUDDEN_RATIO * measured * (flown_wh - last.flown_wh)
        if sudden and last.sudden < _MOST_SUDDEN:
            return reported, (mark._replace(sudden=last.sudden + 1),)
    oldest_wh = flown_wh - model.hover_wh(_MARKS_S)
    return reported, (*(old for old in marks[1 - _MOST_MARKS :] if old.flown_wh >= oldest_wh), mark)


def _drawn_w(batteries: Mapping[int, Battery], currents: Mapping[int, float]) -> float | None:
    """Power of all batteries by their currents; None if one is missing: the sum is too small.

    currents: of all batteries that ever reported one.
    """
    drawn_w = 0.0
    for number in batteries.keys() | currents.keys():
        battery = batteries.get(number)
        if battery is None or not battery.current_a or battery.voltage_v is None:
            return None  # 0 A is no valid current in flight
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
    """Measured factor: by the current, otherwise by the charge.

    With its source, the prior, and the energies flown and drawn by the current, as in `Meter`.

    While the current is missing, the greater of its last measure and that of the charge counts;
    otherwise the charge only where its measure is much greater.
    """
    if not flight_w or not elapsed_s:
        return meter.factor, meter.source, meter.prior, meter.recent_wh, meter.drawn_wh
    recent_wh, used_wh, prior = meter.recent_wh, meter.drawn_wh, meter.prior
    by_current = drawn_w is not None and drawn_w >= _LEAST_RATIO * flight_w
    if drawn_w is not None and by_current:
        if not recent_wh:
            prior = meter.factor
        capped_w = min(drawn_w, _GREATEST_RATIO * flight_w)
        more = capped_w * recent_wh > _AT_ODDS * flight_w * used_wh
        kept = math.exp(-elapsed_s / (_MEASURING_S if more else _FORGETTING_S))
        recent_wh = kept * recent_wh + flight_w * elapsed_s / S_PER_H
        used_wh = kept * used_wh + capped_w * elapsed_s / S_PER_H
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
    packs: Mapping[int, _Pack], flown_wh: float, prior: float, model: PowerModel
) -> tuple[float, float, float]:
    """Energies by the steps of the charge: used, flown in between, certain part of the used one.

    One step alone may be early or late. Of the battery that falls fastest: if they do not empty
    alike, that one ends the flight.
    """
    oldest_wh = flown_wh - model.hover_wh(_MARKS_S)
    marked = [
        pack
        for pack in packs.values()
        if len(pack.marks) > 1 and pack.marks[-1].flown_wh >= oldest_wh
    ]
    measured = [
        max(_over(pack.marks, pack.flown_wh, prior, model), key=lambda of: of[0] / of[1])
        for pack in marked
        if pack.marks[-1].flown_wh > pack.marks[0].flown_wh
    ]
    return max(measured, key=lambda of: of[0] / of[1], default=(0.0, 0.0, 0.0))


def _over(
    marks: tuple[_Mark, ...], reported_wh: float, prior: float, model: PowerModel
) -> Iterator[tuple[float, float, float]]:
    """Yields the same over all marks of a battery, and over the last ones if much faster.

    reported_wh: energy flown until its last report. Where the next step is late by then, a rate
    above the prior factor is at most that with a step now, and not below the prior: a charge that
    stands may be a failed gauge.
    """
    last, recent = marks[-1], marks[: 1 - _RECENT_MARKS]
    begins = [mark for mark in recent if last.flown_wh - mark.flown_wh >= model.hover_wh(_RECENT_S)]
    steps = [(marks[0], marks[1])]
    if begins:
        first = len(begins) - 1
        steps.append((marks[first], marks[first + 1]))
    rate = 0.0
    for begin, sure in steps:
        used, flown_wh = begin.charge - last.charge, last.flown_wh - begin.flown_wh
        standing_wh = (reported_wh - begin.flown_wh) * used / (used + _STEP)
        flown_wh = max(flown_wh, min(standing_wh, used * model.capacity_wh / prior))
        if used > _DRAINS * rate * flown_wh:
            rate = used / flown_wh
            sure_wh = (sure.charge - last.charge) * model.capacity_wh
            yield used * model.capacity_wh, flown_wh, sure_wh


def _blended(
    prior: float, used_wh: float, flown_wh: float, sure_wh: float, model: PowerModel
) -> float:
    """Mean of the measured factor and the prior, weighted by the measuring time.

    A great use in a short time weighs as much as a long time. sure_wh: certain part of the use.
    """
    measured = min(_GREATEST_RATIO, used_wh / flown_wh)
    measured_s = max(flown_wh, sure_wh) / model.hover_w * S_PER_H
    part = measured_s**2 / (measured_s**2 + _MEASURING_S**2)
    return prior + part * (measured - prior)
