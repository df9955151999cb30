"""Greatest wind in which an aircraft holds its position, and signs of saturation. Pure.

    (k + q u) u = g tan(limit),    cos(limit) >= hover thrust / greatest thrust

u: the wind; k, q: of `drag`; limit: the lean that the autopilot allows, or that the motors can
carry. Inputs: the autopilot's parameters, the vehicle's risk model, telemetry.
"""

from __future__ import annotations

import math

from ..mavlink.autopilots import profile
from ..mavlink.autopilots.parameter_names import Parameters
from ..mavlink.telemetry import Telemetry
from ..settings.risk_model import RiskModel
from ..types import AutopilotKind
from .braking import ATTITUDE_MAX_AGE_S, GRAVITY_MPS2, shows_wind
from .drag import air_velocity_mps

_THRUST_SHARE = 0.9
"""Fraction of the greatest thrust for holding; the rest controls the attitude."""
_STEEPEST_RAD = math.radians(80.0)
"""Greatest limit used: the tangent grows without bound."""
_AT_LIMIT = 0.9
"""Fraction of the limit from which more error causes hardly more force."""
_MARGIN = 0.8
"""Usable fraction of the held wind; the rest is for gusts and to regain the position."""


def tilt_limit(kind: AutopilotKind, parameters: Parameters, model: RiskModel) -> tuple[float, str]:
    """Greatest lean in rad, and the parameter or key that sets it.

    A parameter that was never reported counts with its most cautious value; none is awaited.
    """
    limit_rad, source = model.tilt_rad.high, "risk.tilt_deg"
    autopilot = profile(kind)
    known = autopilot.parameters.values(
        [key for key in autopilot.holding_parameters if key in parameters], parameters
    )
    for key in autopilot.tilt_limits:
        if known.get(key, 0.0) > 0.0:
            limit_rad, source = math.radians(known[key]), parameters.called(key).name
            break
    hover_thrust = autopilot.hover_thrust
    thrust = None if hover_thrust is None else known.get(hover_thrust)
    if hover_thrust is not None and thrust is not None and 0.0 < thrust < _THRUST_SHARE:
        carried_rad = math.acos(thrust / _THRUST_SHARE)
        if carried_rad < limit_rad:
            return carried_rad, hover_thrust
    return min(limit_rad, _STEEPEST_RAD), source


def held_wind_mps(model: RiskModel, limit_rad: float) -> float:
    """Wind against which an aircraft leans at its limit."""
    u_mps, _ = air_velocity_mps((GRAVITY_MPS2 * math.tan(limit_rad), 0.0), model)
    return u_mps


def lowered_limit_mps(limit_mps: float, held_mps: float) -> float:
    """The wind limit, or the usable part of the held wind if this is less."""
    return min(limit_mps, round(_MARGIN * held_mps, 1))


def is_saturated(
    telemetry: Telemetry, motor_output: float | None, limit_rad: float, model: RiskModel
) -> bool:
    """Returns True if the lean or the motors are at their limits; False if unknown.

    motor_output: of the strongest motor, as a fraction of its range; None if unknown.
    """
    attitude = telemetry.attitude
    if not shows_wind(telemetry) or attitude is None:
        return False
    if motor_output is not None and motor_output >= model.motor_fraction.high:
        return True
    local = telemetry.local_position
    if local is not None and abs(local.received_s - attitude.received_s) > ATTITUDE_MAX_AGE_S:
        return False
    upright = math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)
    return math.acos(max(-1.0, min(1.0, upright))) >= _AT_LIMIT * limit_rad
