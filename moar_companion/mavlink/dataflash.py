"""ArduPilot's onboard log (.bin): messages with their times, read by pymavlink's DFReader."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Collection, Iterator
from typing import Any

from pymavlink.DFReader import DFReader_binary

MAGIC = b"\xa3\x95\x80"
"""The first message defines FMT, as each message is defined."""

Row = tuple[str, dict[str, Any]]
"""Name of a message, its fields in the units of the log."""


def rows(path: str, names: Collection[str]) -> Iterator[tuple[float, Row]]:
    """Yields messages of these names: seconds of a clock of its own, name and fields.

    Firmware before 3.3 has milliseconds, and messages without a time: these have the time of the
    last one before, or of the first. Raises any error of pymavlink on a broken file. Output of
    pymavlink between two messages is dropped.
    """
    quiet = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
    stamp_s, undated = 0.0, list[Row]()
    with quiet[0], quiet[1], contextlib.closing(_Log(path)) as log:
        while (message := log.recv_match(type=list(names))) is not None:
            # 0: pymavlink knows no time of it
            stamp_s = float(message._timestamp) or stamp_s  # noqa: SLF001
            undated.append((message.get_type(), message.to_dict()))
            if stamp_s:
                yield from ((stamp_s, row) for row in undated)
                undated.clear()
    yield from ((stamp_s, row) for row in undated)


def message_names(path: str) -> list[str]:
    """Names of the messages that a log contains."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.closing(_Log(path)) as log:
        return [name for name, number in log.name_to_id.items() if log.counts[number] > 0]


class _Log(DFReader_binary):  # type: ignore[misc]
    """A log that also closes its file when pymavlink finds it broken."""

    def __init__(self, path: str) -> None:
        try:
            super().__init__(path)
        except BaseException:
            self.close()
            raise
