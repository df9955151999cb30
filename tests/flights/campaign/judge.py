"""The judge: decides from the truth and the setpoints if a flight kept the promise.

Independent of the planner, the gate and the other judge, with its own distances by NumPy.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from moar_companion.planner.site import Conductor, Obstacle, Site

from . import (
    AFTERMATH_S,
    ERROR_FACTOR,
    GUST_MPS,
    GUST_S,
    LEFT_LEG_S,
    LET_GO_S,
    MODE_AGE_S,
    POSITION_AGE_S,
    REPORTED_S,
    REST_SETPOINT_AGE_S,
    SILENCE_S,
)
from .flying import Record, Sent
from .kinds import Breaks

STREAMING = {"ready", "flying", "at_target", "landing_leg", "holding"}
"""States in which setpoints are sent."""
STREAK_S = 0.05
"""A longer pause ends a stream of setpoints; the next one begins another."""
BEGINS_WITHIN_M = 2.0
"""Greatest distance of the aircraft from a stream that begins: `off_path_m`."""
PLANE_M = 2.0
TOLERANCE_M = 0.05
"""For the rounding of cells and frames."""
JUMP_M = 0.2
JUMP_WITHIN_S = 1.5
"""Jumps of the estimate: least size, and time in which a setpoint may go along with one."""
TAKEN_FROM_M = 1.8
"""Farther from its aircraft a setpoint may be taken along: `off_path_m` less the noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """First violation of a rule and their number. outside: broken parts of the promise."""

    rule: str
    time_s: float
    value: float
    state: str
    outside: tuple[str, ...]
    times: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Verdict on a flight. Figures are None where nothing was judged."""

    violations: tuple[Violation, ...]
    least_clearance_m: float | None
    least_keep_out_m: float | None
    greatest_step_mps: float | None
    greatest_error: float | None
    """Greatest error of the estimate, over the promised one."""
    controlled_s: float
    within_s: float

    @property
    def verdict(self) -> str:
        """`broken`, `outside` where violations are all outside the promise, or `kept`."""
        if any(not item.outside for item in self.violations):
            return "broken"
        return "outside" if self.violations else "kept"

    @property
    def row(self) -> dict:
        """The judgement as a JSON object."""
        return {"verdict": self.verdict, **asdict(self)}


def clearance_m(obstacle: Obstacle, points_m: np.ndarray) -> np.ndarray:
    """Distance of each (x, z) from an obstacle: 0 on its outline, negative inside."""
    if isinstance(obstacle, Conductor):
        return np.hypot(*(points_m - obstacle.position_m).T) - obstacle.radius_m
    corners = np.array(obstacle.vertices_m)
    least_m = np.full(len(points_m), math.inf)
    inside = np.zeros(len(points_m), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = end - start
        part = np.clip((points_m - start) @ along / (along @ along), 0.0, 1.0)
        nearest = start + part[:, None] * along
        least_m = np.minimum(least_m, np.hypot(*(points_m - nearest).T))
        crosses = (start[1] > points_m[:, 1]) != (end[1] > points_m[:, 1])
        if along[1]:
            at_x = start[0] + (points_m[:, 1] - start[1]) / along[1] * along[0]
            inside ^= crosses & (points_m[:, 0] < at_x)
    return np.where(inside, -least_m, least_m)


def room_m(site: Site, points_m: np.ndarray, radius_m: float, *, keep_out: bool) -> np.ndarray:
    """Distance of the hull at each (x, z) from the nearest obstacle, or the nearest keep-out."""
    points_m = np.reshape(points_m, (-1, 2))
    if not site.obstacles:
        return np.full(len(points_m), math.inf)
    each = [
        clearance_m(item, points_m) - (item.keep_out_m if keep_out else 0.0)
        for item in site.obstacles
    ]
    return np.min(each, axis=0) - radius_m


def judge(record: Record) -> Judgement:
    """The judgement of a flight."""
    outside = _outside(record)
    ours = controlled(record)
    violations = [
        *_on_the_truth(record, outside, ours),
        *_Stream(record).violations(),
        *_silence(record),
        *_authority(record),
    ]
    points = record.true_m[ours][:, [0, 2]]
    site, radius_m = record.draw.site, record.vehicle.radius_m
    error = _error_m(record) / _promised_error_m(record)
    within = ours & ~np.any(list(outside.values()), axis=0)
    step_s = float(np.median(np.diff(record.time_s)))
    return Judgement(
        violations=_first_of_each(violations),
        least_clearance_m=_least(room_m(site, points, radius_m, keep_out=False)),
        least_keep_out_m=_least(room_m(site, points, radius_m, keep_out=True)),
        greatest_step_mps=_greatest(_Stream(record).speeds_mps()),
        greatest_error=_greatest(error[ours]),
        controlled_s=round(float(ours.sum() * step_s), 2),
        within_s=round(float(within.sum() * step_s), 2),
    )


def _first_of_each(violations: list[Violation]) -> tuple[Violation, ...]:
    """First breach of each rule, by the parts of the promise that did not hold then; counted."""
    found: dict[tuple[str, tuple[str, ...]], list[Violation]] = {}
    for item in sorted(violations, key=lambda item: item.time_s):
        found.setdefault((item.rule, item.outside), []).append(item)
    return tuple(replace(items[0], times=len(items)) for items in found.values())


def _least(values) -> float | None:
    return round(float(np.min(values)), 3) if len(values) else None


def _greatest(values) -> float | None:
    return round(float(np.max(values)), 3) if len(values) else None


# Parts of the promise ---------------------------------------------------------------------------


def _error_m(record: Record) -> np.ndarray:
    """Error of the estimate, and of the site file: both bring an obstacle nearer."""
    return np.linalg.norm(record.error_m, axis=1) + record.draw.map_error_m


def _promised_error_m(record: Record) -> np.ndarray:
    return ERROR_FACTOR * np.maximum(record.margin_m, record.reported_m)


def _outside(record: Record) -> dict[str, np.ndarray]:
    """For each part of the promise: the steps at which it does not hold."""
    time_s = record.time_s
    error = _error_m(record) > _promised_error_m(record)
    wind = np.linalg.norm(record.wind_mps, axis=1) > record.held_wind_mps + 1e-9
    found = {
        "position": _for_a_while(time_s, error),
        "wind": _for_a_while(time_s, wind),
        "gust": _for_a_while(time_s, _gusts(record)),
    }
    for part, since_s in record.broken_s.items():
        found[part.name.lower()] = time_s >= since_s
    return found


def _gusts(record: Record) -> np.ndarray:
    """Steps at which the air has changed too fast: its range within the last `GUST_S`."""
    steps = max(1, round(GUST_S / float(np.median(np.diff(record.time_s)))))
    wind = record.wind_mps
    hard = np.zeros(len(wind), dtype=bool)
    for back in range(5, steps + 1, 5):
        changed = np.linalg.norm(wind[back:] - wind[:-back], axis=1) > GUST_MPS
        hard[back:] |= changed
    return hard


def _for_a_while(time_s: np.ndarray, broken: np.ndarray) -> np.ndarray:
    """The broken steps, each prolonged by `AFTERMATH_S`."""
    last_s = np.maximum.accumulate(np.where(broken, time_s, -math.inf))
    return time_s - last_s <= AFTERMATH_S


def controlled(record: Record) -> np.ndarray:
    """Steps at which the companion's setpoints command the aircraft, or did until just before."""
    found = np.zeros(len(record.time_s), dtype=bool)
    sent_s = np.array([item.time_s for item in record.sent])
    let_go_s = -math.inf
    for index, (time_s, mode) in enumerate(zip(record.time_s, record.modes, strict=True)):
        if mode == record.ours:
            before = np.searchsorted(sent_s, time_s, side="right") - 1
            if before >= 0 and _in_this_control(record, sent_s[before], index):
                found[index] = True
                let_go_s = time_s
        elif mode in record.holds_in and time_s - let_go_s <= LET_GO_S:
            found[index] = True
        else:
            let_go_s = -math.inf
    return found & record.airborne


