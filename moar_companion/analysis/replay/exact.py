"""Exact replay: the recorded calls on a new machine, and every answer compared. No I/O.

Inputs: recorded calls as `recording.calls.call_encoded` made them. Outputs: differences, each with
the recorded and the recomputed value. Plans are taken as they were recorded. Signed links need the
key, which no recording has.

Floating point is the same on one kind of processor with the same versions of Python, numpy and
numba. With others the last digits of a number may differ.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...companion.companion import Companion
from ...companion.planning.map_jobs import MapAnswer, MapJob, answer_map_job
from ...companion.planning.plan_jobs import PlanAnswer
from ...companion.planning.planner_set import PlannerSet
from ...companion.planning.site_maps import SiteMaps
from ...errors import InputError
from ...mavlink.codec import Codec
from ...mavlink.signing import Signing, SigningKey
from ...planner.planner import Planner
from ...planner.site import Site
from ...service.recording.answers import answer_decoded
from ...service.recording.calls import INPUTS, OUTPUTS, START, Start, arguments_decoded
from ...service.recording.value_codec import encoded
from ...settings.vehicle import Vehicle

_NAMES = {
    "control_to_send": "packet",
    "data_to_send": "packet",
    "decisions": "decision",
    "plan_jobs": "plan job",
    "contingency_jobs": "contingency job",
    "map_jobs": "map job",
    "pose_notes": "pose note",
}
ANSWERS = {
    "plan_answered": "plan_jobs",
    "contingency_answered": "contingency_jobs",
    "maps_answered": "map_jobs",
}
"""Method that takes an answer, and method that requested it."""
_NOTHING = "nothing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One answer that is not as recorded. time_s: of the cycle, on the machine's clock."""

    time_s: float
    what: str
    recorded: str
    recomputed: str


class ExactReplay:
    """A machine with the calls of a recording. key: of the signed links, if it has any."""

    def __init__(self, key: SigningKey | None = None) -> None:
        self._key = key
        self._companion: Companion | None = None
        self._vehicle: Vehicle | None = None
        self.planners: PlannerSet | None = None
        """Planners of the site, for recorded answers."""
        self.jobs: dict[str, dict[int, Any]] = {name: {} for name in ANSWERS.values()}
        """Jobs that wait for their answers, by the requesting method and by number."""
        self.time_s = 0.0
        """Time of the last cycle."""
        self.compared: Counter[str] = Counter()
        """Number of compared answers, by kind."""

    def feed(self, call: list[Any]) -> Iterator[Difference]:
        """Carries out a recorded call; yields the differences of its answers.

        Raises InputError for a call that cannot be carried out.
        """
        method, data, options, recorded = call
        result = self.carried_out(method, data, options)
        if method in OUTPUTS:
            yield from self._compared(_NAMES[method], recorded, result)

    def carried_out(self, method: str, data: list[Any], options: dict[str, Any]) -> Any:
        """The result of a call in a form for JSON, without answers to jobs not requested."""
        if method == START:
            self._start(arguments_decoded(method, data)[0])
            return None
        companion = self._companion
        if companion is None or method not in {*INPUTS, *OUTPUTS}:
            raise InputError("the recording", "", f"has the call {method!r} out of place")
        if method in ANSWERS:
            answer = self._answer(method, data[0])
            if answer is None:
                return None
            arguments: tuple[Any, ...] = (answer,)
        elif method == "take_ground":
            arguments = (self._site_maps(*arguments_decoded(method, data)),)
        else:
            arguments = arguments_decoded(method, data)
        if method in {"tick", "shut_down"}:
            self.time_s = arguments[0]
        result = getattr(companion, method)(*arguments, **options)
        if method in self.jobs:
            self.jobs[method] |= {job.job_id: job for job in result}
        return encoded(result)

    def _start(self, start: Start) -> None:
        signing = None
        if start.signed:
            if self._key is None:
                raise InputError(
                    "the recording", "", "is of signed links: give their --signing-key"
                )
            signing = Signing(
                key=self._key, wall_s=start.wall_s, kept=start.kept, references=start.references
            )
        self._vehicle = start.vehicle
        site_maps = None if start.site is None else self._site_maps(start.site)
        self._companion = Companion(
            start.config,
            start.vehicle,
            site_maps,
            before=start.before,
            signing=signing,
            parameters=start.parameters,
        )

    def _site_maps(self, site: Site) -> SiteMaps:
        """The site with its maps, which are made again; the planner that they come from."""
        assert self._vehicle is not None
        planner = Planner(site, self._vehicle, clock=lambda: 0.0)
        self.planners = PlannerSet(planner)
        return SiteMaps(site=site, maps=planner.maps)

    def _answer(self, method: str, data: dict[str, Any]) -> PlanAnswer | MapAnswer | None:
        """A recorded answer; None for a job not requested this time, which is a difference."""
        job = self.jobs[ANSWERS[method]].pop(data["job_id"], None)
        if job is None or self.planners is None:
            return None
        if isinstance(job, MapJob):
            if not data["made"]:
                return MapAnswer(job_id=job.job_id, site_maps=None)
            return answer_map_job(self.planners, job)
        return answer_decoded(self.planners, job, data)

    def _compared(self, kind: str, was: list[Any], now: list[Any]) -> Iterator[Difference]:
        self.compared[kind] += max(len(was), len(now))
        if was == now:
            return
        pairs = [pair for pair in itertools.zip_longest(was, now) if pair[0] != pair[1]]
        if kind == "packet":
            pairs = [(_packet(before), _packet(after)) for before, after in pairs]
        for before, after in pairs:
            path, one, other = _first_difference("", before, after)
            name = _name(kind, before if before is not None else after)
            yield Difference(
                time_s=self.time_s,
                what=" ".join(filter(None, (name, path))),
                recorded=_words(one),
                recomputed=_words(other),
            )


def _name(kind: str, item: Any) -> str:
    if kind == "decision":
        return f"decision {item['kind']}"
    if kind == "packet":
        return f"packet {item['message']}"
    return f"{kind} {item['job_id']}" if "job_id" in item else kind


def _packet(sent: list[str] | None) -> dict[str, Any] | None:
    """A packet that was sent on a link, by its fields."""
    if sent is None:
        return None
    link, packet = sent
    codec = Codec(system_id=1, component_id=1)
    for message in codec.receive(bytes.fromhex(packet)):
        fields = {name: encoded(value) for name, value in message.to_dict().items()}
        name = fields.pop("mavpackettype")
        return {"message": name, "link": link, **fields, "sequence": message.get_seq(), "": packet}
    return {"message": "of no known kind", "link": link, "": packet}


def _first_difference(path: str, was: Any, now: Any) -> tuple[str, Any, Any]:
    """First difference of two values: the path to it, and both values there."""
    if isinstance(was, dict) and isinstance(now, dict) and was.keys() == now.keys():
        for name in was:
            if was[name] != now[name]:
                deeper = f"{path}.{name}" if path else name
                return _first_difference(deeper, was[name], now[name])
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for index, (one, other) in enumerate(zip(was, now, strict=True)):
            if one != other:
                return _first_difference(f"{path}[{index}]", one, other)
    return path, was, now


def _words(value: Any) -> str:
    """A value as text; a long one without its end."""
    if value is None:
        return _NOTHING
    if isinstance(value, dict):
        value = {name: item for name, item in value.items() if name not in {"", "message"}}
    words = value if isinstance(value, str) else str(value)
    return words if len(words) <= 200 else f"{words[:200]}..."
