"""The view socket, with real sockets: its readers cannot disturb the service."""

import asyncio
import contextlib
import functools
import json
import logging
import os
import resource
import socket
import stat
from pathlib import Path
from unittest.mock import patch

import pytest

from moar_companion.service import status_socket
from moar_companion.service.directories import Directory
from moar_companion.service.status_socket import open_view_socket

PATIENCE_S = 20.0


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setattr(status_socket, "PERIOD_S", 0.005)
    # A socket's path may not be long, and pytest's are.
    monkeypatch.chdir(tmp_path)
    return Path("view.sock")


@pytest.fixture
def taken(path):
    """A file that is no socket, at the path of the socket."""
    file = Path("file")
    file.write_text("kept")
    return file


def run(test):
    @functools.wraps(test)
    def wrapper(*arguments, **named):
        asyncio.run(asyncio.wait_for(test(*arguments, **named), PATIENCE_S))

    return wrapper


class Status:
    """Counts how often it was asked for."""

    def __init__(self, size=0):
        self.count = 0
        self.padding = "x" * size

    def __call__(self):
        self.count += 1
        return {"count": self.count, "padding": self.padding}


@contextlib.asynccontextmanager
async def reader(path):
    stream, writer = await asyncio.open_unix_connection(path)
    try:
        yield stream, writer
    finally:
        writer.close()


async def line(stream):
    return json.loads(await stream.readline())


def permissions(path):
    return stat.S_IMODE(path.stat().st_mode) if path.exists() else None


async def read_on(stream, lines):
    """Reads some lines and returns the last. One line comes in each period, as from a clock."""
    return [await line(stream) for _ in range(lines)][-1]


@run
async def test_every_reader_gets_whole_lines_of_json(path):
    async with open_view_socket(path, Status()), reader(path) as (one, _), reader(path) as (two, _):
        for stream in (one, two):
            counts = [(await line(stream))["count"] for _ in range(3)]
            assert counts == sorted(set(counts))


@run
async def test_the_status_is_made_only_while_readers_are_connected(path):
    status, clock = Status(), Path("clock.sock")
    async with (
        open_view_socket(clock, Status()),
        open_view_socket(path, status),
        reader(clock) as (ticking, _),
    ):
        await read_on(ticking, 5)
        assert status.count == 0
        async with reader(path) as (stream, _):
            await read_on(stream, 3)
        await read_on(ticking, 5)
        before = status.count
        await read_on(ticking, 5)
        assert status.count == before >= 3


@run
async def test_data_from_a_client_is_not_read_and_does_no_harm(path):
    async with (
        open_view_socket(path, Status()),
        reader(path) as (talking, writer),
        reader(path) as (quiet, _),
    ):
        writer.write(b'{"command": "land"}\n' * 100_000)
        await line(talking)
        first = await line(quiet)
        assert (await line(quiet))["count"] > first["count"]
        assert writer.transport.get_write_buffer_size() > 0


@run
async def test_a_reader_that_does_not_read_neither_delays_nor_fills_the_memory(path):
    status = Status(size=100_000)
    async with open_view_socket(path, status):
        with socket.socket(socket.AF_UNIX) as stuck:
            stuck.connect(str(path))
            async with reader(path) as (stream, _):
                stream._limit = 1 << 20
                last = await read_on(stream, 200)
                assert last["count"] >= 200
            # Twenty megabytes were sent. Only the kernel's buffer and one line wait.
            stuck.setblocking(False)
            waiting = 0
            with contextlib.suppress(BlockingIOError):
                while data := stuck.recv(1 << 20):
                    waiting += len(data)
            assert waiting < 2_000_000


@run
async def test_readers_beyond_the_limit_are_refused(path, monkeypatch):
    monkeypatch.setattr(status_socket, "_MOST_READERS", 1)
    async with open_view_socket(path, Status()), reader(path) as (stream, _):
        await line(stream)
        async with reader(path) as (late, _):
            assert await late.read() == b""
        await line(stream)


def opened_descriptors():
    return [int(item.name) for item in Path("/proc/self/fd").iterdir()]