def _in_this_control(record: Record, sent_s: float, index: int) -> bool:
    """True if the last setpoint was sent so recently that the flight follows from it."""
    return bool(record.time_s[index] - sent_s <= LET_GO_S)


# Rules ------------------------------------------------------------------------------------------


def _on_the_truth(record, outside, ours):
    points = record.true_m[:, [0, 2]]
    for rule, keep_out in (("collision", False), ("keep_out", True)):
        room = room_m(record.draw.site, points, record.vehicle.radius_m, keep_out=keep_out)
        # Only an entry under control counts: the aircraft may be inside when control begins.
        inside = (room < 0.0) & record.airborne
        entered = inside & ours & ~np.roll(inside, 1)
        for index in np.flatnonzero(entered):
            names = tuple(name for name, steps in outside.items() if steps[index])
            until = index + int(np.argmin(inside[index:])) if not inside[index:].all() else None
            yield Violation(
                rule=rule,
                time_s=round(float(record.time_s[index]), 2),
                value=round(float(room[index:until].min()), 3),
                state=record.states[index],
                outside=names,
            )


class _Stream:
    """The setpoints, one after another."""

    def __init__(self, record: Record) -> None:
        self._record = record
        vehicle = record.vehicle
        speed = vehicle.speed
        self._most_mps = speed.min_mps + max(
            speed.horizontal_mps, speed.up_mps, speed.down_mps, speed.diagonal_up_mps,
            speed.diagonal_down_mps,
        )  # fmt: skip
        self._sent = record.sent
        reported = np.array([item.reported_m for item in self._sent]).reshape(-1, 3)
        # The companion knows the obstacles of its file.
        self._room = room_m(
            record.draw.file_site, reported[:, [0, 2]], vehicle.radius_m, keep_out=True
        )
        self._away = np.array([self._away_m(item.reported_m) for item in self._sent])
        silent = [state not in STREAMING for state in record.states]
        self._silent_steps = np.concatenate([[0], np.cumsum(silent)])

    def _away_m(self, place_m) -> float:
        """Distance of a place outside the workspace, too low, or beside the plane."""
        x, y, z = place_m
        space = self._record.draw.site.workspace
        low = max(space.lower_m[1], -math.inf if (m := space.min_altitude_m) is None else m)
        beyond = (
            max(space.lower_m[0] - x, x - space.upper_m[0], 0.0),
            max(low - z, z - space.upper_m[1], 0.0),
            max(abs(y) - PLANE_M, 0.0),
        )
        return math.hypot(*beyond)

    def _jumped_m(self, time_s: float) -> float:
        """Size of a jump of the estimate just before a time."""
        record = self._record
        steps = (record.time_s > time_s - JUMP_WITHIN_S) & (record.time_s <= time_s + 1e-9)
        part = record.error_m[steps]
        if not len(part):
            return 0.0
        ranged = float(np.linalg.norm(part.max(axis=0) - part.min(axis=0)))
        return ranged if ranged > JUMP_M else 0.0

    def _pairs(self):
        """(index, the setpoint before in the same stream or None, the setpoint, whether taken).

        Taken along by its aircraft: at rest, and nearer to it than before, from far away or since
        it was taken along from there.
        """
        before: Sent | None = None
        taken = False
        for index, item in enumerate(self._sent):
            if before is not None and self._is_other_stream(before, item):
                before = None
            taken = before is not None and self._is_taken(before, item, already=taken)
            yield index, before, item, taken
            before = item

    def _is_other_stream(self, before: Sent, item: Sent) -> bool:
        """True after a pause, or after a state without a stream."""
        steps = np.searchsorted(self._record.time_s, [before.time_s - 1e-6, item.time_s - 1e-6])
        ended = self._silent_steps[steps[1]] > self._silent_steps[steps[0]]
        return bool(ended or item.time_s - before.time_s > STREAK_S)

    def _goes_on(self, index: int) -> bool:
        """True if a stream begins at a place that the previous one may have reached."""
        if not index:
            return False
        before, item = self._sent[index - 1], self._sent[index]
        moved_m = math.dist(before.local_m, item.local_m)
        return moved_m <= self._most_mps * (item.time_s - before.time_s)

    def speeds_mps(self) -> list[float]:
        """Speed of every setpoint that neither a jump nor the aircraft's drift has moved."""
        return [
            speed
            for _, before, item, taken in self._pairs()
            if before is not None
            and not taken
            and (speed := _speed_mps(before, item)) is not None
            and (speed <= self._most_mps or not self._jumped_m(item.time_s))
        ]

    @staticmethod
    def _is_taken(before: Sent, item: Sent, *, already: bool) -> bool:
        was_m, is_m = (math.dist(each.reported_m, item.aircraft_m) for each in (before, item))
        return not item.moves and (
            (is_m < was_m and (already or was_m > TAKEN_FROM_M))
            or (already and item.reported_m == before.reported_m)
        )

    def violations(self):
        broken_s = self._record.broken_s.get(Breaks.WORDS, math.inf)
        last: dict[str, int] = {}
        for index, rule, value in self._found():
            item = self._sent[index]
            again = index - last.get(rule, -(10**9)) <= 1
            last[rule] = index
            if not again:
                yield Violation(
                    rule=rule,
                    time_s=round(item.time_s, 2),
                    value=round(float(value), 3),
                    state=item.state,
                    outside=("words",) if item.time_s >= broken_s else (),
                )

    def _found(self):
        """(index, rule, value) of every setpoint that breaks a rule."""
        on_leg, leg_s = False, -math.inf
        for index, before, item, taken in self._pairs():
            near = math.dist(item.reported_m, item.aircraft_m) <= BEGINS_WITHIN_M
            if before is None and not near and not self._goes_on(index):
                yield index, "begins", math.dist(item.reported_m, item.aircraft_m)
            if before is not None and not taken:
                speed = _speed_mps(before, item)
                allowed_m = (self._most_mps + 0.05) * (item.time_s - before.time_s) + 1e-3
                moved_m = math.dist(before.local_m, item.local_m)
                if moved_m > allowed_m and moved_m > allowed_m + self._jumped_m(item.time_s):
                    yield index, "step", speed
            age_s = item.position_age_s
            if age_s > (POSITION_AGE_S if item.moves else REST_SETPOINT_AGE_S):
                yield index, "stale", age_s
            if item.mode_age_s > MODE_AGE_S:
                yield index, "stale_mode", item.mode_age_s
            away = self._away[index]
            if item.on_leg:
                leg_s = item.time_s
            on_leg = item.time_s - leg_s <= LEFT_LEG_S or (on_leg and away > TOLERANCE_M)
            if away > TOLERANCE_M and not on_leg and not taken:
                was = self._away[index - 1] if before is not None else None
                if (was is None and not near) or (
                    was is not None
                    and away > was + 2e-3
                    and away > was + self._jumped_m(item.time_s)
                ):
                    yield index, "outside", away
            room = self._room[index]
            if room < -TOLERANCE_M:
                was = self._room[index - 1] if before is not None else None
                if (was is None and not near) or (
                    was is not None
                    and room < was - 2e-3
                    and room < was - self._jumped_m(item.time_s)
                ):
                    yield index, "setpoint_keep_out", room


