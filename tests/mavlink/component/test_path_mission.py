"""The planned path as a mission to download: one path a download, and nothing to upload."""

from __future__ import annotations

import math
from random import Random

import pytest

from moar_companion.mavlink.commands import Sender
from moar_companion.mavlink.component.component_service import Asker
from moar_companion.mavlink.component.path_mission import PathMission
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.types import GeodeticPoint

DENIED, UNSUPPORTED, INVALID_SEQUENCE = 14, 3, 13
ACCEPTED = 0


def path_of(length, latitude_deg=45.0):
    return tuple(
        GeodeticPoint(
            latitude_deg=latitude_deg + 1e-5 * at, longitude_deg=-71.9, altitude_amsl_m=210.0 + at
        )
        for at in range(length)
    )


class Station:
    """A ground station's side of the protocol, with its ids."""

    def __init__(self, server, component_id=190, system_id=255):
        self.server = server
        self.sender = Sender(link="udp", system_id=system_id, component_id=component_id)
        self.now_s = 100.0

    def send(self, name, *, target_component=195, **fields):
        message = create(name, target_system=1, target_component=target_component, **fields)
        on_board = self.sender.system_id == 1
        asker = Asker(sender=self.sender, objection=None, on_board=on_board)
        return self.server.handle(message, asker, self.now_s)

    def list(self, **options):
        return self.send("MISSION_REQUEST_LIST", **{"mission_type": 0} | options)

    def item(self, seq, name="MISSION_REQUEST_INT"):
        (answer,) = self.send(name, seq=seq, mission_type=0)
        return answer

    def acknowledge(self):
        assert self.send("MISSION_ACK", type=ACCEPTED, mission_type=0) == []

    def download(self):
        (count,) = self.list()
        items = [self.item(seq) for seq in range(count.count)]
        self.acknowledge()
        return items


@pytest.fixture
def server():
    served = PathMission()
    served.offer(path_of(5))
    return served


def test_a_path_is_downloaded_whole_with_its_places(server):
    items = Station(server).download()
    assert [item.seq for item in items] == [0, 1, 2, 3, 4]
    for item, point in zip(items, path_of(5), strict=True):
        assert item.get_type() == "MISSION_ITEM_INT"
        assert (item.frame, item.command) == (mavlink.MAV_FRAME_GLOBAL, 16)
        assert item.x == pytest.approx(point.latitude_deg * 1e7, abs=0.6)
        assert item.y == pytest.approx(point.longitude_deg * 1e7, abs=0.6)
        assert item.z == point.altitude_amsl_m
        assert math.isnan(item.param4)
    assert [item.current for item in items] == [1, 0, 0, 0, 0]


def test_without_a_path_the_list_is_empty():
    assert Station(PathMission()).download() == []


def test_the_older_request_is_answered_with_the_same_item(server):
    station = Station(server)
    station.list()
    assert station.item(2, "MISSION_REQUEST").x == station.item(2).x


def test_a_path_that_changes_meanwhile_is_not_mixed_with_the_one_under_way(server):
    station, other = Station(server), Station(server, component_id=191)
    (count,) = station.list()
    first = station.item(0)
    server.offer(path_of(3, latitude_deg=46.0))
    rest = [station.item(seq) for seq in range(1, count.count)]
    assert all(item.x < 46e7 for item in (first, *rest))
    assert all(item.x >= 46e7 for item in other.download())
    station.acknowledge()
    assert len(station.download()) == 3


def test_a_repeated_request_of_the_list_continues_its_download(server):
    station = Station(server)
    (count,) = station.list()
    station.item(0)
    server.offer(path_of(9, latitude_deg=46.0))
    (again,) = station.list()
    assert (again.count, again.opaque_id) == (count.count, count.opaque_id)


def test_a_station_that_asks_for_the_list_alone_soon_gets_the_present_path(server):
    station = Station(server)
    counts = []
    for second in range(6):
        server.offer(path_of(5 + second))
        counts += [count.count for count in station.list()]
        station.now_s += 1.0
    assert counts == sorted(counts)
    assert counts[-1] >= 8


def test_a_path_that_begins_is_there_at_the_next_request():
    served = PathMission()
    station = Station(served)
    assert station.list()[0].count == 0
    served.offer(path_of(4))
    assert station.list()[0].count == 4


def test_a_download_without_an_acknowledgement_ends_two_seconds_after_its_last_item(server):
    station = Station(server)
    (count,) = station.list()
    for seq in range(count.count):
        station.item(seq)
    server.offer(path_of(2))
    assert station.list()[0].count == 5
    station.now_s += 2.1
    assert station.list()[0].count == 2


def test_a_download_that_is_silent_ends_and_has_to_begin_again(server):
    station = Station(server)
    station.list()
    server.offer(path_of(2))
    station.now_s += 11.0
    assert station.item(1).type == INVALID_SEQUENCE
    assert len(station.download()) == 2


def test_an_item_beyond_the_path_or_without_a_list_is_refused(server):
    station = Station(server)
    assert station.item(0).type == INVALID_SEQUENCE
    station.list()
    for seq in (5, 65535):
        assert station.item(seq).type == INVALID_SEQUENCE
    assert station.item(4).seq == 4


