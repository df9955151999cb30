"""The checks of one cycle: telemetry, flight and computer against the limits. Pure.

Inputs: observations, limits, time; output: the supervisor's `Causes`, as texts with the value. A
required measurement that is missing is a cause. A reported value counts until the next one,
whatever its age: only a measurement ends a cause.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

from ..config import Supervision
from ..estimation.pose import Pose
from ..estimation.pose_tracker import airborne, grounded
from ..power import BATTERY_MAX_AGE_S, is_powered
from ..risk import IndexReport, RiskEstimate
from ..risk.holding import MARGIN
from ..risk.localization import (
    ESTIMATOR_ACCURACY,
    ESTIMATOR_HEIGHT_ACCURACY,
    ODOMETRY_ACCURACY,
    ODOMETRY_HEIGHT_ACCURACY,
)
from ..risk.receivers import RECEIVER_ACCURACY, trouble
from ..risk.wind import strongest
from ..site import Margin
from ..types import AutopilotKind, Battery, Mission, Telemetry
from . import link_age
from .autopilot_failsafe import battery_failsafe, holding_failsafe, taken_mode
from .conditions import Causes
from .file_faults import FileFault

_READ_LATE_S = 0.2
"""Above this wait for reading, data is late because of the companion, not the network."""
_ATTITUDE_TIMEOUT_S = 1.0
"""ATTITUDE comes at 100 Hz, at 10 Hz on a slow link."""
_HOVER_MPS = 1.0
"""A hold is offered only to an aircraft that is nearly at rest: one that gets the mode in full
flight would swing back to the hold. ArduPilot may be in GUIDED already, flying elsewhere."""
_SATURATED_OFF_M = 1.5
"""Beyond this error, with tilt or motors at their limits, the aircraft cannot return. In calm air
PX4 strays by 1.15 m."""
_OFF_M = 0.5
"""In recordings of flights the local position, by its origin, is near the global one: within 0.11 m
(PX4) or 0.03 m (ArduPilot), height included. After receiver recovery PX4 reported
0.73 m for 0.24 s, and once 56 m for one message."""
_CRITICAL = 3
_FAILED = 5
"""MAV_BATTERY_CHARGE_STATE: critical, emergency, failed."""
WAY_MAX_AGE_S = 15.0
"""Escape routes are replanned about every 2 s; 15 s of flight correspond to a battery's longest
silence."""
_COMPASS = (
    "north",
    "north-east",
    "east",
    "south-east",
    "south",
    "south-west",
    "west",
    "north-west",
)
_MOST_NAMED = 2
_WHOLE = 100.0
"""From this value on decimals are omitted."""
_MOST_SHOWN = 99_999.0
_MOST_DIGITS = 2
_NONE_LEFT_S = 0.5
"""A shorter time would be shown as 0 s."""
_SOON_S = 60.0
"""Lead time of the warning before the aircraft has to leave."""
_MB = 1e6
_ESTIMATOR = (ESTIMATOR_ACCURACY, ODOMETRY_ACCURACY)
_HEIGHT = (ESTIMATOR_HEIGHT_ACCURACY, ODOMETRY_HEIGHT_ACCURACY)


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """Free resources of the computer, in bytes; None where unknown or not required.

    read_late_s: maximum wait of received data for reading in the last second.
    file_faults: faults of the files that the service writes.
    """

    disk_free: float | None = None
    memory_available: float | None = None
    read_late_s: float = 0.0
    file_faults: tuple[FileFault, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class EscapeRoute:
    """The better escape route. left_s: flight time left after it; None: unknown.

    age_s: since its request. flown_left_s: flight time left after the active exit, where that
    exit takes too much and this route takes clearly less.
    """

    mission: Mission
    left_s: float | None
    reserve_s: float
    age_s: float
    flown_left_s: float | None = None
    exposed_s: float = 0.0
    """Time until the last place from where a battery's action would hit an obstacle is passed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckInputs:
    """Observations for the checks.

    faults: causes that are known as such. conflict: text about a second autopilot.
    expected: the autopilot of the vehicle file, whose margin is kept; None where it names none.
    position_late_s: extra delay against the fastest position message, by its own clock.
    jumped_m: total of recent position jumps. jump_margin_m: permitted position error here.
    origin_moved_m: distance of the origin from its place at flight begin, or at an operator's last
    override. origin_margin_m: its limit. global_off_m, home_off_m: from the local position, by the
    origin, to the autopilot's other reports of the same place.
    error_m: from the setpoint to the aircraft.
    escaping: an exit or evacuation is flown.
    drifted_m: distance that the wind has moved the aircraft; None while it holds. saturated: tilt
    or motors at their limits. held_wind_mps: maximum wind in which the aircraft can hold.
    stands: the setpoint does not move although a path is flown.
    strays: text for an aircraft outside the workspace and its checked legs. room_m: from the hull
    to the nearest keep-out. widening_m: required inflation of keep-outs. azimuth_rad: of +x, from
    north. misread: text for a wrong number of cells in the vehicle file.
    plan_awaited_s: wait for a new inspection plan. fence_silent: the autopilot does not report its
    uploaded fence.
    """

    telemetry: Telemetry
    risk: RiskEstimate
    conflict: str | None = None
    expected: AutopilotKind | None = None
    pose: Pose | None
    position_moved_s: float
    position_late_s: float = math.inf
    jumped_m: float = 0.0
    jump_margin_m: float = math.inf
    origin_moved_m: float = 0.0
    origin_margin_m: float = math.inf
    global_off_m: float | None = None
    home_off_m: float | None = None
    room_m: float | None = None
    widening_m: float = 0.0
    azimuth_rad: float | None = None
    misread: str | None = None
    in_control: bool = False
    escaping: bool = False
    landing: bool = False
    error_m: float | None = None
    drifted_m: float | None = None
    saturated: bool = False
    held_wind_mps: float | None = None
    stands: bool = False
    strays: str | None = None
    plan_awaited_s: float | None = None
    fence_silent: bool = False
    escape_route: EscapeRoute | None = None
    exposure: str | None = None
    """Reason to leave before an autopilot failsafe acts; None if there is none."""
    host: Host = field(default_factory=Host)
    faults: Causes = field(default_factory=Causes)


