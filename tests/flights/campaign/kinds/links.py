"""Faults of the companion's link: losses, delays, forged packets."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import all as mavlink

from ...operator import Manner
from .. import packets
from .table import Breaks, kind, set_conditions

# The companion's link ---------------------------------------------------------------------------


@kind("the link loses 10 to 50 % of its packets, both ways")
def link_loses(flight, rng):
    return set_conditions(flight, link_loss_percent=rng.uniform(10.0, 50.0))


@kind("packets take 50 to 450 ms, both ways")
def link_delays(flight, rng):
    return set_conditions(flight, link_delay_ms=rng.uniform(50.0, 450.0))


@kind("packets take up to 300 ms more and overtake each other")
def link_reorders(flight, rng):
    return set_conditions(flight, link_jitter_ms=rng.uniform(50.0, 300.0))


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
    return set_conditions(flight, radio_rssi=45.0 + rng.uniform(10.0, 80.0))


@kind("packets take 50 to 300 ms, up to 200 ms more, and 5 to 30 % are lost, both ways")
def link_slow_and_lossy(flight, rng):
    return set_conditions(
        flight,
        link_delay_ms=rng.uniform(50.0, 300.0),
        link_jitter_ms=rng.uniform(0.0, 200.0),
        link_loss_percent=rng.uniform(5.0, 30.0),
    )


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
