"""The command: makes traces, or compares with them."""

from __future__ import annotations

import argparse
import fnmatch
import json
import lzma
import multiprocessing
import sys
import time
from functools import partial
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

from moar_companion.analysis.replay.exact import ExactReplay
from moar_companion.service.recording.calls import call_encoded
from tests import traces

from ..flights.lockstep import Lockstep
from .flights import FLIGHTS
from .trace import CHANNELS, Trace, difference, trace_of

FOLDER = Path(__file__).parents[1] / "data" / "traces"
MADE_WITH = {
    "processor": llvmlite.binding.get_host_cpu_name(),
    "python": ".".join(map(str, sys.version_info[:2])),
    "numpy": np.__version__,
    "numba": numba.__version__,
}


def path(name: str) -> Path:
    return FOLDER / f"{name}.json.xz"


def flown(name: str, renamed: dict[str, str], exact: bool) -> tuple[str, Trace, str, int, float]:
    """A flight's name, trace, reason of a failure, number of setpoints, and processor time.

    exact: the flight is also replayed, and a difference counts as a failure.
    """
    began_s, failed = time.process_time(), ""
    ready, fly = FLIGHTS[name]
    flight = ready()
    try:
        fly(flight)
    except AssertionError as error:
        failed = f"not flown to its end: {error}"
    if exact:
        failed = "; ".join(filter(None, (failed, _parted(flight))))
    took_s = time.process_time() - began_s
    return name, trace_of(flight, renamed), failed, len(flight.setpoints), took_s


def _parted(flight: Lockstep) -> str:
    """First difference of the flight's exact replay; empty if there is none."""
    replay = ExactReplay()
    for call in flight.calls:
        for item in replay.feed(json.loads(json.dumps(call_encoded(call), allow_nan=False))):
            values = f"recorded {item.recorded}, recomputed {item.recomputed}"
            return f"replay parts at {item.time_s:.2f} s: {item.what}: {values}"
    return ""


def make(name: str, trace: Trace, failed: str) -> list[str]:
    """Store a trace; returns the reasons if that is impossible."""
    if failed:
        return [failed]
    text = json.dumps({"made_with": MADE_WITH, **trace}, indent=0)
    path(name).write_bytes(lzma.compress(text.encode(), preset=9))
    return []


def compare(name: str, trace: Trace, failed: str) -> list[str]:
    """Differences of a flight from its trace."""
    if not path(name).exists():
        return ["has no trace"]
    then = json.loads(lzma.decompress(path(name).read_bytes()))
    found = [each for channel in CHANNELS if (each := difference(channel, then, trace))]
    if found and then["made_with"] != MADE_WITH:
        found.append(f"made with {then['made_with']}, compared with {MADE_WITH}")
    return [*found, failed] if failed else found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.traces",
        description=traces.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("do", choices=("make", "compare"))
    parser.add_argument("--only", default="*", metavar="PATTERN", help="of flights: 'exit*'")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    parser.add_argument("--renamed", default="", metavar="OLD=NEW,...")
    parser.add_argument("--exact", action="store_true", help="replay each flight exactly, too")
    options = parser.parse_args(arguments)
    names = fnmatch.filter(FLIGHTS, options.only)
    if not names:
        parser.error(f"no flight is named {options.only!r}")
    pairs = [pair.split("=") for pair in options.renamed.split(",") if pair]
    fly = partial(flown, renamed={new: old for old, new in pairs}, exact=options.exact)
    differing, setpoints, spent_s = 0, 0, 0.0
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        for name, trace, failed, count, took_s in pool.imap(fly, names):
            found = (make if options.do == "make" else compare)(name, trace, failed)
            differing, spent_s = differing + bool(found), spent_s + took_s
            setpoints += count
            print("\n  ".join([f"{name}: {took_s:.1f} s", *found]), flush=True)  # noqa: T201
    bad = "not made" if options.do == "make" else "differ"
    flights = f"{len(names)} flights with {setpoints} setpoints"
    print(f"{flights}: {differing} {bad}, {spent_s:.0f} s of processor")  # noqa: T201
    return int(differing > 0)
