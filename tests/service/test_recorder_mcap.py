"""The .mcap of the recorder: parts, room on the disk, and what is left of a killed process."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from moar_companion.service import recorder as recorder_module
from moar_companion.service.recorder import NO_LIMITS, Recorder, RecordingLimits

OFFSET_S = 1_700_000_000.0


class Numbers:
    """A source of an .mcap: a message for each number."""

    library = "test"

    @property
    def channels(self):
        return {"/number": ("Number", b'{"type": "object"}')}

    def latched(self):
        yield "/number", 0, b'{"number": "first"}'

    def messages(self, items, *, last):  # noqa: ARG002 - as of a source
        for number in items:
            yield "/number", number, json.dumps({"number": number}).encode()


def recorder_in(folder, now_s=0.0, **limits):
    given = {name: getattr(NO_LIMITS, name) for name in NO_LIMITS.__slots__}
    return Recorder(
        folder, OFFSET_S, now_s, source=Numbers(), limits=RecordingLimits(**given | limits)
    )


def numbers(path):
    with path.open("rb") as file:
        return [json.loads(item.data)["number"] for *_, item in make_reader(file).iter_messages()]


def wait_for(condition):
    until_s = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.001)


def test_messages_are_in_a_file_that_readers_of_mcap_read(tmp_path):
    recorder = recorder_in(tmp_path)
    for number in range(1, 100):
        recorder.write([], [], number, number)
    recorder.close()
    path = recorder.folder / "flight.mcap"
    assert numbers(path) == ["first", *range(1, 100)]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary.statistics.message_count == 100
    assert [(item.topic, item.message_encoding) for item in summary.channels.values()] == [
        ("/number", "json")
    ]
    assert [item.encoding for item in summary.schemas.values()] == ["jsonschema"]


def test_a_long_recording_has_parts_that_each_begin_with_the_latched_messages(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(recorder_module, "_PERIOD_S", 0.0)
    recorder = recorder_in(tmp_path, part_s=10.0)
    recorder.write([(0.0, b"a")], [(0.0, "text", {})], 1, 10.0)
    wait_for((recorder.folder / "flight-2.mcap").exists)
    recorder.write([(20.0, b"b")], [(20.0, "text", {})], 2, 19.0)
    recorder.close()
    assert [numbers(recorder.folder / name) for name in ("flight.mcap", "flight-2.mcap")] == [
        ["first", 1],
        ["first", 2],
    ]
    names = {path.name for path in recorder.folder.iterdir()}
    assert {"flight-2.tlog", "decisions-2.jsonl"} < names
    assert (recorder.folder / "flight-2.tlog").read_bytes().endswith(b"b")


def test_old_recordings_make_room_and_without_any_the_recording_ends(tmp_path, monkeypatch, caplog):
    old = tmp_path / "flight_20200101T000000.000000Z"
    old.mkdir()
    (old / "flight.tlog").write_bytes(bytes(1000))

    def free_bytes(_):
        return 500.0 if old.exists() else 1500.0

    monkeypatch.setattr(recorder_module, "_free_bytes", free_bytes)
    recorder = recorder_in(tmp_path, floor_bytes=1000.0)
    recorder.write([], [], 1, 1.0)
    recorder.close()
    assert not old.exists()
    assert recorder.ended is None
    recorder = recorder_in(tmp_path, 1.0, floor_bytes=2000.0)
    recorder.write([], [], 1, 1.0)
    recorder.close()
    assert str(recorder.ended.strerror) == "less than 0 MB free"
    assert [item.levelname for item in caplog.records if "ended" in item.message] == ["WARNING"]


def test_an_error_in_the_messages_ends_the_recording_and_not_the_flight(tmp_path, caplog):
    recorder = recorder_in(tmp_path)
    recorder.write([], [], object(), 1.0)
    recorder.close()
    assert "TypeError" in recorder.ended.strerror


KILLED = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.service.test_recorder_mcap import recorder_in
recorder = recorder_in(Path(sys.argv[1]))
number = 0
while True:
    number += 1
    recorder.write([(float(number), bytes(10))], [], time.monotonic_ns(), 0.0)
    time.sleep(0.02)
    if number % 10 == 0:
        print(number, flush=True)
"""


@pytest.mark.slow
def test_a_killed_process_loses_no_more_than_a_second_and_leaves_a_readable_file(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path), Path.cwd()], stdout=subprocess.PIPE
    ) as process:
        for _ in range(12):
            process.stdout.readline()
        process.send_signal(signal.SIGKILL)
        killed_ns = time.monotonic_ns()
    (path,) = tmp_path.glob("flight_*/flight.mcap")
    found = []
    with path.open("rb") as file, contextlib.suppress(EndOfFile):  # it was not closed
        found.extend(
            record.log_time for record in StreamReader(file).records if isinstance(record, Message)
        )
    assert (killed_ns - found[-1]) * 1e-9 < 1.0
    assert found[1:] == sorted(found[1:])
