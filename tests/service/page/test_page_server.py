"""The page's server with real sockets: what each address answers, and to whom."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from moar_companion.errors import InputError
from moar_companion.service.page import page_server
from moar_companion.service.page.live_feed import LiveFeed
from moar_companion.service.page.page_channel import ServiceAnswer
from moar_companion.service.page.page_recordings import PageRecordings
from moar_companion.service.page.page_server import MOST_VIEWERS, PageContent
from tests.service.page.merging import merged
from tests.service.page.serving import PATIENCE_S, TOKEN, served

pytestmark = [pytest.mark.real_time, pytest.mark.slow]

FLIGHT = "flight_20261128T120000.000000Z"
OTHER = "flight_20261127T120000.000000Z"
SITE = {"revision": 3, "site": {"targets": [{"name": "a"}, {"name": "b"}]}, "maps": None}


class Service:
    """The orders that the page has given, and the answers to them."""

    def __init__(self):
        self.orders = []
        self.watched = []
        self.feed = LiveFeed(self.watched.append)
        self.answer = ServiceAnswer(result="ACCEPTED", final=True, reason="")

    async def order(self, word, target):
        self.orders.append((word, target))
        return self.answer


class SlowPlanner:
    """Answers when it may, one after the other."""

    def __init__(self):
        self.may = threading.Event()
        self.asked = []

    def document(self):
        return {"site": {}}

    def answer(self, document):
        if "wrong" in document:
            raise InputError("what-if", "wrong", "is not a known key")
        self.asked.append(document["number"])
        self.may.wait(PATIENCE_S)
        return {"plan": document["number"]}


@pytest.fixture
def service():
    return Service()


@pytest.fixture
def planner():
    return SlowPlanner()


@pytest.fixture
def folder(tmp_path):
    for name in (FLIGHT, OTHER):
        (tmp_path / name).mkdir()
        (tmp_path / name / "flight.mcap").write_bytes(b"mcap of " + name.encode())
        (tmp_path / name / "decisions.jsonl").write_bytes(b"{}\n")
    (tmp_path / FLIGHT / "notes.txt").write_text("a person's")
    (tmp_path / "secret.txt").write_text("secret")
    (tmp_path / FLIGHT / "flight.tlog").symlink_to(tmp_path / "secret.txt")
    return tmp_path


@pytest.fixture
def page(service, planner, folder):
    content = PageContent(
        about={"kind": "service"},
        site=lambda: SITE,
        feed=service.feed,
        order=service.order,
        token=TOKEN,
        recordings=PageRecordings(folder),
        make_what_if=lambda: planner,
        allowed_hosts=frozenset({"drone-1"}),
        tile_url="https://tiles.example/{z}/{x}/{y}.png",
    )
    with served(content) as page:
        yield page


def update(page, service, number=0, **sections):
    status = {"number": number, "plan": None, "recorder": f"/flights/{FLIGHT}"} | sections
    page.call(lambda: service.feed.update(status, time.monotonic(), site_revision=1))


# What is served


def test_the_page_comes_with_headers_that_forbid_all_that_is_not_its_own(page):
    status, headers, content = page.ask("GET", "/")
    assert (status, headers.get_content_type()) == (200, "text/html")
    assert b"<html" in content
    policy = headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "img-src 'self' data: blob: https://tiles.example;" in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    again = page.ask("GET", "/", If_None_Match=headers["ETag"])
    assert (again[0], again[2]) == (304, b"")


def test_the_page_says_what_it_can_and_has_the_site(page):
    status, _, about = page.ask("GET", "/api/page")
    tiles = "https://tiles.example/{z}/{x}/{y}.png"
    values = {"orders": True, "what_if": True, "tile_url": tiles}
    assert (status, about) == (200, {"kind": "service", **values})
    assert page.ask("GET", "/api/site")[2] == SITE


@pytest.mark.parametrize(
    "path",
    [
        *("/static/../page_server.py", "/static/..%2fpage_server.py", "/static/%2e%2e/setup.py"),
        *("/static//etc/passwd", "/static/%2fetc%2fpasswd", "/static/index.html%00.js"),
        *(f"/api/recordings/{FLIGHT}/notes.txt", f"/api/recordings/{FLIGHT}/flight.tlog"),
        *(f"/api/recordings/{FLIGHT}/..%2f..%2fsecret.txt", "/api/recordings/../secret.txt"),
        *("/api/recordings/../flight.mcap", "/api/recordings/%2e%2e/secret.txt"),
        *(f"/api/playback/..%2f{FLIGHT}", "/api/playback/..", "/etc/passwd", "//etc/passwd"),
    ],
)
def test_no_path_leads_to_another_file(page, path):
    status, _, content = page.ask("GET", path)
    assert status == 404
    assert content == {"problem": content["problem"]}


# Who is answered


def test_a_name_that_leads_to_this_computer_has_no_answer_and_no_frames(page, service):
    update(page, service)
    for path in ("/", "/api/site", "/api/recordings"):
        status, _, content = page.ask("GET", path, Host="evil.example")
        assert (status, list(content)) == (421, ["problem"])
    own = socket.create_connection(("127.0.0.1", page.port))
    with pytest.raises(InvalidStatus, match="421"), connect("ws://evil.example/live", sock=own):
        pass
    assert page.ask("GET", "/api/site", Host="drone-1:8195")[0] == 200


def test_a_page_of_another_site_can_neither_act_nor_see(page, service):
    origin = {"Origin": "http://evil.example"}
    order = {"order": "hold"}
    assert page.ask("POST", "/api/order", body=order, token=TOKEN, **origin)[0] == 403
    assert page.ask("DELETE", f"/api/recordings/{FLIGHT}", token=TOKEN, **origin)[0] == 403
    assert page.ask("POST", "/api/what-if", body={}, **origin)[0] == 403
    assert page.ask("GET", "/api/site", Sec_Fetch_Site="cross-site")[0] == 403
    with pytest.raises(InvalidStatus, match="403"), page.viewer(origin="http://evil.example"):
        pass
    assert service.orders == []
    assert service.watched == []
    own = {"Origin": f"http://{page.host}"}
    assert page.ask("POST", "/api/order", body=order, token=TOKEN, **own)[0] == 200


# Orders


def test_an_order_has_the_companions_answer(page, service):
    order = {"order": "inspection", "target": "b"}
    service.answer = ServiceAnswer(result="DENIED", final=True, reason="MOAR: no target")
    status, _, answer = page.ask("POST", "/api/order", body=order, token=TOKEN)
    assert (status, service.orders) == (200, [("inspection", 1)])
    assert answer == {"result": "DENIED", "final": True, "reason": "MOAR: no target"}
    page.ask("POST", "/api/order", body={"order": "exit", "target": 0}, token=TOKEN)
    page.ask("POST", "/api/order", body={"order": "hold"}, token=TOKEN)
    assert service.orders[1:] == [("exit", 0), ("hold", None)]
    service.answer = None
    assert page.ask("POST", "/api/order", body={"order": "hold"}, token=TOKEN)[0] == 503


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"order": "arm"}, 400),
        ({"order": ["hold"]}, 400),
        ({"order": "inspection", "target": "c"}, 400),
        ({"order": "inspection", "target": -1}, 400),
        ({"order": "inspection", "target": True}, 400),
        ({"order": "inspection", "target": 1.5}, 400),
        ({"order": "exit", "target": 70_000}, 400),
        ({}, 400),
        ("", 400),
        ("[]", 400),
        ("{", 400),
        (b"\xff\xfe", 400),
        ("[" * 100_000, 400),
        ('{"order": NaN}', 400),
        (b" " * 300_000, 413),
    ],
)
def test_a_body_that_is_no_order_is_one_line(page, service, body, status):
    answer = page.ask("POST", "/api/order", body=body, token=TOKEN)
    assert (answer[0], list(answer[2])) == (status, ["problem"])
    assert "\n" not in answer[2]["problem"]
    assert service.orders == []


def test_nothing_acts_without_the_token(page, service, folder, monkeypatch):
    monkeypatch.setattr(page_server, "_PAUSE_S", 0.01)
    for token in (None, "", "wrong", TOKEN[:-1], TOKEN + "x"):
        assert page.ask("POST", "/api/order", body={"order": "hold"}, token=token)[0] == 401
        assert page.ask("DELETE", f"/api/recordings/{OTHER}", token=token)[0] == 401
    assert service.orders == []
    assert (folder / OTHER / "flight.mcap").exists()


def test_wrong_tokens_are_tried_one_after_the_other_and_delay_no_right_one(
    page, service, monkeypatch
):
    monkeypatch.setattr(page_server, "_PAUSE_S", PATIENCE_S)
    with ThreadPoolExecutor(4) as threads:
        guesses = [
            threads.submit(page.ask, "POST", "/api/order", body={}, token=f"guess-{number}")
            for number in range(3)
        ]
        assert page.ask("POST", "/api/order", body={"order": "hold"}, token=TOKEN)[0] == 200
        assert not any(guess.done() for guess in guesses)
        page.loop.call_soon_threadsafe(_cancel_waiting)
        for guess in guesses:
            guess.exception(PATIENCE_S)


def _cancel_waiting():
    """Ends the pauses: the tasks of the requests that wait."""
    for task in asyncio.all_tasks():
        if "run_asgi" in repr(task):
            task.cancel()


# Viewers


def test_a_viewer_has_the_whole_state_and_then_its_changes(page, service):
    update(page, service, 1, aircraft={"position_m": [1.0, 0.0, 2.0]})
    with page.viewer() as viewer:
        first = json.loads(viewer.recv(PATIENCE_S))
        assert (first["all"]["number"], first["flown"]) == (1, [[1.0, 0.0, 2.0]])
        update(page, service, 2)
        change = json.loads(viewer.recv(PATIENCE_S))["changed"]
        assert merged(first["all"], change)["number"] == 2
        assert "recorder" not in change
        assert service.watched == [True]
    while service.watched != [True, False]:
        time.sleep(0.01)


def test_a_viewer_that_takes_nothing_loses_frames_and_delays_none(page, service):
    big = ["x" * 50_000]
    update(page, service, 0)
    slow, fast = page.viewer(max_queue=1), page.viewer()
    with slow, fast:
        slow.recv(PATIENCE_S)
        fast.recv(PATIENCE_S)
        for number in range(1, 201):
            update(page, service, number, words=[*big, number])
            state = json.loads(fast.recv(PATIENCE_S))
            assert (state.get("changed") or state["all"])["number"] == number
        seen, number = 0, 0
        while number < 200:
            frame = json.loads(slow.recv(PATIENCE_S))
            number = (frame.get("changed") or frame["all"])["number"]
            seen += 1
        assert "all" in frame
        assert seen < 100


def test_a_viewer_that_takes_nothing_for_long_is_closed(page, service, monkeypatch):
    monkeypatch.setattr(page_server, "_SEND_S", 0.2)
    update(page, service, 0)
    with socket.create_connection(("127.0.0.1", page.port)) as viewer:
        viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        _open_by_hand(viewer, page)
        while not service.watched:
            time.sleep(0.01)
        number = 0
        while service.watched == [True]:
            number += 1
            update(page, service, number, words=["x" * 100_000, number])
            time.sleep(0.01)
    assert service.watched == [True, False]


def test_more_viewers_than_it_serves_are_told_so_and_the_others_go_on(page, service):
    update(page, service, 0)
    viewers = [page.viewer() for _ in range(MOST_VIEWERS)]
    for viewer in viewers:
        viewer.recv(PATIENCE_S)
    with page.viewer() as more, pytest.raises(ConnectionClosed, match="more than"):
        more.recv(PATIENCE_S)
    update(page, service, 1)
    for viewer in viewers:
        assert json.loads(viewer.recv(PATIENCE_S))["changed"] == {"number": 1}
        viewer.close()


@pytest.mark.parametrize(
    "data",
    [
        "a text",
        b"bytes",
        "x" * 2000,
    ],
)
def test_a_viewer_that_sends_is_closed_and_the_next_is_served(page, service, data):
    update(page, service, 0)
    with page.viewer() as viewer:
        viewer.recv(PATIENCE_S)
        viewer.send(data)
        with pytest.raises(ConnectionClosed):
            viewer.recv(PATIENCE_S)
    with page.viewer() as viewer:
        assert json.loads(viewer.recv(PATIENCE_S))["all"]["number"] == 0


@pytest.mark.parametrize(
    "frame",
    [
        b"\xff\xff\xff\xff\xff\xff",  # reserved bits, an unknown opcode
        b"\x81\x05hello",  # not masked
        b"\x81\xff" + (1 << 62).to_bytes(8, "big") + b"mask",  # longer than any memory
        b"\x89\xfe\x01\x00mask" + bytes(256),  # a ping longer than one may be
        b"\x81\x82mask\xff\xff",  # not UTF-8
        b"\x00\x80mask",  # the rest of no message
    ],
)
def test_a_malformed_frame_ends_its_viewer_alone(page, service, frame):
    update(page, service, 0)
    with page.viewer() as other, socket.create_connection(("127.0.0.1", page.port)) as viewer:
        other.recv(PATIENCE_S)
        viewer.settimeout(PATIENCE_S)
        _open_by_hand(viewer, page)
        viewer.sendall(frame)
        while viewer.recv(65_536):
            pass
        update(page, service, 1)
        assert json.loads(other.recv(PATIENCE_S))["changed"] == {"number": 1}


def _open_by_hand(viewer, page):
    viewer.sendall(
        f"GET /live HTTP/1.1\r\nHost: {page.host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    assert viewer.recv(12) == b"HTTP/1.1 101"


@pytest.mark.parametrize(
    "data",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",  # TLS
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 20_000 + b"\r\n",
        b"\0" * 100_000,
    ],
)
def test_what_is_no_request_is_refused_and_the_next_is_answered(page, data):
    with socket.create_connection(("127.0.0.1", page.port)) as client:
        client.settimeout(PATIENCE_S)
        try:
            client.sendall(data)
            while client.recv(65_536):
                pass
        except ConnectionError:
            pass
    assert page.ask("GET", "/api/site")[0] == 200


def test_two_hundred_connections_that_send_nothing_leave_room_for_the_others(page, service, caplog):
    update(page, service, 0)
    with page.viewer() as viewer:
        viewer.recv(PATIENCE_S)
        silent = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(200)]
        update(page, service, 1)
        assert json.loads(viewer.recv(PATIENCE_S))["changed"] == {"number": 1}
        closed = 0
        for client in silent:
            client.settimeout(0.001)
            try:
                closed += client.recv(1) == b""
            except TimeoutError:
                pass
            except ConnectionError:
                closed += 1
        assert closed >= 200 - 128
        for client in silent:
            client.close()
        assert page.ask("GET", "/api/site")[0] == 200
        update(page, service, 2)
        assert json.loads(viewer.recv(PATIENCE_S))["changed"] == {"number": 2}
    assert caplog.messages == []


def test_a_connection_without_a_request_is_closed_in_time(page, monkeypatch):
    monkeypatch.setattr("moar_companion.service.page.browser_connection._REQUEST_S", 0.2)
    for sent in (b"", b"GET / HTT", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET"):
        with socket.create_connection(("127.0.0.1", page.port)) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(sent)
            try:
                while client.recv(65_536):
                    pass
            except ConnectionError:
                pass


# Recordings


def test_recordings_are_listed_newest_first_with_what_the_recorder_has_named(page, service):
    update(page, service)
    flights = page.ask("GET", "/api/recordings")[2]["recordings"]
    assert [(item["name"], item["active"]) for item in flights] == [(FLIGHT, True), (OTHER, False)]
    names = [file["name"] for file in flights[0]["files"]]
    assert names == ["decisions.jsonl", "flight.mcap"]
    assert flights[0]["bytes"] == sum(file["bytes"] for file in flights[0]["files"])


def test_a_file_that_the_recorder_removes_meanwhile_is_not_listed(folder, monkeypatch):
    def recorded_until_now(path):
        if path.name == "flight.mcap":
            path.unlink()
        return path.suffix in {".mcap", ".jsonl"}

    recordings = PageRecordings(folder)
    name = "moar_companion.service.page.page_recordings.is_recorded"
    monkeypatch.setattr(name, recorded_until_now)
    files = [[file["name"] for file in flight["files"]] for flight in recordings.flights(None)]
    assert files == [["decisions.jsonl"], ["decisions.jsonl"]]
    monkeypatch.setattr(name, lambda path: not path.unlink())
    assert recordings.remove(OTHER)


def test_a_file_is_downloaded_whole_or_in_part(page):
    path = f"/api/recordings/{OTHER}/flight.mcap"
    content = b"mcap of " + OTHER.encode()
    status, headers, got = page.ask("GET", path)
    assert (status, got) == (200, content)
    assert f'filename="{OTHER}_flight.mcap"' in headers["Content-Disposition"]
    assert page.ask("GET", path, Range="bytes=5-7")[::2] == (206, content[5:8])


def test_a_file_that_grows_is_downloaded_as_it_was(page, folder):
    path = folder / FLIGHT / "flight.mcap"
    content = bytes(20_000_000)
    path.write_bytes(content)
    client = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE_S)
    with contextlib.closing(client):
        client.request("GET", f"/api/recordings/{FLIGHT}/flight.mcap")
        # More than a connection takes before the client reads: the page waits with the rest.
        response = client.getresponse()
        with path.open("ab") as file:
            file.write(bytes(500_000))
        assert response.read() == content


@pytest.mark.parametrize("range_", ["bytes=9-8", "bytes=1000-", "pages=1", "bytes=0-1,3-4"])
def test_odd_parts_of_a_file_are_answered(page, range_):
    path = f"/api/recordings/{OTHER}/flight.mcap"
    assert page.ask("GET", path, Range=range_)[0] in {200, 206, 400, 416}
    assert page.ask("HEAD", path)[::2] == (200, b"")


def test_the_present_flight_is_played_back_as_long_as_it_is(folder):
    opened = []

    class Growing:
        def __init__(self, path):
            opened.append(path)
            self.bytes = path.stat().st_size

        def summary(self):
            return {"duration_s": self.bytes}

        def frames(self, *_):
            return [self.bytes]

    content = PageContent(
        about={}, site=lambda: None, recordings=PageRecordings(folder), open_playback=Growing
    )
    path = folder / FLIGHT / "flight.mcap"
    with served(content) as page:
        for size in (10, 30):
            path.write_bytes(bytes(size))
            played = page.ask("GET", f"/api/playback/{FLIGHT}")[2]
            assert played == {"name": FLIGHT, "duration_s": size}
            frames = page.ask("GET", f"/api/playback/{FLIGHT}/frames?from=0&to=1")[2]
            assert frames == {"frames": [size]}
    assert opened == [path, path]


@pytest.mark.parametrize("query", ["", "from=0", "from=nan&to=1", "from=0&to=nan", "from=x&to=1"])
def test_frames_of_no_time_are_refused_in_one_line(page, query):
    status, _, document = page.ask("GET", f"/api/playback/{OTHER}/frames?{query}")
    assert (status, list(document)) == (400, ["problem"])


def test_a_flight_is_removed_but_neither_the_present_one_nor_a_persons_file(page, service, folder):
    # As long as the present one is unknown, none is.
    assert page.ask("DELETE", f"/api/recordings/{FLIGHT}", token=TOKEN)[0] == 503
    update(page, service)
    assert page.ask("DELETE", f"/api/recordings/{FLIGHT}", token=TOKEN)[0] == 409
    assert page.ask("DELETE", f"/api/recordings/{OTHER}", token=TOKEN)[2] == {"removed": OTHER}
    assert not (folder / OTHER).exists()
    assert page.ask("DELETE", f"/api/recordings/{OTHER}", token=TOKEN)[0] == 404
    update(page, service, recorder=None)
    assert page.ask("DELETE", f"/api/recordings/{FLIGHT}", token=TOKEN)[0] == 200
    assert [path.name for path in sorted((folder / FLIGHT).iterdir())] == [
        "flight.tlog",
        "notes.txt",
    ]
    assert (folder / "secret.txt").exists()


# What-if


def test_a_request_that_a_newer_one_follows_is_not_planned(page, planner):
    with ThreadPoolExecutor(4) as threads:
        first = threads.submit(page.ask, "POST", "/api/what-if", body={"number": 0})
        while not planner.asked:
            time.sleep(0.01)
        waiting = threads.submit(page.ask, "POST", "/api/what-if", body={"number": 1})
        while not _waits(page, 2):
            time.sleep(0.01)
        newest = threads.submit(page.ask, "POST", "/api/what-if", body={"number": 2})
        while not _waits(page, 3):
            time.sleep(0.01)
        planner.may.set()
        assert first.result()[2] == {"plan": 0}
        assert waiting.result()[0] == 429
        assert newest.result()[2] == {"plan": 2}
    assert planner.asked == [0, 2]


def _waits(page, number):
    """True if so many requests are being answered."""
    return (
        page.call(lambda: sum("run_asgi" in repr(task) for task in asyncio.all_tasks())) >= number
    )


def test_what_can_be_changed_is_told_and_a_wrong_change_is_one_line(page, planner):
    planner.may.set()
    assert page.ask("GET", "/api/what-if")[2] == {"site": {}}
    status, _, content = page.ask("POST", "/api/what-if", body={"wrong": 1})
    assert (status, content) == (400, {"problem": "what-if: wrong: is not a known key"})


def test_a_page_without_a_service_has_no_frames_and_takes_no_orders():
    with served(PageContent(about={"kind": "site"}, site=lambda: None)) as page:
        assert page.ask("GET", "/api/page")[2] == {
            "kind": "site",
            "orders": False,
            "what_if": False,
            "tile_url": None,
        }
        status, _, site = page.ask("GET", "/api/site")
        assert (status, site) == (200, None)
        assert page.ask("POST", "/api/order", body={"order": "hold"}, token=TOKEN)[0] == 403
        assert page.ask("DELETE", f"/api/recordings/{FLIGHT}", token=TOKEN)[0] == 403
        assert page.ask("GET", "/api/what-if")[0] == 404
        assert page.ask("GET", "/api/recordings")[2] == {"recordings": []}
        with pytest.raises(InvalidStatus, match="403"), page.viewer():
            pass
