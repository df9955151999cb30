"""Figures of a flight: true clearance, tracking, takeover, end; as a table."""

from __future__ import annotations

import bisect
import contextlib
import json
import math
import re
import shutil
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import shapely
from pymavlink import mavutil

from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import OperatorError
from tests.flights.judging import clearances_m, local_place, shape
from tests.flights.operator import Manner

from .rig import LET_GO, Rig
from .stalls import around, slowest

_RECORDED = ["SET_POSITION_TARGET_LOCAL_NED", "LOCAL_POSITION_NED", "HEARTBEAT"]
_FRESH_S = 0.1
"""Age beyond which a setpoint does not count, in simulated seconds."""
_TOUCHED_DOWN_M = 0.5
_NOTICE_S = 0.2
"""Time limit for the end of the stream after a takeover."""
_NOTICE_ON_LOSSY_LINK_S = 0.3
"""0.2 s under way, and five losses in a row of mode reports, fifty a second by ArduPilot. PX4 sends
the mode twice a second and at a change: its takeover may be noticed later, which the page says."""
_SWITCH_DEBOUNCE_S = 0.2
"""Debounce time of ArduPilot's mode switch (RC_Channel)."""


_SENSOR_STOPPED = re.compile(
    r"(ACC|ACCEL|GYRO|MAG|BARO) #\d+ failed|No valid data from (Accel|Gyro|Compass|Baro)"
)
"""PX4's texts of sensors that its simulator no longer feeds: no scenario makes them fail."""
_READ_LATE_S = 0.5
"""Mean delay of the service's record, which is written once a second."""
MOST_FLIGHTS = 3
"""Flights of a row: those that the machine spoilt, and the one that counts."""
_SLOWEST = 0.8
"""Least speed of a simulator's clock, over 10 s, at which a flight counts: timeouts of the operator
and the companion are in real time."""


@dataclass(frozen=True)
class Row:
    """A flight in figures; None: not measured."""

    kind: str
    scenario: str
    speed: float
    problem: str | None
    """Event that ended the scenario early."""
    unable: str | None = None
    clearance_m: float | None = None
    """Hull to obstacle, least, by truth, from take-off to landing, or to a LAND of the operator's
    elsewhere than above a landing point."""
    clearance_whole_m: float | None = None
    """The same over the whole flight."""
    keep_out_margin_m: float | None = None
    """Hull to keep-out, least, until the operator's LAND."""
    believed_margin_m: float | None = None
    """The same by the autopilot's own position, in the companion's mode."""
    error_mean_m: float | None = None
    error_p95_m: float | None = None
    error_max_m: float | None = None
    """Truth to setpoint, while the autopilot follows it: its tracking and its estimate's error."""
    tracking_mean_m: float | None = None
    tracking_p95_m: float | None = None
    tracking_max_m: float | None = None
    """The autopilot's own position to setpoint: its tracking alone."""
    speed_max_mps: float | None = None
    """Greatest speed over half a second."""
    let_go: str | None = None
    """State and text of a release by the companion before the landing."""
    let_go_after_s: float | None = None
    """Time from its cause to the release."""
    after_release: str | None = None
    """Nearest obstacle from the release to the operator's LAND, and hull to obstacle there: 0 or
    less is a hit."""
    expected_let_go: str | None = None
    """Words of the release that the scenario causes."""
    expected_after_s: tuple[float, float] | None = None
    takeover_s: float | None = None
    """Time from the pilot's action to the last setpoint."""
    state: str | None = None
    landed: bool = False
    shown: str = ""
    """Reason why clearance and release are shown and not judged."""
    objections: list[str] = field(default_factory=list)
    """Faults that the scenario itself found."""
    delays: list[str] = field(default_factory=list)
    """Delays of the autopilot's position in flight, by cause, the longest first."""
    spoilt: str | None = None
    """Delay of the simulator or the machine that explains the faults; None without faults."""
    spoilt_before: list[str] = field(default_factory=list)
    """Faults and delays of earlier flights of this row."""
    states: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    autopilot_texts: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def collision(self):
        """Objection against the distance from an obstacle; None without one."""
        if self.shown or self.keep_out_margin_m is None or self.keep_out_margin_m >= 0.0:
            return None
        after = f", after the release: {self.after_release}" if self.after_release else ""
        return (
            f"{self.clearance_m:.2f} m from an obstacle,"
            f" {-self.keep_out_margin_m:.2f} m inside its keep-out{after}"
        )

    @property
    def release_faults(self):
        """Objections against a release or its absence."""
        if self.shown:
            return []
        if not self.expected_let_go:
            return [f"let go: {self.let_go}"] if self.let_go else []
        if not self.let_go:
            return ["was to let go, and did not"]
        faults = []
        if self.expected_let_go not in self.let_go:
            faults.append(f"let go: {self.let_go}, not: {self.expected_let_go}")
        if self.expected_after_s is not None:
            least_s, most_s = self.expected_after_s
            if self.let_go_after_s is None or not least_s <= self.let_go_after_s <= most_s:
                faults.append(
                    f"let go {_text(self.let_go_after_s, ' s')} after the cause,"
                    f" not {least_s:g} to {most_s:g} s"
                )
        return faults

    @property
    def faults(self):
        """Objections against this flight."""
        faults = [self.problem] if self.problem else []
        faults += [self.collision] if self.collision else []
        faults += self.release_faults
        faults += self.objections
        notice_s = _NOTICE_ON_LOSSY_LINK_S if self.scenario == "lossy_link" else _NOTICE_S
        if self.scenario == "takeover_by_sticks" and "ardupilot" in self.kind:
            notice_s += _SWITCH_DEBOUNCE_S
        if self.takeover_s is not None and self.takeover_s > notice_s:
            faults.append(f"the takeover was noticed after {self.takeover_s:.2f} s")
        if not self.landed:
            faults.append("did not land")
        return faults


