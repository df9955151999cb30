"""Messages of ArduPilot's onboard log, read from made files."""

from __future__ import annotations

from pathlib import Path

import pytest

from moar_companion.mavlink.dataflash import MAGIC, rows

from ..replay.test_dataflash import definition, entry

FORMATS = definition(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
MODE = definition(130, "MODE", "QB", "TimeUS,ModeNum") + entry(130, "QB", 40_500_000, 4)


def read(path, content, *names):
    path.write_bytes(FORMATS + content)
    return list(rows(str(path), names))


def is_open(path):
    """True if this process has the file open."""
    return path in {each.resolve() for each in Path("/proc/self/fd").iterdir()}


def test_only_the_named_messages_are_read_with_their_seconds_since_boot(tmp_path):
    attitude = definition(131, "ATT", "Qf", "TimeUS,Roll") + entry(131, "Qf", 41_000_000, 1.5)
    assert FORMATS.startswith(MAGIC)
    ((time_s, (name, fields)),) = read(tmp_path / "log.bin", MODE + attitude, "ATT")
    assert (time_s, name, fields["Roll"]) == (41.0, "ATT", 1.5)


def test_messages_without_a_time_have_the_time_of_the_last_one_before_or_of_the_first(tmp_path):
    mode = definition(130, "MODE", "B", "Mode")
    attitude = definition(131, "ATT", "If", "TimeMS,Roll")
    content = [
        entry(130, "B", 4),
        entry(131, "If", 40_000, 1.5),
        entry(130, "B", 9),
        entry(131, "If", 41_000, 1.5),
    ]
    found = read(tmp_path / "log.bin", mode + attitude + b"".join(content), "ATT", "MODE")
    assert [(time_s, name) for time_s, (name, _) in found] == [
        (40.0, "MODE"),
        (40.0, "ATT"),
        (40.0, "MODE"),
        (41.0, "ATT"),
    ]


def test_a_log_without_any_time_begins_about_zero(tmp_path):
    log = definition(130, "MODE", "B", "Mode") + entry(130, "B", 4)
    assert read(tmp_path / "log.bin", log, "MODE")[0][0] < 1.0


def test_a_log_with_a_broken_definition_is_an_error_and_its_file_is_closed(tmp_path):
    path = tmp_path / "broken.bin"
    broken = definition(131, "GPS", "QB", "TimeUS,Status,GMS,GWk") + entry(131, "QB", 1, 3)
    with pytest.raises(IndexError):
        read(path, broken, "GPS")
    assert not is_open(path)
