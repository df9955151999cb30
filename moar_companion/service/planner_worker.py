"""The planner's threads: kernels, maps and plans in one, what is precomputed in the other.

The compiled search does not hold the interpreter, so that the loop goes on meanwhile. Both threads
are made at once, with the priority of who makes the worker.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial

from ..autopilots.failsafe_actions import Failsafes
from ..planner.planner import Planner
from .compiling import make_ready
from .jobs import PlanAnswer, PlanJob, answer_job, preparations, prepare_for
from .planners import Planners
from .pools import started_pool
from .resident_memory import release_compiler

_logger = logging.getLogger(__name__)


class PlannerWorker:
    """Makes the planner ready, and then plans; asked by the loop, which never waits for it."""

    def __init__(self) -> None:
        self._planners: Planners | None = None
        self._planning_thread = started_pool("planner")
        self._tables_thread = started_pool("tables")
        self._planning: Future[None] | None = None
        self._failsafes: Failsafes | None = None
        """Those of the tables; None: these have not been begun."""
        self._tables_failed = False
        self._answers: queue.SimpleQueue[tuple[bool, PlanAnswer]] = queue.SimpleQueue()
        self._ready: Future[Planner | None] | None = None
        self._progress: tuple[int, int] | None = None
        """How many of how many kernels are compiled, where some had to be."""
        self._told: tuple[int, int] | None = None
        self._ending = threading.Event()

    def begin(self, make_planner: Callable[[], Planner]) -> None:
        """Have the planner made."""
        self._ready = self._planning_thread.submit(self._make_ready, make_planner)

    def close(self, *, wait: bool = False) -> None:
        """End; what has not begun is not done any more, unless it is waited for."""
        self._ending.set()
        for pool in (self._tables_thread, self._planning_thread):
            pool.shutdown(wait=wait, cancel_futures=not wait)

    def new_planner(self) -> Planner | None:
        """The planner, once, when it is ready; raises what its making did."""
        if self._ready is None or not self._ready.done():
            return None
        planner = self._ready.result()
        self._ready = None
        if planner is not None:
            self.take(planner)
        return planner

    def take(self, planner: Planner) -> None:
        """Plan with this one; tables are made behind the first plan, which would wait for them."""
        self._planners = Planners(planner)

    def new_progress(self) -> tuple[int, int] | None:
        """How many of how many kernels are compiled, whenever that has changed."""
        progress = self._progress
        if self._ready is None or progress == self._told:
            return None
        self._told = progress
        return progress

    def plan(self, job: PlanJob) -> None:
        """Make a plan; one that has not begun yet is overtaken.

        A contingency is not: of these there is one at a time, which is all that a plan waits for.
        """
        if self._planning is not None:
            self._planning.cancel()
        self._planning = self._submit(job, contingency=False)
        if self._planners is not None:
            self._in_tables_thread(partial(prepare_for, self._planners, job))

    def plan_contingency(self, job: PlanJob) -> None:
        """Make a plan of a way out."""
        self._submit(job, contingency=True)

    def answers(self) -> Iterator[tuple[bool, PlanAnswer]]:
        """Whether a contingency was planned, and its plan, of those made since the last call."""
        with contextlib.suppress(queue.Empty):
            while True:
                yield self._answers.get_nowait()

    def _make_ready(self, make_planner: Callable[[], Planner]) -> Planner | None:
        """In the planner's thread: the kernels, then the maps; None when the service ends."""
        if not make_ready(self._note_progress, self._ending):
            return None
        planner = make_planner()
        self._in_tables_thread(release_compiler)
        return planner

    def _note_progress(self, count: int, of: int) -> None:
        """In the planner's thread."""
        self._progress = count, of

    def _prepare(self) -> None:
        """Have whatever is precomputed made ready, unless the service ends."""
        if self._planners is not None:
            for prepare in preparations(self._planners.exact):
                self._in_tables_thread(prepare)

    def _in_tables_thread(self, work: Callable[[], None]) -> None:
        """Have something done that no plan waits for; nothing where the service ends."""
        with contextlib.suppress(RuntimeError):
            self._tables_thread.submit(self._try, work)

    def _try(self, work: Callable[[], None]) -> None:
        """In the tables' thread: plans are found without them, too."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the flight goes on without it
            level = logging.DEBUG if self._tables_failed else logging.WARNING
            self._tables_failed = True
            _logger.log(level, "plans without tables: %s: %s", type(error).__name__, error)

    def _submit(self, job: PlanJob, *, contingency: bool) -> Future[None] | None:
        if self._planners is None:
            return None
        return self._planning_thread.submit(self._answer, self._planners, job, contingency)

    def _answer(self, planners: Planners, job: PlanJob, contingency: bool) -> None:
        """In the planner's thread."""
        try:
            answer = answer_job(planners, job)
        except Exception as error:  # noqa: BLE001 - the flight goes on without this plan
            _logger.error("the planner failed: %s: %s", type(error).__name__, error)  # noqa: TRY400
            reason = "the planner failed"
            answer = PlanAnswer(job_id=job.job_id, plan=None, reason=reason, failed=True)
        self._answers.put((contingency, answer))
        if job.failsafes != self._failsafes and (self._failsafes is not None or not contingency):
            # Their places cost more in all plans: the tables were dropped, and are made anew.
            self._failsafes = job.failsafes
            self._prepare()
