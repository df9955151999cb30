"""Entries in systemd's journal: fields, and only where stderr is connected to it."""

from __future__ import annotations

import logging
import os
import socket

import pytest

from moar_companion.service import journal
from moar_companion.service.log import log_to_stderr

logger = logging.getLogger("moar.test")


@pytest.fixture
def received(tmp_path, monkeypatch):
    """A socket in place of the journal's."""
    monkeypatch.setattr(journal, "_SOCKET", str(tmp_path / "socket"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "socket"))
        receiver.settimeout(10)
        yield receiver


@pytest.fixture
def stream(tmp_path, monkeypatch):
    """A file in place of stderr, which JOURNAL_STREAM names."""
    with (tmp_path / "stderr").open("wb") as file:
        status = os.fstat(file.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        monkeypatch.setattr("sys.__stderr__", file)
        yield tmp_path / "stderr"


def test_a_record_is_an_entry_with_its_priority_module_and_fields(received, stream):
    with log_to_stderr():
        fields = {"kind": "text", "reason": "wind 12.3 m/s > 10 (of 3 s)"}
        logger.info("MOAR: %s", "wind 12.3 m/s > 10, holding", extra={"fields": fields})
        logger.warning("two\nlines\x1b")
        logger.error("the end")
    entries = [received.recv(4096).decode() for _ in range(3)]
    assert entries[0].splitlines() == [
        "MESSAGE=MOAR: wind 12.3 m/s > 10, holding",
        "PRIORITY=6",
        "SYSLOG_IDENTIFIER=moar-companion",
        "LOGGER=moar.test",
        "MOAR_KIND=text",
        "MOAR_REASON=wind 12.3 m/s > 10 (of 3 s)",
    ]
    assert [entry.splitlines()[1] for entry in entries] == [
        "PRIORITY=6",
        "PRIORITY=4",
        "PRIORITY=3",
    ]
    # A field is one line: a text cannot add another.
    assert len(entries[1].splitlines()) == 4
    assert stream.read_bytes() == b""


@pytest.mark.parametrize("named", ["1:2", None])
def test_another_stderr_than_the_journals_has_lines(named, received, stream, monkeypatch):
    if named is None:
        monkeypatch.delenv("JOURNAL_STREAM")
    else:
        monkeypatch.setenv("JOURNAL_STREAM", named)
    with log_to_stderr():
        logger.info("a line")
    assert stream.read_text() == "INFO a line\n"


def test_without_a_journal_that_answers_stderr_has_the_lines(stream, tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "_SOCKET", str(tmp_path / "nowhere"))
    with log_to_stderr():
        logger.info("a line")
    assert stream.read_text() == "INFO a line\n"


def test_a_journal_that_ends_delays_and_raises_nothing(received, stream):
    with log_to_stderr():
        received.close()
        logger.info("lost")
    assert stream.read_bytes() == b""