def causes(seen: CheckInputs, limits: Supervision, off_path_m: float, now_s: float) -> Causes:
    """Returns all present reasons against a flight. off_path_m: the vehicle's."""
    telemetry, faults = seen.telemetry, seen.faults
    return Causes(
        autopilot_identity=_control(seen),
        autopilot_link_lost=link_age.silence(telemetry, limits, now_s),
        mode_unconfirmed=link_age.mode_unconfirmed(telemetry, limits, now_s),
        position=_position(seen, limits, now_s),
        attitude=_attitude(telemetry, now_s),
        origin="local origin unknown" if seen.pose is None else None,
        loop_stall=faults.loop_stall,
        autopilot_reboot=faults.autopilot_reboot,
        setpoint_rejected=faults.setpoint_rejected,
        failsafe_took_mode=taken_mode(telemetry),
        ground="on the ground" if grounded(telemetry) else None,
        landing=_mode(seen, landing=True),
        pilot=_mode(seen, landing=False),
        battery_critical=_battery_critical(seen),
        battery_failsafe=battery_failsafe(telemetry),
        failsafe_reported=holding_failsafe(telemetry, escaping=seen.escaping),
        battery_reserve=_battery_reserve(seen, limits.battery_reserve),
        energy_evacuation=_no_return(seen, Mission.EVACUATION),
        energy_exit=_no_return(seen, Mission.EXIT),
        energy_low_soon=_no_return_soon(seen.escape_route),
        failsafe_exposure=seen.exposure if seen.in_control else None,
        memory=_free("memory", seen.host.memory_available, limits.memory_free_mb),
        setpoint_held=faults.setpoint_held,
        no_clearance=faults.no_clearance,
        position_jump=exceeds(
            "the position jumped",
            seen.jumped_m,
            min(limits.jump_limit_m, round(seen.jump_margin_m, 1)),
            "m",
        ),
        origin_moved=exceeds(
            "the origin moved",
            seen.origin_moved_m,
            min(limits.jump_limit_m, round(seen.origin_margin_m, 1)),
            "m",
        ),
        position_disagreement=exceeds("global position off", seen.global_off_m, _OFF_M, "m")
        or exceeds("home position off", seen.home_off_m, _OFF_M, "m"),
        uncertainty=exceeds(
            "position uncertainty",
            uncertainty_m(seen.risk),
            limits.position_uncertainty_limit_m,
            "m",
        ),
        gnss=trouble(seen.telemetry, seen.risk.localization.receivers, now_s),
        localization=exceeds(
            "localization risk", seen.risk.indices.localization, limits.localization_limit, ""
        ),
        control_saturated=_saturated(seen),
        wind=_wind(seen, limits.wind_limit_mps),
        ground_link=_ground_link(telemetry, limits, now_s),
        autopilot_fence=faults.autopilot_fence if seen.in_control else None,
        outside_workspace=seen.strays if seen.in_control else None,
        off_path=exceeds("off the path", seen.error_m, off_path_m, "m")
        if seen.in_control
        else None,
        no_progress=_standing(seen),
        planner=_plan(seen, limits.plan_stale_s),
        planner_late=_plan(seen, limits.plan_stale_s) or _plan(seen, 0.5 * limits.plan_stale_s),
        obstacle=_obstacle(seen),
        off_plane=_plane(seen, limits),
        not_hovering=_moving(seen),
        offboard_loss_unknown=faults.offboard_loss_unknown,
        offboard_loss_collision=faults.offboard_loss_collision,
        battery_silent=_battery_silent(seen, now_s),
        disk=_free("disk", seen.host.disk_free, limits.disk_free_mb),
        not_flying=None if seen.in_control or airborne(telemetry, now_s) else "not in the air",
        unmonitored=_unknown(seen, now_s)
        if seen.in_control or airborne(telemetry, now_s)
        else None,
    )


