"""Download of the autopilot's fence: answers, refusals, losses, silence."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.fence_download import FenceDownload
from moar_companion.mavlink.telemetry import FenceItem

AUTOPILOT, OURS = (1, 1), (1, 195)
FENCE = mavlink.MAV_MISSION_TYPE_FENCE
TARGET = {"target_system": 1, "target_component": 195}


def count(number, mission_type=FENCE):
    return create("MISSION_COUNT", **TARGET, count=number, mission_type=mission_type, opaque_id=0)


def item(seq):
    unused = dict.fromkeys(("param2", "param3", "param4", "z"), 0.0)
    return create(
        "MISSION_ITEM_INT",
        **TARGET,
        **unused,
        seq=seq,
        frame=0,
        command=5001,
        current=0,
        autocontinue=1,
        param1=3.0,
        x=450000000 + seq,
        y=70000000,
        mission_type=FENCE,
    )


def refusal(result):
    return create("MISSION_ACK", **TARGET, type=result, mission_type=FENCE)


def read(download, number=3, now_s=0.0):
    """Downloads a whole fence, with every answer at once."""
    assert download.next_request(AUTOPILOT, now_s).get_type() == "MISSION_REQUEST_LIST"
    end = download.handle(count(number), AUTOPILOT, now_s)
    for seq in range(number):
        assert end is None
        asked = download.next_request(AUTOPILOT, now_s)
        assert (asked.get_type(), asked.seq) == ("MISSION_REQUEST_INT", seq)
        end = download.handle(item(seq), AUTOPILOT, now_s)
    assert (end.get_type(), end.type) == ("MISSION_ACK", mavlink.MAV_MISSION_ACCEPTED)


def test_all_fence_items_are_read_in_turn_and_acknowledged():
    download = FenceDownload()
    assert download.items is None
    read(download)
    assert len(download.items) == 3
    assert download.items[1] == FenceItem(
        command=5001,
        parameter=3.0,
        latitude_deg=pytest.approx(45.0000001, rel=0.0, abs=1e-9),
        longitude_deg=pytest.approx(7.0),
    )


def test_an_empty_list_is_a_valid_fence():
    download = FenceDownload()
    read(download, 0)
    assert download.items == ()


def test_the_fence_is_read_again_periodically_and_stays_known_meanwhile():
    download = FenceDownload()
    read(download)
    assert download.next_request(AUTOPILOT, 9.9) is None
    download.next_request(AUTOPILOT, 10.0)
    assert len(download.items) == 3
    download.handle(count(0), AUTOPILOT, 10.0)
    assert download.items == ()


def test_a_lost_item_is_requested_again():
    download = FenceDownload()
    download.next_request(AUTOPILOT, 0.0)
    download.handle(count(2), AUTOPILOT, 0.0)
    assert download.next_request(AUTOPILOT, 0.0).seq == 0
    assert download.next_request(AUTOPILOT, 0.9) is None
    assert download.next_request(AUTOPILOT, 1.0).seq == 0
    download.handle(item(0), AUTOPILOT, 1.1)
    download.handle(item(0), AUTOPILOT, 1.1)  # the first answer, late
    assert download.next_request(AUTOPILOT, 1.1).seq == 1


def test_an_autopilot_that_never_answers_is_silent_and_queried_again_later():
    download = FenceDownload()
    asked = [download.next_request(AUTOPILOT, float(second)) for second in range(12)]
    assert sum(message is not None for message in asked) == 5
    assert download.silent
    assert download.items is None
    read(download, now_s=20.0)
    assert not download.silent


def test_an_autopilot_that_sends_a_count_but_no_item_leaves_its_fence_unknown():
    download = FenceDownload()
    download.next_request(AUTOPILOT, 0.0)
    download.handle(count(4), AUTOPILOT, 0.0)
    for second in range(60):
        download.next_request(AUTOPILOT, float(second))
    assert download.items is None
    assert not download.silent


def test_an_autopilot_that_falls_silent_keeps_the_fence_that_was_read():
    download = FenceDownload()
    read(download)
    for second in range(10, 22):
        download.next_request(AUTOPILOT, float(second))
    assert download.silent
    assert len(download.items) == 3


def test_a_busy_autopilot_is_queried_again_soon():
    download = FenceDownload()
    download.next_request(AUTOPILOT, 0.0)
    download.handle(refusal(mavlink.MAV_MISSION_DENIED), AUTOPILOT, 0.0)
    assert download.items is None
    assert download.next_request(AUTOPILOT, 0.5) is None
    read(download, now_s=1.0)


def test_an_autopilot_without_fence_support_has_an_empty_fence():
    download = FenceDownload()
    download.next_request(AUTOPILOT, 0.0)
    download.handle(refusal(mavlink.MAV_MISSION_UNSUPPORTED), AUTOPILOT, 0.0)
    assert download.items == ()


def test_unrequested_answers_and_other_mission_types_are_ignored():
    download = FenceDownload()
    download.handle(count(0), AUTOPILOT, 0.0)
    assert download.items is None
    download.next_request(AUTOPILOT, 0.0)
    download.handle(count(0, mission_type=0), AUTOPILOT, 0.0)
    assert download.items is None


def test_after_a_restart_the_fence_is_read_at_once():
    download = FenceDownload()
    read(download)
    download.restart()
    assert download.next_request(AUTOPILOT, 0.1).get_type() == "MISSION_REQUEST_LIST"
    assert download.items is not None


def test_items_out_of_turn_and_before_the_count_are_ignored():
    download = FenceDownload()
    download.next_request(AUTOPILOT, 0.0)
    assert download.handle(item(0), AUTOPILOT, 0.0) is None
    download.handle(count(2), AUTOPILOT, 0.0)
    download.next_request(AUTOPILOT, 0.0)
    assert download.handle(item(1), AUTOPILOT, 0.0) is None
    assert download.items is None
    download.handle(item(0), AUTOPILOT, 0.0)
    download.next_request(AUTOPILOT, 0.0)
    assert download.handle(item(1), AUTOPILOT, 0.0).get_type() == "MISSION_ACK"
    assert [each.latitude_deg for each in download.items] == pytest.approx(
        [45.0, 45.0000001], rel=0.0, abs=1e-9
    )
