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
    """Yields messages of these names: seconds since boot, name and fields.

    Messages without a time in microseconds, of firmware before 2014, are left out. Raises any error
    of pymavlink on a broken file. Output of pymavlink between two messages is dropped.
    """
    quiet = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
    with quiet[0], quiet[1], contextlib.closing(_Log(path)) as log:
        while (message := log.recv_match(type=list(names))) is not None:
            fields = message.to_dict()
            stamp_us = fields.get("TimeUS")
            if isinstance(stamp_us, int):
                yield stamp_us * 1e-6, (message.get_type(), fields)


class _Log(DFReader_binary):  # type: ignore[misc]
    """A log that also closes its file when pymavlink finds it broken."""

    def __init__(self, path: str) -> None:
        try:
            super().__init__(path)
        except BaseException:
            self.close()
            raise