def _speed_mps(before: Sent, item: Sent) -> float:
    return math.dist(before.local_m, item.local_m) / (item.time_s - before.time_s)


def _silence(record: Record):
    """Setpoints after a takeover."""
    sent_s = np.array([item.time_s for item in record.sent])
    orders_s = np.array(record.orders_s)
    broken_s = record.broken_s.get(Breaks.WORDS, math.inf)
    for index in range(1, len(record.modes)):
        if record.modes[index - 1] != record.ours or record.modes[index] == record.ours:
            continue
        took_s = float(record.time_s[index])
        if not np.any((sent_s > took_s - STREAK_S) & (sent_s <= took_s)):
            continue
        reported_s = min(
            (at_s for at_s in record.taken_reported_s if at_s >= took_s), default=math.inf
        )
        until_s = max(took_s + SILENCE_S, min(reported_s + REPORTED_S, took_s + MODE_AGE_S))
        next_s = orders_s[orders_s > took_s - 0.5]
        ordered_s = float(next_s.min()) if len(next_s) else math.inf
        late = sent_s[(sent_s > until_s) & (sent_s < ordered_s)]
        if len(late):
            yield Violation(
                rule="silence",
                time_s=round(took_s, 2),
                value=round(float(late[0] - took_s), 3),
                state=record.states[index],
                outside=("words",) if late[0] >= broken_s else (),
            )


def _authority(record: Record):
    for time_s, what in record.forbidden[:1]:
        yield Violation(
            rule=f"authority: {what}", time_s=round(time_s, 2), value=0.0, state="", outside=()
        )
