"""Faults of the air and of the aircraft: wind, motors, receiver, estimate, battery."""

from __future__ import annotations

import math
from dataclasses import replace

from sitl.conditions import GPS_JAMMED, GPS_NO_FIX, GPS_SILENT

from .. import packets
from .table import Breaks, kind, set_conditions

# Wind -------------------------------------------------------------------------------------------


@kind("the wind rises within 5 s to 0.5 to 1 times what is promised, and falls again")
def wind_rises(flight, rng):
    end_mps = rng.uniform(0.5, 1.0) * flight.held_wind_mps
    flight.note(wind_mps=end_mps)
    start_mps = flight.autopilot.conditions.wind_mps
    return flight.ramp("wind_mps", start_mps, end_mps, 5.0)


@kind("the wind rises within 3 s to 1.1 to 2 times what is promised", lasts_s=(5.0, 14.0))
def wind_beyond(flight, rng):
    end_mps = rng.uniform(1.1, 2.0) * flight.held_wind_mps
    flight.note(wind_mps=end_mps)
    start_mps = flight.autopilot.conditions.wind_mps
    return flight.ramp("wind_mps", start_mps, end_mps, 3.0)


@kind("gusts of a standard deviation of 0.5 to 1.5 m/s")
def gusts(flight, rng):
    return set_conditions(flight, gust_mps=rng.uniform(0.5, 1.5))


@kind("one hard gust: 6 to 16 m/s at once", lasts_s=(1.0, 6.0))
def gust_hard(flight, rng):
    return set_conditions(
        flight, wind_mps=rng.uniform(6.0, 16.0), wind_from_deg=rng.uniform(0.0, 360.0)
    )


@kind("air that rises or sinks by 1 to 4 m/s", lasts_s=(2.0, 12.0))
def vertical_wind(flight, rng):
    return set_conditions(flight, wind_up_mps=rng.choice((-1.0, 1.0)) * rng.uniform(1.0, 4.0))


@kind("the wind turns by 90 to 180 degrees within 5 s", lasts_s=(10.0, 20.0))
def wind_turns(flight, rng):
    from_deg = flight.autopilot.conditions.wind_from_deg
    turned_deg = rng.choice((-1.0, 1.0)) * rng.uniform(90.0, 180.0)
    flight.note(turned_deg=turned_deg)
    return flight.ramp("wind_from_deg", from_deg, from_deg + turned_deg, 5.0)


@kind("a drag of 0.1 to 1.0 /s, which the vehicle file does not know", breaks=Breaks.AIRCRAFT)
def drag_unlike(flight, rng):
    return set_conditions(flight, drag_per_s=rng.uniform(0.1, 1.0))


@kind("the motors give 55 to 80 % of their thrust", breaks=Breaks.AIRCRAFT)
def motors_weak(flight, rng):
    quad = flight.autopilot._world.quad
    whole, part = quad.airframe, rng.uniform(0.55, 0.8)
    flight.note(part=part)
    quad.airframe = replace(whole, hover_thrust=min(0.95, whole.hover_thrust / part))
    return lambda: setattr(quad, "airframe", whole)


# Receiver and estimate --------------------------------------------------------------------------


@kind("the receiver has no fix", lasts_s=(1.0, 15.0))
def gps_no_fix(flight, rng):
    return set_conditions(flight, gps_mode=GPS_NO_FIX)


@kind("the receiver is silent", lasts_s=(1.0, 15.0))
def gps_silent(flight, rng):
    return set_conditions(flight, gps_mode=GPS_SILENT)


@kind("the receiver is jammed", lasts_s=(3.0, 15.0))
def gps_jammed(flight, rng):
    return set_conditions(flight, gps_mode=GPS_JAMMED)


@kind("4 to 7 satellites, and a worse dilution of precision")
def satellites_few(flight, rng):
    return set_conditions(flight, satellites=rng.randint(4, 7), hdop=rng.uniform(1.5, 4.0))


@kind("the dilution of precision is 2 to 8, and reported")
def hdop_worse(flight, rng):
    return set_conditions(flight, hdop=rng.uniform(2.0, 8.0), vdop=rng.uniform(2.0, 8.0))


@kind("the estimate is 2 to 6 times as noisy, and nothing tells it")
def estimate_noisy(flight, rng):
    return set_conditions(flight, gps_noise_factor=rng.uniform(2.0, 6.0))


def _jump(flight, rng, low_m, high_m):
    far_m, towards_rad = rng.uniform(low_m, high_m), rng.uniform(0.0, math.tau)
    north_m, east_m = far_m * math.cos(towards_rad), far_m * math.sin(towards_rad)
    flight.note(north_m=north_m, east_m=east_m)
    flight.autopilot.jump(north_m, east_m)


