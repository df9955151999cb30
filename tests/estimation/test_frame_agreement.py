"""Agreement of the autopilot's messages on one position."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.companion.estimation.frame_agreement import FrameAgreement
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.telemetry import (
    GlobalPosition,
    Home,
    LocalOrigin,
    LocalPosition,
    Telemetry,
)
from moar_companion.mavlink.telemetry_receiver import MESSAGE_IDS
from moar_companion.mavlink.translate import update
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN, GeodeticPoint
from tests.mavlink.conftest import SHARED, packets

from ..companion.desk import ACCEPTED, EXIT, STEP_S, Desk

SITE = SiteFrame(
    origin=GeodeticPoint(latitude_deg=45.4, longitude_deg=-71.9, altitude_amsl_m=210.0),
    azimuth_deg=90.0,
)
"""Metres near by, to a few millimetres: x to the east, y to the north, z up."""


def at(east_m=0.0, north_m=0.0, up_m=0.0):
    return SITE.to_geodetic((east_m, north_m, up_m))


def telemetry_at(
    origin=(0.0, 0.0, 0.0),
    place=(10.0, 5.0, 8.0),
    local=(5.0, 10.0, -8.0),
    velocity=(0.0, 0.0, 0.0),
    ahead_s=0.0,
    home=None,
):
    return Telemetry(
        local_origin=LocalOrigin(received_s=1.0, point=at(*origin)),
        local_position=LocalPosition(
            received_s=1.0, boot_s=50.0, position_ned_m=local, velocity_ned_mps=velocity
        ),
        global_position=GlobalPosition(received_s=1.0, boot_s=50.0 + ahead_s, point=at(*place)),
        home=home,
    )


def agreement_of(*telemetries, kind=PX4, grounded=False):
    agreement = FrameAgreement()
    for telemetry in telemetries:
        agreement.update(telemetry, kind, grounded=grounded)
    return agreement


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_equal_local_and_global_positions_agree(kind):
    assert agreement_of(telemetry_at(), kind=kind).global_off_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("off", "off_m"), [((0.8, 0.0, 0.0), 0.8), ((0.0, -0.8, 0.0), 0.8), ((0.0, 0.6, 0.8), 1.0)]
)
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_an_origin_other_than_the_estimators_is_detected_in_any_direction(kind, off, off_m):
    assert agreement_of(telemetry_at(origin=off), kind=kind).global_off_m == pytest.approx(
        off_m, abs=0.05
    )


def test_a_global_position_of_another_instant_is_compared_by_the_velocity():
    moved = telemetry_at(place=(11.0, 5.0, 8.0), velocity=(0.0, 5.0, 0.0), ahead_s=0.2)
    assert agreement_of(moved).global_off_m == pytest.approx(0.0, abs=0.05)


def test_positions_that_are_far_apart_in_time_are_not_compared():
    """ArduPilot without its receiver stops the local position and repeats the global one."""
    agreement = agreement_of(telemetry_at(), telemetry_at(place=(90.0, 0.0, 8.0), ahead_s=4.0))
    assert agreement.global_off_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("later_s", [2.0, 4.0, 600.0])
def test_a_disagreement_lasts_until_another_global_position_agrees(later_s):
    wrong = telemetry_at(place=(55.0, 5.0, 8.0))
    later = replace(wrong, local_position=replace(wrong.local_position, boot_s=50.0 + later_s))
    agreement = agreement_of(wrong, later)
    assert agreement.global_off_m == pytest.approx(45.0, abs=0.5)
    right = replace(
        later, global_position=replace(telemetry_at().global_position, boot_s=50.0 + later_s)
    )
    agreement.update(right, PX4, grounded=False)
    assert agreement.global_off_m == pytest.approx(0.0, abs=0.05)


def fly(desk, seconds, off_m=None):
    """Flies with a global position a distance north of the local one; None: silent."""
    names = ("latitude_deg", "longitude_deg", "altitude_amsl_m")
    origin = GeodeticPoint(**dict(zip(names, desk.origin, strict=True)))
    frame = SiteFrame(origin=origin, azimuth_deg=90.0)
    for _ in range(round(seconds / STEP_S)):
        if off_m is not None:
            north_m, east_m, down_m = desk.position_ned_m
            place = frame.to_geodetic((east_m, north_m + off_m, -down_m))
            message = create(
                "GLOBAL_POSITION_INT",
                time_boot_ms=round(desk.boot_s * 1e3),
                lat=round(place.latitude_deg * 1e7),
                lon=round(place.longitude_deg * 1e7),
                alt=round(place.altitude_amsl_m * 1e3),
                relative_alt=0,
                vx=0,
                vy=0,
                vz=0,
                hdg=0,
            )
            desk.handle(desk.autopilot.pack(message))
        desk.step()
    return desk


@pytest.mark.parametrize("end", ["agrees", pytest.param("an exit", marks=pytest.mark.slow)])
def test_a_silent_global_position_does_not_end_a_hold_for_a_disagreement(end):
    desk = fly(Desk().come_to("flying"), 2.0, 0.0)
    fly(desk, 2.0, 45.0)
    assert desk.said("global position off 45")
    fly(desk, 10.0)
    assert desk.state == "holding"
    began_s = desk.now_s
    if end == "agrees":
        fly(desk, 7.0, 0.0)
    else:
        desk.order(EXIT).run(2.0)
        assert desk.answers()[-1] == ACCEPTED
    assert desk.state == "flying"
    assert any(any((m.vx, m.vy, m.vz)) for m in desk.setpoints(began_s))


def test_unknown_positions_are_not_compared():
    assert agreement_of(Telemetry()).global_off_m is None
    assert agreement_of(telemetry_at(place=(50.0, 0.0, 0.0)), kind=UNKNOWN).global_off_m is None


def test_a_home_that_disagrees_with_the_origin_is_detected_on_ardupilot():
    home = Home(received_s=1.0, point=at(20.0, 0.0, 0.0), position_ned_m=(0.0, 18.0, 0.0))
    assert agreement_of(telemetry_at(home=home), kind=ARDUPILOT).home_off_m == pytest.approx(
        2.0, abs=0.06
    )
    assert agreement_of(telemetry_at(home=home), kind=PX4).home_off_m is None


def test_a_slowly_moving_origin_is_measured_from_its_position_at_the_takeoff():
    creeping = [telemetry_at(origin=(0.02 * count, 0.0, 0.0)) for count in range(50)]
    assert agreement_of(*creeping).origin_moved_m == pytest.approx(0.98, abs=0.01)
    assert agreement_of(*creeping, grounded=True).origin_moved_m == 0.0


def test_an_accepted_origin_is_the_new_reference():
    agreement = agreement_of(telemetry_at(), telemetry_at(origin=(1.0, 0.0, 0.0)))
    agreement.accept_origin()
    assert agreement.origin_moved_m == 0.0
    agreement.update(telemetry_at(origin=(1.0, 0.3, 0.0)), PX4, grounded=False)
    assert agreement.origin_moved_m == pytest.approx(0.3, abs=0.01)


def test_after_a_restart_the_first_origin_is_the_reference():
    agreement = agreement_of(telemetry_at(), Telemetry(), telemetry_at(origin=(30.0, 0.0, 0.0)))
    assert agreement.origin_moved_m == 0.0


def recorded_m(name, kind):
    """(time, distance from local to global position) in a recording, and the final agreement."""
    path = SHARED / "traces" / f"{name}.companion.tlog"
    if not path.exists():
        pytest.skip(f"the recording {path} is not here")
    codec = Codec(system_id=9, component_id=9, wanted=MESSAGE_IDS)
    agreement, telemetry, found = FrameAgreement(), Telemetry(), []
    for now_s, packet in packets(path):
        for message in codec.receive(packet):
            if (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
                continue
            telemetry = update(telemetry, message, now_s)
            agreement.update(telemetry, kind, grounded=False)
            if agreement.global_off_m is not None:
                found.append((now_s, agreement.global_off_m))
    return found, agreement


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "kind", "most_m", "longest_s"),
    [
        pytest.param("px4/a1_boot_offboard_takeoff", PX4, 0.11, 0.0, marks=pytest.mark.slow),
        pytest.param("px4/e1_pilot_override", PX4, 0.11, 0.0, marks=pytest.mark.slow),
        ("px4/h1_msg_intervals", PX4, 0.12, 0.0),
        pytest.param(
            "px4/d3_gps_silent_v117", PX4, 0.74, 0.3, marks=pytest.mark.slow
        ),  # when the receiver returned
        ("px4/d1_gps_degradation", PX4, 56.2, 0.1),  # the same
        ("ardupilot/a2_square", ARDUPILOT, 0.03, 0.0),
        pytest.param("ardupilot/b_batt", ARDUPILOT, 0.03, 0.0, marks=pytest.mark.slow),
        pytest.param("ardupilot/d4_gps_input", ARDUPILOT, 0.03, 0.0, marks=pytest.mark.slow),
    ],
)
def test_positions_of_recorded_autopilots_agree(name, kind, most_m, longest_s):
    found, agreement = recorded_m(name, kind)
    assert max(off_m for _, off_m in found) <= most_m
    began_s, apart_s = math.inf, 0.0
    for now_s, off_m in found:
        began_s = min(began_s, now_s) if off_m > 0.5 else math.inf
        apart_s = max(apart_s, now_s - began_s)
    assert apart_s <= longest_s
    assert agreement.origin_moved_m == 0.0
    assert (agreement.home_off_m or 0.0) <= 0.01
