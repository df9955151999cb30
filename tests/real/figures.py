"""Figures of a flight: true clearance, tracking, takeover, end; as a table."""

from __future__ import annotations

import bisect
import contextlib
import json
import math
from dataclasses import asdict, dataclass, field

import numpy as np
from pymavlink import mavutil

from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import OperatorError
from tests.flights.judging import clearances_m, local_place
from tests.flights.operator import Manner

from .rig import LET_GO, Rig

_RECORDED = ["SET_POSITION_TARGET_LOCAL_NED", "LOCAL_POSITION_NED", "HEARTBEAT"]
_FRESH_S = 0.1
"""Age beyond which a setpoint does not count, in simulated seconds."""
_TOUCHED_DOWN_M = 0.5
_NOTICE_S = 0.2
"""Time limit for the end of the stream after a takeover."""
_NOTICE_ON_LOSSY_LINK_S = 0.3
"""0.2 s under way, and five losses in a row of mode reports, which come fifty times a second."""
_SWITCH_DEBOUNCE_S = 0.2
"""Debounce time of ArduPilot's mode switch (RC_Channel)."""


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
    keep_out_margin_m: float | None = None
    """Hull to keep-out, least."""
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
    let_go: str | None = None
    """State and text of a release by the companion before the landing."""
    expected_let_go: bool = False
    takeover_s: float | None = None
    state: str | None = None
    landed: bool = False
    states: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    autopilot_texts: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def faults(self):
        """Objections against this flight."""
        faults = [self.problem] if self.problem else []
        if self.keep_out_margin_m is not None and self.keep_out_margin_m < 0.0:
            faults.append(
                f"{self.clearance_m:.2f} m from an obstacle,"
                f" {-self.keep_out_margin_m:.2f} m inside its keep-out"
            )
        if self.let_go and not self.expected_let_go:
            faults.append(f"let go: {self.let_go}")
        if self.expected_let_go and not self.let_go:
            faults.append("was to let go, and did not")
        notice_s = _NOTICE_ON_LOSSY_LINK_S if self.scenario == "lossy_link" else _NOTICE_S
        if self.scenario == "takeover_by_sticks" and self.kind.endswith("ardupilot"):
            notice_s += _SWITCH_DEBOUNCE_S
        if self.takeover_s is not None and self.takeover_s > notice_s:
            faults.append(f"the takeover was noticed after {self.takeover_s:.2f} s")
        if not self.landed:
            faults.append("did not land")
        return faults


def flown(kind, scenario, folder, *, speed=None):
    """Fly a scenario and return its row; all files are in the folder."""
    speed = scenario.speed if speed is None else speed
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
    row = _row(rig, kind, scenario, speed, problem)
    (folder / "row.json").write_text(json.dumps(asdict(row), indent=1))
    return row


def _row(rig: Rig, kind, scenario, speed, problem):
    places = [place for place in rig.truth.places[: rig.judged] if not place.on_ground]
    points = [place.position_m for place in places]
    if points:
        clearance = float(min(clearances_m(rig.site, points))) - rig.vehicle.radius_m
        margin = float(min(clearances_m(rig.site, points, keep_out=True))) - rig.vehicle.radius_m
    errors = _errors_m(rig, places)
    tracking, believed = _tracking_m(rig)
    companion = [item for item in rig.operator.received_texts if item.companion]
    states = [state for _, state in rig.decisions.states]
    return Row(
        kind=kind.name,
        scenario=scenario.name,
        speed=speed,
        problem=problem,
        clearance_m=round(clearance, 3) if points else None,
        keep_out_margin_m=round(margin, 3) if points else None,
        believed_margin_m=_believed_margin_m(rig, believed),
        error_mean_m=_rounded(np.mean, errors),
        error_p95_m=_rounded(_p95, errors),
        error_max_m=_rounded(np.max, errors),
        tracking_mean_m=_rounded(np.mean, tracking),
        tracking_p95_m=_rounded(_p95, tracking),
        tracking_max_m=_rounded(np.max, tracking),
        speed_max_mps=_speed_max_mps(places, speed),
        let_go=_let_go(rig, companion),
        expected_let_go=scenario.let_go,
        takeover_s=None if rig.takeover_s is None else round(rig.takeover_s, 3),
        state=states[-1] if states else None,
        landed=_landed(rig),
        states=states,
        texts=[item.text for item in companion],
        autopilot_texts=[item.text for item in rig.operator.received_texts if not item.companion],
        notes=rig.notes,
    )


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
    """Release by the companion before a pilot took over or gave LAND; None without one."""
    for _, state in rig.decisions.states[: rig.states_in_charge]:
        if state in LET_GO:
            texts = [text.text for text in companion if text.text.endswith(f", {state}")]
            return texts[0] if texts else state
    return None


_COLUMNS = (
    "aircraft | scenario | hull to obstacle | to keep-out | by estimate"
    " | truth to setpoint, mean/p95/max | estimate to setpoint | fastest"
    " | let go | takeover | final state | against it"
)


def table(rows):
    """A Markdown table of rows."""
    lines = [f"| {_COLUMNS} |", "|" + "---|" * (_COLUMNS.count("|") + 1)]
    for row in rows:
        if row.unable:
            lines.append(f"| {row.kind} | {row.scenario} | not flown: {row.unable} |" + " |" * 9)
            continue
        errors = _three(row.error_mean_m, row.error_p95_m, row.error_max_m)
        tracking = _three(row.tracking_mean_m, row.tracking_p95_m, row.tracking_max_m)
        cells = (
            row.kind,
            row.scenario,
            _text(row.clearance_m, " m"),
            _text(row.keep_out_margin_m, " m"),
            _text(row.believed_margin_m, " m"),
            errors,
            tracking,
            _text(row.speed_max_mps, " m/s"),
            row.let_go or "no",
            _text(row.takeover_s, " s"),
            f"{row.state}{'' if row.landed else ', not landed'}",
            "; ".join(row.faults) or "nothing",
        )
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def _three(*values):
    return "/".join(map(_text, values)) + " m" if None not in values else ""


def _text(value, unit=""):
    return "" if value is None else f"{value:.2f}{unit}"
