"""What outlives the process: where the mission stood, for the process that is started after it.

Pure: the machine's memory in, the bytes of a file out, and back. `memory_file` has the file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from ..mission.machine import state_words
from ..mission.states import STREAMING, MissionState
from ..mission.values import Task
from ..site import Site
from ..types import Mission


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """Where the mission stands. since_s: when its state began, on the machine's clock."""

    state: MissionState
    since_s: Annotated[float, Field(allow_inf_nan=False)]
    task: Task | None = None
    site: str | None = None
    """The name of the site, which gives the task its meaning."""

    @property
    def streamed(self) -> bool:
        """Whether setpoints were sent."""
        return self.state in STREAMING

    def rest(self, site: Site | None) -> Task | None:
        """What of a flight that was cut short can be flown on a site; None for nothing."""
        task = self.task
        if not self.streamed or task is None or task.done or site is None or site.name != self.site:
            return None
        return task if _fits(task, site) else None

    def words(self, now_s: float) -> str:
        """For people: `flying inspection (to splice-2, begun 12 s ago)`, as in a text."""
        words, to, goal = state_words(self.state, self.task).partition(" to ")
        # Across a step of the host's clock it may have begun in the future.
        begun = "" if self.since_s > now_s else f"begun {now_s - self.since_s:.0f} s ago"
        details = ", ".join(filter(None, (f"{to}{goal}".strip(), begun)))
        return f"{words} ({details})" if details else words


def _fits(task: Task, site: Site) -> bool:
    """Whether a site has what a task names."""
    if task.mission is Mission.INSPECTION:
        return {target.name for target in site.targets}.issuperset(task.stops)
    return 0 <= (task.landing or 0) < len(site.landing_m.get(task.mission, ()))


@dataclass(frozen=True, slots=True, kw_only=True)
class _File:
    """What is in the file; its times are seconds since 1970."""

    version: Literal[1] = 1
    memory: Memory


_FILE = TypeAdapter(_File)


def encoded(memory: Memory, clock_offset_s: float) -> bytes:
    """A memory as JSON. clock_offset_s: wall clock minus the machine's clock."""
    since_s = memory.since_s + clock_offset_s
    return _FILE.dump_json(_File(memory=replace(memory, since_s=since_s)), indent=1)


def decoded(data: bytes, clock_offset_s: float) -> Memory:
    """The memory in a file, on the machine's clock of today; ValueError when it is not one."""
    memory = _FILE.validate_json(data, strict=True).memory
    return replace(memory, since_s=memory.since_s - clock_offset_s)
