"""Hostile input in flight: the whole companion beside a fake autopilot, by the seed of a life.

A life is a companion that receives bursts of hostile input, each 2 s, and between them flies the
operator's orders. In even lives PX4 flies, in odd ones ArduPilot. In every second pair of lives no
message has the autopilot's ids from its own address. Judged are

- every cycle (decoding, cycle and packing): no exception, and its processor time;
- every setpoint: its form, and the obstacles on the site by the reported origin;
- without messages with the autopilot's ids: setpoints never jump, and no collision.
"""

from __future__ import annotations

import gc
import itertools
import math
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from random import Random

import numpy as np

from moar_companion.companion.companion import Companion
from moar_companion.companion.intake import BUDGET_BYTES, LEAST_BYTES
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.signing import Signing, SigningKey, timestamp_at
from moar_companion.service.recording.calls import RecordedCompanion
from moar_companion.settings.link_config import LinkConfig, LinkRole
from sitl.wire import packet_header, packets

from ..benchmarks.soak import anonymous_mb, forget
from ..copies import flown_once
from ..flights import judging
from ..flights.lockstep import COMPANION_LINK, Lockstep
from ..flights.operator import EXIT, INSPECTION, Manner
from ..packets import decoded
from .frames import OURS, Shape, frame, hostile_payload, nearly_frames, shape_of

LONGEST_MS = 50.0
SHOWN = 4
"""Number of rows of figures for a life."""
BURST_STEPS = 150
CALM_STEPS = 750
"""Longest time until the aircraft flies again."""
_VAIN = 2
"""Number of bursts without a flight after which a new copy begins: messages test flights."""
ENDED = {"released", "overridden"}
"""States without a stream."""
AUTOPILOT = ("127.0.0.1", 14580)
STATIONS, STREAM, SIGNED = "udp:0.0.0.0:14550", "tcp:127.0.0.1:5760", "udp:0.0.0.0:14551"
SECRET = bytes(range(32))
WALL_S = 1_800_000_000.0

Place = tuple[str, tuple[str, int] | None]
"""A link, and an address on listening links."""
Hostile = tuple[Place, bytes]
Source = Callable[[], Iterator[Hostile]]
"""Bytes that arrive in a cycle."""

HOME: Place = (COMPANION_LINK, AUTOPILOT)
STATION: Place = (STATIONS, ("10.0.0.3", 14550))
ELSEWHERE: list[Place] = [
    (STREAM, None),
    *(
        (link, (f"10.0.{net}.66", 4242))
        for net in range(6)
        for link in (COMPANION_LINK, STATIONS, SIGNED)
    ),
]
OPERATORS = [(255, 190), (245, 190), (1, 154)]
STRANGERS = [(42, 1), (2, 1), (51, 68), (0, 0), OURS, (1, 1), (255, 1)]


class Cycles:
    """A companion as in the service; measures the processor time of each cycle."""

    def __init__(self, companion: Companion) -> None:
        self.companion = companion
        self.costs_ms: list[float] = []
        self.arrived: list = []
        self._out: list[tuple[str, bytes]] = []

    def __getattr__(self, name: str):
        return getattr(self.companion, name)

    def receive(self, link, data, now_s, address) -> None:
        self.arrived.append((now_s, link, data, address))

    def tick(self, now_s: float) -> None:
        arrived, self.arrived = self.arrived, []
        began_ns = time.thread_time_ns()
        self.companion.take_in(arrived, now_s)
        self.companion.tick(now_s)
        self._out = self.companion.data_to_send()
        self.costs_ms.append((time.thread_time_ns() - began_ns) * 1e-6)
        self.companion.received_packets()

    def data_to_send(self) -> list[tuple[str, bytes]]:
        return [item for item in self._out if item[0] == COMPANION_LINK]


class FuzzedFlight(Lockstep):
    """A flight on four links, with the last packets of the autopilot."""

    def __init__(self, **options) -> None:
        self.last: dict[int, bytes] = {}
        """The autopilot's last packet of each message."""
        self.boot_s = 0.0
        self._order_s = 0.0
        super().__init__(**options)

    def new_companion(self, before=None) -> RecordedCompanion:
        others = (
            LinkConfig(url=STATIONS, role=LinkRole.OPERATOR),
            LinkConfig(url=STREAM, role=LinkRole.OPERATOR),
            LinkConfig(url=SIGNED, role=LinkRole.OPERATOR, signed=True),
        )
        config = replace(self.config, links=(*self.config.links, *others))
        site_maps = SiteMaps(site=self.flown_site, maps=self.planner.maps)
        signing = Signing(key=SigningKey(SECRET), wall_s=WALL_S)
        return RecordedCompanion(config, self.vehicle, site_maps, before=before, signing=signing)

    def handle(self, data: bytes) -> None:
        for packet in packets(data):
            number = packet_header(packet)[0]
            self.last[number] = packet
            if number == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._position = packet
                self.boot_s = decoded(packet).time_boot_ms * 1e-3
        self.companion.receive(COMPANION_LINK, data, self.now_s, AUTOPILOT)

    def fly_on(self, pick: Random) -> None:
        """The operator's orders, once a second, to start a flight."""
        if self.now_s < self._order_s:
            return
        self._order_s = self.now_s + 1.0
        if self.state == "ready" and not self.operator.in_mode("ours"):
            self.operator.mode("ours")
        elif self.state not in {"ready", "planning", "flying", "landing_leg"}:
            self.operator.mission(pick.choice((INSPECTION, INSPECTION, EXIT)))


