"""Flights that capture views, in lockstep: aims are in the pictures, none is taken twice."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.planner.site import Site
from moar_companion.settings.config import Inspection, OnFailure, shipped_configs

from ..thorough import thorough
from .cameras import payload_of, with_views
from .lockstep import hovering
from .operator import Manner

pytestmark = pytest.mark.slow

SHUTTER = mavlink.MAVLink_command_long_message(
    1, 100, mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 0, 1, 977, 0, 0, 0
).pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
"""A ground station asks the camera for a picture."""
EACH = pytest.mark.parametrize(
    "manner", [Manner.ARDUPILOT, pytest.param(Manner.PX4, marks=thorough)]
)


def shipped(**views):
    return with_views(Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml"), **views)


def at_first_view(manner=Manner.ARDUPILOT, *, payload=None, **config):
    site = shipped()
    flight = hovering(site=site, manner=manner, payload=payload_of(site, **payload or {}), **config)
    flight.begin(1)
    flight.run_until_state("at_target", 60.0)
    return flight


def decided(flight, kind):
    return [item.data for item in flight.decisions if item.kind == kind]


def texts(flight):
    return [row["text"] for row in decided(flight, "text")]


def counted(flight):
    return [row for row in decided(flight, "picture") if row["count"]]


@EACH
def test_both_splices_are_captured_in_the_middle_of_sharp_pictures(manner):
    flight = at_first_view(manner)
    flight.run_until_state("holding", 120.0)
    assert flight.companion.status.task.done
    rows = counted(flight)
    assert [row["stop"] for row in rows].count("splice-outer/1") == 2
    assert [row["stop"] for row in rows].count("splice-inner/1") == 2
    pictures = {picture.number: picture for picture in flight.payload.pictures}
    for row in rows:
        sighting = pictures[row["number"]].sightings[row["stop"]]
        assert sighting.in_middle_fifth
        assert sighting.blur_px < 1.0
    assert flight.payload.holder == (0, 0)


def test_a_takeover_ends_the_capture_at_once_and_frees_the_gimbal():
    flight = at_first_view()
    flight.run_until(lambda: flight.payload.holder == (1, 195), 5.0)
    flight.operator.mode("hold")
    flight.run_until_state("overridden", 2.0)
    flight.run(1.0)
    assert flight.payload.holder == (0, 0)
    [view] = decided(flight, "view")
    assert view["outcome"] == "interrupted"
    taken = len(flight.payload.pictures)
    flight.run(5.0)
    assert len(flight.payload.pictures) == taken


def test_after_a_hold_only_what_is_missing_is_captured():
    flight = at_first_view()
    flight.run_until(lambda: bool(counted(flight)), 10.0)
    flight.operator.mission(0)
    flight.run_until_state("holding", 2.0)
    flight.run(3.0)
    flight.operator.go_on()
    flight.run_until(lambda: flight.companion.status.task.stops[:1] != ("splice-outer/1",), 30.0)
    assert [row["count"] for row in counted(flight)] == [1, 2]


def test_a_failed_view_holds_the_flight_and_continue_tries_it_again():
    flight = at_first_view()
    flight.payload.faults.card_full = True
    flight.run_until_state("holding", 40.0)
    assert "MOAR: camera card full, holding" in texts(flight)
    assert flight.payload.holder == (0, 0)
    flight.payload.faults.card_full = False
    flight.operator.go_on()
    flight.run_until(lambda: len(counted(flight)) == 2, 30.0)


def test_a_failed_view_is_left_out_where_that_is_set():
    flight = at_first_view(
        payload={"holder": (255, 190)}, inspection=Inspection(on_failure=OnFailure.SKIP)
    )
    flight.run_until_state("flying", 30.0)
    assert "MOAR: gimbal held by 255/190, target skipped" in texts(flight)
    flight.run_until_state("holding", 90.0)
    assert "MOAR: stops not done: 2, holding" in texts(flight)
    assert flight.payload.holder == (255, 190)
    assert not flight.payload.pictures


def test_a_picture_that_another_takes_is_none_of_a_view():
    flight = at_first_view()
    flight.payload.faults.busy = True
    flight.run_until_state("holding", 40.0)
    flight.payload.faults.busy = False
    flight.run(6.0)
    flight.payload.receive(SHUTTER)
    flight.run(1.0)
    [row] = decided(flight, "picture")
    assert (row["marks"], row["count"], "stop" in row) == (["not asked for"], 0, False)


def test_without_a_gimbal_the_aircrafts_heading_aims():
    flight = at_first_view(payload={"gimbal": False})
    flight.run_until(lambda: bool(counted(flight)), 30.0)
    sighting = flight.payload.pictures[0].sightings["splice-outer/1"]
    assert abs(sighting.right) <= 0.1


def test_a_view_may_be_a_video():
    site = shipped(pictures=0, video_s=3.0)
    flight = hovering(site=site, manner=Manner.ARDUPILOT, payload=payload_of(site))
    flight.begin(1)
    flight.run_until_state("at_target", 60.0)
    flight.run(4.0)
    flight.payload.receive(SHUTTER)
    flight.run_until(lambda: bool(decided(flight, "video")), 30.0)
    flight.run(0.5)
    [picture] = decided(flight, "picture")
    assert picture["marks"] == ["not asked for"]
    [(start_s, end_s)] = flight.payload.videos_s
    assert end_s - start_s >= 2.9
