"""Mission snapshot: the mission's state, kept for the next process; what of it can be flown.

Pure. `service/snapshot_file` has the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from ..planner.site import Site
from .mission.state_changes import state_words
from .mission.values import MissionStatus, Task
from .mission_states import STREAMING, MissionState


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSnapshot:
    """State of the mission. since_s: when its state began, on the machine's clock."""

    state: MissionState
    since_s: Annotated[float, Field(allow_inf_nan=False)]
    task: Task | None = None
    site: str | None = None
    """Name of the site, which gives the task its meaning."""

    @classmethod
    def of(cls, status: MissionStatus, site: Site | None) -> MissionSnapshot:
        """The snapshot of a status; site: where it is flown."""
        name = None if site is None else site.name
        return cls(state=status.state, since_s=status.since_s, task=status.task, site=name)

    @property
    def streamed(self) -> bool:
        """True if setpoints were sent."""
        return self.state in STREAMING

    def rest(self, site: Site | None) -> Task | None:
        """Rest of a task that can be flown on a site; None if there is none, or a pilot flew."""
        task, overridden = self.task, self.state is MissionState.OVERRIDDEN
        if overridden or task is None or task.done or site is None or site.name != self.site:
            return None
        return task if _fits(task, site) else None

    def words(self, now_s: float) -> str:
        """Text for operators: `flying inspection (to splice-2, begun 12 s ago)`."""
        words, to, goal = state_words(self.state, self.task).partition(" to ")
        # After a step of the host's clock the start may lie in the future.
        begun = "" if self.since_s > now_s else f"begun {now_s - self.since_s:.0f} s ago"
        details = ", ".join(filter(None, (f"{to}{goal}".strip(), begun)))
        return f"{words} ({details})" if details else words


def _fits(task: Task, site: Site) -> bool:
    """True if a site has the targets or landing points that a task names."""
    if task.mission.visits_targets:
        return {target.name for target in site.targets}.issuperset(task.stops)
    return 0 <= (task.landing or 0) < len(site.landing_m.get(task.mission, ()))