def uncertainty_m(risk: RiskEstimate) -> float | None:
    """Position uncertainty: the estimator's largest value (PX4), else the receiver's, in metres.

    Each source's last value counts. While the estimator reports nothing, the receiver counts, too.
    The plane is vertical: level and height accuracy count, and the worse applies to all directions,
    across the plane, too. For height only the estimator counts (ArduPilot reports none): height is
    barometric, which the receiver's v_acc does not describe.
    """
    told = risk.last_known.get("localization", {})
    estimator_tells = _known_now(risk.report.localization, _ESTIMATOR)
    level = _ESTIMATOR if estimator_tells else (*_ESTIMATOR, RECEIVER_ACCURACY)
    sources = (*level, *_HEIGHT)
    return max((told[name].value or 0.0 for name in sources if name in told), default=None)


def widening_m(risk: RiskEstimate, margin: Margin) -> float:
    """Obstacle inflation: position uncertainty above the margin's position error, in metres."""
    return max(0.0, (uncertainty_m(risk) or 0.0) - margin.position_m)


def _known_now(index: IndexReport, names: Collection[str]) -> bool:
    return any(report.known and report.name in names for report in index.inputs)


def _control(seen: CheckInputs) -> str | None:
    autopilot = seen.telemetry.autopilot
    if autopilot is None:
        return "no autopilot is heard"
    if seen.conflict is not None:
        return seen.conflict
    if seen.expected not in (None, autopilot.kind):
        return f"vehicle file {seen.expected.value}, heard {autopilot.kind.value}"
    return None if autopilot.multirotor else "the vehicle is no multirotor"


def _position(seen: CheckInputs, limits: Supervision, now_s: float) -> str | None:
    if seen.telemetry.local_position is None:
        return "no local position is heard"
    under_way_s = link_age.delay_s(seen.telemetry.link, seen.position_late_s)
    age_s = now_s - seen.position_moved_s + under_way_s
    if seen.host.read_late_s > _READ_LATE_S:
        return exceeds("position read late, age", age_s, limits.position_timeout_s, "s")
    return exceeds("position age", age_s, limits.position_timeout_s, "s")


def _attitude(telemetry: Telemetry, now_s: float) -> str | None:
    attitude = telemetry.attitude
    known = attitude is not None and now_s - attitude.received_s <= _ATTITUDE_TIMEOUT_S
    return None if known else "the attitude is unknown"


def _mode(seen: CheckInputs, *, landing: bool) -> str | None:
    autopilot = seen.telemetry.autopilot
    if not seen.in_control or autopilot is None or seen.landing is not landing:
        return None
    # The mode may have been left and given back between two cycles.
    return seen.faults.pilot if autopilot.ours else f"the autopilot is in {autopilot.mode}"


