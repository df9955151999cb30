"""Delays of an autopilot's position messages, by cause: its simulator, or this computer.

Input: (arrival, time_boot_ms in seconds) of each message, both in the simulator's seconds. The lag
is the difference of the two. A delivery that was late is made up for within moments, and the lag
falls back. A simulator that stood still goes on where it stopped, and the lag stays: PX4's never
catches up, ArduPilot's by at most 0.1 s. Pure.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

LEAST_S = 0.2
"""Shorter delays are of no account: a position may be 0.5 s old."""
_AROUND_S = 1.0
"""Time before and after a delay in which the lag without it is found."""
_EQUAL_S = 0.01
"""Difference of lags that is none: the delay began with the first of them."""
SIMULATOR, HOST, SILENCE, MACHINE = "simulator", "host", "silence", "machine"


@dataclass(frozen=True)
class Stall:
    """A delay that ended at time_s. cause:

    SIMULATOR: its clock stood still. HOST: its messages arrived late. SILENCE: its clock ran, and
    no message was sent. MACHINE: no process was scheduled.
    """

    time_s: float
    length_s: float
    cause: str

    def __str__(self):
        return f"{self.cause} {self.length_s:.2f} s"


def stalls(samples: Iterable[tuple[float, float]]) -> list[Stall]:
    """Delays of `LEAST_S` or more, by the arrivals and stamps of one autopilot's messages.

    A clock that goes back is another start of the autopilot.
    """
    found: list[Stall] = []
    for run in _runs(samples):
        found += _delays(run)
        found += [
            Stall(time_s, gap_s, SILENCE)
            for (before_s, before_stamp_s), (time_s, stamp_s) in itertools.pairwise(run)
            if (gap_s := min(time_s - before_s, stamp_s - before_stamp_s)) >= LEAST_S
        ]
    return sorted(found, key=lambda stall: stall.time_s)


def slowest(samples: Iterable[tuple[float, float]], span_s: float = 10.0) -> float | None:
    """Least speed of the autopilot's clock over a span; None if it was not received for so long."""
    least = None
    for run in _runs(samples):
        first = 0
        for time_s, stamp_s in run:
            while time_s - run[first][0] > span_s:
                from_s, from_stamp_s = run[first]
                first += 1
                speed = (stamp_s - from_stamp_s) / (time_s - from_s)
                least = speed if least is None else min(least, speed)
    return least


def around(stalls: Iterable[Stall], time_s: float) -> list[Stall]:
    """Delays that lasted at this time, or had ended up to `_AROUND_S` before."""
    return [
        stall
        for stall in stalls
        if stall.time_s - stall.length_s <= time_s <= stall.time_s + _AROUND_S
    ]


def _runs(samples: Iterable[tuple[float, float]]) -> list[list[tuple[float, float]]]:
    runs: list[list[tuple[float, float]]] = []
    for time_s, stamp_s in samples:
        if not runs or stamp_s < runs[-1][-1][1]:
            runs.append([])
        runs[-1].append((time_s, stamp_s))
    return runs


def _delays(run: Sequence[tuple[float, float]]) -> list[Stall]:
    times_s = [time_s for time_s, _ in run]
    lags_s = [time_s - stamp_s for time_s, stamp_s in run]
    before_s = _least_of_the_last(times_s, lags_s)
    after_s = _least_of_the_last([-time_s for time_s in reversed(times_s)], lags_s[::-1])[::-1]
    found: list[Stall] = []
    for late, group in itertools.groupby(
        range(len(run)), key=lambda number: lags_s[number] - before_s[number] >= LEAST_S
    ):
        if not late:
            continue
        numbers = list(group)
        most_s = max(lags_s[number] - before_s[number] for number in numbers)
        peak = next(
            number for number in numbers if lags_s[number] - before_s[number] > most_s - _EQUAL_S
        )
        stayed_s = after_s[peak] - before_s[peak]
        for length_s, cause in ((stayed_s, SIMULATOR), (lags_s[peak] - after_s[peak], HOST)):
            if length_s >= LEAST_S:
                found.append(Stall(times_s[peak], length_s, cause))
    return found


def _least_of_the_last(times_s: Sequence[float], values: Sequence[float]) -> list[float]:
    """Least of the values from `_AROUND_S` before each time on, and of the last one before."""
    least: list[float] = []
    first = 0
    for number, time_s in enumerate(times_s):
        while first < number and time_s - times_s[first + 1] >= _AROUND_S:
            first += 1
        least.append(min(values[first : number + 1]))
    return least
