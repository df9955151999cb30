"""Resident memory of the process: releases unused memory of pymavlink, glibc and LLVM. Linux.

    before the threads start    limit_arenas: few arenas, large arrays go back to the system
                                release_descriptions: the texts of pymavlink's enums are freed
    once all kernels are loaded release_compiler: LLVM's code and data, and the kernels' bitcode

All save memory only: a call that the system lacks is left out.
"""

from __future__ import annotations

import contextlib
import ctypes
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import MappingProxyType

from ..mavlink.dialect import mavlink
from ..planner.jit import release_bitcode

_ARENA_MAX = -8
_MMAP_THRESHOLD = -3
"""M_ARENA_MAX and M_MMAP_THRESHOLD of mallopt(3)."""
_MOST_ARENAS = 2
"""By default each thread has its own, which reserves 64 MB of address space."""
_LARGE_BYTES = 2**20
"""Size from which arrays (tables, solvers) are mapped one by one. By default glibc raises this
to the largest that was freed, up to 32 MB. The next tables would then be in an arena, and leave
holes."""
_MADV_DONTNEED = 4
_COMPILER = "libllvmlite.so"
_MAPPING = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S+) .*?(\S*)$")
_SMAPS = Path("/proc/self/smaps")
_NO_TEXTS: MappingProxyType[int, str] = MappingProxyType({})


def limit_arenas() -> None:
    """Makes all threads share two arenas of malloc, with large arrays outside of these."""
    with contextlib.suppress(OSError, AttributeError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_ARENA_MAX, _MOST_ARENAS)
        libc.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)


def release_descriptions() -> None:
    """Frees the descriptions of the enum entries (2,362 in pymavlink 2.4.50: 0.7 MB), not names."""
    for enum in mavlink.enums.values():
        for entry in enum.values():
            entry.description, entry.param, entry.label = "", _NO_TEXTS, _NO_TEXTS


def release_compiler() -> None:
    """Frees what loading the kernels has left: bitcode, LLVM's pages, free memory of malloc.

    LLVM's pages are the file's, never written: a page that is used after all is read again.
    """
    with contextlib.suppress(AttributeError):  # another numba may keep it elsewhere
        release_bitcode()
    with contextlib.suppress(OSError, AttributeError):
        libc = ctypes.CDLL(None)
        for first, last in unwritten(_SMAPS.read_text().splitlines(), _COMPILER):
            size = ctypes.c_size_t(last - first)
            libc.madvise(ctypes.c_void_p(first), size, _MADV_DONTNEED)
        libc.malloc_trim(0)


def unwritten(smaps: Iterable[str], name: str) -> Iterator[tuple[int, int]]:
    """First and last address + 1 of a file's mappings that are not writable and not written.

    smaps: lines of /proc/PID/smaps, proc_pid_smaps(5). What relocation wrote before the mapping
    was protected is anonymous memory, in RAM or swapped, and has no copy in the file.
    """
    first = last = 0
    pending = False
    for line in smaps:
        mapping = _MAPPING.match(line)
        if mapping is not None:
            first, last = int(mapping[1], 16), int(mapping[2], 16)
            pending = "w" not in mapping[3] and mapping[4].rpartition("/")[2] == name
            continue
        key, _, value = line.partition(":")
        if key in {"Anonymous", "Swap"} and value.split()[0] != "0":
            pending = False
        if key == "VmFlags" and pending:
            yield first, last
