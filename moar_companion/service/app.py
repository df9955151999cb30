"""The asyncio shell around the companion: links, clock, planner, recorder, view.

One loop runs the machine at the setpoint rate, with the bytes received since, and sends its output.
Plans are made in one thread, whose compiled search does not hold the interpreter. That thread also
prepares the planner, while the loop already receives and sends heartbeats. Operations that can wait
for a disk or for a reader of the log have their own threads: the loop never waits for them.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import math
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..companion.companion import Companion
from ..companion.error_margin import flown_site
from ..companion.intake import Arrival
from ..companion.planning.map_jobs import MapAnswer
from ..companion.planning.site_maps import SiteMaps
from ..companion.safety.check_inputs import Host
from ..companion.safety.file_faults import FileFault, words
from ..companion.status import LatestDecisions
from ..mavlink.link import Link, open_link
from ..mavlink.link_basics import clock_s
from ..mavlink.peers import Address
from ..mavlink.urls import parse_url
from ..planner.planner import Planner
from ..planner.site import Site
from ..settings.config import CompanionConfig
from ..settings.mqtt_config import ORDER_LINK
from ..settings.page_config import PAGE_LINK
from ..settings.vehicle import VehicleFile
from ..texts import service_texts
from .host_monitor import HostMonitor
from .log import AutopilotLog, log_to_stderr
from .optional_parts import (
    companion_class,
    open_mqtt,
    open_page,
    open_parameters,
    open_perception,
    open_recorder,
    open_signing,
    open_snapshot,
    open_view,
)
from .planner_worker import PlannerWorker, Work
from .pools import started_pool
from .priority import NICE, ahead_of_others, in_real_time
from .resident_memory import limit_arenas, release_descriptions
from .stored_parameters import start_settings
from .systemd import Watchdog, notify

if TYPE_CHECKING:
    from .cycle_recorder import CycleRecorder
    from .mqtt_publisher import MqttPublisher
    from .order_queue import OrderQueue
    from .page_process import PageProcess
    from .perception_process import PerceptionProcess
    from .signing_clock import SigningClock
    from .snapshot_file import SnapshotFile
    from .stored_parameters import ParameterFile

_SWITCH_INTERVAL_S = 0.0005
"""The planner thread gives the interpreter back to the streaming loop at least this often."""
_MAX_CYCLE_S = 0.1
"""Output of a cycle older than this is discarded. No setpoint leaves 200 ms after its cycle began:
the rest is for operating-system delays between the clock reading and the sending."""
_LONGEST_WAIT_S = 0.05
"""Maximum wait of packets that command motion for a serial line that is behind."""
_CATCHING_UP_S = 0.001
_LONGEST_CATCHING_UP_S = 0.1
"""After a loop stall: period of the reads of queued bytes, and their maximum total time, even if
more bytes arrive. 4 MB of queued datagrams are read in 30 ms."""
_HOST_PERIOD_S = 1.0
"""Period of the checks of the autopilot's status and the computer's free resources."""
_CLOCK_SET_S = 0.5
"""Least step of the wall clock that counts as set; a clock that is adjusted drifts less."""

_logger = logging.getLogger(__name__)


def run_service(config: CompanionConfig, *, vehicle_named: bool = False, speed: float = 1.0) -> int:
    """Runs until SIGTERM or SIGINT; returns the exit status.

    vehicle_named: the command line names the vehicle file, above what was set in flight.
    speed: seconds of the companion's clock per real second; other than 1 only with a simulator.
    Raises InputError for files that cannot be used, LinkError for links that cannot be opened.
    """
    file = VehicleFile.load(config.vehicle)
    site = None if config.site is None else Site.load(config.site)
    settings = start_settings(config, file, vehicle_named=vehicle_named)
    config, vehicle = settings.config, settings.vehicle
    if site is not None:
        site = flown_site(site, vehicle, config.supervision)
    limit_arenas()
    release_descriptions()
    with ahead_of_others() as ahead, log_to_stderr(), contextlib.ExitStack() as stack:
        if not ahead:
            _logger.info("no priority over other programs: nice %d not permitted", NICE)
        settings.log()
        memory = open_snapshot(config, stack)
        stored = open_parameters(config, settings, stack)
        before = None if memory is None else memory.load(time.time() - _clock_s(speed))
        signing, clock = open_signing(config, time.time(), stack)
        companion = companion_class(config)(
            config,
            vehicle,
            None,
            before=before,
            signing=signing,
            parameters=settings.parameters,
        )
        make_planner = None
        if site is not None:
            make_planner = partial(Planner, site, vehicle, clock=time.perf_counter)
        perception = open_perception(config, site, speed)
        page = open_page(config, vehicle, stack)
        service = Service(
            config, companion, make_planner, memory, clock, perception, stored, page, speed=speed
        )
        asyncio.run(service.run())
    return 0


def _clock_s(speed: float) -> float:
    """The companion's clock: monotonic, unaffected by host clock changes, runs during suspend."""
    return clock_s() * speed


