"""Faults of the files that the service writes, as reported to operators. Pure.

Inputs: faults from the service, in `Host`. Outputs: texts for operators.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ...mavlink.telemetry import Telemetry

_WORDS = {
    errno.ENOSPC: "disk full",
    errno.EDQUOT: "disk full",
    errno.ENOENT: "folder gone",
    errno.EROFS: "read-only",
    errno.EACCES: "read-only",
    errno.EPERM: "read-only",
    errno.EIO: "I/O error",
}
"""Short words: a STATUSTEXT has room for 50 characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFault:
    """A fault (`no state file: disk full`), and its consequence (`restart goes idle`)."""

    reason: str
    action: str


def words(error: OSError) -> str:
    """Reason of a write error in a text for pilots."""
    return _WORDS.get(error.errno or 0) or f"error {error.errno or 0}"


class FileFaultTexts:
    """Reports each fault after autopilot discovery, again to the first ground station, and its end.

    Before autopilot discovery a text would reach no receiver.
    """

    def __init__(self) -> None:
        self._reported: dict[FileFault, int] = {}
        """Number of kinds of receivers known at each fault's last report."""

    def texts(
        self, faults: Iterable[FileFault], telemetry: Telemetry
    ) -> Iterator[tuple[FileFault, bool]]:
        """Faults to be reported now, each with True if it is over."""
        listeners = (telemetry.autopilot is not None) + (telemetry.ground_station is not None)
        current = tuple(faults)
        for fault in current:
            if self._reported.get(fault, 0) < listeners:
                self._reported[fault] = listeners
                yield fault, False
        for fault in [fault for fault in self._reported if fault not in current]:
            del self._reported[fault]
            yield fault, True
