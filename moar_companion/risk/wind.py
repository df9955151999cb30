"""Wind risk WR (paper, Section IV-C (a)): wind speed and what is left to resist it.

Inputs: the autopilot's own wind estimate, the wind that explains how a hovering multirotor leans,
the lean itself against the tilt limit, the greatest motor output against its range.

Many autopilots report no wind on a multirotor by default, or only after half a minute; the lean
is always there. With linear drag, dv/dt = lean - c (v - w), so w = v - (lean - dv/dt) / c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..types import LandedState, Telemetry
from ..vehicle import RiskModel
from .inputs import InputReport, at_least_unknown_alone, measured

GRAVITY_MPS2 = 9.80665

WINDOW_S = 2.5
"""Over which lean is averaged: longer than the swing of a position controller's correction
(about 1 s), shorter than a lull between gusts."""
WINDOW_MIN_S = 2.0
"""What the window must span before its mean counts."""
ATTITUDE_MAX_AGE_S = 0.5
"""ATTITUDE and LOCAL_POSITION_NED come at 10 Hz or more, even on a slow link: 5 periods."""
WIND_MAX_AGE_S = 3.0
"""Wind comes at 5 to 10 Hz, on a slow link at 1 Hz: 3 periods."""
MOTORS_MAX_AGE_S = 1.0
"""SERVO_OUTPUT_RAW comes at 5 to 10 Hz: 5 periods."""
_TILT_COSINE_MIN = 0.5
"""60 deg: no multirotor holds its height beyond, and the tangent grows without bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeanSample:
    """Attitude and velocity at one instant in the air."""

    attitude_s: float
    velocity_s: float
    tilt_rad: float
    lean_ne_mps2: tuple[float, float]
    """Horizontal acceleration by the thrust that also carries the weight, north and east."""
    velocity_ne_mps: tuple[float, float] | None
    """None where it was not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WindMemory:
    """The samples of the last `WINDOW_S` in the air, oldest first."""

    samples: tuple[LeanSample, ...] = ()


def _tells_of_wind(telemetry: Telemetry) -> bool:
    """Whether lean and motor outputs say anything about wind.

    During the landed state TAKEOFF the aircraft may still stand on its legs. Without any landed
    state, armed has to do.
    """
    armed = telemetry.autopilot is not None and telemetry.autopilot.armed
    landed = telemetry.landed
    return armed and (landed is None or landed.state in {LandedState.IN_AIR, LandedState.LANDING})


def remember(memory: WindMemory, telemetry: Telemetry) -> WindMemory:
    """The memory with the latest attitude and velocity; empty on the ground.

    The window ends at the latest attitude, so that without a new one nothing changes.
    """
    if not _tells_of_wind(telemetry):
        return WindMemory()
    latest = _sample(telemetry)
    samples = memory.samples
    if latest is None or (samples and latest.attitude_s <= samples[-1].attitude_s):
        return memory
    begin_s = latest.attitude_s - WINDOW_S
    return WindMemory(
        samples=(*(sample for sample in samples if sample.attitude_s >= begin_s), latest)
    )


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: WindMemory
) -> tuple[InputReport, ...]:
    """The normalised inputs of the wind risk; `memory` includes this telemetry."""
    wind = telemetry.wind
    reported = measured(
        "wind reported",
        None if wind is None else math.hypot(*wind.velocity_ned_mps[:2]),
        "m/s",
        received_s=None if wind is None else wind.received_s,
        now_s=now_s,
        max_age_s=WIND_MAX_AGE_S,
        risk=model.wind_mps.fraction,
    )
    samples = memory.samples
    whole = bool(samples) and samples[-1].attitude_s - samples[0].attitude_s >= WINDOW_MIN_S
    estimate = wind_from_lean(samples, model.drag_per_s) if whole else None
    heard_s = samples[-1].attitude_s if samples else None
    from_lean = measured(
        "wind from lean",
        None if estimate is None else math.hypot(*estimate),
        "m/s",
        received_s=heard_s,
        now_s=now_s,
        max_age_s=ATTITUDE_MAX_AGE_S,
        risk=model.wind_mps.fraction,
    )
    tilt = measured(
        "tilt",
        sum(sample.tilt_rad for sample in samples) / len(samples) if whole else None,
        "rad",
        received_s=heard_s,
        now_s=now_s,
        max_age_s=ATTITUDE_MAX_AGE_S,
        risk=model.tilt_rad.fraction,
    )
    others = reported, from_lean, tilt
    return *others, _motors(telemetry, now_s, model, others)


def lean_acceleration_mps2(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float]:
    """Acceleration north and east by a thrust whose vertical part is g.

    The thrust points along -z of the body, R(yaw) R(pitch) R(roll) (0, 0, -1): nose down
    accelerates forwards, right side down to the right.
    """
    upright = max(_TILT_COSINE_MIN, math.cos(roll_rad) * math.cos(pitch_rad))
    forward = -math.cos(roll_rad) * math.sin(pitch_rad)
    right = math.sin(roll_rad)
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    scale = GRAVITY_MPS2 / upright
    return scale * (forward * cosine - right * sine), scale * (forward * sine + right * cosine)


def wind_from_lean(
    samples: tuple[LeanSample, ...], drag_per_s: float
) -> tuple[float, float] | None:
    """The wind (north, east, towards which it blows) by which the samples' lean is explained.

    Means over the samples: w = v - (lean - dv/dt) / c. None where a velocity is missing, or where
    velocity was received only once.
    """
    first, last = samples[0].velocity_ne_mps, samples[-1].velocity_ne_mps
    span_s = samples[-1].velocity_s - samples[0].velocity_s
    velocities = [s.velocity_ne_mps for s in samples if s.velocity_ne_mps is not None]
    if first is None or last is None or len(velocities) < len(samples) or span_s <= 0.0:
        return None
    count = len(samples)

    def along(axis: int) -> float:
        lean = sum(sample.lean_ne_mps2[axis] for sample in samples) / count
        velocity = sum(velocity[axis] for velocity in velocities) / count
        acceleration = (last[axis] - first[axis]) / span_s
        return velocity - (lean - acceleration) / drag_per_s

    return along(0), along(1)


def _sample(telemetry: Telemetry) -> LeanSample | None:
    """The latest attitude with the velocity of the same time, if there is one."""
    attitude, local = telemetry.attitude, telemetry.local_position
    if attitude is None:
        return None
    angles = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad
    if not all(map(math.isfinite, angles)):
        return None
    velocity = None
    velocity_s = attitude.received_s
    if (
        local is not None
        and abs(local.received_s - attitude.received_s) <= ATTITUDE_MAX_AGE_S
        and all(map(math.isfinite, local.velocity_ned_mps))
    ):
        velocity = local.velocity_ned_mps[:2]
        velocity_s = local.received_s
    upright = math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)
    return LeanSample(
        attitude_s=attitude.received_s,
        velocity_s=velocity_s,
        tilt_rad=math.acos(max(-1.0, min(1.0, upright))),
        lean_ne_mps2=lean_acceleration_mps2(*angles),
        velocity_ne_mps=velocity,
    )


def _motors(
    telemetry: Telemetry, now_s: float, model: RiskModel, others: tuple[InputReport, ...]
) -> InputReport:
    """The greatest output in use, over its range; on the ground it says nothing.

    Outputs hardly rise before the lean is at its limit: low ones alone do not mean calm.
    """
    motors = telemetry.motors
    greatest = None
    if motors is not None and motors.pulse_us and _tells_of_wind(telemetry):
        pulse = model.motor_pulse_us
        greatest = (max(motors.pulse_us) - pulse.low) / (pulse.high - pulse.low)
    return measured(
        "motor output",
        greatest,
        "",
        received_s=None if motors is None else motors.received_s,
        now_s=now_s,
        max_age_s=MOTORS_MAX_AGE_S,
        risk=at_least_unknown_alone(model.motor_fraction.fraction, others, model.unknown),
    )
