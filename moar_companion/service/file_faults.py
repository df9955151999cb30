"""Faults of the files that the service writes, as operators are told of them. Pure.

The shell hands them in with what the computer has left (`Host`); texts for people come out.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ..types import Telemetry

_WORDS = {
    errno.ENOSPC: "disk full",
    errno.EDQUOT: "disk full",
    errno.ENOENT: "folder gone",
    errno.EROFS: "read-only",
    errno.EACCES: "read-only",
    errno.EPERM: "read-only",
}
"""Of a few letters: a STATUSTEXT has room for 50 characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileFault:
    """What is wrong (`no state file: disk full`), and what follows (`restart goes idle`)."""

    reason: str
    action: str


def words(error: OSError) -> str:
    """Why a file cannot be written, for people."""
    return _WORDS.get(error.errno or 0) or error.strerror or str(error)


class FileFaultTexts:
    """Tells each fault once the autopilot is heard, again to the first ground station, and its end.

    Before the autopilot is heard a text would reach nobody.
    """

    def __init__(self) -> None:
        self._told: dict[FileFault, int] = {}
        """Of how many kinds of listeners were heard then."""

    def texts(
        self, faults: Iterable[FileFault], telemetry: Telemetry
    ) -> Iterator[tuple[FileFault, bool]]:
        """Faults to be told now, each with whether it is over."""
        listeners = (telemetry.autopilot is not None) + (telemetry.ground_station is not None)
        current = tuple(faults)
        for fault in current:
            if self._told.get(fault, 0) < listeners:
                self._told[fault] = listeners
                yield fault, False
        for fault in [fault for fault in self._told if fault not in current]:
            del self._told[fault]
            yield fault, True
