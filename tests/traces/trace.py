"""The trace of a flight, and the differences of two traces."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Iterator
from typing import Any

from sitl.wire import packets as cut

from ..flights.campaign import packets

CHANNELS = ("setpoints", "packets", "decisions", "texts")
FREE_TEXTS = ("text", "reason", "detail", "words", "cause", "reading")
"""Keys of decisions."""
MOTION = ("x", "y", "z", "vx", "vy", "vz", "yaw")

Trace = dict[str, dict[str, Any]]


def trace_of(flight, renamed: dict[str, str]) -> Trace:
    """The trace of a flight. renamed: old words by new ones, in decisions and texts."""
    new = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, renamed))})(?![\w-])")

    def old(text: str) -> str:
        return new.sub(lambda found: renamed[found[0]], text) if renamed else text

    trace = {}
    for name in CHANNELS:
        everything, seconds, lines = hashlib.sha256(), {}, {}
        for number, (time_s, exact, line) in enumerate(_HAPPENED[name](flight)):
            second, taken = str(int(time_s + 1e-6)), f"{time_s:.3f} {old(exact)}\n".encode()
            everything.update(taken)
            seconds.setdefault(second, hashlib.sha256()).update(taken)
            if line:  # the last setpoint of each second is kept
                lines[second if name == "setpoints" else number] = [round(time_s, 3), old(line)]
        trace[name] = {
            "all": everything.hexdigest(),
            "seconds": {second: one.hexdigest()[:4] for second, one in seconds.items()},
            "lines": list(lines.values()),
        }
    return trace


def difference(name: str, then: Trace, now: Trace) -> str:
    """First difference of a channel with its time; empty if there is none."""
    was, is_ = then[name], now[name]
    if was["all"] == is_["all"]:
        return ""
    differing = was["seconds"].items() ^ is_["seconds"].items()
    head = f"{name} differ from second {min((int(s) for s, _ in differing), default='?')} on"
    for before, after in itertools.zip_longest(was["lines"], is_["lines"], fillvalue=("end", "")):
        if before != after:
            return (
                f"{head}\n    was at {before[0]} s: {before[1]}\n    is at {after[0]} s: {after[1]}"
            )
    return f"{head}, by less than the lines are rounded to"


def _setpoints(flight) -> Iterator[tuple[float, str, str]]:
    for item in flight.setpoints:
        message = item.message
        line = " ".join(f"{name} {round(getattr(message, name), 2) + 0.0:.2f}" for name in MOTION)
        yield item.time_s, _content(bytes(message.get_msgbuf())), line


def _packets(flight) -> Iterator[tuple[float, str, str]]:
    for time_s, packet, message in _others(flight):
        if message.get_type() != "STATUSTEXT":
            line = str(message) if message.get_type().startswith("COMMAND") else ""
            yield time_s, _content(packet), line


def _decisions(flight) -> Iterator[tuple[float, str, str]]:
    for item in flight.decisions:
        data = _parted(item.data, [])
        line = "" if item.kind == "status" else f"{item.kind} {json.dumps(_shown(data))}"
        yield item.time_s, f"{item.kind} {json.dumps(data, sort_keys=True)}", line


def _texts(flight) -> Iterator[tuple[float, str, str]]:
    texts: list[tuple[float, str, str]] = []
    for time_s, _, message in _others(flight):
        if message.get_type() == "STATUSTEXT":
            line = f"severity {message.severity}: {message.text}"
            texts.append((time_s, f"{line} {message.id} {message.chunk_seq}", line))
    for item in flight.decisions:
        _parted(item.data, words := [])
        texts += [(item.time_s, word, f"{item.kind}: {word}") for word in words]
    yield from sorted(texts, key=lambda each: each[0])


_HAPPENED = dict(zip(CHANNELS, (_setpoints, _packets, _decisions, _texts), strict=True))
"""For each channel, in order of time: the time, the whole entry, and a line of it or nothing."""


def _others(flight):
    """Sent packets other than setpoints: time, packet, message."""
    for time_s, data in flight.to_autopilot:
        for packet in cut(data):
            message = packets.decoded(packet)
            if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
                yield time_s, packet, message


def _content(packet: bytes) -> str:
    """A MAVLink 2 packet without the fields that depend on earlier packets."""
    return (packet[:4] + packet[5 : 10 + packet[1]]).hex()


def _parted(value, words: list[str]):
    """A value without its free texts, which are added to words."""
    if isinstance(value, list | tuple):
        return [_parted(item, words) for item in value]
    if not isinstance(value, dict):
        return value
    words += [str(value[key]) for key in FREE_TEXTS if value.get(key)]
    return {key: _parted(item, words) for key, item in value.items() if key not in FREE_TEXTS}


def _shown(value, depth: int = 3):
    """A value with rounded numbers, without deep or long parts."""
    if isinstance(value, float):
        return round(value, 3) + 0.0
    if isinstance(value, dict):
        return {key: _shown(item, depth - 1) for key, item in value.items()} if depth else "{}"
    if isinstance(value, list | tuple):
        return f"[{len(value)}]" if len(value) > 3 else [_shown(item, depth) for item in value]
    return value
