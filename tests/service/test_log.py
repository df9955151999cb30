"""The log on stderr: all lines in order; a slow reader delays no caller."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from moar_companion.mavlink.telemetry import AutopilotStatus
from moar_companion.service import background_writer, log
from moar_companion.service.log import AutopilotLog, log_to_stderr
from moar_companion.settings.link_config import LinkConfig
from moar_companion.types import PX4
from tests.stopped import stopped_pipe

logger = logging.getLogger("test")


@pytest.fixture
def pipe():
    """A stalled pipe."""
    return stopped_pipe()


@contextlib.contextmanager
def log_to(descriptor):
    """The log on a stderr of this number; with None, without one."""
    stderr = None if descriptor is None else SimpleNamespace(fileno=lambda: descriptor)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "__stderr__", stderr)
        with log_to_stderr():
            yield


def threads():
    return [item for item in threading.enumerate() if item.name == "log"]


def all_of(pipe):
    """Logged lines, after every writer has ended."""
    pipe.go_on()
    for thread in threads():
        thread.join(20)
    return pipe.rest().decode().splitlines()


@pytest.mark.parametrize("error", [None, RuntimeError, KeyboardInterrupt])
def test_lines_logged_before_the_end_are_written_after_any_error(error, pipe):
    def say():
        with log_to(pipe.writing):
            logger.debug("not reported")
            for number in range(1000):
                logger.info("number %d", number)
            logger.warning("the end")
            pipe.go_on()
            if error is not None:
                raise error

    if error is None:
        say()
    else:
        with pytest.raises(error):
            say()
    assert all_of(pipe) == [
        *(f"INFO number {number}" for number in range(1000)),
        "WARNING the end",
    ]


def test_a_name_that_is_no_text_is_written_all_the_same(pipe):
    with log_to(pipe.writing):
        # Not by a logger: the test processes send logged lines to each other as text.
        logging.getLogger().handlers[-1].stream.write("a\udce9b\n")
        pipe.go_on()
    assert all_of(pipe) == ["a\\udce9b"]


def test_a_pipe_without_a_reader_loses_lines_and_reports_how_many(pipe, monkeypatch):
    monkeypatch.setattr(log, "_MOST_BYTES", 1000)
    with log_to(pipe.writing):
        for number in range(200):
            logger.info("%d", number)
        pipe.go_on()
        for number in range(200, 1000):
            logger.info("%d", number)
            if b"lost" in pipe.data:
                break
            time.sleep(0.01)
    written, lost, expected = all_of(pipe), 0, 0
    for line in written:
        if found := re.fullmatch(
            r"WARNING (\d+) lines are lost here: stderr did not take them", line
        ):
            lost += int(found[1])
            expected += int(found[1])
        else:
            assert line == f"INFO {expected}"
            expected += 1
    assert lost > 50
    assert expected == number + 1


def test_the_end_does_not_wait_for_ever_for_a_reader(pipe, monkeypatch):
    monkeypatch.setattr(background_writer, "_LAST_WRITE_S", 0.1)
    with log_to(pipe.writing):
        logger.info("said")
    assert all_of(pipe) == ["INFO said"]


def test_a_closed_pipe_causes_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    with log_to(writing):
        logger.info("said")
    os.close(writing)
    assert threads() == []


def test_the_former_logging_is_restored_afterwards(pipe):
    root = logging.getLogger()
    before = (root.level, list(root.handlers))
    with log_to(pipe.writing):
        assert (root.level, list(root.handlers)) != before
    assert (root.level, list(root.handlers)) == before


def test_without_a_stderr_nothing_is_written_anywhere(tmp_path):
    """The next opened file has its number, 2: a link, a recording."""
    path, saved = tmp_path / "next", os.dup(2)
    with path.open("wb") as opened:
        os.dup2(opened.fileno(), 2)
    try:
        with log_to(None):
            logger.info("said")
    finally:
        os.dup2(saved, 2)
        os.close(saved)
    assert path.read_bytes() == b""


def test_absence_of_the_autopilot_is_logged_once_and_each_change_of_its_mode(caplog):
    log = AutopilotLog([LinkConfig(url="udp:127.0.0.1:14540")])
    held = AutopilotStatus(
        received_s=9.0, system_id=7, component_id=1, kind=PX4, armed=False,
        custom_mode=0, mode="HOLD", ours=False, homeward=False, multirotor=True, failsafe=False,
    )  # fmt: skip
    with caplog.at_level("INFO"):
        seen_at_once = AutopilotLog([LinkConfig(url="udp:127.0.0.1:14541")])
        for now_s, status in ((1.0, None), (2.0, held), (7.0, None)):
            seen_at_once.update(status, now_s)
        assert len(caplog.records) == 1  # its mode alone
        caplog.clear()
        for now_s in (1.0, 5.9, 6.0, 7.0):
            log.update(None, now_s)
        for status in (held, replace(held, received_s=10.0), replace(held, armed=True)):
            log.update(status, 10.0)
    assert [record.getMessage() for record in caplog.records] == [
        "no autopilot received on udp:127.0.0.1:14540 for 5 s; is it on, and does it send there?",
        "autopilot px4, system 7: HOLD, disarmed",
        "autopilot px4, system 7: HOLD, armed",
    ]
