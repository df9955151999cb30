"""Deceleration of a multirotor by the air, from its attitude and velocity. Pure.

The thrust carries the weight and points along the lean, so the lean gives an acceleration. The part
of it that does not change the velocity acts against the air:

    b = lean - dv/dt,    lean = (g - dv_down/dt - k v_down) tan(tilt), towards the lean

Every autopilot sends both inputs. b is a mean over a short window, in which the aircraft's own
manoeuvres cancel: integral of the lean over time minus the difference of two velocities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ..mavlink.telemetry import LandedState, Telemetry
from ..types import Vector
from .drag import Level

GRAVITY_MPS2 = 9.80665

WINDOW_S = 1.5
"""Window of the means. In calm flights of the fake autopilots at 3 m/s the estimated wind is at
most 0.8, 0.5, 0.4 m/s with 1, 1.5, 2 s. The delay after a step of the wind equals the window."""
WINDOW_MIN_S = 1.0
"""Least span of a window before its mean counts."""
SETTLING_S = 3.0
"""Time after take-off, a gap or a jump in which no mean counts: PX4 reports in the air 1.5 s before
the legs leave the ground, and on the ground the lean shows no wind."""
ATTITUDE_MAX_AGE_S = 0.5
"""Maximum age of ATTITUDE and LOCAL_POSITION_NED: 5 periods at 10 Hz, also on a slow link."""
_GAP_S = 1.0
"""Greatest time between two samples: the lean in a longer gap is unknown."""
_JUMP_MPS2 = 20.0
"""Acceleration beyond any multirotor's: the estimator has reset its velocity."""
_JUMP_S = 0.1
"""Least time over which velocities are compared: packets arrive in bursts."""
_TILT_COSINE_MIN = 0.5
"""Cosine of 60 deg: no multirotor holds its height beyond, and the tangent grows without bound."""
_LIFT_MIN, _LIFT_MAX = 0.3, 2.0
"""Range of the thrust's vertical part, as a fraction of g, by the vertical acceleration."""


class AirSample(NamedTuple):
    """Attitude and velocity at one instant in the air, and sums since the first of its window."""

    attitude_s: float
    velocity_s: float
    lean_ne_mps2: Level
    velocity_ned_mps: Vector
    begun_s: float
    """Time of the first sample after the last gap."""
    lean_sum_ne_mps: Level = (0.0, 0.0)
    """Integral of the lean."""
    travelled_ned_m: Vector = (0.0, 0.0, 0.0)
    """Integral of the velocity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Braking:
    """Mean velocity and deceleration by the air over a window. time_s: the window's end."""

    time_s: float
    velocity_ne_mps: Level
    deceleration_ne_mps2: Level


def shows_wind(telemetry: Telemetry) -> bool:
    """Returns True if lean and motor outputs show wind: the aircraft flies.

    In the landed state TAKEOFF the aircraft may still stand on its legs. Without a landed state
    armed decides.
    """
    armed = telemetry.autopilot is not None and telemetry.autopilot.armed
    landed = telemetry.landed
    return armed and (landed is None or landed.state in (LandedState.IN_AIR, LandedState.LANDING))


def extended(samples: tuple[AirSample, ...], telemetry: Telemetry) -> tuple[AirSample, ...]:
    """Samples of the last `WINDOW_S` with the latest one, oldest first; none on the ground.

    The window ends at the latest attitude, so that without a new one it stays the same. It restarts
    after a gap and after a jump of the velocity.
    """
    if not shows_wind(telemetry):
        return ()
    latest = _sample(telemetry)
    if latest is None or (samples and latest.attitude_s <= samples[-1].attitude_s):
        return samples
    if not samples or not _continues(samples[-1], latest):
        return (latest,)
    begin_s = latest.attitude_s - WINDOW_S
    kept = 0
    while kept < len(samples) - 1 and samples[kept].attitude_s < begin_s:
        kept += 1
    return (*samples[kept:], _summed(samples[-1], latest))