@pytest.fixture
def few_descriptors():
    """Leaves room for so many more files, and for those that fill gaps among the open ones."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)

    def restrict(more):
        opened = max(opened_descriptors())
        resource.setrlimit(resource.RLIMIT_NOFILE, (opened + 1 + more, before[1]))

    yield restrict
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


@run
async def test_fifty_readers_leave_descriptors_to_links_and_files_and_cost_one_line(path, caplog):
    """As with `ulimit -n 32`: no storm in the log, and the flight goes on."""
    caplog.set_level(logging.WARNING)
    with patch.object(status_socket, "_most_readers", lambda: 4):
        async with open_view_socket(path, Status()), contextlib.AsyncExitStack() as stack:
            streams = []
            for _ in range(50):
                stream, _ = await stack.enter_async_context(reader(path))
                streams.append(stream)
            served = [stream for stream in streams if await stream.readline()]
            assert len(served) == 4
    (record,) = caplog.records
    assert record.message == "view on view.sock: more than 4 readers are refused"


@run
async def test_the_limit_of_readers_leaves_room_for_links_and_files(path, few_descriptors):
    few_descriptors(20)
    opened = len(opened_descriptors())
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert limit - opened - status_socket._most_readers() >= 12


@run
async def test_without_a_descriptor_readers_wait_and_one_line_is_logged(
    path, few_descriptors, caplog, monkeypatch
):
    attempts, five_attempts, listen = [], asyncio.Event(), status_socket._Readers._listen

    def counted(readers):
        attempts.append(readers)
        if len(attempts) == 5:
            five_attempts.set()
        listen(readers)

    monkeypatch.setattr(status_socket._Readers, "_listen", counted)
    monkeypatch.setattr(status_socket, "_RETRY_S", 0.001)
    caplog.set_level(logging.WARNING)
    async with open_view_socket(path, Status()):
        caller = socket.socket(socket.AF_UNIX)
        few_descriptors(1)
        filling = []
        with contextlib.suppress(OSError):
            while True:
                filling.append(os.open(os.devnull, os.O_RDONLY))
        caller.connect(str(path))
        await five_attempts.wait()
        for descriptor in filling:
            os.close(descriptor)
        caller.setblocking(False)
        while not (await asyncio.get_running_loop().sock_recv(caller, 100)):
            pass
        caller.close()
    assert [record.getMessage() for record in caplog.records] == [
        "view on view.sock: no reader accepted: Too many open files"
    ]


@run
async def test_only_members_of_the_group_may_connect(path):
    async with open_view_socket(path, Status()):
        assert permissions(path) == 0o660
    assert permissions(path) is None


@run
async def test_the_socket_file_of_an_ended_service_is_replaced(path):
    with socket.socket(socket.AF_UNIX) as leftover:
        leftover.bind(str(path))
    async with open_view_socket(path, Status()), reader(path) as (stream, _):
        await line(stream)


@run
async def test_the_socket_of_a_running_service_is_not_replaced(path, caplog):
    caplog.set_level(logging.WARNING)
    async with open_view_socket(path, Status()):
        async with open_view_socket(path, Status(size=10)):
            pass
        assert [record.message for record in caplog.records] == [
            "no view: another program serves view.sock"
        ]
        async with reader(path) as (stream, _):
            assert (await line(stream))["padding"] == ""


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("no/such/folder/view.sock", "No such file or directory"),
        ("file", "something else is there"),
        (".", "something else is there"),
        ("x" * 200, "AF_UNIX path too long"),
    ],
    ids=["no folder", "a file", "a folder", "too long"],
)
@run
async def test_a_socket_path_that_cannot_be_used_is_named_in_one_line(taken, name, reason):
    place = Directory(path=taken.parent / name, source="companion.yaml", key="view.socket")
    with pytest.raises(OSError) as caught:  # noqa: PT011 - the next line looks at it
        async with open_view_socket(place.path, Status()):
            pass
    assert str(place.not_free(caught.value)) == (
        f"companion.yaml: view.socket: is {name!r}, must be a free name in a folder that can be "
        f"written: {reason}"
    )
    assert taken.read_text() == "kept"


@run
async def test_a_fault_of_the_view_ends_the_view_alone(path, caplog):
    def broken():
        raise ZeroDivisionError("by nobody")

    async with open_view_socket(path, broken), reader(path) as (stream, _):
        assert await stream.read() == b""
    assert [record.message for record in caplog.records] == [
        "the view ended: ZeroDivisionError: by nobody"
    ]
