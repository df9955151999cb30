"""Memory that pymavlink, glibc and LLVM keep without need is released, and nothing else."""

from __future__ import annotations

from pathlib import Path

from moar_companion.mavlink.dialect import mavlink
from moar_companion.planner import search
from moar_companion.service.resident_memory import (
    release_compiler,
    release_descriptions,
    unwritten,
)

SMAPS = """\
7f0000000000-7f0000001000 r--p 00000000 fe:00 1 /lib/libllvmlite.so
Anonymous:             0 kB
Swap:                  0 kB
VmFlags: rd mr mw me
7f0000001000-7f0000009000 r-xp 00001000 fe:00 1 /lib/libllvmlite.so
Anonymous:             0 kB
Swap:                  0 kB
VmFlags: rd ex mr mw me
7f0000009000-7f000000a000 r--p 00009000 fe:00 1 /lib/libllvmlite.so
Anonymous:             4 kB
Swap:                  0 kB
VmFlags: rd mr mw me ac
7f000000a000-7f000000b000 r--p 0000a000 fe:00 1 /lib/libllvmlite.so
Anonymous:             0 kB
Swap:                  4 kB
VmFlags: rd mr mw me ac
7f000000b000-7f000000c000 rw-p 0000b000 fe:00 1 /lib/libllvmlite.so
Anonymous:             0 kB
Swap:                  0 kB
VmFlags: rd wr mr mw me ac
7f000000c000-7f000000d000 r-xp 00000000 fe:00 2 /lib/libc.so.6
Anonymous:             0 kB
Swap:                  0 kB
VmFlags: rd ex mr mw me
7f000000d000-7f000000e000 rw-p 00000000 00:00 0
Anonymous:             4 kB
Swap:                  0 kB
VmFlags: rd wr mr mw me ac
"""


def test_only_memory_that_the_file_still_holds_is_released():
    """Not what relocation has written, in RAM or swapped; not other files."""
    assert list(unwritten(SMAPS.splitlines(), "libllvmlite.so")) == [
        (0x7F0000000000, 0x7F0000001000),
        (0x7F0000001000, 0x7F0000009000),
    ]
    assert list(unwritten([], "libllvmlite.so")) == []


def resident_mb(name):
    """Resident size of a file's mappings in this process."""
    resident_kb, counted = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if not words[0].endswith(":"):
            counted = words[-1].endswith(name)
        elif counted and words[0] == "Rss:":
            resident_kb += int(words[1])
    return resident_kb / 1024


def test_the_compiler_leaves_the_memory_and_kernels_still_load_and_run():
    _ = search.follow.entry
    assert resident_mb("libllvmlite.so") > 30.0
    release_compiler()
    assert resident_mb("libllvmlite.so") < 10.0
    _ = search.backward.entry


def texts_of(entry):
    return (entry.description, *entry.param.values(), *getattr(entry, "label", {}).values())


def test_enum_entries_keep_their_names_and_lose_their_descriptions():
    entries = [entry for enum in mavlink.enums.values() for entry in enum.values()]
    saved = [dict(vars(entry)) for entry in entries]
    try:
        assert any(any(texts_of(entry)) for entry in entries)
        release_descriptions()
        assert not any(any(texts_of(entry)) for entry in entries)
        assert [entry.name for entry in entries] == [before["name"] for before in saved]
    finally:
        for entry, before in zip(entries, saved, strict=True):
            vars(entry).update(before)
