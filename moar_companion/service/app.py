"""The asyncio shell around the companion: links, clock, planner thread, recorder, view.

One loop thinks at the setpoint rate and sends what the machine gives it; bytes are handed over as
they arrive; plans are made in one thread, whose compiled search does not hold the interpreter.
Whatever may wait for a disk or for who reads the log has a thread of its own: the loop never does.
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
from typing import Any

from ..config import CompanionConfig, LinkRole
from ..mavlink.link import Link, open_link
from ..mavlink.urls import parse_url
from ..outlets.log import log_to_stderr
from ..outlets.recorder import Recorder
from ..planner.planner import Planner
from ..site import Site
from ..types import AutopilotStatus
from ..vehicle import Vehicle
from .companion import Companion
from .host import HostWatch
from .jobs import PlanAnswer, PlanJob, answer_job, preparations, prepare_for
from .memory_file import MemoryFile
from .notify import Watchdog, notify
from .places import recorder_folder, state_folder, view_socket
from .planners import Planners
from .status import LatestDecisions
from .surroundings import Ground
from .view_socket import open_view_socket

_SWITCH_INTERVAL_S = 0.0005
"""The planner thread gives the interpreter back to the streaming loop at least this often."""
_LONGEST_THOUGHT_S = 0.1
"""What was thought earlier than this is not sent any more. No setpoint leaves 200 ms after its
thought began: the rest is for what the operating system does between a look at the clock and the
sending."""
_LONGEST_WAIT_S = 0.05
"""What moves the aircraft waits no longer than this for a serial line that is behind."""
_CATCHING_UP_S = 0.001
_LONGEST_CATCHING_UP = 100
"""Looks, each of the time above, for bytes that have waited while we slept too long."""
_LOOK_PERIOD_S = 1.0
"""How often it is looked at who is heard, and what the computer has left."""
_SILENCE_S = 5.0
"""An autopilot's heartbeat comes each second: after this time without one the user is told."""

_logger = logging.getLogger(__name__)


def run_service(config: CompanionConfig, *, speed: float = 1.0) -> int:
    """Run until SIGTERM or SIGINT; the exit status.

    speed: seconds of the companion's clock in a real one; not 1 beside a simulator only.
    Raises InputError for files that cannot be used, LinkError for links that cannot be opened.
    """
    vehicle = Vehicle.load(config.vehicle)
    site = None if config.site is None else Site.load(config.site)
    planner = None if site is None else Planner(site, vehicle)
    ground = None
    if site is not None and planner is not None:
        ground = Ground(site=site, maps=planner.maps)
    with log_to_stderr(), contextlib.ExitStack() as stack:
        memory = _open_memory(config, stack)
        before = None if memory is None else memory.load(time.time() - _clock_s(speed))
        companion = Companion(config, vehicle, ground, before=before)
        asyncio.run(Service(config, companion, planner, memory, speed=speed).run())
    return 0


