"""Recording of a long flight: `.venv/bin/python -m tests.benchmarks.recorded [MINUTES] [DIR]`.

The flight of `soak` in lockstep, with a whole recorder: the status twice a second, .tlog,
decisions and .mcap. Prints at the end: the sizes; the processor time of the recorder's thread, and
of the recording in the loop, by the flight's time; and the growth of memory.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from mcap.reader import make_reader

from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.companion.status import LatestDecisions
from moar_companion.service.recorder import NO_LIMITS, Recorder
from moar_companion.service.recording.calls import Call
from moar_companion.service.recording.channels import CycleSampler
from moar_companion.service.recording.flight_log import FlightLog
from moar_companion.settings.config import RecorderSettings
from tests.flights.lockstep import Lockstep
from tests.flights.operator import INSPECTION

from .soak import FORGET_S, MINUTE_S, anonymous_mb, forget

OFFSET_S = 1_700_000_000.0
WARM_S = 600.0


class Recorded:
    """A flight and its recorder. spent_s: processor time of the loop for the recording."""

    def __init__(self, folder: Path) -> None:
        self.flight = Lockstep(vehicle="x500")
        site_maps = SiteMaps(site=self.flight.flown_site, maps=self.flight.planner.maps)
        self.flight.calls.append(Call(method="take_ground", arguments=(site_maps,)))
        shipped = RecorderSettings()
        parts = replace(
            NO_LIMITS, part_bytes=1e6 * shipped.part_mb, part_s=MINUTE_S * shipped.part_min
        )
        self.recorder = Recorder(folder, OFFSET_S, 0.0, source=FlightLog(OFFSET_S), limits=parts)
        self.sampler, self.latest = CycleSampler(), LatestDecisions()
        self.spent_s = 0.0

    def step(self, fly: Callable[[], None]) -> None:
        """A step of the flight, recorded."""
        flight = self.flight
        sent, decided = len(flight.to_autopilot), len(flight.decisions)
        fly()
        began_s, companion, now_s = time.thread_time(), flight.companion, flight.now_s
        decisions, calls = flight.decisions[decided:], list(flight.calls)
        flight.calls.clear()
        self.latest.note(decisions, companion.telemetry.link)
        status = None
        if self.sampler.status_is_due(now_s):
            status = self.latest.status_of(
                companion, now_s, clock_offset_s=OFFSET_S, recorder=self.recorder.folder
            )
        self.recorder.write(
            [*companion.received_packets(), *flight.to_autopilot[sent:]],
            ((item.time_s, item.kind, item.data) for item in decisions),
            self.sampler.cycle(companion, calls, status, now_s),
            now_s,
        )
        self.spent_s += time.thread_time() - began_s

    def thread_s(self) -> float:
        """Processor time of the recorder's thread."""
        thread = self.recorder._writer._thread
        return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))

    def wait(self) -> None:
        writer = self.recorder._writer
        while writer._taken_bytes > writer._written_bytes:
            time.sleep(0.01)


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTE_S
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp())
    recorded = Recorded(folder)
    flight, warm_mb, looked_s = recorded.flight, None, 0.0
    flight.step = partial(recorded.step, flight.step)
    flight.begin(INSPECTION)
    while flight.now_s < minutes * MINUTE_S:
        flight.step()
        if flight.now_s - looked_s < FORGET_S:
            continue
        looked_s = flight.now_s
        recorded.wait()
        forget(flight)
        flight.autopilot.conditions.battery_percent = 80.0
        if flight.state == "holding":
            flight.operator.mission(INSPECTION)
        if warm_mb is None and flight.now_s >= WARM_S:
            warm_mb = anonymous_mb()
    grown_mb = anonymous_mb() - (warm_mb or 0.0)
    thread_s = recorded.thread_s()
    recorded.recorder.close()
    seconds = flight.now_s
    sizes: Counter[str] = Counter()
    messages: Counter[tuple[str, str]] = Counter()
    for path in sorted(recorded.recorder.folder.iterdir()):
        name = path.name.split("-")[0].removesuffix(path.suffix) + path.suffix
        sizes[name] += path.stat().st_size
        if path.suffix == ".mcap":
            messages += counted(path)
    for name, size in sizes.items():
        sys.stdout.write(f"{name}: {size / 1e6:.1f} MB, {size / seconds / 1e3:.1f} kB/s\n")
    share = f"thread {thread_s / seconds:.2%}, loop {recorded.spent_s / seconds:.2%}"
    sys.stdout.write(f"{seconds:.0f} s flown; {share} of one core; memory {grown_mb:+.2f} MB\n")
    for (topic, schema), count in sorted(messages.items()):
        sys.stdout.write(f"{topic}: {schema}, {count}\n")


def counted(path: Path) -> Counter[tuple[str, str]]:
    """Messages of a part by topic and schema."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts: Counter[tuple[str, str]] = Counter()
    for number, count in summary.statistics.channel_message_counts.items():
        channel = summary.channels[number]
        counts[channel.topic, summary.schemas[channel.schema_id].name] = count
    return counts


if __name__ == "__main__":
    main()