def test_the_id_of_a_plan_is_that_of_its_path(server):
    def plan_id(path):
        server.offer(path)
        (count,) = Station(server, component_id=20 + len(path)).list()
        return count.opaque_id

    ids = [plan_id(path_of(length)) for length in range(6)]
    assert len(set(ids)) == 6
    assert 0 not in ids
    server.offer(path_of(5))
    (same,) = Station(server, component_id=77).list()
    assert same.opaque_id == ids[5]


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("MISSION_COUNT", {"count": 3, "mission_type": 0, "opaque_id": 0}),
        ("MISSION_COUNT", {"count": 3, "mission_type": 1, "opaque_id": 0}),
        ("MISSION_CLEAR_ALL", {"mission_type": 0}),
        ("MISSION_SET_CURRENT", {"seq": 1}),
        ("MISSION_WRITE_PARTIAL_LIST", {"start_index": 0, "end_index": 1, "mission_type": 0}),
    ],
)
def test_a_change_is_denied_with_a_text_and_changes_nothing(server, name, fields):
    station = Station(server)
    (answer,) = station.send(name, **fields)
    assert (answer.get_type(), answer.type) == ("MISSION_ACK", DENIED)
    assert answer.mission_type == fields.get("mission_type", 0)
    (event,) = server.events_received()
    assert (event.sender, "mission commands go to component 1" in event.reason) == (
        station.sender,
        True,
    )
    assert len(station.download()) == 5


def test_many_refusals_have_one_text_in_two_seconds(server):
    station = Station(server)
    for _ in range(100):
        station.now_s += 0.04
        station.send("MISSION_CLEAR_ALL", mission_type=0)
    assert len(server.events_received()) == 2


def test_refusals_of_many_senders_have_one_text_a_second_on_a_link(server):
    for number in range(2000):
        station = Station(server, component_id=2 + number % 180)
        station.now_s = 100.0 + number * 0.01
        station.send("MISSION_CLEAR_ALL", mission_type=0)
    assert len(server.events_received()) == 5 + 19


def test_fence_and_rally_points_are_not_supported(server):
    for kind in (1, 2, 255):
        (answer,) = Station(server).list(mission_type=kind)
        assert (answer.type, answer.mission_type) == (UNSUPPORTED, kind)


def test_requests_to_all_components_mean_the_autopilots_mission(server):
    station = Station(server)
    assert station.list(target_component=0) == []
    assert station.send("MISSION_CLEAR_ALL", target_component=0, mission_type=0) == []


@pytest.mark.parametrize(("system_id", "component_id"), [(1, 0), (1, 1), (1, 190), (0, 0), (2, 1)])
def test_what_an_autopilot_may_take_for_its_own_mission_is_not_sent(
    server, system_id, component_id
):
    station = Station(server, component_id, system_id)
    assert station.list() == []
    assert station.send("MISSION_REQUEST_INT", seq=0, mission_type=0) == []
    assert station.send("MISSION_CLEAR_ALL", mission_type=0) == []


def test_the_autopilots_own_messages_are_answers_to_the_companion(server):
    station = Station(server, component_id=1)
    for name in ("MISSION_COUNT", "MISSION_REQUEST_LIST"):
        fields = {"count": 3, "opaque_id": 0} if name == "MISSION_COUNT" else {}
        assert station.send(name, mission_type=1, **fields) == []
    assert server.events_received() == []


def test_more_stations_than_the_limit_begin_again_and_memory_stays(server):
    stations = [Station(server, component_id=number) for number in range(2, 200)]
    for station in stations:
        station.list()
    assert stations[0].item(0).type == INVALID_SEQUENCE
    assert stations[-1].item(0).seq == 0
    assert len(server._downloads) <= 8


@pytest.mark.parametrize("seed", range(3))
def test_a_download_completes_over_a_bad_network_and_is_of_one_path(server, seed):
    """30 % loss, delays up to 0.3 s each way, copies, reordering; a new path each second."""
    rng, station, under_way = Random(seed), Station(server), []
    paths = [path_of(5 + second, latitude_deg=45.0 + second) for second in range(60)]
    count, items, asked_s, answers = None, {}, -1.0, []

    def travel(what):
        copies = [rng.uniform(0.0, 0.3) for _ in range(1 + (rng.random() < 0.2))]
        under_way.extend((station.now_s + late_s, what) for late_s in copies if rng.random() > 0.3)

    for step in range(60 * 50):
        station.now_s += 0.02
        server.offer(paths[step // 50])
        waiting = count is None or len(items) < count.count
        if waiting and station.now_s - asked_s > 0.7:
            asked_s = station.now_s
            travel(("ask", None if count is None else len(items)))
        for item in [item for item in under_way if item[0] <= station.now_s]:
            under_way.remove(item)
            kind, what = item[1]
            if kind == "ask":
                answers = station.list() if what is None else [station.item(what)]
                for answer in answers:
                    travel(("answer", answer))
            elif what.get_type() == "MISSION_COUNT":
                count = count or what
            elif what.get_type() == "MISSION_ITEM_INT" and what.seq == len(items):
                items[what.seq] = what
        if not waiting:
            break
    assert len(items) == count.count
    assert len({item.x // 10**7 for item in items.values()}) == 1
