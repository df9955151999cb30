"""The command: compares, renews and makes recorded flights."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from moar_companion.analysis.replay.exact import ANSWERS, ExactReplay
from moar_companion.commands.replay_mcap import McapRecording, replay_exactly
from moar_companion.companion.planning.plan_jobs import answer_job
from moar_companion.service.recording.answers import answer_encoded
from moar_companion.service.recording.calls import call_encoded
from moar_companion.service.recording.flight_log import made_with
from moar_companion.service.recording.schemas import CALLS, CHANNELS, SHAPES, schema
from tests import recordings
from tests.traces.flights import FLIGHTS

FOLDER = Path(__file__).parents[1] / "data" / "recordings"
WHOLE_BYTES = 1 << 30
"""One chunk per file: files are never cut short, and compress best."""

Cycle = tuple[float, list[list[Any]]]


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.mcap"))


def write(path: Path, cycles: Iterable[Cycle]) -> None:
    """A recording of the calls alone. cycles: wall clock, calls."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=WHOLE_BYTES, compression=CompressionType.ZSTD)
        writer.start(library=made_with())
        name = CHANNELS[CALLS]
        number = writer.register_schema(name, "jsonschema", schema(name, SHAPES[name]))
        channel = writer.register_channel(CALLS, "json", number)
        for wall_s, calls in cycles:
            data = json.dumps({"calls": calls}, allow_nan=False, separators=(",", ":")).encode()
            writer.add_message(channel, round(wall_s * 1e6) * 1000, data, 0)
        writer.finish()


def renewed(cycles: Iterable[Cycle]) -> Iterator[Cycle]:
    """The same inputs with new answers.

    A job equal to the recorded one keeps its recorded plan; others get a new plan a cycle later.
    """
    replay = ExactReplay()
    kept: set[tuple[str, int]] = set()
    due: list[list[Any]] = []
    for wall_s, calls in cycles:
        today = []
        for method, data, options, recorded in calls:
            if method == "tick":
                for answered, answer in due:
                    replay.carried_out(answered, [answer], {})
                    today.append([answered, [answer], {}, None])
                due = []
            if method in ANSWERS and (method, data[0]["job_id"]) not in kept:
                continue
            result = replay.carried_out(method, data, options)
            today.append([method, data, options, result])
            for answered, asked in ANSWERS.items():
                if method != asked:
                    continue
                for item in result:
                    job_id = item["job_id"]
                    if item in recorded:
                        kept.add((answered, job_id))
                        continue
                    kept.discard((answered, job_id))
                    assert replay.planners is not None
                    job = replay.jobs[asked][job_id]
                    due.append([answered, answer_encoded(answer_job(replay.planners, job))])
        yield wall_s, today


def flown(story: str) -> Iterator[Cycle]:
    """Calls of a story in lockstep, grouped by cycle."""
    ready, fly = FLIGHTS[story]
    fly(flight := ready())
    calls: list[list[Any]] = []
    for call in flight.calls:
        calls.append(call_encoded(call))
        if call.method == "decisions":
            yield 0.0, calls
            calls = []


def taken(path: str, seconds: float) -> Iterator[Cycle]:
    """The first seconds of a recording."""
    began_s = None
    for wall_s, calls in McapRecording(path).cycles():
        began_s = wall_s if began_s is None else began_s
        if wall_s - began_s > seconds:
            return
        yield wall_s, calls


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.recordings",
        description=recordings.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("do", choices=("compare", "renew", "take", "fly"))
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seconds", type=float, default=1e9)
    given = parser.parse_args(arguments)
    if given.do == "take":
        source, name = given.names
        write(path_of(name), taken(source, given.seconds))
        return 0
    if given.do == "fly":
        for story in given.names:
            write(path_of(story), flown(story))
        return 0
    parted = [name for name in given.names or names() if replay_exactly(str(path_of(name)), None)]
    if given.do == "compare":
        return int(bool(parted))
    for name in parted:
        cycles = list(McapRecording(str(path_of(name))).cycles())
        write(path_of(name), renewed(cycles))
    return 0


def path_of(name: str) -> Path:
    return FOLDER / f"{name}.mcap"
