"""Recordings for the page: their time line, and frames in the form of live ones.

An .mcap has the statuses of the flight. It is read once, for events and for the places of its
chunks; frames are then read from the chunks of their time, so that memory does not grow with the
flight. Other recordings are replayed: what they tell is the aircraft, its risks and its events.
"""

from __future__ import annotations

import bisect
import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from ..errors import InputError
from ..service.page.live_state import LiveState
from ..service.recording.calls import START, arguments_decoded
from ..service.recording.schemas import CALLS, STATUS
from ..settings.input_file import open_file, unreadable
from .replay_mcap import parts_of

if TYPE_CHECKING:
    from ..analysis.replay.replay_report import Replay, ReplaySample
    from ..planner.site import Site
    from ..settings.vehicle import Vehicle

_FLOWN_PERIOD_S = 1.0
_LONGEST_S = 120.0
"""Of one answer with frames: some megabytes."""
_LOOK_BACK_S = 1.0
"""Statuses are 0.5 s apart: within this there is the one before a time."""

_OTHER_FORM = (AttributeError, LookupError, TypeError, ValueError)
"""Errors on a message that another version has recorded: it is left out, the others are played."""

Frames = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """A chunk: its part, its offset there, and the wall clock of its first and last message."""

    path: Path
    offset: int
    first_s: float
    last_s: float


