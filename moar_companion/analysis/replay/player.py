"""Plays a recording: packets and their times in, a `Replay` out. No I/O.

The listener defines a packet: of a .tlog it is one of MAVLink, of a ULog a sample of a topic.

The flight code reads telemetry and judges risk, at its rate. The player decides and sends nothing:
the companion's actions in this flight are in the recording.

Between packets, time advances as recorded: a silent source grows stale as it did in flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from ...mavlink.packet_count import SourceStatistics
from ...mavlink.passive_listener import GROUND_STATION, Input, ListenerEvent
from ...mavlink.telemetry import Telemetry
from ...planner.adaptation import Adaptation
from ...risk import RiskEstimate, update
from ...risk.explain import index_words, weights_section
from ...risk.indices import IndexReport
from ...risk.power import PowerModel
from ...settings.vehicle import Vehicle
from ...status_values import json_dict
from ...types import AutopilotKind, Mission
from .events import SILENCE_S, EventLog
from .replay_report import Replay, ReplayMeasure, ReplaySample
from .site_position import SitePosition

if TYPE_CHECKING:
    from ...risk.drag_fit import DragFlight

RISK_PERIOD_S = 0.1
"""Period of the risk estimate, equal to that in flight."""
SAMPLE_PERIOD_S = 0.5
"""Period of samples: as often as the service reports its indices."""
_LATE_S = 1.0
"""A packet dated back by less than this is late; by more, the clock has stepped."""
_LEAP_S = 3600.0
"""A longer pause is a clock that was set, or a recording that was continued another day."""
_SAMPLE_TICKS = round(SAMPLE_PERIOD_S / RISK_PERIOD_S)
_SETTLED_S = 60.0
"""After this time without a packet all data is stale and the indices stand: samples suffice."""
_ROUNDING = 1e-3
"""Fraction of a period: microseconds since 1970 are not exact in floating point."""


Packet_contra = TypeVar("Packet_contra", contravariant=True)


class RecordingReader(Protocol[Packet_contra]):
    """Reader of a recording, with the state received so far; a `PassiveListener` is one."""

    inputs: dict[str, Input]
    vehicle_type: str | None
    leans: bool

    @property
    def telemetry(self) -> Telemetry:
        """Latest value of every source."""

    @property
    def autopilot(self) -> AutopilotKind | None:
        """Kind of the first autopilot received."""

    @property
    def sources(self) -> Mapping[tuple[int, int], SourceStatistics]:
        """Packets by system and component id."""

    def handle(self, packet: Packet_contra, now_s: float, /) -> list[ListenerEvent]:
        """Takes a packet; returns the events in it."""

    def tick(self, now_s: float, /) -> None:
        """Takes a step of time."""


class Player(Generic[Packet_contra]):
    """Plays one recording. site_position: None without a site. drag: measured from it, if given."""

    def __init__(
        self,
        vehicle: Vehicle,
        listener: RecordingReader[Packet_contra],
        site_position: SitePosition | None = None,
        *,
        drag: DragFlight | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._listener = listener
        self.entries = 0
        """Count of the packets, messages or samples that were played."""
        self._site_position = site_position
        self._drag = drag
        self._power = PowerModel.of(vehicle)
        self._adaptation = Adaptation.of(vehicle, Mission.INSPECTION)
        self._clock = _Clock()
        self._events = EventLog(battery_low=vehicle.risk.battery_remaining.high)
        self._ticks = 0
        self._risk = RiskEstimate.unknown(vehicle.risk)
        self._packet_s = 0.0
        self._known_ticks: dict[str, dict[str, int]] = {}
        self._greatest: dict[str, dict[str, float]] = {}
        self._samples: list[ReplaySample] = []

    def feed(self, recorded_s: float, packet: Packet_contra) -> None:
        """Takes the next packet and its time of recording; never raises, for any content."""
        self.entries += 1
        now_s, step = self._clock.read(recorded_s)
        self._assess_until(math.ceil(now_s / RISK_PERIOD_S - _ROUNDING))
        self._events.now_s = now_s
        if step:
            self._events.report("recording", step)
        if now_s - self._packet_s > SILENCE_S:
            self._events.report(
                "recording", f"nothing was recorded for {_duration(now_s - self._packet_s)}"
            )
        self._packet_s = now_s
        before = self._listener.telemetry
        for event in self._listener.handle(packet, now_s):
            self._events.take(event)
        after = self._listener.telemetry
        if after is not before:
            self._events.compare(before, after)

    @property
    def understood(self) -> bool:
        """True if the recording tells anything of an aircraft."""
        aircraft = (item for name, item in self._listener.inputs.items() if name != GROUND_STATION)
        return self._listener.autopilot is not None or any(item.messages for item in aircraft)

    def note(self, text: str) -> None:
        """Adds an event of the recording itself, after its last packet."""
        self._assess_to_the_end()
        self._events.report("recording", text)

    def finish(self, recording: str) -> Replay:
        """Returns the whole replay, after the last packet; `recording` is its name."""
        self._assess_to_the_end()
        listener = self._listener
        if listener.autopilot is None:
            self._events.report("recording", "no heartbeat of an autopilot")
        return Replay(
            recording=recording,
            vehicle=self._vehicle.name,
            autopilot="unknown" if listener.autopilot is None else listener.autopilot,
            vehicle_type=listener.vehicle_type,
            duration_s=self._packet_s,
            samples=tuple(self._samples),
            events=tuple(self._events.events),
            inputs={name: (item.messages, item.last_s) for name, item in listener.inputs.items()},
            measures={
                index: {
                    name: ReplayMeasure(
                        known_s=ticks * RISK_PERIOD_S,
                        greatest_risk=self._greatest[index].get(name),
                    )
                    for name, ticks in names.items()
                }
                for index, names in self._known_ticks.items()
            },
            sources={
                source: (counted.received, counted.lost)
                for source, counted in listener.sources.items()
            },
        )

    # Time

    def _assess_to_the_end(self) -> None:
        self._assess_until(math.floor(self._packet_s / RISK_PERIOD_S + _ROUNDING) + 1)
        self._events.now_s = self._packet_s

    def _assess_until(self, tick: int) -> None:
        """Runs the cycles before this tick."""
        while self._ticks < tick:
            self._events.now_s = now_s = self._ticks * RISK_PERIOD_S
            settled = now_s - self._packet_s > _SETTLED_S and self._ticks % _SAMPLE_TICKS == 0
            # The last instant always has a cycle: the next packet is compared with it.
            ticks = max(1, min(_SAMPLE_TICKS, tick - 1 - self._ticks)) if settled else 1
            self._assess(now_s, ticks)
            self._ticks += ticks

    def _assess(self, now_s: float, ticks: int) -> None:
        """Runs one cycle in place of `ticks` cycles with the same known data."""
        self._listener.tick(now_s)
        telemetry = self._listener.telemetry
        self._events.watch_link(telemetry)
        judged = telemetry
        if not self._listener.leans:
            # A plane banks, a rover tilts with the ground: their lean has other causes than wind.
            judged = replace(telemetry, attitude=None, motors=None, motor_speeds=None)
        if self._drag is not None:
            self._drag.take(judged)
        self._risk = update(
            self._risk,
            judged,
            now_s,
            model=self._vehicle.risk,
            cruise_mps=self._vehicle.speed.horizontal_mps,
            power=self._power,
        )
        reports = _by_name(self._risk)
        values = self._risk.indices.as_dict()
        for name, report in reports.items():
            self._measure(name, report, ticks)
            self._events.watch_risk(name, values[name], report)
        if self._ticks % _SAMPLE_TICKS == 0:
            self._sample(telemetry, reports, now_s)

    def _measure(self, index: str, report: IndexReport, ticks: int) -> None:
        known = self._known_ticks.setdefault(index, {})
        greatest = self._greatest.setdefault(index, {})
        for item in report.inputs:
            if not item.applies:
                continue
            count = known.setdefault(item.name, 0)
            if item.risk is not None:
                known[item.name] = count + ticks
                greatest[item.name] = max(item.risk, greatest.get(item.name, 0.0))

    def _sample(self, telemetry: Telemetry, reports: dict[str, IndexReport], now_s: float) -> None:
        values = self._risk.indices.as_dict()
        autopilot = None if self._events.silent else telemetry.autopilot
        place = None
        if self._site_position is not None and not self._events.silent:
            place = self._site_position.at(telemetry, self._risk.indices, now_s)
        self._samples.append(
            ReplaySample(
                time_s=now_s,
                risk={
                    name: values[name] if report.ever_known else None
                    for name, report in reports.items()
                },
                why={name: report.worst for name, report in reports.items()},
                reasons={
                    name: index_words(name, values[name], report)
                    for name, report in reports.items()
                },
                weights=json_dict(weights_section(self._adaptation, self._risk.indices)),
                armed=None if autopilot is None else autopilot.armed,
                mode=None if autopilot is None else autopilot.mode,
                mission_state=self._events.mission_state,
                place=place,
            )
        )


class _Clock:
    """Converts the recorder's clock to time since the start, which never decreases."""

    def __init__(self) -> None:
        self._begin_s: float | None = None
        self._last_s = 0.0

    def read(self, recorded_s: float) -> tuple[float, str | None]:
        """Returns a packet's time, and a text if the clock stepped: then no time has passed."""
        if self._begin_s is None:
            self._begin_s = recorded_s
        step_s = recorded_s - self._begin_s - self._last_s
        if step_s < -_LATE_S or step_s > _LEAP_S:
            self._begin_s = recorded_s - self._last_s
            direction = "back" if step_s < 0.0 else "forward"
            return self._last_s, f"the recorder's clock steps {direction} by {_duration(step_s)}"
        self._last_s += max(0.0, step_s)
        return self._last_s, None


def _by_name(risk: RiskEstimate) -> dict[str, IndexReport]:
    return {name: getattr(risk.report, name) for name in risk.indices.as_dict()}


def _duration(seconds: float) -> str:
    seconds = abs(seconds)
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.1f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172_800.0 else f"{seconds / 86_400.0:.1f} d"