class Service:
    """Owns every task, thread and file of the running companion."""

    def __init__(
        self,
        config: CompanionConfig,
        companion: Companion,
        make_planner: Callable[[], Planner] | None,
        memory: SnapshotFile | None,
        signing_clock: SigningClock | None = None,
        perception: PerceptionProcess | None = None,
        stored: ParameterFile | None = None,
        page: PageProcess | None = None,
        *,
        speed: float = 1.0,
    ) -> None:
        self._config = config
        self._companion = companion
        self._make_planner = make_planner
        self._worker = PlannerWorker()
        self._memory = memory
        self._remembered = companion.memory
        self._signing_clock = signing_clock
        self._perception = perception
        self._stored = stored
        self._page = page
        self._kept = companion.parameters
        self._speed = speed
        self._watchdog = Watchdog()
        self._latest = LatestDecisions()
        self._clock_offset_s = time.time() - self._now_s()
        self._mqtt: MqttPublisher | None = None
        self._links: Mapping[str, Link | OrderQueue] = {}
        self._orders: dict[str, OrderQueue] = {}
        """Links of orders that arrive outside MAVLink."""
        self._arrived: list[Arrival] = []
        self._host = Host()
        self._read_late_s = 0.0
        """Maximum delay between arrival and reading of bytes since the last check."""
        self._recorder: CycleRecorder | None = None
        self._autopilot_log = AutopilotLog(config.links)

    async def run(self) -> None:
        """Opens the links, runs cycles until a signal, sends the last setpoint and closes."""
        loop = asyncio.get_running_loop()
        stopped = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        # Host names are resolved, and serial ports opened, in flight, too. One thread for each link
        # is enough: no link has two of these at a time.
        loop.set_default_executor(started_pool("links", len(self._config.links)))
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(self._worker.close)
            self._recorder = open_recorder(
                self._config,
                self._companion,
                self._status_now,
                clock_offset_s=self._clock_offset_s,
                now_s=self._now_s(),
                stack=stack,
            )
            host = HostMonitor(self._recorder_folder)
            stack.callback(host.close)
            if self._perception is not None:
                stack.callback(self._perception.close)
            await open_view(self._config, self._status_now, stack)
            self._mqtt = open_mqtt(self._config, stack)
            links: dict[str, Link | OrderQueue] = {}
            for link in self._config.links:
                address = parse_url(link.url)
                receive = partial(self._receive, link.url)
                links[link.url] = await stack.enter_async_context(open_link(address, receive))
                signed = "signed " if link.signed else ""
                _logger.info("%s%s link on %s", signed, link.role.value, address)
            if self._mqtt is not None and self._mqtt.orders is not None:
                self._orders[ORDER_LINK] = self._mqtt.orders.queue
            if self._page is not None and self._page.orders is not None:
                self._orders[PAGE_LINK] = self._page.orders
            self._links = links | self._orders
            # Imported objects stay until the process ends: the collector can skip them.
            gc.freeze()
            gc.enable()
            notify("READY=1")
            if self._make_planner is not None:
                self._companion.await_planner()
                self._worker.begin(self._make_planner)
            if not stack.enter_context(in_real_time()):
                _logger.info("the loop is not in real time: not permitted")
            cycling = asyncio.create_task(self._cycle_loop(host), name="cycles")
            stopping = asyncio.create_task(stopped.wait(), name="wait for a signal")
            await asyncio.wait({cycling, stopping}, return_when=asyncio.FIRST_COMPLETED)
            notify("STOPPING=1")
            stopping.cancel()
            if cycling.done():
                cycling.result()
            cycling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await cycling
            now_s = self._now_s()
            self._take_in(now_s)
            self._companion.shut_down(now_s)
            self._send(now_s)

    def _take_planner(self) -> None:
        """Takes the planner when it is ready; reports its progress until then."""
        planner, progress = self._worker.new_planner(), self._worker.new_progress()
        if planner is not None:
            # A collection over the objects of planner and compiler stops all threads for 0.2 s.
            gc.freeze()
            self._companion.take_ground(SiteMaps(site=planner.site, maps=planner.maps))
            _logger.info("planner ready")
            notify("STATUS=planner ready")
        elif progress is not None:
            words = service_texts.COMPILING(parts=progress[0], total=progress[1])
            self._companion.await_planner(words)
            _logger.info("%s", words)
            notify(f"STATUS={words}")

    def _now_s(self) -> float:
        return _clock_s(self._speed)

    async def _cycle_loop(self, host: HostMonitor) -> None:
        """Runs one cycle and sends per setpoint period, by deadlines that do not drift."""
        due_s = host_due_s = self._now_s()
        while True:
            now_s = self._now_s()
            self._take_in(now_s)
            self._note_late_reading()
            self._take_planner()
            self._companion.tick(now_s)
            for job in self._companion.plan_jobs():
                self._worker.plan(job)
            for job in self._companion.contingency_jobs():
                self._worker.plan_contingency(job)
            if self._perception is not None:
                self._perception.send(self._companion.pose_notes())
            for map_job in self._companion.map_jobs():
                self._worker.make_maps(map_job)
            if self._send(now_s):
                self._watchdog.feed(now_s / self._speed)
            self._remember(now_s)
            if self._mqtt is not None:
                self._mqtt.publish_due(now_s, self._status_now)
            if self._page is not None:
                self._page.exchange(self._status_now, self._companion.site_maps)
            if now_s >= host_due_s:
                host_due_s = now_s + _HOST_PERIOD_S
                self._autopilot_log.update(self._companion.telemetry.autopilot, now_s / self._speed)
                self._host = replace(
                    host.read(), read_late_s=self._read_late_s, file_faults=self._file_faults()
                )
                self._companion.note_host(self._host)
                self._read_late_s = 0.0
                self._companion.note_wall_clock(time.time())
                self._follow_wall_clock(now_s)
                if self._signing_clock is not None:
                    self._signing_clock.keep(
                        self._companion.signing.timestamps, self._companion.signing.references
                    )
            period_s = 1.0 / self._companion.setpoint_rate_hz
            due_s += period_s
            if due_s <= now_s:
                # After a stall no packet is sent twice to catch up.
                due_s = now_s + period_s
            await asyncio.sleep((due_s - self._now_s()) / self._speed)
            if self._is_late(due_s):
                await self._catch_up()

    def _follow_wall_clock(self, now_s: float) -> None:
        """Takes the wall clock for the status when it was set: at the start it may be far off."""
        offset_s = time.time() - now_s
        if self._speed == 1.0 and abs(offset_s - self._clock_offset_s) > _CLOCK_SET_S:
            self._clock_offset_s = offset_s

    def _is_late(self, due_s: float) -> bool:
        """True if more than the maximum cycle age has passed since `due_s`, in real time."""
        return self._now_s() - due_s > _MAX_CYCLE_S * self._speed

    async def _catch_up(self) -> None:
        """Receives all queued bytes after a stall, so that the next cycle uses the newest."""
        received, end_s = -1, clock_s() + _LONGEST_CATCHING_UP_S
        while received < len(self._arrived) and clock_s() < end_s:
            received = len(self._arrived)
            await asyncio.sleep(_CATCHING_UP_S)

    def _note_late_reading(self) -> None:
        """Reports late reading to the companion before the cycle that finds the position old."""
        if self._read_late_s > self._host.read_late_s:
            self._host = replace(self._host, read_late_s=self._read_late_s)
            self._companion.note_host(self._host)

    def _receive(self, url: str, data: bytes, arrived_s: float, address: Address | None) -> None:
        self._arrived.append((arrived_s * self._speed, url, data, address))
        self._read_late_s = max(self._read_late_s, self._now_s() - arrived_s * self._speed)

    def _take_in(self, now_s: float) -> None:
        """Passes received bytes to the companion; here, so that an error also ends the loop."""
        for link, orders in self._orders.items():
            for packet in orders.take():
                self._receive(link, packet, clock_s(), None)
        arrived, self._arrived = self._arrived, []
        self._companion.take_in(arrived, now_s)
        for kind, answer in self._worker.answers():
            if isinstance(answer, MapAnswer):
                self._companion.maps_answered(answer)
            elif kind is Work.CONTINGENCY:
                self._companion.contingency_answered(answer)
            else:
                self._companion.plan_answered(answer)
        if self._perception is not None:
            for report in self._perception.reports():
                self._companion.perceived(report)

    def _send(self, now_s: float) -> bool:
        """Sends the output of the cycle at `now_s`; True if it was young enough for flight."""
        late = self._is_late(now_s)
        control = [] if late else self._companion.control_to_send()
        outgoing = [packet for packet in control if self._send_in_time(now_s, *packet)]
        if not late and len(outgoing) == len(control):
            self._companion.note_sent()
        for url, data in self._companion.data_to_send(control=False):
            self._links[url].send(data, math.inf, self._companion.peers(url))
            outgoing.append((url, data))
        decisions = self._companion.decisions()
        self._latest.note(decisions, self._companion.telemetry.link)
        for item in decisions:
            if item.kind == "text":
                fields = {"kind": item.kind, "reason": item.data["reason"]}
                _logger.info("%s", item.data["text"], extra={"fields": fields})
        if self._recorder is None:
            self._companion.received_packets()  # only a recording keeps them
        else:
            self._recorder.record(now_s, outgoing, decisions)
        return not late

    def _send_in_time(self, now_s: float, url: str, data: bytes) -> bool:
        """Sends a packet of the cycle at `now_s`, but not after a stall; True if it was sent."""
        in_time = not self._is_late(now_s)
        if in_time:
            self._links[url].send(data, _LONGEST_WAIT_S, self._companion.peers(url))
        return in_time

    def _remember(self, now_s: float) -> None:
        """Saves changed memory for the next process."""
        memory = self._companion.memory
        if self._memory is not None and memory is not None and memory != self._remembered:
            self._remembered = memory
            self._memory.save(memory, time.time() - now_s)
        parameters = self._companion.parameters
        if self._stored is not None and parameters is not None and parameters is not self._kept:
            self._kept = parameters
            self._stored.keep(parameters)

    @property
    def _recorder_folder(self) -> Path | None:
        return None if self._recorder is None else self._recorder.folder

    def _file_faults(self) -> tuple[FileFault, ...]:
        """Faults of the files that the service writes."""
        faults = () if self._memory is None else self._memory.faults
        faults += () if self._stored is None else self._stored.faults
        ended = None if self._recorder is None else self._recorder.ended
        if ended is None:
            return faults
        reason = service_texts.RECORDING_ENDED(fault=words(ended))
        return (*faults, FileFault(reason=reason, action="flying on"))

    def _status_now(self) -> dict[str, Any]:
        """The status for the view."""
        return self._latest.status_of(
            self._companion,
            self._now_s(),
            clock_offset_s=self._clock_offset_s,
            recorder=self._recorder_folder,
        )