def _batteries(telemetry: Telemetry) -> list[tuple[int, Battery]]:
    return [item for item in sorted(telemetry.batteries.items()) if is_powered(item[1])]


def _battery_critical(seen: CheckInputs) -> str | None:
    for number, battery in sorted(seen.telemetry.batteries.items()):
        state: float | None = battery.charge_state if is_powered(battery) else None
        if state is None:
            state = _told_before(seen, number, "charge state")
        if state is not None and _CRITICAL <= state <= _FAILED:
            return f"battery {number} is critical"
    return None


def _battery_reserve(seen: CheckInputs, reserve: float) -> str | None:
    for number, battery in sorted(seen.telemetry.batteries.items()):
        remaining = battery.remaining if is_powered(battery) else None
        if remaining is None:
            remaining = _told_before(seen, number, "remaining")
        if remaining is not None and remaining <= reserve:
            return f"battery {number} at {remaining:.0%}, reserve {reserve:.0%}"
    return None


def _battery_silent(seen: CheckInputs, now_s: float) -> str | None:
    for number, battery in sorted(seen.telemetry.batteries.items()):
        powered, age_s = is_powered(battery), now_s - battery.received_s
        if powered and age_s > BATTERY_MAX_AGE_S and _tells(battery):
            return f"battery {number} is silent for {age_s:.0f} s"
        last = _told_before(seen, number, "remaining")
        if last is not None and (battery.remaining is None or not powered):
            return f"battery {number} tells no charge (was {last:.0%})"
    return None


def _told_before(seen: CheckInputs, number: int, what: str) -> float | None:
    """Last reported value of a battery that the risk estimate keeps; None if there is none."""
    last = seen.risk.last_known.get("battery", {}).get(f"battery {number} {what}")
    return None if last is None else last.value


def _tells(battery: Battery) -> bool:
    """True if it reports its charge; a summary only repeats an earlier charge state."""
    told = battery.charge_state is not None and not battery.summary
    return battery.remaining is not None or told


def _saturated(seen: CheckInputs) -> str | None:
    if seen.drifted_m is not None:
        return f"wind too strong, drifting {max(1.0, seen.drifted_m):.0f} m"
    off_m = seen.error_m
    if not (seen.in_control and seen.saturated) or off_m is None or off_m <= _SATURATED_OFF_M:
        return None
    return f"wind too strong, {off_m:.1f} m off the path"


def _wind(seen: CheckInputs, limit_mps: float) -> str | None:
    item = strongest(tuple(seen.risk.last_known.get("wind", {}).values()))
    if item is None:
        return None
    if seen.held_wind_mps is not None:
        limit_mps = min(limit_mps, round(MARGIN * seen.held_wind_mps, 1))
    words = exceeds(item.name, item.value, limit_mps, item.unit)
    return f"{words} ({item.remark})" if words and item.remark else words


def _no_return(seen: CheckInputs, mission: Mission) -> str | None:
    words = _too_little_left(seen.escape_route, mission)
    return seen.misread if words and seen.misread and not seen.in_control else words


def _too_little_left(way: EscapeRoute | None, mission: Mission) -> str | None:
    if way is None or way.mission is not mission:
        return None
    if way.flown_left_s is not None:
        return f"{_left(way.flown_left_s, Mission.EXIT)} (the {mission.value} takes less)"
    if way.left_s is None or way.left_s > way.reserve_s:
        return None
    words = _left(way.left_s, mission)
    return f"{words} <= {way.reserve_s:.0f}" if words.endswith(" s") else words


def _no_return_soon(way: EscapeRoute | None) -> str | None:
    if way is None or way.left_s is None or not 0.0 < way.left_s - way.reserve_s <= _SOON_S:
        return None
    return f"{_left(way.left_s, way.mission)}, at {way.reserve_s:.0f} s it begins"


def _left(left_s: float, mission: Mission) -> str:
    left = f"{left_s:.0f} s" if left_s > _NONE_LEFT_S else "no flight time"
    return f"{mission.value} leaves {left}"