def flown(kind, scenario, folder, *, speed=None):
    """Fly a scenario until the machine does not spoil it, up to `MOST_FLIGHTS` times.

    Returns the row of the last flight. All its files are in the folder, those of a spoilt flight in
    a folder beside it.
    """
    spoilt_before = []
    while True:
        row = flown_once(kind, scenario, folder, speed=speed)
        row = replace(row, spoilt_before=list(spoilt_before))
        if row.spoilt is None or len(spoilt_before) + 1 >= MOST_FLIGHTS:
            (folder / "row.json").write_text(json.dumps(asdict(row), indent=1))
            return row
        spoilt_before.append(f"{'; '.join(row.faults)} ({row.spoilt})")
        kept = folder.with_name(f"{folder.name}-spoilt{len(spoilt_before)}")
        shutil.rmtree(kept, ignore_errors=True)
        folder.rename(kept)


def flown_once(kind, scenario, folder, *, speed=None):
    """Fly a scenario once and return its row; all files are in the folder."""
    speed = scenario.speed if speed is None else speed
    folder.mkdir(parents=True, exist_ok=True)
    reason = scenario.unable(kind)
    if reason is not None:
        return Row(kind.name, scenario.name, speed, None, unable=reason)
    problem = None
    with contextlib.ExitStack() as stack:
        rig = Rig(
            kind,
            folder,
            stack,
            vehicle=scenario.vehicle,
            speed=speed,
            parameters=scenario.parameters(kind),
        )
        try:
            scenario.fly(rig)
            rig.watch(2.0)
        except OperatorError as error:
            problem = str(error)
            with contextlib.suppress(OperatorError):
                rig.watch(5.0)
                if rig.operator.armed:
                    rig.land()
                rig.watch(2.0)
    rig.decisions.read()  # the service has ended and written everything
    return _row(rig, kind, scenario, speed, problem)


def _row(rig: Rig, kind, scenario, speed, problem):
    judged = [place for place in rig.truth.places[: rig.judged] if not place.on_ground]
    whole = [place for place in rig.truth.places if not place.on_ground]
    margin = None
    if judged:
        points = [place.position_m for place in judged]
        margin = float(min(clearances_m(rig.site, points, keep_out=True))) - rig.vehicle.radius_m
    errors = _errors_m(rig, judged)
    tracking, believed = _tracking_m(rig)
    companion = [item for item in rig.operator.received_texts if item.companion]
    states = [state for _, state in rig.decisions.states]
    let_go, released_s = _let_go(rig, companion) or (None, None)
    expected = scenario.release
    row = Row(
        kind=kind.name,
        scenario=scenario.name,
        speed=speed,
        problem=problem,
        clearance_m=_nearest(rig, judged)[0],
        clearance_whole_m=_nearest(rig, whole)[0],
        keep_out_margin_m=None if margin is None else round(margin, 3),
        believed_margin_m=_believed_margin_m(rig, believed),
        error_mean_m=_rounded(np.mean, errors),
        error_p95_m=_rounded(_p95, errors),
        error_max_m=_rounded(np.max, errors),
        tracking_mean_m=_rounded(np.mean, tracking),
        tracking_p95_m=_rounded(_p95, tracking),
        tracking_max_m=_rounded(np.max, tracking),
        speed_max_mps=_speed_max_mps(judged, speed),
        let_go=let_go,
        let_go_after_s=_after_cause_s(rig, released_s),
        after_release=_after_release(rig, judged, released_s),
        expected_let_go=None if expected is None else getattr(expected, kind.autopilot),
        expected_after_s=None if expected is None else (expected.least_s, expected.most_s),
        takeover_s=None if rig.takeover_s is None else round(rig.takeover_s, 3),
        state=states[-1] if states else None,
        landed=_landed(rig),
        shown=scenario.shown,
        objections=rig.objections,
        states=states,
        texts=[item.text for item in companion],
        autopilot_texts=[item.text for item in rig.operator.received_texts if not item.companion],
        notes=rig.notes,
    )
    delays = rig.stalls()
    longest = sorted(delays, key=lambda stall: -stall.length_s)
    return replace(
        row,
        delays=[str(stall) for stall in longest],
        spoilt=spoilt(row, delays, released_s, slowest(rig.link.positions)),
    )