class McapPlayback:
    """An .mcap of this program, with its further parts. Raises InputError for another file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._topics: dict[Path, dict[int, str]] = {}
        self._chunks: list[_Place] = []
        self._events: Frames = []
        self._flown: list[list[float]] = []
        self._plans: list[tuple[float, dict[str, Any]]] = []
        """Time and section of each adopted path."""
        self._site: tuple[Site, Vehicle] | None = None
        self._vehicle: Vehicle | None = None
        for part in parts_of(path):
            self._read(part)
        if not any(CALLS in topics.values() for topics in self._topics.values()):
            raise InputError(str(path), "", f"has no {CALLS}, must be this program's recording")
        self._begin_s = self._chunks[0].first_s
        self._end_s = max(chunk.last_s for chunk in self._chunks)

    @property
    def vehicle(self) -> Vehicle | None:
        """The vehicle that was flown."""
        return self._vehicle

    def summary(self) -> dict[str, Any]:
        """Length, events, and the flown path as (time, x, y, z)."""
        begin_s = self._begin_s
        return {
            "began_s": begin_s,
            "duration_s": self._end_s - begin_s,
            "events": [event | {"time_s": event["time_s"] - begin_s} for event in self._events],
            "flown": [[time_s - begin_s, *place] for time_s, *place in self._flown],
        }

    def frames(self, from_s: float, to_s: float) -> Frames:
        """Frames of a time, at most two minutes; the first is whole, and not after `from_s`."""
        from_s = min(from_s, self._end_s - self._begin_s)
        to_s = min(to_s, from_s + _LONGEST_S)
        low_s, high_s = (self._begin_s + time_s for time_s in (from_s, to_s))
        live = LiveState(slow_period_s=0.0)
        for _, plan in [item for item in self._plans if item[0] <= low_s - _LOOK_BACK_S][-2:]:
            live.update({"plan": plan}, 0.0)
        frames: Frames = []
        for time_s, status in self._statuses(low_s - _LOOK_BACK_S, high_s):
            live.update(status, time_s)
            at_s = time_s - self._begin_s
            if time_s <= low_s or not frames:
                frames = [{"time_s": at_s, "all": live.state}]
            else:
                frames.append({"time_s": at_s, "changed": live.changes})
        return frames

    def site(self) -> dict[str, Any] | None:
        """Site and maps of the flight's begin; None without a site."""
        if self._site is None:
            return None
        from ..planner.maps import build_maps  # noqa: PLC0415
        from ..planner.site_view import maps_view, site_view  # noqa: PLC0415

        site, vehicle = self._site
        maps = maps_view(build_maps(site, vehicle))
        return {"revision": 1, "site": site_view(site), "maps": maps}

    def _read(self, part: Path) -> None:
        """Reads events and places of chunks; of a part that is cut, to its last whole chunk."""
        topics = self._topics[part] = {}
        try:
            with open_file(part) as file:
                offset = file.tell()
                try:
                    for record in StreamReader(file, emit_chunks=True).records:
                        if isinstance(record, Chunk):
                            self._take_chunk(part, offset, record, topics)
                        offset = file.tell()
                except Exception as error:  # any error of mcap on a record that is cut
                    if not self._chunks:
                        raise InputError(str(part), "", f"is no sound .mcap: {error}") from error
        except OSError as error:
            raise InputError(str(part), "", unreadable(error)) from error

    def _take_chunk(self, part: Path, offset: int, chunk: Chunk, topics: dict[int, str]) -> None:
        times_ns = (chunk.message_start_time, chunk.message_end_time)
        first_s, last_s = (time_ns * 1e-9 for time_ns in times_ns)
        self._chunks.append(_Place(path=part, offset=offset, first_s=first_s, last_s=last_s))
        for topic, time_s, content in _messages(chunk, topics):
            with contextlib.suppress(*_OTHER_FORM):
                self._take(topic, time_s, content)

    def _take(self, topic: str, time_s: float, content: bytes) -> None:
        match topic:
            case "/decision":
                self._take_decision(json.loads(content))
            case "/aircraft":
                self._take_aircraft(time_s, json.loads(content))
            case "/plan":
                self._take_plan(time_s, json.loads(content))
            case _ if topic == CALLS and (self._site is None or self._vehicle is None):
                self._take_calls(json.loads(content)["calls"])

    def _take_decision(self, decision: dict[str, Any]) -> None:
        text = _event_text(decision["kind"], decision["data"])
        if text is not None:
            kind = decision["kind"]
            self._events.append({"time_s": decision["time_s"], "kind": kind, "text": text})

    def _take_aircraft(self, time_s: float, aircraft: dict[str, Any]) -> None:
        place = aircraft["position_m"]
        if place is None or (self._flown and time_s < self._flown[-1][0] + _FLOWN_PERIOD_S):
            return
        self._flown.append([time_s, *place])

    def _take_plan(self, time_s: float, plan: dict[str, Any]) -> None:
        if not self._plans or self._plans[-1][1]["paths"] != plan["paths"]:
            self._plans.append((time_s, plan))

    def _take_calls(self, calls: list[list[Any]]) -> None:
        """Vehicle and site: the first of each."""
        for method, data, _, _ in calls:
            if method == START:
                self._vehicle = arguments_decoded(method, data)[0].vehicle
            elif method == "take_ground" and self._vehicle is not None:
                self._site = (arguments_decoded(method, data)[0], self._vehicle)

    def _statuses(self, low_s: float, high_s: float) -> Iterator[tuple[float, dict[str, Any]]]:
        """Statuses between two times; the sections of one have the same time."""
        status: dict[str, Any] = {}
        last_s = None
        for topic, time_s, content in self._between(low_s, high_s):
            name = topic.removeprefix("/")
            if name not in STATUS:
                continue
            if time_s != last_s and last_s is not None and "mission" in status:
                yield last_s, {"time_s": last_s, **status}
                status = {}
            last_s = time_s
            status[name] = json.loads(content)
        if last_s is not None and "mission" in status:
            yield last_s, {"time_s": last_s, **status}

    def _between(self, low_s: float, high_s: float) -> Iterator[tuple[str, float, bytes]]:
        ends_s = [chunk.last_s for chunk in self._chunks]
        for place in self._chunks[bisect.bisect_left(ends_s, low_s) :]:
            if place.first_s > high_s:
                return
            try:
                with open_file(place.path) as file:
                    file.seek(place.offset)
                    chunk = next(StreamReader(file, skip_magic=True, emit_chunks=True).records)
            except OSError as error:  # it was removed meanwhile
                raise InputError(str(place.path), "", unreadable(error)) from error
            assert isinstance(chunk, Chunk)
            for message in _messages(chunk, self._topics[place.path]):
                if low_s <= message[1] <= high_s:
                    yield message