def _clock_s(speed: float) -> float:
    """The companion's clock: goes on evenly whatever is done to the host's, and in its sleep."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) * speed


def _open_memory(config: CompanionConfig, stack: contextlib.ExitStack) -> MemoryFile | None:
    folder = state_folder(config)
    if folder is None:
        return None
    try:
        memory = MemoryFile(folder.path)
    except OSError as error:
        raise folder.unwritable(error) from error
    stack.callback(memory.close)
    return memory


class Service:
    """Owns every task, thread and file of the running companion."""

    def __init__(
        self,
        config: CompanionConfig,
        companion: Companion,
        planner: Planner | None,
        memory: MemoryFile | None,
        *,
        speed: float = 1.0,
    ) -> None:
        self._config = config
        self._companion = companion
        self._planners = None if planner is None else Planners(planner)
        self._memory = memory
        self._remembered = companion.memory
        self._speed = speed
        self._watchdog = Watchdog()
        self._latest = LatestDecisions()
        self._clock_offset_s = time.time() - self._now_s()
        self._links: Mapping[str, Link] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._preparing = ThreadPoolExecutor(max_workers=1, thread_name_prefix="tables")
        self._planning: Future[PlanAnswer] | None = None
        self._arrived: list[tuple[float, str, bytes]] = []
        self._answered: list[tuple[bool, PlanAnswer]] = []
        """Whether a contingency was planned, and its plan."""
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
            for pool in (self._thread, self._preparing):
                stack.callback(pool.shutdown, wait=False, cancel_futures=True)
            self._recorder = self._open_recorder(stack)
            host = HostWatch(None if self._recorder is None else self._recorder.folder)
            stack.callback(host.close)
            await self._open_view(stack)
            links = {}
            for link in self._config.links:
                address = parse_url(link.url)
                receive = partial(self._receive, link.url)
                links[link.url] = await stack.enter_async_context(open_link(address, receive))
                _logger.info("%s link on %s", link.role.value, address)
            self._links = links
            # What was imported lives as long as the process: no need to look through it again.
            gc.freeze()
            if self._planners is not None:
                for prepare in preparations(self._planners.exact):
                    self._preparing.submit(prepare)
            notify("READY=1")
            loop.call_later(_SILENCE_S, self._say_if_nobody_is_heard)
            thinking = asyncio.create_task(self._think_loop(loop, host), name="think")
            stopping = asyncio.create_task(stopped.wait(), name="wait for a signal")
            await asyncio.wait({thinking, stopping}, return_when=asyncio.FIRST_COMPLETED)
            notify("STOPPING=1")
            stopping.cancel()
            if thinking.done():
                thinking.result()
            thinking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await thinking
            now_s = self._now_s()
            self._take_in(now_s)
            self._companion.shut_down(now_s)
            self._send(now_s)

    def _now_s(self) -> float:
        return _clock_s(self._speed)

    async def _think_loop(self, loop: asyncio.AbstractEventLoop, host: HostWatch) -> None:
        """Think and send at the setpoint rate, by deadlines that do not drift."""
        period_s = 1.0 / self._config.setpoint_rate_hz
        due_s = look_s = self._now_s()
        while True:
            now_s = self._now_s()
            self._take_in(now_s)
            self._companion.tick(now_s)
            for job in self._companion.plan_jobs():
                self._plan(loop, job)
            for job in self._companion.contingency_jobs():
                self._submit(loop, job, contingency=True)
            if self._send(now_s):
                self._watchdog.feed(now_s / self._speed)
            self._remember(now_s)
            if now_s >= look_s:
                look_s = now_s + _LOOK_PERIOD_S
                self._say_who_is_heard()
                self._companion.note_host(host.look())
            due_s += period_s
            if due_s <= now_s:
                # After a pause nothing is sent twice to catch up.
                due_s = now_s + period_s
            await asyncio.sleep((due_s - self._now_s()) / self._speed)
            if self._is_late(due_s):
                await self._catch_up()

    def _is_late(self, due_s: float) -> bool:
        """Whether too long has passed since then: real time, at whatever speed."""
        return self._now_s() - due_s > _LONGEST_THOUGHT_S * self._speed

    async def _catch_up(self) -> None:
        """After a pause: hear all that has waited, so that the next thought is of the newest."""
        heard = -1
        for _ in range(_LONGEST_CATCHING_UP):
            if heard == len(self._arrived):
                return
            heard = len(self._arrived)
            await asyncio.sleep(_CATCHING_UP_S)

    def _receive(self, url: str, data: bytes) -> None:
        self._arrived.append((self._now_s(), url, data))

    def _take_in(self, now_s: float) -> None:
        """Hand over what has arrived: here, so that what fails ends the thinking, too."""
        arrived, self._arrived = self._arrived, []
        for time_s, url, data in arrived:
            self._companion.receive(url, data, time_s)
        answered, self._answered = self._answered, []
        for contingency, answer in answered:
            if contingency:
                self._companion.contingency_answered(answer)
            else:
                self._companion.plan_answered(answer, now_s)

    def _send(self, now_s: float) -> bool:
        """Send what was thought at `now_s`; whether that was still young enough to fly by."""
        late = self._is_late(now_s)
        control = [] if late else self._companion.control_to_send()
        outgoing = [packet for packet in control if self._send_in_time(now_s, *packet)]
        if not late and len(outgoing) == len(control):
            self._companion.note_sent()
        for url, data in self._companion.data_to_send(control=False):
            self._links[url].send(data)
            outgoing.append((url, data))
        decisions = self._companion.decisions()
        self._latest.note(decisions, self._companion.telemetry.link)
        for item in decisions:
            if item.kind == "text":
                _logger.info("%s", item.data["text"])
        heard = self._companion.packets_heard()
        if self._recorder is not None:
            self._recorder.write(
                [*heard, *((now_s, data) for _, data in outgoing)],
                ((item.time_s, item.kind, item.data) for item in decisions),
            )
        return not late

    def _send_in_time(self, now_s: float, url: str, data: bytes) -> bool:
        """Send a packet that was thought at `now_s`, but not after a pause; whether it was sent."""
        in_time = not self._is_late(now_s)
        if in_time:
            self._links[url].send(data, _LONGEST_WAIT_S)
        return in_time

    def _remember(self, now_s: float) -> None:
        """Have what has changed written, for the process after this one."""
        memory = self._companion.memory
        if self._memory is not None and memory is not None and memory != self._remembered:
            self._remembered = memory
            self._memory.save(memory, time.time() - now_s)

    def _plan(self, loop: asyncio.AbstractEventLoop, job: PlanJob) -> None:
        """Make a plan in the thread; one that has not begun yet is overtaken.

        A contingency is not: of these there is one at a time, which is all that a plan waits for.
        """
        if self._planning is not None:
            self._planning.cancel()
        self._planning = self._submit(loop, job, contingency=False)
        if self._planners is not None:
            self._preparing.submit(prepare_for, self._planners, job)

    def _submit(
        self, loop: asyncio.AbstractEventLoop, job: PlanJob, *, contingency: bool
    ) -> Future[PlanAnswer] | None:
        if self._planners is None:
            return None
        planning = self._thread.submit(answer_job, self._planners, job)
        planning.add_done_callback(partial(self._planned, loop, job, contingency))
        return planning

    def _planned(
        self,
        loop: asyncio.AbstractEventLoop,
        job: PlanJob,
        contingency: bool,
        done: Future[PlanAnswer],
    ) -> None:
        """In the planner's thread: the answer goes to the loop, if that still runs."""
        if done.cancelled():
            return
        error = done.exception()
        if error is None:
            answer = done.result()
        else:
            _logger.error("the planner failed: %s: %s", type(error).__name__, error)
            reason = "the planner failed"
            answer = PlanAnswer(job_id=job.job_id, plan=None, reason=reason, failed=True)
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(self._take_answer, contingency, answer)

    def _take_answer(self, contingency: bool, answer: PlanAnswer) -> None:
        self._answered.append((contingency, answer))

    def _status_now(self) -> dict[str, Any]:
        """The status for the view."""
        return self._latest.status_of(
            self._companion,
            self._now_s(),
            clock_offset_s=self._clock_offset_s,
            recorder=None if self._recorder is None else self._recorder.folder,
        )

    async def _open_view(self, stack: contextlib.AsyncExitStack) -> None:
        place = view_socket(self._config)
        if place is None:
            return
        try:
            await stack.enter_async_context(open_view_socket(place.path, self._status_now))
        except OSError as error:
            raise place.not_free(error) from error

    def _open_recorder(self, stack: contextlib.AsyncExitStack) -> Recorder | None:
        folder = recorder_folder(self._config)
        if folder is None:
            return None
        try:
            recorder = Recorder(folder.path, self._clock_offset_s, self._now_s())
        except OSError as error:
            raise folder.unwritable(error) from error
        stack.callback(recorder.close)
        _logger.info("recording to %s", recorder.folder)
        return recorder

    def _say_if_nobody_is_heard(self) -> None:
        """One line in the log, so that a wrong port or baud rate is found."""
        if self._companion.telemetry.autopilot is None:
            links = [link.url for link in self._config.links if link.role is LinkRole.AUTOPILOT]
            _logger.warning(
                "no autopilot heard on %s for %g s; is it on, and does it send there?",
                ", ".join(links),
                _SILENCE_S,
            )

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