def spoilt(row, delays, released_s, least_speed):
    """What of the simulator or the machine explains a row's faults; None without a fault or that.

    A distance from an obstacle and what the scenario itself found are never excused. A wrong
    release is, by a delay at its time; other faults are by any delay of the flight.
    """
    if not row.faults or row.collision or row.objections:
        return None
    for text in row.autopilot_texts:
        if _SENSOR_STOPPED.search(text):
            return f"simulator: {text.strip()}"
    if row.release_faults and released_s is not None:
        delays = around(delays, released_s)
    elif least_speed is not None and least_speed < _SLOWEST:
        return f"simulator at {least_speed:.2f} of its speed"
    return str(max(delays, key=lambda stall: stall.length_s)) if delays else None


def _nearest(rig, places):
    """Least distance from hull to obstacle, and that obstacle's name; (None, None) without one."""
    if not places or not rig.site.obstacles:
        return None, None
    points = shapely.points([place.position_m[::2] for place in places])
    distances = [float(shapely.distance(shape(item), points).min()) for item in rig.site.obstacles]
    least = min(distances)
    name = rig.site.obstacles[distances.index(least)].name
    return round(least - rig.vehicle.radius_m, 3), name


def _after_release(rig, places, released_s):
    """Nearest obstacle after a release; None without a release in the air."""
    if released_s is None:
        return None
    distance_m, name = _nearest(rig, [place for place in places if place.time_s > released_s])
    return None if name is None else f"{name} {distance_m:.2f} m"


def _after_cause_s(rig, released_s):
    if released_s is None or rig.cause_s is None:
        return None
    return round((released_s - rig.cause_s) * rig.speed, 2)


def _rounded(function, values):
    return round(float(function(values)), 3) if len(values) else None


def _p95(values):
    return np.percentile(values, 95)


def _landed(rig):
    """True if the aircraft is on the ground, disarmed."""
    places = rig.truth.places
    return bool(places) and not places[-1].armed and places[-1].position_m[2] < _TOUCHED_DOWN_M


def _errors_m(rig, places):
    """Distances from the truth to the last setpoint, in the companion's mode."""
    setpoints = list(rig.link.setpoints)
    origin = rig.operator.origin
    if not setpoints or origin is None:
        return []
    sent = [item.sent_s for item in setpoints]
    modes = rig.operator.modes
    changed = [mode.time_s for mode in modes]
    given = MANNERS[rig.kind.autopilot].given_custom_mode
    manner = Manner(rig.kind.autopilot)
    errors = []
    for place in places:
        mode = bisect.bisect_right(changed, place.time_s) - 1
        last = bisect.bisect_right(sent, place.time_s) - 1
        if mode < 0 or modes[mode].custom_mode != given or last < 0:
            continue
        if (place.time_s - sent[last]) * rig.speed > _FRESH_S:
            continue
        wanted = local_place(rig.site, manner, origin, _Local(*setpoints[last].position_ned_m))
        errors.append(float(np.linalg.norm(np.subtract(wanted, place.position_m))))
    return errors


