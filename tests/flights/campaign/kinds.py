"""The kinds of faults, as one table: name, effect, duration, broken part of the promise.

A kind begins on a flight with its own random numbers, and returns a function that ends it, or None.
"""

from __future__ import annotations

import enum
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.safety.check_inputs import Host
from sitl.conditions import GPS_JAMMED, GPS_NO_FIX, GPS_SILENT
from sitl.geodesy import FlatProjection, SphereProjection

from ..operator import EVACUATION, EXIT, INSPECTION, RELEASE, Manner
from . import packets

Undo = Callable[[], None]


class Breaks(enum.Flag):
    """Parts of the promise that a fault breaks from its begin on, without being measurable."""

    NOTHING = 0
    AIRCRAFT = enum.auto()
    WORDS = enum.auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One row of the table. begin: (flight, random numbers) -> function that ends it, or None."""

    name: str
    what: str
    begin: Callable[[object, random.Random], Undo | None]
    lasts_s: tuple[float, float]
    breaks: Breaks
    manners: frozenset[Manner]


KINDS: dict[str, Kind] = {}


def kind(
    what: str,
    *,
    lasts_s: tuple[float, float] = (3.0, 20.0),
    breaks: Breaks = Breaks.NOTHING,
    manners: frozenset[Manner] = frozenset(Manner),
):
    """Add a function to the table, under its own name."""

    def enter(begin):
        KINDS[begin.__name__] = Kind(
            name=begin.__name__,
            what=what,
            begin=begin,
            lasts_s=lasts_s,
            breaks=breaks,
            manners=manners,
        )
        return begin

    return enter


def _conditions(flight, **values) -> Undo:
    """Set conditions of the world; returns the function that restores them."""
    conditions = flight.autopilot.conditions
    before = {name: getattr(conditions, name) for name in values}
    flight.note(**values)

    def put(these):
        for name, value in these.items():
            setattr(conditions, name, value)

    put(values)
    return lambda: put(before)


def _parameters(flight, **values) -> Undo:
    """Set parameters by the ground station; returns the function that restores them."""
    before = {name: flight.autopilot.parameter(name) for name in values}
    flight.note(**values)

    def put(these):
        for name, value in these.items():
            flight.autopilot.set_parameter(name, value)

    put(values)
    return lambda: put(before)


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
    return _conditions(flight, gust_mps=rng.uniform(0.5, 1.5))


@kind("one hard gust: 6 to 16 m/s at once", lasts_s=(1.0, 6.0))
def gust_hard(flight, rng):
    return _conditions(
        flight, wind_mps=rng.uniform(6.0, 16.0), wind_from_deg=rng.uniform(0.0, 360.0)
    )


@kind("air that rises or sinks by 1 to 4 m/s", lasts_s=(2.0, 12.0))
def vertical_wind(flight, rng):
    return _conditions(flight, wind_up_mps=rng.choice((-1.0, 1.0)) * rng.uniform(1.0, 4.0))


@kind("the wind turns by 90 to 180 degrees within 5 s", lasts_s=(10.0, 20.0))
def wind_turns(flight, rng):
    from_deg = flight.autopilot.conditions.wind_from_deg
    turned_deg = rng.choice((-1.0, 1.0)) * rng.uniform(90.0, 180.0)
    flight.note(turned_deg=turned_deg)
    return flight.ramp("wind_from_deg", from_deg, from_deg + turned_deg, 5.0)


@kind("a drag of 0.1 to 1.0 /s, which the vehicle file does not know", breaks=Breaks.AIRCRAFT)
def drag_unlike(flight, rng):
    return _conditions(flight, drag_per_s=rng.uniform(0.1, 1.0))


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
    return _conditions(flight, gps_mode=GPS_NO_FIX)


@kind("the receiver is silent", lasts_s=(1.0, 15.0))
def gps_silent(flight, rng):
    return _conditions(flight, gps_mode=GPS_SILENT)


@kind("the receiver is jammed", lasts_s=(3.0, 15.0))
def gps_jammed(flight, rng):
    return _conditions(flight, gps_mode=GPS_JAMMED)


@kind("4 to 7 satellites, and a worse dilution of precision")
def satellites_few(flight, rng):
    return _conditions(flight, satellites=rng.randint(4, 7), hdop=rng.uniform(1.5, 4.0))


@kind("the dilution of precision is 2 to 8, and told")
def hdop_worse(flight, rng):
    return _conditions(flight, hdop=rng.uniform(2.0, 8.0), vdop=rng.uniform(2.0, 8.0))


@kind("the estimate is 2 to 6 times as noisy, and nothing tells it")
def estimate_noisy(flight, rng):
    return _conditions(flight, gps_noise_factor=rng.uniform(2.0, 6.0))


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


# Battery ----------------------------------------------------------------------------------------


@kind("the battery has 15 to 25 % left")
def battery_low(flight, rng):
    return _once(flight, battery_percent=rng.uniform(15.0, 25.0))


@kind("the battery has 3 to 8 % left")
def battery_critical(flight, rng):
    return _once(flight, battery_percent=rng.uniform(3.0, 8.0))


def _once(flight, **values) -> None:
    _conditions(flight, **values)


@kind("the voltage falls to 2.6 to 3.5 V per cell, whatever the charge", lasts_s=(3.0, 15.0))
def voltage_low(flight, rng):
    cells = flight.autopilot._world.battery.options.cells
    return _conditions(flight, battery_voltage_v=cells * rng.uniform(2.6, 3.5))


@kind("the battery drains 20 to 60 times as fast", lasts_s=(10.0, 30.0))
def battery_drains(flight, rng):
    return _conditions(flight, drain_factor=rng.uniform(20.0, 60.0))


@kind("nothing of the battery is told", lasts_s=(10.0, 40.0))
def battery_unreported(flight, rng):
    return flight.filter(packets.drop(packets.SYS_STATUS, packets.BATTERY_STATUS))


@kind("one motor's output is told as 0 or as full", lasts_s=(3.0, 20.0))
def motor_output_told(flight, rng):
    value, motor = rng.choice((1000, 2000)), rng.randint(1, 4)
    flight.note(motor=motor, value=value)

    def edit(message):
        setattr(message, f"servo{motor}_raw", value)

    return flight.filter(packets.change({packets.SERVO_OUTPUT}, edit))


# The companion's link ---------------------------------------------------------------------------


@kind("the link loses 10 to 50 % of its packets, both ways")
def link_loses(flight, rng):
    return _conditions(flight, link_loss_percent=rng.uniform(10.0, 50.0))


@kind("packets take 50 to 450 ms, both ways")
def link_delays(flight, rng):
    return _conditions(flight, link_delay_ms=rng.uniform(50.0, 450.0))


@kind("packets take up to 300 ms more and overtake each other")
def link_reorders(flight, rng):
    return _conditions(flight, link_jitter_ms=rng.uniform(50.0, 300.0))


@kind("20 to 100 % of the packets arrive twice")
def link_duplicates(flight, rng):
    part = rng.uniform(0.2, 1.0)
    flight.note(part=part)
    return flight.filter(packets.duplicate(lambda: rng.random() < part))


@kind("1 to 20 % of the packets arrive with a wrong bit")
def link_corrupts(flight, rng):
    part = rng.uniform(0.01, 0.2)
    flight.note(part=part)
    return flight.filter(packets.corrupt(lambda: rng.random() < part, rng.randrange))


@kind("the link is cut both ways", lasts_s=(0.2, 8.0))
def link_cut(flight, rng):
    return flight.flag("cut", True)


@kind("nothing reaches the companion; its words reach the autopilot", lasts_s=(0.2, 8.0))
def link_deaf(flight, rng):
    return flight.flag("deaf", True)


@kind("the companion's words are lost; it hears the autopilot", lasts_s=(0.2, 8.0))
def link_mute(flight, rng):
    return flight.flag("mute", True)


@kind("everything to the companion waits for 0.3 to 3 s and arrives at once", lasts_s=(3.1, 3.1))
def link_stalls(flight, rng):
    held_s = rng.uniform(0.3, 3.0)
    flight.note(held_s=held_s)
    return flight.filter(packets.hold_back(flight.now_s + held_s))


@kind("the telemetry radio fades to 10 to 80 above a noise of 45")
def radio_fades(flight, rng):
    return _conditions(flight, radio_rssi=45.0 + rng.uniform(10.0, 80.0))


# Forged and late packets ------------------------------------------------------------------------


@kind("positions of 2 to 20 s before are heard again", breaks=Breaks.WORDS)
def late_positions(flight, rng):
    late_s = rng.uniform(2.0, 20.0)
    flight.note(late_s=late_s)
    ids = {packets.LOCAL_POSITION, packets.GLOBAL_POSITION, packets.ATTITUDE}
    return flight.filter(packets.replay(late_s, ids))


@kind("modes of 2 to 20 s before are heard again", breaks=Breaks.WORDS)
def late_modes(flight, rng):
    late_s = rng.uniform(2.0, 20.0)
    flight.note(late_s=late_s)
    return flight.filter(packets.replay(late_s, {packets.HEARTBEAT, packets.CURRENT_MODE}))


@kind("positions are forged 1 to 10 m off, with the autopilot's ids", breaks=Breaks.WORDS)
def forged_position(flight, rng):
    off_m, hz = rng.uniform(1.0, 10.0), rng.choice((1.0, 10.0, 50.0))
    flight.note(off_m=off_m, hz=hz)

    def make(_):
        nav = flight.autopilot.manner.navigation
        boot_ms = round(nav.since_boot_s * 1000)
        message = mavlink.MAVLink_local_position_ned_message(
            boot_ms, nav.x + off_m, nav.y, nav.z, 0.0, 0.0, 0.0
        )
        return [packets.packed(message)]

    return flight.filter(packets.insert(make, 1.0 / hz))


@kind("heartbeats are forged that tell our mode, with the autopilot's ids", breaks=Breaks.WORDS)
def forged_mode(flight, rng):
    px4 = flight.operator.manner is Manner.PX4
    message = mavlink.MAVLink_heartbeat_message(
        2, 12 if px4 else 3, 217, 6 << 16 if px4 else 4, 4, 3
    )
    return flight.filter(packets.insert(lambda _: [packets.packed(message)], 0.2))


@kind("a second autopilot of another system id is heard")
def second_autopilot(flight, rng):
    message = mavlink.MAVLink_heartbeat_message(2, 12, 81, 4 << 16 | 3 << 24, 4, 3)
    return flight.filter(packets.insert(lambda _: [packets.packed(message, system=2)], 1.0))


@kind("unknown components send commands to the companion, with any numbers")
def hostile_commands(flight, rng):
    numbers = (31010, 193, 176, 400, 512, 511, 246, 22, 31011, 0, 65535)
    values = (0.0, 1.0, 2.0, 3.0, -1.0, math.nan, math.inf, 1e30, 21196.0)

    def make(_):
        message = mavlink.MAVLink_command_long_message(
            rng.choice((0, 1, 1, 255)), rng.choice((0, 1, 195, 195)), rng.choice(numbers),
            rng.randrange(3), *(rng.choice(values) for _ in range(7)),
        )  # fmt: skip
        if message.command in (31010, 193):
            flight.note_order()
        ids = rng.choice(((255, 190), (7, 1), (1, 191), (255, 1)))
        return [packets.packed(message, system=ids[0], component=ids[1])]

    return flight.filter(packets.insert(make, 0.3))


# Pilot and operator -----------------------------------------------------------------------------


@kind("no ground station is heard", lasts_s=(3.0, 30.0))
def gcs_lost(flight, rng):
    operator = flight.operator
    operator.silent = True
    return lambda: setattr(operator, "silent", False)


@kind("the remote control is lost", lasts_s=(1.0, 15.0))
def rc_lost(flight, rng):
    if flight.operator.manner is Manner.ARDUPILOT:
        return _parameters(flight, SIM_RC_FAIL=1)
    flight.autopilot.move_sticks()
    flight.later(1.0, flight.autopilot.no_sticks)
    return flight.autopilot.move_sticks


@kind("the pilot takes the mode: hold or position")
def pilot_takes_mode(flight, rng):
    mode = rng.choice(("hold", "position"))
    flight.note(mode=mode)
    flight.autopilot.move_sticks()
    flight.later(0.2, lambda: flight.operator.mode(mode))


@kind("the pilot takes the mode and gives it back", lasts_s=(0.1, 6.0))
def pilot_gives_back(flight, rng):
    mode = rng.choice(("hold", "position"))
    flight.note(mode=mode)
    flight.autopilot.move_sticks()
    flight.operator.mode(mode)
    return lambda: flight.operator.mode("ours")


@kind("the pilot takes position mode and flies by the sticks", lasts_s=(1.0, 6.0))
def pilot_flies(flight, rng):
    roll, pitch = rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)
    flight.note(roll=roll, pitch=pitch)
    flight.autopilot.move_sticks()
    flight.later(0.2, lambda: flight.operator.mode("position"))
    flight.later(0.4, lambda: flight.autopilot.move_sticks(roll=roll, pitch=pitch))
    return flight.autopilot.move_sticks


@kind(
    "the pilot moves the sticks, and the autopilot takes that as his",
    lasts_s=(0.5, 3.0),
    manners=frozenset({Manner.PX4}),
)
def sticks_take(flight, rng):
    flight.autopilot.set_parameter("COM_RC_OVERRIDE", 3)
    flight.autopilot.move_sticks()
    flight.later(0.5, lambda: flight.autopilot.move_sticks(roll=rng.uniform(0.5, 1.0)))
    return flight.autopilot.move_sticks


@kind("the operator lands or returns by the autopilot's own mode")
def operator_lands(flight, rng):
    mode = rng.choice(("land", "return"))
    flight.note(mode=mode)
    flight.operator.mode(mode)


@kind("orders that contradict each other, every 0.1 to 0.6 s", lasts_s=(2.0, 6.0))
def orders_contradict(flight, rng):
    due = [0.0]

    def order(_):
        if flight.now_s >= due[0]:
            due[0] = flight.now_s + rng.uniform(0.1, 0.6)
            flight.order(rng.choice((INSPECTION, EXIT, EVACUATION)))

    return flight.each_step(order)


@kind("the operator releases, and orders anew", lasts_s=(1.0, 8.0))
def released(flight, rng):
    flight.order(RELEASE)
    return lambda: flight.order(INSPECTION)


# The autopilot ----------------------------------------------------------------------------------


@kind("the autopilot restarts in the air", breaks=Breaks.AIRCRAFT)
def autopilot_reboot(flight, rng):
    flight.autopilot.reboot()


@kind("the autopilot's clock begins anew, and nothing else", breaks=Breaks.NOTHING)
def clock_restarts(flight, rng):
    since_ms = round(flight.autopilot.manner.navigation.since_boot_s * 1000)

    def edit(message):
        message.time_boot_ms = max(0, message.time_boot_ms - since_ms)

    ids = {
        packets.SYSTEM_TIME, packets.ATTITUDE, packets.LOCAL_POSITION, packets.GLOBAL_POSITION,
    }  # fmt: skip
    return flight.filter(packets.change(ids, edit))


@kind("motors are stopped by a forced disarming", breaks=Breaks.AIRCRAFT)
def force_disarmed(flight, rng):
    flight.operator.command(400, 0, 21196)


@kind("home is set where the aircraft is")
def home_moved(flight, rng):
    flight.operator.command(179, 1)


@kind("the autopilot's ceiling or circle is drawn in", lasts_s=(5.0, 25.0))
def fence_drawn_in(flight, rng):
    metres = round(rng.uniform(6.0, 25.0), 1)
    upwards = rng.random() < 0.5
    if flight.operator.manner is Manner.PX4:
        name = "GF_MAX_VER_DIST" if upwards else "GF_MAX_HOR_DIST"
        return _parameters(flight, **{name: metres, "GF_ACTION": rng.choice((0, 1, 2))})
    name, bit = ("FENCE_ALT_MAX", 1) if upwards else ("FENCE_RADIUS", 2)
    return _parameters(
        flight,
        **{name: metres, "FENCE_TYPE": bit, "FENCE_ACTION": rng.choice((0, 4)), "FENCE_ENABLE": 1},
    )


@kind("a circle is uploaded that excludes a place on the site")
def fence_uploaded(flight, rng):
    if flight.operator.manner is Manner.ARDUPILOT:
        _parameters(flight, FENCE_TYPE=4, FENCE_ACTION=0, FENCE_ENABLE=1)
    else:
        _parameters(flight, GF_ACTION=1)
    x_m, radius_m = rng.uniform(-10.0, 40.0), rng.uniform(2.0, 8.0)
    flight.note(x_m=x_m, radius_m=radius_m)
    place = flight.site.frame.to_geodetic((x_m, 0.0, 0.0))
    flight.operator.upload_fence([(5004, radius_m, place.latitude_deg, place.longitude_deg)])


@kind("a parameter is set that decides what happens without the companion", lasts_s=(5.0, 30.0))
def loss_action_changed(flight, rng):
    if flight.operator.manner is Manner.PX4:
        return _parameters(
            flight, COM_OBL_RC_ACT=rng.choice((0, 3, 4, 5)), COM_OF_LOSS_T=rng.uniform(0.1, 5.0)
        )
    return _parameters(flight, GUID_TIMEOUT=rng.uniform(0.2, 8.0))


@kind("parameters are not told", lasts_s=(60.0, 60.0))
def parameters_missing(flight, rng):
    return flight.filter(packets.drop(packets.PARAM_VALUE))


@kind("one stream is missing", lasts_s=(2.0, 30.0))
def stream_missing(flight, rng):
    stream = rng.choice(
        (
            packets.ATTITUDE, packets.SYS_STATUS, packets.GPS_RAW_INT, packets.ESTIMATOR_STATUS,
            packets.ODOMETRY, packets.EXTENDED_SYS_STATE, packets.TIMESYNC, packets.HOME_POSITION,
        )
    )  # fmt: skip
    flight.note(stream=stream)
    return flight.filter(packets.drop(stream))


@kind("no position is told", lasts_s=(0.2, 8.0))
def position_missing(flight, rng):
    return flight.filter(packets.drop(packets.LOCAL_POSITION, packets.ODOMETRY))


@kind("the position that is told repeats its last words, its clock too", lasts_s=(0.2, 8.0))
def position_frozen(flight, rng):
    return flight.filter(packets.freeze(packets.LOCAL_POSITION, packets.ODOMETRY))


@kind("the mode is not told", lasts_s=(0.5, 8.0))
def mode_unreported(flight, rng):
    return flight.filter(packets.drop(packets.HEARTBEAT, packets.CURRENT_MODE))


@kind("the local frame's origin moves by 1 to 20 m", breaks=Breaks.AIRCRAFT | Breaks.WORDS)
def origin_moved(flight, rng):
    nav = flight.autopilot.manner.navigation
    px4 = flight.operator.manner is Manner.PX4
    old = nav.origin if px4 else nav._projection
    far_m, towards_rad = rng.uniform(1.0, 20.0), rng.uniform(0.0, math.tau)
    flight.note(far_m=far_m, towards_deg=math.degrees(towards_rad))
    north_m, east_m = far_m * math.cos(towards_rad), far_m * math.sin(towards_rad)
    new = (SphereProjection if px4 else FlatProjection)(*old.reproject(north_m, east_m))
    setattr(nav, "origin" if px4 else "_projection", new)
    flight.autopilot._world.estimator._count_reset()


# The companion's computer -----------------------------------------------------------------------


@kind("the companion is killed, and started again after that", lasts_s=(0.3, 6.0))
def companion_restarts(flight, rng):
    flight.stop_companion(killed=True)
    return flight.restart_companion


@kind("the companion is killed for good")
def companion_killed(flight, rng):
    flight.stop_companion(killed=True)


@kind("the loop stands still for 0.1 to 3 s", lasts_s=(0.1, 3.0))
def loop_pauses(flight, rng):
    flight.stop_companion(killed=False)
    return flight.wake_companion


@kind("plans take 0.5 to 5 s", lasts_s=(5.0, 30.0))
def planner_slow(flight, rng):
    return flight.flag("plan_delay_s", rng.uniform(0.5, 5.0))


@kind("no plan is answered", lasts_s=(2.0, 25.0))
def planner_silent(flight, rng):
    return flight.flag("planning", False)


@kind("the disk is full", lasts_s=(5.0, 30.0))
def disk_full(flight, rng):
    return _host(flight, Host(disk_free=0.0, memory_available=4e9))


@kind("the memory is low", lasts_s=(3.0, 20.0))
def memory_low(flight, rng):
    return _host(flight, Host(disk_free=4e9, memory_available=5e7))


@kind("what arrived was read 0.1 to 2 s late, by the host's word", lasts_s=(0.5, 5.0))
def read_late(flight, rng):
    return _host(flight, Host(read_late_s=rng.uniform(0.1, 2.0)))


def _host(flight, host: Host) -> Undo:
    flight.companion.note_host(host)
    return lambda: flight.companion.note_host(Host())
