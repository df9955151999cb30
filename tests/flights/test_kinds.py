"""Kinds of faults: each draws the flight that it needs, and acts on it."""

from __future__ import annotations

import functools
import itertools
import json
import math
import random
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.error_margin import margin_of
from moar_companion.settings.config import Supervision
from tests.copies import flown_once
from tests.mavlink.signed import OTHER_SECRET, SECRET
from tests.vehicles import named_vehicle

from .campaign import packets
from .campaign.drawing import draw
from .campaign.flying import RandomFlight
from .campaign.kinds import KINDS
from .campaign.kinds.near import DRIFTED_M, drift
from .campaign.sites import moved_conductors, narrow_site, shipped_site
from .lidar_on_board import scene_of
from .lockstep import as_simulated
from .operator import Manner

SITE = shipped_site("315kv_double_circuit")


def drawn_with(kind, manner=None):
    """A flight of one kind alone."""
    manners = KINDS[kind].manners if manner is None else {manner}
    seed = next(each for each in itertools.count(1) if draw_manner(each) in manners)
    return draw(seed, [kind])


def draw_manner(seed):
    return random.Random(seed).choice(list(Manner))


@flown_once
def hovering(kind, manner=None):
    """The flight of a kind, in the air, before its first order."""
    flight = RandomFlight(replace(drawn_with(kind, manner), whole=False))
    flight._begin_in_the_air()
    return flight


PLAIN = dict.fromkeys(Manner, "gusts")
"""A kind that prepares nothing: its flight serves all such kinds."""


@functools.cache
def with_lidar():
    """A flight that the kinds of the lidar share: its decoder cannot be copied."""
    return hovering.__wrapped__("lidar_loses", Manner.PX4)


def flight_of(kind):
    row = KINDS[kind]
    if kind.startswith("lidar_"):
        return with_lidar()
    manner = Manner.PX4 if Manner.PX4 in row.manners else Manner.ARDUPILOT
    return hovering(kind if row.prepare else PLAIN[manner], manner)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_draws_the_flight_that_it_needs(kind):
    drawn = drawn_with(kind)
    assert {fault.kind for fault in drawn.faults} == {kind}
    assert repr(drawn) == repr(drawn_with(kind))
    assert drawn.lidar == kind.startswith("lidar_")
    assert drawn.signed == kind.startswith(("signed_", "signing_"))
    assert drawn.orders_by_mqtt == (kind == "orders_by_mqtt")
    assert (drawn.map_error_m > 0.0) == (drawn.mapped is not None) == ("wrong" in kind)
    assert bool(drawn.firmware) == kind.startswith("firmware_")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_begins_and_ends(kind):
    flight = flight_of(kind)
    undo = KINDS[kind].begin(flight, random.Random(1))
    flight.run(0.3)
    if undo is not None:
        undo()
        flight.run(0.1)
    assert json.dumps(flight._noted)
    assert len(flight.rows) > 200


def test_a_flight_has_one_kind_that_prepares_it():
    for seed in range(1, 150):
        kinds = [fault.kind for fault in draw(seed).faults]
        assert sum(KINDS[kind].prepare is not None for kind in kinds) <= 1


# Beside the conductors --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("manner", Manner)
@pytest.mark.parametrize("reported", [True, False])
def test_a_drift_moves_the_aircraft_in_its_direction_and_is_reported_or_not(manner, reported):
    flight = hovering("gusts", manner)
    before = flight.rows[-1]
    drift(flight, random.Random(3), reported=reported)
    flight.run(2.0)
    noted = flight._noted
    along_m = 2.0 * noted["speed_mps"] * math.cos(math.radians(noted["towards_deg"]))
    x_error_m, reported_m = flight.rows[-1][4] - before[4], flight.rows[-1][10] - before[10]
    assert x_error_m == pytest.approx(along_m, abs=0.2)
    assert reported_m == pytest.approx(2.0 * noted["speed_mps"] if reported else 0.0, abs=0.1)
    flight.run(DRIFTED_M / noted["speed_mps"])
    assert abs(flight.rows[-1][4]) < DRIFTED_M + 0.5


