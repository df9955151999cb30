"""Wind risk WR (paper, Section IV-C (a)): wind speed and the reserve against it.

Inputs: the autopilot's wind estimate; the wind that explains the lean of a multirotor, and its
variation; the lean that this wind requires in a hover, against the tilt limit. Further inputs: the
greatest motor output against its range, as a mean over a short time; the distance of the aircraft
to the setpoint.

Many autopilots report no wind on a multirotor by default, or only after half a minute; the lean is
always available. `braking` gives the deceleration by the air, `drag` the airspeed: the wind is the
velocity over ground minus the velocity through the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ..mavlink.telemetry import Telemetry, Wind
from ..settings.risk_model import Range, RiskModel
from .braking import ATTITUDE_MAX_AGE_S, GRAVITY_MPS2, AirSample, braking, extended, shows_wind
from .drag import Level, air_velocity_mps, deceleration_mps2
from .drag_learning import DragLearning, apart_from_own_motion
from .input_reports import InputReport, source_at, source_of

MOTOR_OUTPUT = "motor output"
REPORTED = "wind reported"
FROM_TILT = "wind from tilt"
USUAL_DRAG = "default drag, not measured"
_ALONE = "alone it proves no calm"
GUST_S = 15.0
"""Time constant of the running spread: the last 30 s have 86 % of the weight."""
WIND_MAX_AGE_S = 3.0
"""Maximum age of the wind: 5 to 10 Hz, on a slow link 1 Hz: 3 periods."""
_WIND_MAX_MPS = 100.0
"""Greatest wind used: no aircraft flies in more, and the spread would keep it long."""
_DEVIATION_MAX_MPS = 3.0
"""Greatest standard deviation of a usable wind estimate: beyond it calm and the wind at which the
risk begins are indistinguishable. PX4's settled estimate has 0.2 m/s."""
MOTORS_MAX_AGE_S = 1.0
"""Maximum age of SERVO_OUTPUT_RAW: 5 periods at 5 to 10 Hz."""
CLIMB_MPS = 0.5
"""Least speed of a climb: the motors then lift the aircraft, and show no wind."""
MOTORS_WINDOW_S = 0.8
"""Window of their mean: four samples at 5 Hz, and less than their maximum age. A jump of the
setpoint takes the motors to their limit for one sample; wind holds them there."""
_USUAL_PULSE_US = Range(low=1000.0, high=2000.0)
"""Default range of both autopilots."""
_LEAST_PULSE_US = 800.0
"""Least pulse that PX4 allows for a motor (PWM_MAIN_MIN1); DShot idles at a twentieth of 1999."""
_OUTPUT_MAX = 1.5
"""Greatest plausible output over its range: beyond it the units differ (DroneCAN's 8191)."""


class Spread(NamedTuple):
    """Mean and variance of a wind, weighted to the present; span_s: duration since the start."""

    time_s: float
    mean_ne_mps: Level
    variance_m2ps2: float = 0.0
    span_s: float = 0.0

    @property
    def deviation_mps(self) -> float:
        """Standard deviation of the wind's vector."""
        return math.sqrt(self.variance_m2ps2)

    def then(self, time_s: float, wind_ne_mps: Level) -> Spread:
        """Spread updated by a later wind. The first seconds are a plain mean."""
        elapsed_s = max(0.0, time_s - self.time_s)
        span_s = self.span_s + elapsed_s
        weight = min(1.0, elapsed_s / max(1e-9, min(GUST_S, span_s)))
        mean_north, mean_east = self.mean_ne_mps
        north, east = wind_ne_mps[0] - mean_north, wind_ne_mps[1] - mean_east
        variance = self.variance_m2ps2 + weight * (north * north + east * east)
        return Spread(
            time_s=time_s,
            mean_ne_mps=(mean_north + weight * north, mean_east + weight * east),
            variance_m2ps2=(1.0 - weight) * variance,
            span_s=span_s,
        )

    def with_model(self, before: RiskModel, after: RiskModel) -> Spread:
        """Spread of the same leans with another drag, so that learning it is no gust."""
        mean = air_velocity_mps(deceleration_mps2(self.mean_ne_mps, before), after)
        return self._replace(mean_ne_mps=mean)


class MotorSample(NamedTuple):
    """A value of the strongest motor, valid until the next one, and the time of its reception."""

    received_s: float
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WindMemory:
    """Samples of the last seconds in the air, oldest first, their wind, and its spread.

    wind_ne_mps: towards which it blows; None if unknown.
    """

    samples: tuple[AirSample, ...] = ()
    wind_ne_mps: Level | None = None
    spread: Spread | None = None
    learning: DragLearning = field(default_factory=DragLearning)
    """Drag of the aircraft, kept across landings."""
    outputs: tuple[MotorSample, ...] = ()
    motor_speeds: tuple[MotorSample, ...] = ()
    """Outputs and speeds of the strongest motor, as fractions of its range."""