def _ground_link(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    heard = telemetry.ground_station
    if heard is None or now_s - heard.received_s <= limits.ground_link_lost_s:
        return None
    return f"no ground station for {now_s - heard.received_s:.0f} s"


def _standing(seen: CheckInputs) -> str | None:
    if not seen.stands:
        return None
    error = "" if seen.error_m is None else f", {_distance(seen.error_m)} m from setpoint"
    return f"no progress{error}"


def _plan(seen: CheckInputs, limit_s: float) -> str | None:
    awaited_s = seen.plan_awaited_s
    return exceeds("no new plan for", awaited_s, limit_s, "s")


def _obstacle(seen: CheckInputs) -> str | None:
    least_m = seen.widening_m
    if seen.room_m is None or seen.room_m >= least_m:
        return None
    words = f"{_distance(least_m - seen.room_m)} m too close to an obstacle"
    known_m = uncertainty_m(seen.risk)
    return f"{words} (position uncertainty {known_m:.1f} m)" if known_m and least_m else words


def _plane(seen: CheckInputs, limits: Supervision) -> str | None:
    if seen.pose is None or seen.in_control:
        return None  # the flight goes on, and the escape route stays open
    beside_m, limit_m = seen.pose.position_m[1], limits.plane_tolerance_m
    if abs(beside_m) <= limit_m:
        return None
    side = f"{_side(beside_m, seen.azimuth_rad)} of plane"
    shown = _shown(abs(beside_m), limit_m)
    return f"over {limit_m:g} m {side}" if shown is None else f"{shown} m {side} > {limit_m:g}"


def _side(beside_m: float, azimuth_rad: float | None) -> str:
    """Side of the plane by compass; without azimuth left or right of +x. beside_m: y, to left."""
    if azimuth_rad is None:
        return "left" if beside_m > 0.0 else "right"
    return compass(azimuth_rad - math.copysign(0.5 * math.pi, beside_m))


def compass(towards_rad: float) -> str:
    """The nearest of the eight compass points to a direction from north, as text."""
    return _COMPASS[round(towards_rad / (math.tau / len(_COMPASS))) % len(_COMPASS)]


def _moving(seen: CheckInputs) -> str | None:
    if seen.pose is None or seen.in_control:
        return None
    words = exceeds("moving at", math.hypot(*seen.pose.velocity_mps), _HOVER_MPS, "m/s")
    return None if words is None else f"{words}, hover first"


def _unknown(seen: CheckInputs, now_s: float) -> str | None:
    tells = any(_tells(battery) for _, battery in _batteries(seen.telemetry))
    missing = [
        name
        for name, known in (
            ("wind", strongest(seen.risk.report.wind.inputs) is not None),
            ("battery", tells and _battery_silent(seen, now_s) is None),
            (
                "position accuracy",
                _known_now(seen.risk.report.localization, (*_ESTIMATOR, RECEIVER_ACCURACY)),
            ),
            ("uploaded fence", not seen.fence_silent),
            ("ground station", seen.telemetry.ground_station is not None),
            ("way out", seen.escape_route is not None and seen.escape_route.age_s <= WAY_MAX_AGE_S),
        )
        if not known
    ]
    if len(missing) <= _MOST_NAMED:
        return f"unknown: {' and '.join(missing)}" if missing else None
    first, others = missing[0], missing[1:]
    return f"unknown: {first} and {len(others)} more ({', '.join(others)})"


def _free(what: str, left: float | None, limit_mb: float) -> str | None:
    if left is None or left >= limit_mb * _MB:
        return None
    return f"{what} {left / _MB:.0f} MB < {limit_mb:g}"


def exceeds(what: str, value: float | None, limit: float, unit: str) -> str | None:
    """Text for a value above its limit: `wind 12.3 m/s > 10`; None where it is not above.

    Enough digits are shown that both differ; `wind over 10 m/s` where that takes too many.
    """
    if value is None or value <= limit:
        return None
    shown = _shown(value, limit)
    words = ("over", f"{limit:g}", unit) if shown is None else (shown, unit, ">", f"{limit:g}")
    return " ".join(filter(None, (what, *words)))


def _shown(value: float, limit: float) -> str | None:
    """A value above its limit, with enough digits that both differ; None where too many."""
    value = min(value, _MOST_SHOWN)
    if value >= _WHOLE and round(value) > limit:
        return f"{value:.0f}"
    digits = range(1, _MOST_DIGITS + 1)
    return next((f"{value:.{n}f}" for n in digits if round(value, n) > limit), None)


def _distance(value_m: float) -> str:
    """A distance above 0 as text, never 0.0."""
    return _shown(value_m, 0.0) or "0.01"
