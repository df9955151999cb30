"""The page's process: what it gets from the control loop, and that it disturbs no cycle."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import signal
import socket
import threading
from dataclasses import replace
from pathlib import Path
from time import monotonic

import pytest
from websockets.sync.client import connect

from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.errors import InputError, LinkError
from moar_companion.mavlink.commands import CommandResult
from moar_companion.planner.maps import build_maps
from moar_companion.planner.site import Site
from moar_companion.service.page.page_channel import ServiceChannel
from moar_companion.service.page_process import PageProcess, listen, read_token
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.page_config import PageConfig
from moar_companion.settings.vehicle import Vehicle
from tests.mqtt.test_orders import ACCEPTED, USER_1, acknowledgement

SITE_FILE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE_FILE = shipped_configs() / "vehicles" / "x500.yaml"
TOKEN = "a-token-of-the-page"
PATIENCE_S = 30.0


@pytest.fixture
def token_file(tmp_path):
    file = tmp_path / "page.token"
    file.touch(mode=0o600)
    file.write_text(f"{TOKEN}\n")
    return file


@pytest.fixture
def config(token_file):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    page = PageConfig(enabled=True, port=port, token_file=token_file)
    return CompanionConfig(vehicle=VEHICLE_FILE, site=SITE_FILE, page=page)


class Loop:
    """A control loop of which the page alone is run, each 5 ms, with a status that counts."""

    def __init__(self, config):
        vehicle = Vehicle.load(config.vehicle)
        site = Site.load(config.site)
        self.port = config.page.port
        self.page = PageProcess(config, vehicle)
        self.site_maps = SiteMaps(site=site, maps=build_maps(site, vehicle))
        self.cycles = self.statuses = 0
        self.hurries = False
        """True: no pause between cycles, and a status in each."""
        self.packets = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()
        self.page.close()

    def cycle(self):
        self.cycles += 1
        for packet in () if self.page.orders is None else self.page.orders.take():
            self.packets.append(packet)
            self.page.orders.send(acknowledgement(USER_1, ACCEPTED), 0.0, ())
        self.page.exchange(self._status, self.site_maps)

    def _status(self):
        self.statuses += 1
        return {"number": self.statuses, "plan": None, "recorder": None}

    def _run(self):
        while not self._ending.wait(0.0 if self.hurries else 0.005):
            if self.hurries:
                self.page._due_s = 0.0
            self.cycle()

    def viewer(self):
        return connect(f"ws://127.0.0.1:{self.port}/live", open_timeout=PATIENCE_S)

    def ask(self, method, path, body=None):
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        headers = {"Authorization": f"Bearer {TOKEN}"}
        client.request(
            method, path, body=None if body is None else json.dumps(body), headers=headers
        )
        response = client.getresponse()
        content = json.loads(response.read())
        client.close()
        return response.status, content

    def site(self):
        """The site, once the process has it."""
        end_s = monotonic() + PATIENCE_S
        while monotonic() < end_s:
            _, site = self.ask("GET", "/api/site")
            if site is not None:
                return site
        raise AssertionError("no site")


@pytest.fixture
def loop(config):
    with Loop(config) as loop:
        yield loop


def number(viewer):
    """The number of the next status that a viewer has; a frame may be of the silence alone."""
    while True:
        frame = json.loads(viewer.recv(PATIENCE_S))
        status = frame.get("changed") or frame["all"]
        if "number" in status:
            return status["number"]


@pytest.mark.real_time
@pytest.mark.slow
def test_viewers_have_what_the_loop_knows_and_their_orders_reach_it(loop):
    assert loop.site()["site"]["name"] == loop.site_maps.site.name
    with loop.viewer() as viewer:
        numbers = [number(viewer) for _ in range(10)]
        assert numbers == sorted(set(numbers))
    answer = loop.ask("POST", "/api/order", {"order": "inspection", "target": "splice-inner"})
    assert answer == (200, {"result": "ACCEPTED", "final": True, "reason": ""})
    assert len(loop.packets) == 1
    assert loop.ask("GET", "/api/page")[1]["vehicle"]["name"] == "X500"
    assert loop.ask("POST", "/api/what-if", {})[1]["plan"]["status"] == "found"


@pytest.mark.real_time
@pytest.mark.slow
def test_a_page_that_is_killed_is_served_again_with_its_site(loop):
    before = loop.site()
    process = loop.page.process_id
    os.kill(process, signal.SIGKILL)
    # The socket stays open: a browser waits for the new process.
    assert loop.site()["site"] == before["site"]
    assert loop.page.process_id not in {None, process}
    with loop.viewer() as viewer:
        first = number(viewer)
        assert number(viewer) > first


@pytest.mark.real_time
@pytest.mark.slow
def test_a_page_that_takes_nothing_delays_no_cycle_and_goes_on_with_the_newest(loop):
    loop.site()
    with loop.viewer() as viewer:
        viewer.recv(PATIENCE_S)
        os.kill(loop.page.process_id, signal.SIGSTOP)
        loop.hurries = True
        end = loop.cycles + 20_000  # a cycle that waited would never end
        while loop.cycles < end:
            threading.Event().wait(0.01)
        loop.hurries = False
        made = loop.statuses
        os.kill(loop.page.process_id, signal.SIGCONT)
        while number(viewer) <= made:
            pass


def test_a_page_that_is_started_again_takes_no_answer_to_an_order_of_the_one_before():
    async def order_id():
        own, other = socket.socketpair()
        channel = ServiceChannel(own)
        running = asyncio.create_task(channel.run())
        reader, writer = await asyncio.open_connection(sock=other)
        await reader.readuntil(b"site_wanted")
        ordering = asyncio.create_task(channel.order("hold", None))
        await reader.readline()
        line = await reader.readline()
        ordering.cancel()
        writer.close()
        await running  # to the end of the channel
        await writer.wait_closed()
        return json.loads(line)["order"]["order_id"]

    assert asyncio.run(order_id()) != asyncio.run(order_id())


@pytest.mark.real_time
@pytest.mark.slow
def test_the_page_ends_with_the_service(config):
    with Loop(config) as loop:
        loop.site()
        process = loop.page.process_id
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


@pytest.mark.real_time
@pytest.mark.slow
def test_a_fault_of_the_page_ends_the_page_and_no_cycle(loop, caplog):
    loop.site()
    loop._status = broken
    end = loop.cycles + 500
    while loop.cycles < end:
        threading.Event().wait(0.01)
    assert caplog.messages.count("the page ended: RuntimeError: no status") == 1


def broken():
    raise RuntimeError("no status")


def test_without_a_viewer_a_status_a_second_is_made(config, monkeypatch):
    monkeypatch.setattr("moar_companion.service.page_process.ChildProcess", FakeProcess)
    now_s = 100.0
    monkeypatch.setattr("moar_companion.service.page_process.clock_s", lambda: now_s)
    loop = Loop(replace(config, page=replace(config.page, port=free_port())))
    for cycle in range(251):  # 5 s
        now_s = 100.0 + 0.02 * cycle
        loop.cycle()
    assert loop.statuses in {5, 6}
    loop.page._other_end.sendall(b'{"watched": true}\n')
    before = loop.statuses
    for cycle in range(50):
        now_s = 110.0 + 0.02 * cycle
        loop.cycle()
    assert loop.statuses - before >= 11
    loop.page.close()


class FakeProcess:
    """No process: the test has the other end of the channel."""

    def __init__(self, *_):
        self.process_id = None

    def close(self, *channel):
        for item in channel:
            item.close()


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


def test_more_orders_than_a_cycle_takes_are_rejected_for_now(config, monkeypatch):
    monkeypatch.setattr("moar_companion.service.page_process.ChildProcess", FakeProcess)
    page = PageProcess(config, Vehicle.load(VEHICLE_FILE))
    for number in range(10):
        order = {"order_id": str(number), "word": "hold", "target": None}
        page._other_end.sendall(json.dumps({"order": order}).encode() + b"\n")
    page.exchange(dict, None)
    lines = page._other_end.recv(65_536).splitlines()
    answers = [json.loads(line)["answer"] for line in lines if b"answer" in line]
    assert [answer["order_id"] for answer in answers] == ["8", "9"]
    assert {answer["result"] for answer in answers} == {CommandResult.TEMPORARILY_REJECTED.name}
    assert len(page.orders.take()) == 8
    page.close()


def test_a_line_that_a_killed_page_has_begun_ends_nothing(config, monkeypatch):
    monkeypatch.setattr("moar_companion.service.page_process.ChildProcess", FakeProcess)
    page = PageProcess(config, Vehicle.load(VEHICLE_FILE))
    page._other_end.sendall(b'{"order": {"ord\n{"order": {"order_id": "1", ')
    page.exchange(dict, None)
    page._other_end.sendall(b'"word": "hold", "target": null}}\n')
    page.exchange(dict, None)
    assert len(page.orders.take()) == 1
    page.close()


@pytest.mark.parametrize(
    ("word", "target"),
    [("fly", None), (["hold"], None), ("hold", "x"), ("hold", 1.5), ("hold", 10**99), ("hold", -1)],
)
def test_what_is_no_order_reaches_no_link_whatever_the_page_sends(
    config, monkeypatch, word, target
):
    monkeypatch.setattr("moar_companion.service.page_process.ChildProcess", FakeProcess)
    page = PageProcess(config, Vehicle.load(VEHICLE_FILE))
    order = {"order_id": "1", "word": word, "target": target}
    for message in ({"order": order}, {"order": {**order, "word": "hold", "target": 0}}):
        page._other_end.sendall(json.dumps(message).encode() + b"\n")
    page.exchange(dict, None)
    assert len(page.orders.take()) == 1
    page.close()


def test_a_port_in_use_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(LinkError, match=rf"^page on 127.0.0.1:{port}: .*in use"):
            listen("127.0.0.1", port)


@pytest.mark.parametrize(
    ("content", "mode", "problem"),
    [
        (b"short", 0o600, r"holds no token \(5 bytes\), must be 16 to 256"),
        (b"", 0o600, r"holds no token \(0 bytes\)"),
        (b"a token with a space", 0o600, "without spaces"),
        (b"x" * 257, 0o600, r"\(257 bytes\)"),
        (b"x" * 5000, 0o600, r"\(over 4096 bytes\)"),
        (b"\xc3\xa4" * 10, 0o600, "printable"),
        (TOKEN.encode(), 0o640, "open to group or others"),
    ],
)
def test_a_token_that_cannot_be_used_is_one_line_without_it(tmp_path, content, mode, problem):
    file = tmp_path / "token"
    file.write_bytes(content)
    file.chmod(mode)
    with pytest.raises(InputError, match=problem) as caught:
        read_token(PageConfig(enabled=True, token_file=file), "companion.yaml")
    assert str(caught.value).startswith(f"companion.yaml: page.token_file: is {str(file)!r}: ")
    assert TOKEN not in str(caught.value)


def test_the_token_is_the_one_line_of_its_file_or_of_a_credential(token_file, monkeypatch):
    assert read_token(PageConfig(enabled=True, token_file=token_file), "") == TOKEN
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(token_file.parent))
    credential = PageConfig(enabled=True, token_credential=token_file.name)
    assert read_token(credential, "") == TOKEN
    assert read_token(PageConfig(enabled=True), "") is None
    assert Path(token_file).exists()