@kind("the estimate is reset by 0 to 0.4 m, and stays there")
def estimate_reset(flight, rng):
    _jump(flight, rng, 0.0, 0.4)


@kind("the estimate is reset by 0.5 to 1.4 m, and stays there")
def estimate_jump(flight, rng):
    _jump(flight, rng, 0.5, 1.4)


@kind("the estimate is reset by 1.5 to 6 m, and stays there")
def estimate_jump_far(flight, rng):
    _jump(flight, rng, 1.5, 6.0)


@kind("the estimate jumps to and fro by 0.5 to 2 m", lasts_s=(0.2, 3.0))
def estimate_jump_back(flight, rng):
    far_m, towards_rad = rng.uniform(0.5, 2.0), rng.uniform(0.0, math.tau)
    north_m, east_m = far_m * math.cos(towards_rad), far_m * math.sin(towards_rad)
    flight.note(north_m=north_m, east_m=east_m)
    flight.autopilot.jump(north_m, east_m)
    return lambda: flight.autopilot.jump(-north_m, -east_m)


@kind("the estimate drifts at 0.05 to 0.4 m/s, and nothing tells it", lasts_s=(5.0, 20.0))
def estimate_drift(flight, rng):
    estimator = flight.autopilot._world.estimator
    speed_mps, towards_rad = rng.uniform(0.05, 0.4), rng.uniform(0.0, math.tau)
    flight.note(speed_mps=speed_mps, towards_deg=math.degrees(towards_rad))

    def drift(step_s):
        estimator._off_n += speed_mps * step_s * math.cos(towards_rad)
        estimator._off_e += speed_mps * step_s * math.sin(towards_rad)

    return flight.each_step(drift)


@kind("the height drifts off by 0.5 to 3 m within 5 s, and nothing tells it", lasts_s=(5.0, 20.0))
def height_drift(flight, rng):
    estimator = flight.autopilot._world.estimator
    off_m = rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 3.0)
    flight.note(off_m=off_m)
    began_s = flight.now_s

    def drift(_):
        wanted_m = off_m * min(1.0, (flight.now_s - began_s) / 5.0)
        estimator._err_d += 0.05 * (wanted_m - estimator._err_d)

    return flight.each_step(drift)


@kind("the heading that the autopilot estimates is 2 to 8 degrees off", lasts_s=(10.0, 40.0))
def heading_false(flight, rng):
    return _mislead(flight, rng, 2.0, 8.0)


@kind(
    "the heading that the autopilot estimates is 10 to 60 degrees off",
    lasts_s=(5.0, 30.0),
    breaks=Breaks.AIRCRAFT,
)
def heading_false_far(flight, rng):
    return _mislead(flight, rng, 10.0, 60.0)


def _mislead(flight, rng, low_deg, high_deg):
    error_deg = rng.choice((-1.0, 1.0)) * rng.uniform(low_deg, high_deg)
    within_s = rng.choice((0.02, 5.0))
    flight.note(error_deg=error_deg, within_s=within_s)
    return flight.ramp("heading_error_deg", 0.0, error_deg, within_s)


# Battery ----------------------------------------------------------------------------------------


@kind("the battery has 15 to 25 % left")
def battery_low(flight, rng):
    return _once(flight, battery_percent=rng.uniform(15.0, 25.0))


@kind("the battery has 3 to 8 % left")
def battery_critical(flight, rng):
    return _once(flight, battery_percent=rng.uniform(3.0, 8.0))


def _once(flight, **values) -> None:
    set_conditions(flight, **values)


@kind("the voltage falls to 2.6 to 3.5 V per cell, whatever the charge", lasts_s=(3.0, 15.0))
def voltage_low(flight, rng):
    cells = flight.autopilot._world.battery.options.cells
    return set_conditions(flight, battery_voltage_v=cells * rng.uniform(2.6, 3.5))


@kind("the battery drains 20 to 60 times as fast", lasts_s=(10.0, 30.0))
def battery_drains(flight, rng):
    return set_conditions(flight, drain_factor=rng.uniform(20.0, 60.0))


@kind("nothing of the battery is reported", lasts_s=(10.0, 40.0))
def battery_unreported(flight, rng):
    return flight.filter(packets.drop(packets.SYS_STATUS, packets.BATTERY_STATUS))


@kind("one motor's output is reported as 0 or as full", lasts_s=(3.0, 20.0))
def motor_output_reported(flight, rng):
    value, motor = rng.choice((1000, 2000)), rng.randint(1, 4)
    flight.note(motor=motor, value=value)

    def edit(message):
        setattr(message, f"servo{motor}_raw", value)

    return flight.filter(packets.change({packets.SERVO_OUTPUT}, edit, flight.key))
