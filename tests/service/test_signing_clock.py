"""Time stamps stored across restarts: never behind those sent, never too far ahead."""

from __future__ import annotations

import errno
import json
import logging
import os

import pytest

from moar_companion.mavlink.signing import (
    LATEST_TIMESTAMP,
    UNITS_PER_S,
    SigningRefusal,
    link_signings,
    timestamp_at,
)
from moar_companion.service.signing_clock import SigningClock, load_signing
from moar_companion.service.whole_file import WholeFile
from moar_companion.settings.config import CompanionConfig, State
from moar_companion.settings.link_config import KeySource, LinkConfig

from ..mavlink.signed import SECRET, SignedPeer

URL = "udp:127.0.0.1:14540"
EPOCH_S = 1_420_070_400


@pytest.fixture
def config(tmp_path):
    key = tmp_path / "key"
    key.write_bytes(SECRET)
    key.chmod(0o400)
    return CompanionConfig(
        vehicle=tmp_path,
        links=(LinkConfig(url=URL, signed=True),),
        signing=KeySource(key_file=key),
        state=State(directory=tmp_path),
        file=tmp_path / "companion.yaml",
    )


def start(config, *, wall_s):
    """The link of the next process."""
    return link_signings(config.links, load_signing(config, wall_s))[URL]


def keep(folder, *timestamps):
    """A process that has these time stamps, a second apart."""
    clock = SigningClock(folder)
    for timestamp in timestamps:
        clock.keep({URL: timestamp}, {URL: 0})
    clock.close()


def test_the_reference_for_new_senders_is_stored_separately_and_unchanged(config, tmp_path):
    clock = SigningClock(tmp_path)
    clock.keep({URL: 500 * UNITS_PER_S}, {URL: 100 * UNITS_PER_S})
    clock.close()
    link = start(config, wall_s=EPOCH_S + 50.0)
    assert (link.timestamp, link.reference) == (505 * UNITS_PER_S, 100 * UNITS_PER_S)


def test_a_clock_file_without_the_reference_is_used_with_the_wall_clock(config, tmp_path):
    file = {"version": 1, "timestamps": {URL: 500 * UNITS_PER_S}}
    (tmp_path / "signing.json").write_text(json.dumps(file))
    link = start(config, wall_s=EPOCH_S + 50.0)
    assert (link.timestamp, link.reference) == (500 * UNITS_PER_S, 50 * UNITS_PER_S)


YEAR_S = 365 * 86400
NOW_S = 1_800_000_000.0


def test_a_wall_clock_that_was_once_far_in_the_future_is_not_used_for_ever(
    config, tmp_path, caplog
):
    wrong = start(config, wall_s=NOW_S + 60 * YEAR_S)
    clock = SigningClock(tmp_path)
    clock.keep({URL: wrong.timestamp}, {URL: wrong.reference})
    clock.close()
    link = start(config, wall_s=NOW_S)
    assert link.reference == timestamp_at(NOW_S)
    assert link.timestamp > wrong.timestamp  # peers refuse older time stamps than they received
    sender = SignedPeer(timestamp=timestamp_at(NOW_S - 30.0))
    assert link.refusal(sender.ground_heartbeat()) is None
    old = SignedPeer(system_id=2, timestamp=timestamp_at(NOW_S - 90.0))
    assert link.refusal(old.ground_heartbeat()) is SigningRefusal.OLD
    assert "21900.0 days ahead of this computer's clock, not used" in caplog.text


@pytest.mark.parametrize(
    ("wall_s", "reported"),
    [(NOW_S - 2 * YEAR_S, False), (NOW_S - YEAR_S, True), (NOW_S, False)],
)
def test_with_a_clock_that_may_not_be_set_the_stored_time_stamp_is_used(
    config, tmp_path, caplog, wall_s, reported
):
    clock = SigningClock(tmp_path)
    clock.keep({URL: timestamp_at(NOW_S)}, {URL: timestamp_at(NOW_S)})
    clock.close()
    assert start(config, wall_s=wall_s).reference == timestamp_at(NOW_S)
    assert ("where it is right delete the file, and restart" in caplog.text) is reported


