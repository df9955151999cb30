"""The planner's threads: one for kernels, maps and plans, one for precomputed tables.

The compiled search does not hold the interpreter lock, so that the loop keeps running. Both threads
start at once, with the priority of the thread that makes the worker.
"""

from __future__ import annotations

import contextlib
import enum
import logging
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial

from ..companion.planning.map_jobs import MapAnswer, MapJob, answer_map_job
from ..companion.planning.plan_jobs import (
    PlanAnswer,
    PlanJob,
    answer_job,
    preparations,
    prepare_for,
)
from ..companion.planning.planner_set import PlannerSet
from ..mavlink.autopilots.failsafe_actions import Failsafes
from ..planner.planner import Planner
from ..texts import pilot_texts
from .compiling import make_ready
from .pools import started_pool
from .resident_memory import release_compiler

_logger = logging.getLogger(__name__)


class Work(enum.Enum):
    """Kind of job that an answer belongs to."""

    PLAN = "plan"
    CONTINGENCY = "contingency plan"
    MAPS = "maps"


class PlannerWorker:
    """Makes the planner ready, then plans for the loop, which never waits for it."""

    def __init__(self) -> None:
        self._planners: PlannerSet | None = None
        self._planning_thread = started_pool("planner")
        self._tables_thread = started_pool("tables")
        self._planning: Future[None] | None = None
        self._failsafes: Failsafes | None = None
        """Failsafes of the tables; None: tables have not been begun."""
        self._tables_failed = False
        self._answers: queue.SimpleQueue[tuple[Work, PlanAnswer | MapAnswer]] = queue.SimpleQueue()
        self._ready: Future[Planner | None] | None = None
        self._progress: tuple[int, int] | None = None
        """Count of compiled kernels and their total, if some had to be compiled."""
        self._reported: tuple[int, int] | None = None
        self._ending = threading.Event()

    def begin(self, make_planner: Callable[[], Planner]) -> None:
        """Starts making the planner."""
        self._ready = self._planning_thread.submit(self._make_ready, make_planner)

    def close(self, *, wait: bool = False) -> None:
        """Ends the threads; drops work that has not begun, unless `wait` is set."""
        self._ending.set()
        for pool in (self._tables_thread, self._planning_thread):
            pool.shutdown(wait=wait, cancel_futures=not wait)

    def new_planner(self) -> Planner | None:
        """Returns the planner once, when it is ready; raises the error of its making."""
        if self._ready is None or not self._ready.done():
            return None
        planner = self._ready.result()
        self._ready = None
        if planner is not None:
            self.take(planner)
        return planner

    def take(self, planner: Planner) -> None:
        """Sets the planner; tables follow the first plan, which would wait for them."""
        self._planners = PlannerSet(planner)

    def new_progress(self) -> tuple[int, int] | None:
        """Returns count and total of compiled kernels when these have changed."""
        progress = self._progress
        if self._ready is None or progress == self._reported:
            return None
        self._reported = progress
        return progress

    def plan(self, job: PlanJob) -> None:
        """Submits a plan; cancels one that has not begun yet.

        Contingency plans are not cancelled: at most one is pending, so a plan waits for one only.
        """
        if self._planning is not None:
            self._planning.cancel()
        self._planning = self._submit(job, Work.PLAN)
        if self._planners is not None:
            self._in_tables_thread(partial(prepare_for, self._planners, job))

    def plan_contingency(self, job: PlanJob) -> None:
        """Submits a contingency plan."""
        self._submit(job, Work.CONTINGENCY)

    def make_maps(self, job: MapJob) -> None:
        """Submits maps with other obstacles; later plans are made on them."""
        if self._planners is not None:
            self._planning_thread.submit(self._make_maps, self._planners, job)

    def answers(self) -> Iterator[tuple[Work, PlanAnswer | MapAnswer]]:
        """Yields the answers since the last call, in the order in which they were made."""
        with contextlib.suppress(queue.Empty):
            while True:
                yield self._answers.get_nowait()

    def _make_ready(self, make_planner: Callable[[], Planner]) -> Planner | None:
        """Runs in the planner's thread: kernels, then maps; None when the service ends."""
        if not make_ready(self._note_progress, self._ending):
            return None
        planner = make_planner()
        self._in_tables_thread(release_compiler)
        return planner

    def _note_progress(self, count: int, of: int) -> None:
        """Runs in the planner's thread."""
        self._progress = count, of

    def _prepare(self) -> None:
        """Submits all precomputation, unless the service ends."""
        if self._planners is not None:
            for prepare in preparations(self._planners.exact):
                self._in_tables_thread(prepare)

    def _in_tables_thread(self, work: Callable[[], None]) -> None:
        """Submits work that no plan waits for; does nothing when the service ends."""
        with contextlib.suppress(RuntimeError):
            self._tables_thread.submit(self._try, work)

    def _try(self, work: Callable[[], None]) -> None:
        """Runs in the tables' thread; logs errors, as plans are found without tables too."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the flight goes on without it
            level = logging.DEBUG if self._tables_failed else logging.WARNING
            self._tables_failed = True
            _logger.log(level, "plans without tables: %s: %s", type(error).__name__, error)

    def _submit(self, job: PlanJob, kind: Work) -> Future[None] | None:
        if self._planners is None:
            return None
        return self._planning_thread.submit(self._answer, self._planners, job, kind)

    def _make_maps(self, planners: PlannerSet, job: MapJob) -> None:
        """Runs in the planner's thread."""
        try:
            answer = answer_map_job(planners, job)
        except Exception as error:  # noqa: BLE001 - the flight goes on with the maps before
            _logger.error("no new maps: %s: %s", type(error).__name__, error)  # noqa: TRY400
            answer = MapAnswer(job_id=job.job_id, site_maps=None)
        self._answers.put((Work.MAPS, answer))

    def _answer(self, planners: PlannerSet, job: PlanJob, kind: Work) -> None:
        """Runs in the planner's thread."""
        try:
            answer = answer_job(planners, job)
        except Exception as error:  # noqa: BLE001 - the flight goes on without this plan
            _logger.error("the planner failed: %s: %s", type(error).__name__, error)  # noqa: TRY400
            reason = pilot_texts.PLANNER_FAILED()
            answer = PlanAnswer(job_id=job.job_id, plan=None, reason=reason, failed=True)
        self._answers.put((kind, answer))
        begun = self._failsafes is not None or kind is Work.PLAN
        if job.failsafes != self._failsafes and begun:
            # Exposed cells cost more in all plans: the tables were dropped, and are made again.
            self._failsafes = job.failsafes
            self._prepare()