def _tracking_m(rig):
    """Recorded LOCAL_POSITION_NED in the companion's mode: distances to the setpoint; places."""
    given = MANNERS[rig.kind.autopilot].given_custom_mode
    distances, places = [], []
    for path in sorted(rig.folder.glob("flight_*/flight.tlog")):
        recording = mavutil.mavlink_connection(str(path), dialect="all")
        sent_s, wanted, ours = -math.inf, None, False
        while (message := recording.recv_match(type=_RECORDED)) is not None:
            match message.get_type():
                case "SET_POSITION_TARGET_LOCAL_NED":
                    sent_s, wanted = message._timestamp, message
                case "LOCAL_POSITION_NED" if ours and message._timestamp - sent_s < _FRESH_S:
                    apart = (message.x - wanted.x, message.y - wanted.y, message.z - wanted.z)
                    distances.append(math.hypot(*apart))
                    places.append(_Local(message.x, message.y, message.z))
                case "HEARTBEAT" if message.get_srcComponent() == 1:
                    ours = message.custom_mode == given
        recording.close()
    return distances, places


def _believed_margin_m(rig, believed):
    origin = rig.operator.origin
    if not believed or origin is None:
        return None
    manner = Manner(rig.kind.autopilot)
    points = [local_place(rig.site, manner, origin, place) for place in believed]
    least = float(min(clearances_m(rig.site, points, keep_out=True)))
    return round(least - rig.vehicle.radius_m, 3)


@dataclass(frozen=True)
class _Local:
    x: float
    y: float
    z: float


def _speed_max_mps(places, speed):
    """Greatest true speed over half a second."""
    fastest = 0.0
    first = 0
    for place in places:
        while (place.time_s - places[first].time_s) * speed > 0.5:
            before = places[first]
            first += 1
            seconds = (place.time_s - before.time_s) * speed
            if seconds < 0.7:
                moved = np.linalg.norm(np.subtract(place.position_m, before.position_m))
                fastest = max(fastest, float(moved) / seconds)
    return round(fastest, 2)


def _let_go(rig, companion):
    """Release by the companion before a pilot took over or gave LAND: its text and time, or None.

    The time is by `clock_s`; the text's reception, or if that was lost the state's record.
    """
    for time_s, state in rig.decisions.states[: rig.states_in_charge]:
        if state in LET_GO:
            for text in companion:
                if text.text.endswith(f", {state}"):
                    return text.text, text.time_s
            return state, time_s - _READ_LATE_S
    return None


_COLUMNS = (
    "scenario | aircraft | hull to obstacle, whole flight | to keep-out: truth | estimate"
    " | truth to setpoint | estimate to setpoint | fastest"
    " | let go | after it | takeover | against it | machine"
)
_WHO = {"px4": "PX4", "ardupilot": "ArduPilot"}


def table(rows):
    """A Markdown table of rows."""
    lines = [f"| {_COLUMNS} |", "|" + "---|" * (_COLUMNS.count("|") + 1)]
    for row in rows:
        begin = (f"`{row.scenario}`", _named(row.kind))
        if row.unable:
            cells = (*begin, f"not flown: {row.unable}", *[""] * (_COLUMNS.count("|") - 2))
        else:
            cells = (*begin, *_cells(row))
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def _cells(row):
    against = row.faults
    if row.shown:
        against = [f"not judged: {row.shown}", *against]
    return (
        f"{_text(row.clearance_m)}, {_text(row.clearance_whole_m)}",
        _text(row.keep_out_margin_m),
        _text(row.believed_margin_m),
        _three(row.error_mean_m, row.error_p95_m, row.error_max_m),
        _three(row.tracking_mean_m, row.tracking_p95_m, row.tracking_max_m),
        _text(row.speed_max_mps),
        _release_text(row),
        row.after_release or "",
        _text(row.takeover_s),
        "; ".join(against) or "nothing",
        _machine_text(row),
    )


def _named(kind):
    real, autopilot, *release = kind.split("-")
    return " ".join((real, _WHO[autopilot], *release))


def _release_text(row):
    if row.let_go is None:
        return "no"
    text = row.let_go.removeprefix("MOAR: ")
    return text if row.let_go_after_s is None else f"{text}, {row.let_go_after_s:.1f} s"


def _machine_text(row):
    """Longest delay in the flight; flights before it that the machine spoilt."""
    texts = [f"spoilt by {row.spoilt}"] if row.spoilt else row.delays[:1]
    if row.spoilt_before:
        texts.append(f"flight {len(row.spoilt_before) + 1}: {'; '.join(row.spoilt_before)}")
    return ", ".join(texts)


def _three(*values):
    return "/".join(map(_text, values)) if None not in values else ""


def _text(value, unit=""):
    return "" if value is None else f"{value:.2f}{unit}"
