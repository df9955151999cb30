"""What the computer has left: room for recordings, and memory. Linux's word, in bytes."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

from .causes import Host

_MEMORY = Path("/proc/meminfo")


def host(recordings: Path | None) -> Host:
    """What is left now. recordings: the folder in which flights are recorded, if any.

    What the system does not tell is None.
    """
    disk_free = None
    if recordings is not None:
        with contextlib.suppress(OSError):
            disk_free = float(shutil.disk_usage(recordings).free)
    memory = None
    with contextlib.suppress(OSError):
        memory = memory_available(_MEMORY.read_text())
    return Host(disk_free=disk_free, memory_available=memory)


def memory_available(meminfo: str) -> float | None:
    """MemAvailable of /proc/meminfo, in bytes; None where it is not told."""
    for line in meminfo.splitlines():
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            return 1024.0 * float(value.split()[0])
    return None