def test_a_wall_clock_after_the_last_time_stamp_leaves_room_for_the_next(config):
    link = start(config, wall_s=EPOCH_S + LATEST_TIMESTAMP / UNITS_PER_S + 1.0)
    assert link.next_timestamp() < link.next_timestamp()


def in_file(folder):
    return json.loads((folder / "signing.json").read_text())["timestamps"][URL]


def test_without_a_file_the_wall_clock_counts(config):
    assert start(config, wall_s=EPOCH_S + 10.0).timestamp == 10 * UNITS_PER_S


@pytest.mark.parametrize("wall_s", [0.0, EPOCH_S - 1.0, EPOCH_S + 1.0])
def test_a_computer_without_a_clock_continues_after_the_last_sent_time_stamp(
    config, tmp_path, wall_s
):
    sent = [100 * UNITS_PER_S + second * UNITS_PER_S for second in range(30)]
    for count in range(1, len(sent) + 1):
        (tmp_path / "signing.json").unlink(missing_ok=True)
        keep(tmp_path, *sent[:count])
        after = start(config, wall_s=wall_s).timestamp
        assert sent[count - 1] < after <= sent[count - 1] + 5 * UNITS_PER_S


def test_a_restart_is_not_a_minute_ahead_of_the_clocks_of_its_peers(config, tmp_path):
    """Twenty failed starts, each after 3 s: systemd makes no more."""
    for wall_s in range(EPOCH_S + 1000, EPOCH_S + 1060, 3):
        link = start(config, wall_s=wall_s)
        keep(tmp_path, link.next_timestamp())
    ahead = link.timestamp / UNITS_PER_S - (wall_s - EPOCH_S)
    assert 0.0 < ahead < 50.0


def test_the_clock_file_is_written_every_few_seconds_and_not_more_often(tmp_path, monkeypatch):
    writes = []
    monkeypatch.setattr(WholeFile, "put", lambda _, data: writes.append(data))
    clock = SigningClock(tmp_path)
    for second in range(61):
        clock.keep({URL: second * UNITS_PER_S}, {URL: 0})
    clock.close()
    assert len(writes) == 16


def test_the_time_stamp_of_a_peer_far_ahead_is_stored_at_once(config, tmp_path):
    keep(tmp_path, 1 * UNITS_PER_S, LATEST_TIMESTAMP)
    assert in_file(tmp_path) == LATEST_TIMESTAMP
    assert start(config, wall_s=EPOCH_S + 5.0).timestamp == LATEST_TIMESTAMP


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b'{"version": 2, "timestamps": {}}',
        b'{"version": 1, "timestamps": {"a": -1}}',
        b'{"version": 1, "timestamps": {"a": 281474976710656}}',
        b'{"version": 1, "timestamps": {"a": "1"}}',
    ],
)
def test_an_invalid_clock_file_is_reported_and_not_used(config, tmp_path, content, caplog):
    (tmp_path / "signing.json").write_bytes(content)
    assert start(config, wall_s=EPOCH_S + 5.0).timestamp == 5 * UNITS_PER_S
    assert "no time stamps of this version, not used" in caplog.text


def test_a_disk_write_error_is_reported_once_and_the_old_file_stays(tmp_path, monkeypatch, caplog):
    keep(tmp_path, 1 * UNITS_PER_S)

    def fsync(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fsync)
    for timestamp in (10, 20):
        keep(tmp_path, timestamp * UNITS_PER_S)
    assert in_file(tmp_path) == 6 * UNITS_PER_S
    levels = [record.levelno for record in caplog.records]
    assert levels == [logging.WARNING, logging.WARNING]
    assert "signing.json: not written: No space left on device" in caplog.text