def _messages(chunk: Chunk, topics: dict[int, str]) -> Iterator[tuple[str, float, bytes]]:
    """Topic, wall clock and content of each message; notes the channels in `topics`."""
    for record in breakup_chunk(chunk):
        match record:
            case Channel(id=channel, topic=topic):
                topics[channel] = topic
            case Message(channel_id=channel):
                yield topics.get(channel, ""), record.log_time * 1e-9, record.data


def _event_text(kind: str, data: Mapping[str, Any]) -> str | None:
    """An event for people; None for a decision that is none."""
    match kind:
        case "text":
            return str(data["text"])
        case "state":
            return f"{data['before']} -> {data['state']}"
        case "condition":
            change = f"acts: {data['action']}" if data["began"] else "cleared"
            return f"{data['name']} {change}: {data['reason']}"
        case "plan":
            explanation = data["explanation"]
            return "; ".join(filter(None, (explanation["reason"], explanation["path"])))
        case "order":
            return f"{data['order']}, from system {data['sender']}"
        case "answer":
            return f"{data['verdict']} {data['reason']}".strip()
        case "replan":
            return str(data["reason"])
        case _:
            return None


class ReplayPlayback:
    """A replayed recording. site: what `GET /api/site` answers; None without."""

    def __init__(self, replay: Replay, site: dict[str, Any] | None) -> None:
        self._replay = replay
        self._site = site

    def summary(self) -> dict[str, Any]:
        """Length, events, and the flown path as (time, x, y, z)."""
        replay = self._replay
        return {
            "began_s": None,
            "duration_s": replay.duration_s,
            "events": [
                {"time_s": event.time_s, "kind": event.kind, "text": event.text}
                for event in replay.events
            ],
            "flown": [
                [sample.time_s, *sample.place.position_m]
                for sample in replay.samples
                if sample.place is not None
            ],
        }

    def frames(self, from_s: float, to_s: float) -> Frames:
        """Frames of a time, at most two minutes; the first is whole, and not after `from_s`."""
        from_s = min(from_s, self._replay.duration_s)
        to_s = min(to_s, from_s + _LONGEST_S)
        live = LiveState(slow_period_s=0.0)
        frames: Frames = []
        for sample in self._replay.samples:
            if sample.time_s > to_s:
                break
            if sample.time_s < from_s - _LOOK_BACK_S:
                continue
            live.update(_status(self._replay, sample), sample.time_s)
            if sample.time_s <= from_s or not frames:
                frames = [{"time_s": sample.time_s, "all": live.state}]
            else:
                frames.append({"time_s": sample.time_s, "changed": live.changes})
        return frames

    def site(self) -> dict[str, Any] | None:
        """Site and maps."""
        return self._site


def _status(replay: Replay, sample: ReplaySample) -> dict[str, Any]:
    """A sample as far as it has the values of a status."""
    place = sample.place
    autopilot = {"kind": replay.autopilot, "mode": sample.mode, "armed": sample.armed}
    return {
        "time_s": sample.time_s,
        "autopilot": autopilot,
        "mission": {"state": sample.mission_state},
        "aircraft": None
        if place is None
        else {"position_m": list(place.position_m), "clearance_m": place.clearance_m},
        "risk": {
            name: {
                "value": value,
                "known": value is not None,
                "cause": sample.why[name],
                "words": sample.reasons.get(name),
                "inputs": [],
            }
            for name, value in sample.risk.items()
        },
        "weights": dict(sample.weights) or None,
    }
