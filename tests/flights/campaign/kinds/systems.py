"""Faults of the autopilot and of the companion's computer."""

from __future__ import annotations

import math

from moar_companion.companion.safety.check_inputs import Host
from sitl.geodesy import FlatProjection, SphereProjection

from ...operator import Manner
from .. import packets
from .table import Breaks, Undo, kind, set_parameters

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
    return flight.filter(packets.change(ids, edit, flight.key))


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
        return set_parameters(flight, **{name: metres, "GF_ACTION": rng.choice((0, 1, 2))})
    name, bit = ("FENCE_ALT_MAX", 1) if upwards else ("FENCE_RADIUS", 2)
    return set_parameters(
        flight,
        **{name: metres, "FENCE_TYPE": bit, "FENCE_ACTION": rng.choice((0, 4)), "FENCE_ENABLE": 1},
    )


@kind("a circle is uploaded that excludes a place on the site")
def fence_uploaded(flight, rng):
    if flight.operator.manner is Manner.ARDUPILOT:
        set_parameters(flight, FENCE_TYPE=4, FENCE_ACTION=0, FENCE_ENABLE=1)
    else:
        set_parameters(flight, GF_ACTION=1)
    x_m, radius_m = rng.uniform(-10.0, 40.0), rng.uniform(2.0, 8.0)
    flight.note(x_m=x_m, radius_m=radius_m)
    place = flight.site.frame.to_geodetic((x_m, 0.0, 0.0))
    flight.operator.upload_fence([(5004, radius_m, place.latitude_deg, place.longitude_deg)])


@kind("a parameter is set that decides what happens without the companion", lasts_s=(5.0, 30.0))
def loss_action_changed(flight, rng):
    if flight.operator.manner is Manner.PX4:
        return set_parameters(
            flight, COM_OBL_RC_ACT=rng.choice((0, 3, 4, 5)), COM_OF_LOSS_T=rng.uniform(0.1, 5.0)
        )
    return set_parameters(flight, GUID_TIMEOUT=rng.uniform(0.2, 8.0))


@kind("parameters are not reported", lasts_s=(60.0, 60.0))
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


@kind("no position is reported", lasts_s=(0.2, 8.0))
def position_missing(flight, rng):
    return flight.filter(packets.drop(packets.LOCAL_POSITION, packets.ODOMETRY))


@kind("the position that is reported repeats its last words, its clock too", lasts_s=(0.2, 8.0))
def position_frozen(flight, rng):
    return flight.filter(packets.freeze(packets.LOCAL_POSITION, packets.ODOMETRY))


@kind("the mode is not reported", lasts_s=(0.5, 8.0))
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