def remember(memory: WindMemory, telemetry: Telemetry, model: RiskModel) -> WindMemory:
    """Memory with the latest attitude, velocity and motors; on the ground only the drag."""
    return replace(
        _with_air(memory, telemetry, model),
        outputs=_with_latest(memory.outputs, _output(telemetry, model)),
        motor_speeds=_with_latest(memory.motor_speeds, _motor_speed(telemetry, model)),
    )


def _with_latest(
    samples: tuple[MotorSample, ...], latest: MotorSample | None
) -> tuple[MotorSample, ...]:
    return () if latest is None else with_sample(samples, latest)


def with_sample(samples: tuple[MotorSample, ...], latest: MotorSample) -> tuple[MotorSample, ...]:
    """Samples of the last `MOTORS_WINDOW_S`, the one valid before them, and the latest.

    The window restarts after a gap of more than `MOTORS_MAX_AGE_S`.
    """
    if samples and latest.received_s <= samples[-1].received_s:
        return samples
    if not samples or latest.received_s - samples[-1].received_s > MOTORS_MAX_AGE_S:
        return (latest,)
    begin_s = latest.received_s - MOTORS_WINDOW_S
    standing = sum(sample.received_s <= begin_s for sample in samples[1:])
    return (*samples[standing:], latest)


def window_mean(samples: tuple[MotorSample, ...], now_s: float) -> float | None:
    """Mean over the last `MOTORS_WINDOW_S`, or since the first sample; None without any.

    The last sample counts up to now.
    """
    if not samples:
        return None
    begin_s = max(samples[0].received_s, now_s - MOTORS_WINDOW_S)
    if now_s <= begin_s:
        return samples[-1].value
    ends_s = [*(sample.received_s for sample in samples[1:]), now_s]
    stood = (
        value * max(0.0, end_s - max(begin_s, received_s))
        for (received_s, value), end_s in zip(samples, ends_s, strict=True)
    )
    return sum(stood) / (now_s - begin_s)


def _with_air(memory: WindMemory, telemetry: Telemetry, model: RiskModel) -> WindMemory:
    samples = extended(memory.samples, telemetry)
    if samples is memory.samples:
        return memory
    learning = memory.learning
    used = learning.used(model)
    air = braking(samples, used.drag_per_s)
    if air is None and not samples:
        return WindMemory(learning=learning)
    if air is None:
        return replace(memory, samples=samples, wind_ne_mps=None)
    through = air_velocity_mps(apart_from_own_motion(air, learning, used), used)
    learning = learning.then(air, model)
    wind = (air.velocity_ne_mps[0] - through[0], air.velocity_ne_mps[1] - through[1])
    speed_mps = math.hypot(*wind)
    if not math.isfinite(speed_mps):
        return replace(memory, samples=samples, wind_ne_mps=None, learning=learning)
    if speed_mps > _WIND_MAX_MPS:
        wind = (wind[0] / speed_mps * _WIND_MAX_MPS, wind[1] / speed_mps * _WIND_MAX_MPS)
    spread = memory.spread
    if spread is None:
        spread = Spread(time_s=air.time_s, mean_ne_mps=wind)
    spread = spread.then(air.time_s, wind).with_model(used, learning.used(model))
    return WindMemory(samples=samples, wind_ne_mps=wind, spread=spread, learning=learning)


def inputs(
    telemetry: Telemetry,
    now_s: float,
    model: RiskModel,
    memory: WindMemory,
    tracking_error_m: float | None,
) -> tuple[InputReport, ...]:
    """Normalised inputs of the wind risk; `memory` includes this telemetry.

    tracking_error_m: from the setpoint to the aircraft, infinite if its position is unknown; None
    while the companion does not fly the aircraft.
    """
    reported, wind, spread = telemetry.wind, memory.wind_ne_mps, memory.spread
    used = memory.learning.used(model)
    hover = None if wind is None else math.hypot(*deceleration_mps2(wind, used))
    report = source_of(reported, now_s, WIND_MAX_AGE_S)
    lean = source_at(
        memory.samples[-1].attitude_s if memory.samples else None, now_s, ATTITUDE_MAX_AGE_S
    )
    others = (
        report.input_report(
            REPORTED,
            None if reported is None else _reported_mps(reported),
            "m/s",
            model.wind_mps.fraction,
        ),
        lean.input_report(
            FROM_TILT,
            None if wind is None else math.hypot(*wind),
            "m/s",
            model.wind_mps.fraction,
            remark=_drag_remark(memory.learning, model),
        ),
        lean.input_report(
            "gusts",
            None if wind is None or spread is None else spread.deviation_mps,
            "m/s",
            model.gust_mps.fraction,
        ),
        lean.input_report(
            "tilt in hover",
            None if hover is None else math.atan(hover / GRAVITY_MPS2),
            "rad",
            model.tilt_rad.fraction,
        ),
    )
    return *others, *_effort(telemetry, now_s, model, memory, others, tracking_error_m)