@flown_once
def hovering(manner: Manner) -> FuzzedFlight:
    flight = FuzzedFlight(manner=manner)
    flight.take_off()
    return flight


class Report:
    """Received inputs and findings of a process."""

    def __init__(self) -> None:
        self.given = 0
        self.companions = 0
        self.by_state: Counter[str] = Counter()
        self.costs_ms: list[np.ndarray] = []
        self.found: list[str] = []

    def find(self, words: str) -> None:
        self.found.append(words)
        sys.stdout.write(words + "\n")

    def show(self, words: str) -> None:
        """Prints a row: amount of input, memory, longest cycle."""
        greatest = max(max(costs, default=0.0) for costs in self.costs_ms)
        row = f"| {words} | {self.given} | {anonymous_mb():.1f} MB | {greatest:.1f} ms |\n"
        sys.stdout.write(row)
        sys.stdout.flush()

    def __str__(self) -> str:
        costs = np.concatenate(self.costs_ms)
        median, p99, p9999 = np.percentile(costs, (50.0, 99.0, 99.99))
        states = ", ".join(
            f"{state} {100 * count / self.given:.0f} %"
            for state, count in self.by_state.most_common()
        )
        return (
            f"{self.given} in {len(costs)} cycles of {self.companions} companions: {states}\n"
            f"processor time of a cycle: median {median:.2f}, p99 {p99:.2f}, p99.99 {p9999:.2f}, "
            f"greatest {costs.max():.2f} ms\nfound: {len(self.found)}\n"
        )


