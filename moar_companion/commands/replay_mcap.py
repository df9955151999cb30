"""The .mcap of a flight in `moar-companion replay`: its packets, and the exact replay of its calls.

A recording continues in `flight-2.mcap` and so on beside the named file. An unclosed part, as after
a killed process, is read up to its last whole chunk.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcap.records import Channel, Header, Message
from mcap.stream_reader import StreamReader

from ..errors import InputError
from ..mavlink.codec import Codec
from ..service.recorded_files import part_name
from ..service.recording.calls import arguments_decoded
from ..service.recording.flight_log import made_with
from ..service.recording.schemas import CALLS
from ..settings.input_file import open_file, unreadable
from .outputs import print_text

if TYPE_CHECKING:
    from ..mavlink.signing import SigningKey

MAGIC = b"\x89MCAP0\r\n"
_NUMBER = re.compile(r" \d+\b|(?<=\[)\d+")
"""Numbers of jobs and places in lists, which are counted together."""
_MOST_SHOWN = 10
"""Maximum number of printed differences; the counts include all."""


def parts_of(first: Path) -> Iterator[Path]:
    """Yields the parts of a recording, of which `first` is named."""
    number = 2
    yield first
    while (following := first.with_name(part_name(first.name, number))).exists():
        yield following
        number += 1


class McapRecording:
    """A recording in one .mcap or several parts. path: the first of them."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.made_with = ""
        self.cut_short = False
        """True if a part was not closed; known after its calls were read."""

    def cycles(self) -> Iterator[tuple[float, list[list[Any]]]]:
        """Yields wall clock and calls of each cycle; raises InputError for an unsound file."""
        found = False
        for path in parts_of(Path(self.path)):
            try:
                with open_file(path) as file:
                    for cycle in self._cycles_of(StreamReader(file)):
                        found = True
                        yield cycle
            except OSError as error:
                raise InputError(str(path), "", unreadable(error)) from error
        if not found:
            raise InputError(self.path, "", f"has no {CALLS}, must be this program's recording")

    def _cycles_of(self, reader: StreamReader) -> Iterator[tuple[float, list[list[Any]]]]:
        channels: set[int] = set()
        try:
            for record in reader.records:
                match record:
                    case Header(library=library):
                        self.made_with = self.made_with or library
                    case Channel(id=channel, topic=topic) if topic == CALLS:
                        channels.add(channel)
                    case Message(channel_id=channel) if channel in channels:
                        yield record.log_time * 1e-9, json.loads(record.data)["calls"]
        except Exception as error:  # any error of mcap on a record that is cut
            self.cut_short = True
            if not channels:
                raise InputError(self.path, "", f"is no sound .mcap: {error}") from error


def messages_of(first: Path, topics: AbstractSet[str]) -> Iterator[tuple[str, float, bytes]]:
    """Topic, wall clock and content of the messages of some topics, of all parts of a recording.

    Raises InputError for a file that is no sound `.mcap`; one that is cut ends at the cut.
    """
    for path in parts_of(first):
        channels: dict[int, str] = {}
        try:
            with open_file(path) as file:
                try:
                    for record in StreamReader(file).records:
                        match record:
                            case Channel(id=channel, topic=topic) if topic in topics:
                                channels[channel] = topic
                            case Message(channel_id=channel) if channel in channels:
                                yield channels[channel], record.log_time * 1e-9, record.data
                except Exception as error:  # any error of mcap on a record that is cut
                    if not channels:
                        raise InputError(str(path), "", f"is no sound .mcap: {error}") from error
        except OSError as error:
            raise InputError(str(path), "", unreadable(error)) from error


def packets(recording: McapRecording) -> Iterator[tuple[float, bytes]]:
    """Yields time and packet of both directions, as a .tlog of the flight has them."""
    codecs: dict[Any, Codec] = {}
    for wall_s, calls in recording.cycles():
        for method, data, _, result in calls:
            if method == "take_in":
                arrived, now_s = arguments_decoded(method, data)
                for time_s, link, received, address in arrived:
                    codec = codecs.setdefault(
                        (link, address), Codec(system_id=1, component_id=1, wanted=())
                    )
                    codec.receive(received)
                    for packet in codec.packets:
                        yield wall_s + time_s - now_s, packet
            elif method in {"control_to_send", "data_to_send"}:
                for _, packet in result:
                    yield wall_s, bytes.fromhex(packet)


def replay_exactly(path: str, key: SigningKey | None) -> int:
    """Replays a recording on a new machine and prints differences; 1 if there are any, else 0."""
    from ..analysis.replay.exact import Difference, ExactReplay  # noqa: PLC0415

    recording, replay = McapRecording(path), ExactReplay(key)
    differences: list[Difference] = []
    counts: Counter[str] = Counter()
    cycles = 0
    began_s: float | None = None
    for _, calls in recording.cycles():
        cycles += 1
        for call in calls:
            for difference in replay.feed(call):
                counts[_NUMBER.sub("", difference.what)] += 1
                if len(differences) < _MOST_SHOWN:
                    differences.append(difference)
        began_s = replay.time_s if began_s is None else began_s
    compared = ", ".join(f"{number} {kind}s" for kind, number in replay.compared.items())
    cut = "; not closed, replayed to its last whole second" if recording.cut_short else ""
    print_text(f"{path}: {cycles} cycles, {replay.time_s - (began_s or 0.0):.1f} s{cut}\n")
    print_text(f"  compared: {compared}\n")
    for item in differences:
        print_text(
            f"  {item.time_s - (began_s or 0.0):10.2f} s  {item.what}\n"
            f"      recorded    {item.recorded}\n"
            f"      recomputed  {item.recomputed}\n"
        )
    if counts and recording.made_with != made_with():
        print_text(f"  recorded by {recording.made_with}, recomputed by {made_with()}\n")
    numbers = "; ".join(f"{what}: {number}" for what, number in counts.most_common())
    print_text(f"  {counts.total()} differences: {numbers}\n" if counts else "  no difference\n")
    return int(bool(counts))
