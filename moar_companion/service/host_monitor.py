"""Free resources of the computer: disk for recordings, and memory. As Linux reports, in bytes."""

from __future__ import annotations

import contextlib
import shutil
import threading
from pathlib import Path

from ..companion.safety.check_inputs import Host

_MEMORY = Path("/proc/meminfo")
_PERIOD_S = 1.0


class HostMonitor:
    """Reads the free disk space in a thread, each second: a failed disk blocks only that thread.

    recordings: the folder in which flights are recorded, if any.
    """

    def __init__(self, recordings: Path | None) -> None:
        self._disk_free: float | None = None
        self._closing = threading.Event()
        if recordings is not None:
            self._disk_free = disk_free(recordings)
            threading.Thread(
                target=self._read_loop, args=(recordings,), name="host", daemon=True
            ).start()

    def read(self) -> Host:
        """Free resources now; of the disk, the last value. None: not reported by the system."""
        memory = None
        with contextlib.suppress(OSError):
            memory = memory_available(_MEMORY.read_text())
        return Host(disk_free=self._disk_free, memory_available=memory)

    def close(self) -> None:
        """Ends the reading of the disk."""
        self._closing.set()

    def _read_loop(self, recordings: Path) -> None:
        while not self._closing.wait(_PERIOD_S):
            self._disk_free = disk_free(recordings)


def disk_free(folder: Path) -> float | None:
    """Free space for non-root users, in bytes; None for a missing folder. May wait for the disk."""
    with contextlib.suppress(OSError):
        return float(shutil.disk_usage(folder).free)
    return None


def memory_available(meminfo: str) -> float | None:
    """MemAvailable of /proc/meminfo, in bytes; None where it is missing."""
    for line in meminfo.splitlines():
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            return 1024.0 * float(value.split()[0])
    return None