def _drag_remark(learning: DragLearning, model: RiskModel) -> str:
    """Remark on the reliability of the wind from tilt, by the knowledge of the drag."""
    if learning.known(model):
        drag, error = learning.drag_per_s(model), learning.error_per_s
        return f"drag {drag:.2f} ± {error:.2f} /s, of this flight"
    return USUAL_DRAG if model.drag_is_usual else ""


def strongest(inputs: tuple[InputReport, ...]) -> InputReport | None:
    """Input of the wind speed in use, named by its source: the greatest of those known now."""
    known = [item for item in inputs if item.name in {REPORTED, FROM_TILT} and item.known]
    return max(known, key=lambda item: item.value or 0.0, default=None)


def _reported_mps(wind: Wind) -> float | None:
    """Speed of the reported wind; None if its standard deviation is too great."""
    if wind.deviation_mps is not None and wind.deviation_mps > _DEVIATION_MAX_MPS:
        return None
    return math.hypot(*wind.velocity_ned_mps[:2])


def _effort(
    telemetry: Telemetry,
    now_s: float,
    model: RiskModel,
    memory: WindMemory,
    others: tuple[InputReport, ...],
    tracking_error_m: float | None,
) -> tuple[InputReport, ...]:
    """Inputs of the motors and of the tracking; without other inputs they never mean calm.

    Outputs hardly rise before the lean is at its limit. On the ground they are unknown; in a climb
    and a take-off they mean nothing.
    """
    climbs = _climbs(telemetry)
    alone = not any(item.known for item in others)
    least, remark = (model.unknown, _ALONE) if alone else (0.0, "")

    def trouble(output: float) -> float:
        return max(least, model.motor_fraction.fraction(output))

    ours = source_at(None if tracking_error_m is None else now_s, now_s, 0.0)
    return (
        source_of(telemetry.motors, now_s, MOTORS_MAX_AGE_S).input_report(
            MOTOR_OUTPUT,
            window_mean(memory.outputs, now_s),
            "of its range",
            trouble,
            applies=not climbs,
            remark=remark,
        ),
        source_of(telemetry.motor_speeds, now_s, MOTORS_MAX_AGE_S).input_report(
            "motor speed",
            window_mean(memory.motor_speeds, now_s),
            "of its range",
            trouble,
            applies=not climbs,
            remark=remark,
        ),
        ours.input_report(
            "tracking error",
            tracking_error_m,
            "m",
            lambda error_m: max(least, model.tracking_error_m.fraction(error_m)),
            applies=tracking_error_m is not None,
            remark=remark,
        ),
    )


def _climbs(telemetry: Telemetry) -> bool:
    position = telemetry.local_position
    return position is not None and position.velocity_ned_mps[2] < -CLIMB_MPS


def _motors_show_wind(telemetry: Telemetry) -> bool:
    return shows_wind(telemetry) and not _climbs(telemetry)


def _output(telemetry: Telemetry, model: RiskModel) -> MotorSample | None:
    """Greatest output of a motor over its range; None if it does not depend on the wind."""
    motors, pulses = telemetry.motors, _pulse_range(telemetry, model)
    if motors is None or not motors.pulse_us or pulses is None or not _motors_show_wind(telemetry):
        return None
    output = pulses.share(max(motors.pulse_us))
    return MotorSample(motors.received_s, output) if output <= _OUTPUT_MAX else None


def _motor_speed(telemetry: Telemetry, model: RiskModel) -> MotorSample | None:
    """Greatest speed of a motor over its range; None if it does not depend on the wind."""
    speeds, speed_range = telemetry.motor_speeds, model.motor_rpm
    if speeds is None or not any(speeds.rpm) or speed_range is None:
        return None
    share = speed_range.share(max(speeds.rpm))
    return MotorSample(speeds.received_s, share) if _motors_show_wind(telemetry) else None


def _pulse_range(telemetry: Telemetry, model: RiskModel) -> Range | None:
    """Outputs of no and full thrust: configured, otherwise from parameters, otherwise default.

    None if not configured and the outputs are no pulse widths.
    """
    if model.motor_pulse_us is not None:
        return model.motor_pulse_us
    motors = telemetry.motors
    if motors is not None and motors.least_us is not None and motors.least_us < _LEAST_PULSE_US:
        return None
    low, high = telemetry.motor_min_us, telemetry.motor_max_us
    if low is None or high is None or low >= high:
        return _USUAL_PULSE_US
    return Range(low=low, high=high)
