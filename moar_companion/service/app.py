"""The asyncio shell around the companion: links, clock, planner thread, recorder.

One loop thinks at the setpoint rate and sends what the machine gives it; bytes are handed over as
they arrive; plans are made in one thread, whose compiled search does not hold the interpreter.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import signal
import sys
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

from ..config import CompanionConfig
from ..errors import InputError
from ..mavlink.link import Link, open_link
from ..mavlink.urls import parse_url
from ..outlets.recorder import Recorder
from ..planner.planner import Planner
from ..site import Site
from ..types import AutopilotStatus
from ..vehicle import Vehicle
from .companion import Companion
from .jobs import PlanAnswer, PlanJob, answer_job, prepare_all
from .notify import notify
from .surroundings import Ground

_SWITCH_INTERVAL_S = 0.0005
"""The planner thread gives the interpreter back to the streaming loop at least this often."""
_FLUSH_PERIOD_S = 1.0

_logger = logging.getLogger(__name__)


def run_service(config: CompanionConfig) -> int:
    """Run until SIGTERM or SIGINT; the exit status.

    Raises InputError for files that cannot be used, LinkError for links that cannot be opened.
    """
    vehicle = Vehicle.load(config.vehicle)
    site = None if config.site is None else Site.load(config.site)
    planner = None if site is None else Planner(site, vehicle)
    ground = None
    if site is not None and planner is not None:
        ground = Ground(site=site, maps=planner.maps)
    companion = Companion(config, vehicle, ground)
    asyncio.run(Service(config, companion, planner).run())
    return 0


class Service:
    """Owns every task, thread and file of the running companion."""

    def __init__(
        self, config: CompanionConfig, companion: Companion, planner: Planner | None
    ) -> None:
        self._config = config
        self._companion = companion
        self._planner = planner
        self._links: Mapping[str, Link] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._planning: Future[PlanAnswer] | None = None
        self._arrived: list[tuple[float, str, bytes]] = []
        self._answered: list[PlanAnswer] = []
        self._recorder: Recorder | None = None
        self._heard: AutopilotStatus | None = None

    async def run(self) -> None:
        """Open the links, think until a signal comes, say farewell and close."""
        loop = asyncio.get_running_loop()
        stopped = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(self._thread.shutdown, wait=False, cancel_futures=True)
            self._recorder = self._open_recorder(stack, loop.time())
            links = {}
            for link in self._config.links:
                address = parse_url(link.url)
                receive = partial(self._receive, loop, link.url)
                links[link.url] = await stack.enter_async_context(open_link(address, receive))
                _logger.info("%s link on %s", link.role.value, address)
            self._links = links
            # What was imported lives as long as the process: no need to look through it again.
            gc.freeze()
            if self._planner is not None:
                self._thread.submit(prepare_all, self._planner)
            notify("READY=1")
            thinking = asyncio.create_task(self._think_loop(loop), name="think")
            stopping = asyncio.create_task(stopped.wait(), name="wait for a signal")
            await asyncio.wait({thinking, stopping}, return_when=asyncio.FIRST_COMPLETED)
            notify("STOPPING=1")
            stopping.cancel()
            if thinking.done():
                thinking.result()
            thinking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await thinking
            self._take_in(loop.time())
            self._companion.shut_down(loop.time())
            self._send(loop.time())

    async def _think_loop(self, loop: asyncio.AbstractEventLoop) -> None:
        """Think and send at the setpoint rate, by deadlines that do not drift."""
        period_s = 1.0 / self._config.setpoint_rate_hz
        due_s = flush_s = loop.time()
        while True:
            now_s = loop.time()
            self._take_in(now_s)
            self._companion.tick(now_s)
            for job in self._companion.plan_jobs():
                self._plan(loop, job)
            self._send(now_s)
            if now_s >= flush_s:
                flush_s = now_s + _FLUSH_PERIOD_S
                self._say_who_is_heard()
                if self._recorder is not None:
                    self._recorder.flush()
            due_s += period_s
            if due_s <= now_s:
                # After a pause nothing is sent twice to catch up.
                due_s = now_s + period_s
            await asyncio.sleep(due_s - loop.time())

    def _receive(self, loop: asyncio.AbstractEventLoop, url: str, data: bytes) -> None:
        self._arrived.append((loop.time(), url, data))

    def _take_in(self, now_s: float) -> None:
        """Hand over what has arrived: here, so that what fails ends the thinking, too."""
        arrived, self._arrived = self._arrived, []
        for time_s, url, data in arrived:
            self._companion.receive(url, data, time_s)
        answered, self._answered = self._answered, []
        for answer in answered:
            self._companion.plan_answered(answer, now_s)

    def _send(self, now_s: float) -> None:
        outgoing = self._companion.data_to_send()
        for url, data in outgoing:
            self._links[url].send(data)
        decisions = self._companion.decisions()
        heard = self._companion.packets_heard()
        if self._recorder is not None:
            self._recorder.write(
                [*heard, *((now_s, data) for _, data in outgoing)],
                ((item.time_s, item.kind, item.data) for item in decisions),
            )

    def _plan(self, loop: asyncio.AbstractEventLoop, job: PlanJob) -> None:
        """Make a plan in the thread; one that has not begun yet is overtaken."""
        if self._planner is None:
            return
        if self._planning is not None:
            self._planning.cancel()
        self._planning = self._thread.submit(answer_job, self._planner, job)
        self._planning.add_done_callback(partial(self._planned, loop, job))

    def _planned(
        self, loop: asyncio.AbstractEventLoop, job: PlanJob, done: Future[PlanAnswer]
    ) -> None:
        """In the planner's thread: the answer goes to the loop, if that still runs."""
        if done.cancelled():
            return
        error = done.exception()
        if error is None:
            answer = done.result()
        else:
            _logger.error("the planner failed: %s: %s", type(error).__name__, error)
            answer = PlanAnswer(job_id=job.job_id, plan=None, reason="the planner failed")
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(self._answered.append, answer)

    def _open_recorder(self, stack: contextlib.AsyncExitStack, now_s: float) -> Recorder | None:
        directory = self._config.recorder.directory
        if directory is None:
            return None
        try:
            recorder = Recorder(directory, time.time() - now_s, now_s)
        except OSError as error:
            raise InputError("recorder", "directory", f"{directory}: {error.strerror}") from error
        stack.callback(recorder.close)
        _logger.info("recording to %s", recorder.folder)
        return recorder

    def _say_who_is_heard(self) -> None:
        """One line in the log when the autopilot appears or its mode changes."""
        heard = self._companion.telemetry.autopilot
        before = self._heard
        if heard is not None and (
            before is None or (heard.mode, heard.armed) != (before.mode, before.armed)
        ):
            _logger.info(
                "autopilot %s, system %d: %s, %s",
                heard.kind.value,
                heard.system_id,
                heard.mode,
                "armed" if heard.armed else "disarmed",
            )
        self._heard = heard
