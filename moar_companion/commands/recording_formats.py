"""Recordings of each format, played: MAVLink (.tlog, .mcap), ArduPilot (.bin) and PX4 (.ulg).

A recording that ends in the middle of a packet is played to its end. One of which nothing is
understood raises InputError with the reason. A ULog is read by pyulog, of the extra `ulog`.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from dataclasses import dataclass
from typing import Any

from ..analysis.replay.dataflash_listener import MESSAGES, DataflashListener
from ..analysis.replay.player import Player, RecordingReader
from ..analysis.replay.site_position import SitePosition
from ..analysis.replay.ulog import UlogListener, samples
from ..analysis.replay.ulog_topics import TOPICS, UlogSample, UlogTopic
from ..errors import InputError
from ..mavlink.dataflash import Row, message_names, rows
from ..mavlink.passive_listener import PassiveListener
from ..mavlink.tlog import Tlog
from ..risk.drag_fit import DragFlight
from ..settings.vehicle import Vehicle
from ..texts.text_format import plural
from .options import require
from .replay_mcap import McapRecording, packets

ULOG = b"ULog\x01\x12\x35"
_ULOG_HEAD_BYTES = 16
_ULOG_DEFINITIONS, _ULOG_DATA = b"BFIMPQ", b"ALCD"
"""Kinds of messages of a ULog's two parts."""
_MOST_NAMES = 6
"""Maximum number of messages or topics that an error names."""


@dataclass(frozen=True, slots=True)
class Flight:
    """What a recording is judged by. site_position, drag: None without."""

    vehicle: Vehicle
    site_position: SitePosition | None = None
    drag: DragFlight | None = None

    def player(self, listener: RecordingReader[Any]) -> Player[Any]:
        """Player of a recording of this flight."""
        return Player(self.vehicle, listener, self.site_position, drag=self.drag)


def tlog_played(path: str, data: bytes, flight: Flight, *, whole: bool) -> Player[bytes]:
    """A .tlog. whole: False if it was unpacked from a file that is cut."""
    tlog = Tlog(data)
    if not tlog.recognised:
        raise InputError(
            path, "", "is no recording, must be a .tlog, .tlog.gz, .mcap, .bin or .ulg"
        )
    playback: Player[bytes] = flight.player(PassiveListener())
    for record in tlog:
        playback.feed(record.time_s, record.packet)
    if tlog.cut_short:
        playback.note("ends in the middle of a packet")
    elif not whole:
        playback.note("ends in the middle of the gzip file")
    if tlog.bad_packets or tlog.skipped_bytes:
        playback.note(
            f"left out: broken packets {tlog.bad_packets}, stray bytes {tlog.skipped_bytes}"
        )
    return _understood(playback, path, _no_heartbeat(playback))


def mcap_played(path: str, flight: Flight) -> Player[bytes]:
    """The packets of an .mcap of this program."""
    recording = McapRecording(path)
    playback: Player[bytes] = flight.player(PassiveListener())
    for time_s, packet in packets(recording):
        playback.feed(time_s, packet)
    if recording.cut_short:
        playback.note("was not closed")
    return _understood(playback, path, _no_heartbeat(playback))


def dataflash_played(path: str, data: bytes, flight: Flight) -> Player[Row]:
    """A .bin of ArduPilot."""
    playback: Player[Row] = flight.player(DataflashListener())
    # pymavlink reads files alone; the input may be packed
    with tempfile.NamedTemporaryFile(suffix=".bin") as file:
        file.write(data)
        file.flush()
        try:
            for time_s, row in rows(file.name, MESSAGES):
                playback.feed(time_s, row)
            found = [] if playback.understood else message_names(file.name)
        except Exception as error:  # any error of pymavlink on a broken file
            raise InputError(path, "", f"is no sound .bin: {error}") from error
    return _understood(playback, path, _none_read("message", MESSAGES, found))


def ulog_played(path: str, data: bytes, flight: Flight) -> Player[UlogSample]:
    """A .ulg of PX4."""
    require(path, "pyulog", "ulog")
    from pyulog import ULog  # noqa: PLC0415

    if not _defines_its_topics(data):
        raise InputError(path, "", "is no sound ULog: its definitions are broken")
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # pyulog prints its errors
            log = ULog(io.BytesIO(data), list(TOPICS))
    except Exception as error:  # any error of pyulog on a broken file
        raise InputError(path, "", f"is no sound ULog: {error}") from error
    playback: Player[UlogSample] = flight.player(UlogListener())
    dated = [
        item
        for item in log.data_list
        if "timestamp" in item.data and item.data["timestamp"].dtype.kind == "u"
    ]
    topics = [
        UlogTopic(
            name=item.name,
            instance=item.multi_id,
            columns={field: column.tolist() for field, column in item.data.items()},
        )
        for item in dated
    ]
    texts = [
        (int(item.timestamp), item.log_level - ord("0"), item.message)
        for item in log.logged_messages
    ]
    for time_s, sample in samples(topics, texts, int(log.start_timestamp)):
        playback.feed(time_s, sample)
    if log.file_corruption or len(dated) < len(log.data_list):
        playback.note("parts of the log are broken, and left out")
    return _understood(playback, path, _none_read("topic", TOPICS, sorted(log.message_formats)))


def _understood(playback: Player[Any], path: str, reason: str) -> Player[Any]:
    """The player; raises InputError with the reason if nothing is known of an aircraft."""
    if not playback.understood:
        raise InputError(path, "", f"tells nothing of an aircraft: {reason}")
    return playback


def _no_heartbeat(playback: Player[bytes]) -> str:
    return f"no heartbeat of an autopilot in {playback.entries} packet{plural(playback.entries)}"


def _none_read(what: str, known: Any, found: list[str]) -> str:
    """Reason of a log with no message (or topic) of those that are known."""
    others = [name for name in found if name not in known]
    shown = ", ".join(others[:_MOST_NAMES]) + (", …" if others[_MOST_NAMES:] else "")
    return f"no {what} that is read" + (f", only {shown}" if shown else "")


def _defines_its_topics(data: bytes) -> bool:
    """Returns True if the definitions of a ULog lead to its data: else pyulog never returns."""
    position = _ULOG_HEAD_BYTES
    while position + 3 <= len(data):
        size, kind = int.from_bytes(data[position : position + 2], "little"), data[position + 2]
        if kind in _ULOG_DATA:
            return True
        if kind not in _ULOG_DEFINITIONS or not size:
            return False
        position += 3 + size
    return False
