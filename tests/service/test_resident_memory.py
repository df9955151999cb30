"""Memory that pymavlink, glibc and LLVM keep without need is released, and nothing else."""

from __future__ import annotations

import pytest

from moar_companion.service.resident_memory import unwritten

from ..processes import output_of

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


RESIDENT = """
from pathlib import Path

def resident_mb(name):
    resident_kb, counted = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if not words[0].endswith(":"):
            counted = words[-1].endswith(name)
        elif counted and words[0] == "Rss:":
            resident_kb += int(words[1])
    return resident_kb / 1024
"""
COMPILER = f"""{RESIDENT}
from moar_companion.planner import search
from moar_companion.service.resident_memory import release_compiler

search.follow.ready
print(resident_mb("libllvmlite.so"))
release_compiler()
print(resident_mb("libllvmlite.so"))
search.backward.ready
"""


def test_the_compiler_leaves_the_memory_and_kernels_still_load():
    before_mb, after_mb = map(float, output_of(COMPILER).split())
    assert before_mb > 30.0
    assert after_mb < 10.0


PAGE = f"""{RESIDENT}
import sys
from moar_companion.commands.page_worker import content_of
from moar_companion.service.page.live_feed import LiveFeed
from moar_companion.settings.config import shipped_configs

class Channel:
    site, feed, order = None, LiveFeed(lambda watched: None), None

setup = {{
    "site": str(shipped_configs() / "sites" / "315kv_double_circuit.yaml"),
    "vehicle": str(shipped_configs() / "vehicles" / "x500.yaml"),
    "margin_m": (1.0, 0.5),
    "about": {{}}, "token": None, "recordings": None, "allowed_hosts": (), "tile_url": None,
}}
plans = content_of(setup, Channel()).make_what_if()
print(resident_mb("libllvmlite.so"), "scipy.sparse" in sys.modules)
answer = plans.answer({{"parts": ["alternatives"]}})
print(len(answer["alternatives"]), "scipy.sparse" in sys.modules)
print(plans.answer({{"parts": ["maps", "baselines"]}})["plan"]["status"])
"""


@pytest.mark.slow
def test_a_page_that_plans_keeps_no_compiler_and_loads_what_its_viewers_ask_for():
    compiler_mb, loaded, count, still, status = output_of(PAGE).split()
    assert float(compiler_mb) < 10.0
    assert (loaded, still, status) == ("False", "False", "found")
    assert int(count) > 1


DESCRIPTIONS = """
from moar_companion.mavlink.dialect import mavlink
from moar_companion.service.resident_memory import release_descriptions

entries = [entry for enum in mavlink.enums.values() for entry in enum.values()]

def described():
    return any(
        any((entry.description, *entry.param.values(), *getattr(entry, "label", {}).values()))
        for entry in entries
    )

names = [entry.name for entry in entries]
print(described())
release_descriptions()
print(described(), names == [entry.name for entry in entries])
"""


def test_enum_entries_keep_their_names_and_lose_their_descriptions():
    assert output_of(DESCRIPTIONS).split() == ["True", "False", "True"]