class Life:
    """Bursts on one companion until an amount of input."""

    def __init__(self, what: str, seed: int, report: Report) -> None:
        self.pick = Random(f"{what} {seed}")
        self.what, self.seed, self.report = what, seed, report
        self.manner = list(Manner)[seed % 2]
        self.sends_as_autopilot = what == "messages" and seed // 2 % 2 == 0
        self.failed_tasks = 0
        self._begin()
        codec = self.flight.companion.companion.state.session._codecs[COMPANION_LINK]
        self.shapes = [shape_of(mavlink.mavlink_map[number]) for number in sorted(codec._wanted)]

    def _begin(self) -> None:
        self.flight = hovering(self.manner)
        self.cycles = self.flight.companion = Cycles(self.flight.companion)
        self.report.companions += 1
        # As in the service: cycles do not garbage-collect the objects from before the start.
        gc.unfreeze()
        gc.collect()
        gc.freeze()

    def live(self, count: int) -> None:
        report = self.report
        end, shown_every = report.given + count, max(1, count // SHOWN)
        for burst in itertools.count():
            name, before = f"life {self.seed}, burst {burst}", report.given
            try:
                self._calm()
                self._burst(end)
                self._judge()
            except Exception as error:  # noqa: BLE001 - any is a finding
                trace = "".join(traceback.format_exception(error)[-3:])
                report.find(f"{name}, state {self.flight.state}: {trace}")
                self._begin()
            costs_ms = np.array(self.cycles.costs_ms)
            report.costs_ms.append(costs_ms)
            self.cycles.costs_ms.clear()
            if max(costs_ms, default=0.0) > LONGEST_MS:
                report.find(f"{name}: a cycle of {max(costs_ms):.0f} ms")
            forget(self.flight)
            if before // shown_every != report.given // shown_every:
                report.show(name)
            if report.given >= end:
                break

    def _calm(self) -> None:
        """The operator starts a flight; not always until it flies."""
        pick, flight = self.pick, self.flight
        wanted = pick.choice(
            [{"flying", "landing_leg"}] * 5 + [{"ready"}, {"landing_leg"}, {flight.state}]
        )
        self.failed_tasks += 1
        for step in range(CALM_STEPS):
            if flight.state in {"flying", "landing_leg"}:
                self.failed_tasks = 0
            if flight.state in wanted and step >= 20:
                break
            if not (flight.state == "ready" and "ready" in wanted):
                flight.fly_on(pick)
            flight.step()
        if self.failed_tasks >= _VAIN:
            self.failed_tasks = 0
            self._begin()

    def _burst(self, end: int) -> None:
        flight, report = self.flight, self.report
        source = self._messages() if self.what == "messages" else self._noise()
        for _ in range(BURST_STEPS):
            left = BUDGET_BYTES
            for place, data in source():
                if place != HOME and place[0] != STREAM:
                    left -= max(LEAST_BYTES, len(data))
                    if left < 0:
                        break
                flight.companion.receive(place[0], data, flight.now_s, place[1])
                amount = 1 if self.what == "messages" else len(data)
                report.given += amount
                report.by_state[flight.state] += amount
            self.pick.shuffle(self.cycles.arrived)
            flight.step()
            if report.given >= end:
                break

    def _messages(self) -> Source:
        """Senders and messages of this burst."""
        pick = self.pick
        groups: list[list[tuple[Place, tuple[int, int]]]] = [
            [(place, ids) for place in (HOME, STATION, (STREAM, None)) for ids in OPERATORS],
            [(place, ids) for place in ELSEWHERE for ids in [*OPERATORS, *STRANGERS]],
            [(HOME, ids) for ids in STRANGERS if ids != (1, 1)],
        ]
        if self.sends_as_autopilot:
            groups += [[(HOME, (1, 1))]] * 4
        speakers = pick.choice([*groups, list(itertools.chain(*groups))])
        shapes = pick.choice([self.shapes, pick.sample(self.shapes, pick.choice((1, 2, 5)))])
        count = pick.choice((8, 30, 80))

        def source() -> Iterator[Hostile]:
            for _ in range(count):
                place, ids = pick.choice(speakers)
                yield place, self._message(pick.choice(shapes), place, ids)

        return source

    def _message(self, shape: Shape, place: Place, ids: tuple[int, int]) -> bytes:
        pick, flight = self.pick, self.flight
        genuine = flight.last.get(shape.message_class.id)
        seq = pick.randrange(256)
        if genuine is not None:
            seq = genuine[4] if pick.random() < 0.8 else seq
            genuine = genuine[10:-2]
        signed = None
        if place[0] == SIGNED and pick.random() < 0.8:
            off_s = pick.choice((0.0, 0.0, 0.0, -100.0, 1e7))
            signed = SECRET, timestamp_at(WALL_S + flight.now_s + off_s)
        payload = hostile_payload(pick, shape, genuine, flight.boot_s)
        return frame(shape.message_class, payload, ids, seq, signed)

    def _noise(self) -> Source:
        """Sources of this burst's bytes, and number of pieces per cycle."""
        pick, flight = self.pick, self.flight
        everywhere = [HOME, *ELSEWHERE]
        places = pick.choice([[HOME], [(STREAM, None)], ELSEWHERE, everywhere])
        count = pick.choice((4, 20, 60))

        def source() -> Iterator[Hostile]:
            orders = [
                self._message(pick.choice(self.shapes), place, (255, 190))
                for place in (STATION, (SIGNED, None))
            ]
            genuine = [*flight.last.values(), *orders]
            for _ in range(count):
                yield pick.choice(places), nearly_frames(pick, genuine)

        return source

    def _judge(self) -> None:
        flight = self.flight
        if flight.setpoints:
            judging.assert_the_stream_is_sound(flight)
            self._take_last_setpoints()
        if flight.setpoints:
            room_m = judging.clearances_m(flight.site, judging.setpoint_places(flight))
            assert min(room_m) > flight.vehicle.radius_m, "a setpoint inside an obstacle"
        if not self.sends_as_autopilot:
            if flight.setpoints:
                judging.assert_setpoints_never_jump(flight)
            if not all(truth.on_ground for truth in flight.truths):
                judging.assert_nothing_was_touched(flight)

    def _take_last_setpoints(self) -> None:
        """Checks that a last setpoint is at the previous one, at rest, and removes it."""
        flight, before = self.flight, None
        for item in flight.setpoints:
            if item.state in ENDED:
                assert not any((item.message.vx, item.message.vy, item.message.vz))
            if item.state in ENDED and before is not None:
                ends = [(m.x, m.y, m.z) for m in (before.message, item.message)]
                assert math.dist(*ends) < 2e-3 or self.sends_as_autopilot, "the last one jumps"
            before = item
        flight.setpoints = [item for item in flight.setpoints if item.state not in ENDED]


def run(what: str, count: int, seeds: Iterable[int]) -> Report:
    """Runs lives with `count` inputs each."""
    report = Report()
    for seed in seeds:
        Life(what, seed, report).live(count)
    return report
