"""Exact replay: a recorded flight flies again without a difference; a planted one is named."""

import json
from unittest import mock

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.analysis.replay.exact import ExactReplay
from moar_companion.companion.planning.map_jobs import MapJob
from moar_companion.companion.safety.check_inputs import Host
from moar_companion.errors import InputError
from moar_companion.mavlink.codec import checksum_of
from moar_companion.mavlink.signing import SigningKey
from moar_companion.service.recording.calls import call_encoded

from ..flights.lockstep import Lockstep
from ..flights.operator import INSPECTION
from ..flights.test_lidar_on_board import SITE, hovering
from ..mavlink.component.ftp_client import BURST, OPEN, request

SETPOINT_ID, FILE_TRANSFER_ID, MISSION_ITEM_ID = "540000", "6e0000", "490000"
SET_INTERVAL = 511


def recorded(flight):
    return [json.loads(json.dumps(call_encoded(call), allow_nan=False)) for call in flight.calls]


@pytest.fixture(scope="module")
def calls():
    flight = Lockstep(vehicle="x500")
    flight.companion.note_host(Host(disk_free=1e9, memory_available=1e9))
    flight.companion.note_wall_clock(1.7e9)
    flight.begin(INSPECTION)
    flight.autopilot.conditions.wind_mps = 6.0
    for asked in (
        request(1, OPEN, data=b"/general.json.xz"),
        mavlink.MAVLink_mission_request_list_message(1, 195),
        mavlink.MAVLink_command_long_message(1, 195, SET_INTERVAL, 0, 252, -1, *[0] * 5),
    ):
        flight.operator.send(asked)
    flight.run(1.0)
    flight.operator.send(request(3, BURST, size=239))
    flight.operator.send(mavlink.MAVLink_mission_request_int_message(1, 195, 1))
    flight.run(1.0)
    return recorded(flight)


def results(calls, method):
    return [call[3] for call in calls if call[0] == method and call[3]]


def differences(calls, key=None):
    replay = ExactReplay(key)
    return [difference for call in calls for difference in replay.feed(call)], replay


@pytest.mark.slow
def test_planted_differences_are_named_with_both_values_and_there_are_no_others(calls):
    calls = json.loads(json.dumps(calls))
    setpoints = [
        sent for sent in results(calls, "data_to_send") if sent[0][1][14:20] == SETPOINT_ID
    ]
    packet = bytearray.fromhex(setpoints[20][0][1])
    packet[14] ^= 1  # the last bit of x
    packet[-2:] = checksum_of(packet, 0)
    setpoints[20][0][1] = packet.hex()
    sent = results(calls, "data_to_send")[5]
    sent.append(sent[0])
    decided = [item for items in results(calls, "decisions") for item in items]
    plan = next(item["data"]["plan"] for item in decided if item["kind"] == "plan")
    plan["cost"]["total"] *= 1.0 + 1e-15
    job = results(calls, "contingency_jobs")[0][0]
    job["widening_m"] += 0.5
    sent_ids = {packet[1][14:20] for sent in results(calls, "data_to_send") for packet in sent}
    assert {FILE_TRANSFER_ID, MISSION_ITEM_ID} <= sent_ids
    found, replay = differences(calls)
    assert replay.compared["packet"] > 500
    one, two, three, four = sorted(found, key=lambda item: item.what)
    assert (one.what, two.what) == (
        "contingency job 1 widening_m",
        "decision plan data.plan.cost.total",
    )
    assert (one.recorded, one.recomputed) == ("0.5", "0.0")
    assert float(two.recorded) == pytest.approx(float(two.recomputed))
    assert float(two.recorded) != float(two.recomputed)
    assert three.recomputed == "nothing"
    assert four.what == "packet SET_POSITION_TARGET_LOCAL_NED x"
    assert 0.0 < abs(float(four.recorded) - float(four.recomputed)) < 1e-5


@pytest.mark.slow
def test_a_missing_input_is_a_difference_between_the_flights(calls):
    received = [index for index, call in enumerate(calls) if call[0] == "receive"]
    fewer = [call for index, call in enumerate(calls) if index not in received[10:40]]
    assert differences(fewer[:2000])[0]


@pytest.mark.slow
def test_a_flight_with_perception_is_repeated_without_a_difference():
    flight = hovering(SITE)
    flight.run_until(lambda: made(flight), 5.0)
    flight.operator.mission(INSPECTION, 0)
    flight.run(2.0)
    calls = recorded(flight)
    assert sum(call[0] == "maps_answered" for call in calls) > 0
    assert sum(call[0] == "perceived" for call in calls) > 20
    found, replay = differences(calls)
    assert found == []
    assert replay.compared["map job"] == made(flight)


def made(flight):
    """Number of map jobs that were answered."""
    return sum(call.method == "maps_answered" for call in flight.calls)


@pytest.mark.slow
def test_maps_that_failed_are_not_made_in_the_replay(calls):
    replay = ExactReplay()
    for call in calls[:50]:
        list(replay.feed(call))
    job = MapJob(job_id=7, site=replay.planners.exact.site)
    replay.jobs["map_jobs"][7] = job
    with mock.patch("moar_companion.analysis.replay.exact.answer_map_job", side_effect=MemoryError):
        answer = replay._answer("maps_answered", {"job_id": 7, "made": False})
    assert answer.site_maps is None


@pytest.mark.parametrize(
    ("kind", "was", "now", "what", "recorded", "recomputed"),
    [
        (
            "decision",
            [{"kind": "plan", "data": {"cost": [1.0, 2.0]}}],
            [{"kind": "plan", "data": {"cost": [1.0, 2.5]}}],
            "decision plan data.cost[1]",
            "2.0",
            "2.5",
        ),
        ("plan job", [{"job_id": 3}], [], "plan job 3", "{'job_id': 3}", "nothing"),
        ("status", [{"text": "a" * 300}], [{}], "status", f"{{'text': '{'a' * 190}...", "{}"),
        ("packet", [], [["a link", "00"]], "packet of no known kind", "nothing", None),
    ],
)
def test_a_difference_is_named_by_its_path_with_both_values(
    kind, was, now, what, recorded, recomputed
):
    replay = ExactReplay()
    (found,) = replay._compared(kind, was, now)
    assert (found.what, found.recorded) == (what, recorded)
    assert recomputed is None or found.recomputed == recomputed
    assert (replay.compared[kind], list(replay._compared(kind, was, was))) == (1, [])


SECRET = bytes(range(32))


def test_signed_links_need_their_key_which_is_not_in_the_recording():
    flight = Lockstep(secret=SECRET)
    flight.run(2.0)
    calls = recorded(flight)
    assert SECRET.hex() not in json.dumps(calls)
    with pytest.raises(InputError, match="signing-key"):
        differences(calls)
    assert differences(calls, SigningKey(SECRET))[0] == []
    assert differences(calls, SigningKey(SECRET[::-1]))[0]