@pytest.mark.slow
def test_a_fault_that_waits_begins_when_its_condition_holds_and_notes_the_time():
    flight = hovering("gusts", Manner.PX4)
    flight._noted = noted = {"kind": "waits"}
    begun = []
    flight.when(lambda: flight.now_s > start_s + 0.1, lambda: begun.append(flight.note(x=1)))
    start_s = flight.now_s
    flight._noted = {}
    flight.run(0.08)
    assert begun == []
    flight.run(0.2)
    assert len(begun) == 1
    assert noted == {"kind": "waits", "x": 1}


@pytest.mark.parametrize("vehicle", ["x500", "linedrone"])
def test_a_narrow_gap_is_as_wide_as_its_part_of_what_the_vehicle_needs(vehicle):
    for seed in range(20):
        site, part = narrow_site(random.Random(seed), Manner.PX4, vehicle)
        flown = as_simulated(named_vehicle(vehicle), Manner.PX4)
        needed_m = flown.radius_m + 0.0175 + 0.25 + margin_of(flown, Supervision()).total_m
        heights_m = sorted(item.position_m[1] for item in site.obstacles)
        gaps_m = [after - before for before, after in itertools.pairwise(heights_m)]
        assert max(gaps_m) == pytest.approx(2.0 * part * needed_m)
        assert sorted(gaps_m)[:-1] == pytest.approx([1.6 * needed_m] * (len(gaps_m) - 1))
        middle_m = next(
            (low + high) / 2.0
            for low, high in itertools.pairwise(heights_m)
            if high - low == max(gaps_m)
        )
        (target,) = site.targets
        assert target.position_m[1] == pytest.approx(middle_m)


def test_the_conductors_of_a_wrong_file_are_off_by_the_noted_error():
    moved, error_m = moved_conductors(SITE, random.Random(1), 2.0)
    off_m = [
        math.dist(one.position_m, two.position_m)
        for one, two in zip(SITE.obstacles, moved.obstacles, strict=True)
    ]
    assert max(off_m) == pytest.approx(error_m)
    assert min(off_m) >= 0.1
    assert error_m <= 2.0


# Links ------------------------------------------------------------------------------------------


def heartbeat(key=SECRET, stamp=5):
    message = mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
    return packets.packed(message, seq=9, signature=packets.Signature(key, 2, stamp))


def test_a_changed_packet_of_a_signed_link_keeps_its_signature_valid():
    def edit(message):
        message.custom_mode = 7

    ((_, changed),) = packets.change({packets.HEARTBEAT}, edit, SECRET)(0.0, [(0.0, heartbeat())])
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = SECRET
    message = reader.decode(bytearray(changed))
    assert (message.custom_mode, message.get_seq(), changed[-13]) == (7, 9, 2)
    with pytest.raises(mavlink.MAVError):
        reader.decode(bytearray(heartbeat(OTHER_SECRET, stamp=6)))


def test_late_packets_arrive_in_their_order_with_the_time_of_their_arrival():
    late = packets.late(0.05)
    assert late(1.0, [(1.0, b"a"), (1.0, b"b")]) == []
    assert late(1.02, [(1.02, b"c")]) == []
    assert late(1.05, []) == [(1.05, b"a"), (1.05, b"b")]
    assert late(1.2, []) == [(1.2, b"c")]


def test_the_scene_of_a_site_has_its_conductors_across_the_plane():
    scene = scene_of(SITE).scene
    assert [(wire.start_m[0], wire.start_m[2]) for wire in scene.wires] == [
        item.position_m for item in SITE.obstacles
    ]
    assert all(wire.start_m[1] == -wire.end_m[1] for wire in scene.wires)