def braking(samples: tuple[AirSample, ...], drag_per_s: float) -> Braking | None:
    """Mean deceleration in the samples' window; None if the window is too short.

    drag_per_s: of the vertical motion, which changes the thrust of a lean.
    """
    if len(samples) < 2:
        return None
    first, last = samples[0], samples[-1]
    span_s = last.attitude_s - first.attitude_s
    velocity_span_s = last.velocity_s - first.velocity_s
    settled = last.attitude_s - last.begun_s >= SETTLING_S
    if not settled or span_s < WINDOW_MIN_S or velocity_span_s < 0.5 * span_s:
        return None
    north, east, down = _rates(first.velocity_ned_mps, last.velocity_ned_mps, velocity_span_s)
    v_north, v_east, v_down = _rates(first.travelled_ned_m, last.travelled_ned_m, span_s)
    lift = 1.0 - (down + drag_per_s * v_down) / GRAVITY_MPS2
    scale = min(_LIFT_MAX, max(_LIFT_MIN, lift)) / span_s
    lean_north = scale * (last.lean_sum_ne_mps[0] - first.lean_sum_ne_mps[0])
    lean_east = scale * (last.lean_sum_ne_mps[1] - first.lean_sum_ne_mps[1])
    return Braking(
        time_s=last.attitude_s,
        velocity_ne_mps=(v_north, v_east),
        deceleration_ne_mps2=(lean_north - north, lean_east - east),
    )


def _rates(before: Vector, after: Vector, span_s: float) -> Vector:
    """Change per second of each of three components."""
    return (
        (after[0] - before[0]) / span_s,
        (after[1] - before[1]) / span_s,
        (after[2] - before[2]) / span_s,
    )


def lean_acceleration_mps2(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Level:
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


def _sample(telemetry: Telemetry) -> AirSample | None:
    """Latest attitude with the velocity of the same time; None without both.

    Also None without an absolute position, since the estimator's velocity is then a guess, too.
    """
    attitude, local, estimator = (
        telemetry.attitude,
        telemetry.local_position,
        telemetry.estimator,
    )
    if (
        attitude is None
        or local is None
        or (estimator is not None and not estimator.horizontal_position_ok)
        or abs(local.received_s - attitude.received_s) > ATTITUDE_MAX_AGE_S
    ):
        return None
    angles = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad
    if not math.isfinite(sum(angles) + sum(local.velocity_ned_mps)):
        return None
    return AirSample(
        attitude_s=attitude.received_s,
        velocity_s=local.received_s,
        lean_ne_mps2=lean_acceleration_mps2(*angles),
        velocity_ned_mps=local.velocity_ned_mps,
        begun_s=attitude.received_s,
    )


def _continues(before: AirSample, after: AirSample) -> bool:
    elapsed_s = after.velocity_s - before.velocity_s
    jump_mps = math.dist(before.velocity_ned_mps, after.velocity_ned_mps)
    return (
        after.attitude_s - before.attitude_s <= _GAP_S
        and elapsed_s >= 0.0
        and jump_mps <= _JUMP_MPS2 * max(_JUMP_S, elapsed_s)
    )


def _summed(before: AirSample, latest: AirSample) -> AirSample:
    """Latest sample with its sums, by trapezoids."""
    half_s = 0.5 * (latest.attitude_s - before.attitude_s)
    (lean_n, lean_e), (old_lean_n, old_lean_e) = latest.lean_ne_mps2, before.lean_ne_mps2
    (v_n, v_e, v_d), (old_n, old_e, old_d) = latest.velocity_ned_mps, before.velocity_ned_mps
    (sum_n, sum_e), (travelled_n, travelled_e, travelled_d) = (
        before.lean_sum_ne_mps,
        before.travelled_ned_m,
    )
    return AirSample(
        attitude_s=latest.attitude_s,
        velocity_s=latest.velocity_s,
        lean_ne_mps2=latest.lean_ne_mps2,
        velocity_ned_mps=latest.velocity_ned_mps,
        begun_s=before.begun_s,
        lean_sum_ne_mps=(
            sum_n + half_s * (old_lean_n + lean_n),
            sum_e + half_s * (old_lean_e + lean_e),
        ),
        travelled_ned_m=(
            travelled_n + half_s * (old_n + v_n),
            travelled_e + half_s * (old_e + v_e),
            travelled_d + half_s * (old_d + v_d),
        ),
    )
