"""Resources of the computer: disk for recordings, and memory. As Linux reports, in bytes."""

from __future__ import annotations

import contextlib
import shutil
import threading
from pathlib import Path
from typing import NamedTuple

from ..companion.safety.check_inputs import Host

_MEMORY = Path("/proc/meminfo")
_PERIOD_S = 1.0


class Disk(NamedTuple):
    """Space of a disk for non-root users, in bytes; None where unknown."""

    free: float | None = None
    total: float | None = None


class HostMonitor:
    """Reads the free disk space in a thread, each second: a failed disk blocks only that thread.

    recordings: the folder in which flights are recorded, if any.
    """

    def __init__(self, recordings: Path | None) -> None:
        self._disk = Disk()
        self._closing = threading.Event()
        if recordings is not None:
            self._disk = disk_of(recordings)
            threading.Thread(
                target=self._read_loop, args=(recordings,), name="host", daemon=True
            ).start()

    def read(self) -> Host:
        """Resources now; of the disk, the last values. None: not reported by the system."""
        memory: dict[str, float] = {}
        with contextlib.suppress(OSError):
            memory = memory_bytes(_MEMORY.read_text())
        return Host(
            disk_free=self._disk.free,
            disk_total=self._disk.total,
            memory_available=memory.get("MemAvailable"),
            memory_total=memory.get("MemTotal"),
        )

    def close(self) -> None:
        """Ends the reading of the disk."""
        self._closing.set()

    def _read_loop(self, recordings: Path) -> None:
        while not self._closing.wait(_PERIOD_S):
            self._disk = disk_of(recordings)


def disk_of(folder: Path) -> Disk:
    """Space of the disk with a folder; unknown for a missing folder. May wait for the disk."""
    with contextlib.suppress(OSError):
        usage = shutil.disk_usage(folder)
        return Disk(free=float(usage.free), total=float(usage.total))
    return Disk()


def memory_bytes(meminfo: str) -> dict[str, float]:
    """MemAvailable and MemTotal of /proc/meminfo, in bytes, as far as it has them."""
    parts = (line.split() for line in meminfo.splitlines())
    found = {part[0].rstrip(":"): 1024.0 * float(part[1]) for part in parts if len(part) > 1}
    return {name: found[name] for name in ("MemAvailable", "MemTotal") if name in found}
