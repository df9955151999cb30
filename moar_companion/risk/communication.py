"""Communication risk CR (paper, Section IV-C (b)): the ways by which people reach the aircraft.

Inputs: the telemetry radio's margin at both ends, its broken packets and its transmit buffer; the
pilot's transmitter; the age of the ground station's last heartbeat; and our own link to the
autopilot, by which its words come: packets lost on it both ways, its data rate and its silence. A
good link to the autopilot does not say that anyone on the ground is heard: where nothing else is
known, the number of known ways to the ground is 0, and that is what decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ..types import LandedState, LinkNode, LinkStatistics, Radio, Telemetry
from ..vehicle import RiskModel
from .inputs import YES_OR_NO, InputReport, certain, heard

_RADIO_MAX_AGE_S = 3.0
"""A telemetry radio sends RADIO_STATUS about once a second: 3 periods."""
_REMOTE_CONTROL_MAX_AGE_S = 3.0
"""RC_CHANNELS comes at 5 Hz, SYS_STATUS at 2 Hz, on a slow link at 1 Hz: 3 periods."""
_LINK_MAX_AGE_S = 3.0
"""An autopilot's slowest streams are its heartbeat and LINK_NODE_STATUS, at 1 Hz: 3 periods."""
_SILENCE_MAX_AGE_S = math.inf
"""Of a silence: it is the measurement itself, and never grows stale."""
_WINDOW_S = 3.0
"""Over which packets are counted: some hundred on a usual link, and three of a radio's words."""
_SAMPLE_S = 0.5
"""Between two remembered counts, so that the window is six of them."""
_PACKETS_MIN = 20
"""Fewer are no statistics: one packet in 20 lost is 5 %."""
_USUAL_RATE_S = 120.0
"""Time constant of the usual data rate: links fade within seconds, streams change for good."""
_USUAL_RATE_KNOWN_S = 20.0
"""Streams are asked for, and flow, within some seconds."""


class _Counted(Protocol):
    @property
    def received_s(self) -> float: ...


_Source = TypeVar("_Source", bound=_Counted)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommunicationMemory:
    """Counts over the last `_WINDOW_S`, oldest first: what comes here, goes there, and the radio's.

    usual_rate_hz: the mean rate of streams on our own link since `usual_since_s`, or over the last
    minutes; None before anything was counted. A rate so low that it is a risk becomes usual on the
    ground alone.
    """

    here: tuple[LinkStatistics, ...] = ()
    there: tuple[LinkNode, ...] = ()
    radio: tuple[Radio, ...] = ()
    usual_rate_hz: float | None = None
    usual_since_s: float = 0.0


def remember(
    memory: CommunicationMemory, telemetry: Telemetry, model: RiskModel
) -> CommunicationMemory:
    """The memory with the latest counts; counts that went back begin a new window.

    A window ends at its source's latest word, so that without a new one nothing changes.
    """
    here = _window(memory.here, telemetry.link, lambda link: link.packets_received)
    usual_rate_hz, usual_since_s = memory.usual_rate_hz, memory.usual_since_s
    rate_hz = _rate_hz(here, here[-1]) if here and here is not memory.here else None
    if rate_hz is not None:
        if usual_rate_hz is None:
            usual_rate_hz, usual_since_s = rate_hz, here[-1].received_s
        age_s, landed = here[-1].received_s - usual_since_s, telemetry.landed
        grounded = landed is not None and landed.state is LandedState.ON_GROUND
        fallen = age_s >= _USUAL_RATE_KNOWN_S and usual_rate_hz > 0.0
        fallen = fallen and model.data_rate.fraction(rate_hz / usual_rate_hz) > 0.0
        if grounded or not fallen:
            span_s = min(age_s, _USUAL_RATE_S) + _SAMPLE_S
            usual_rate_hz += _SAMPLE_S / span_s * (rate_hz - usual_rate_hz)
    return CommunicationMemory(
        here=here,
        there=_window(memory.there, telemetry.link_node, lambda node: node.packets_received),
        radio=_window(memory.radio, telemetry.radio, lambda radio: radio.receive_errors),
        usual_rate_hz=usual_rate_hz,
        usual_since_s=usual_since_s,
    )


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    """The normalised inputs of the communication risk; `memory` includes this telemetry."""
    radio = _radio_inputs(telemetry, now_s, model, memory)
    remote = _remote_control_inputs(telemetry, now_s, model)
    station, link = telemetry.ground_station, telemetry.link
    ground = heard(station, now_s, _SILENCE_MAX_AGE_S).says(
        "ground station silence",
        None if station is None else max(0.0, now_s - station.received_s),
        "s",
        model.ground_station_age_s.fraction,
    )
    # Signals and heartbeats: a free buffer or channels that go on do not say that anyone is there.
    ways = (radio[:2], remote[:2], (ground,))
    known_ways = heard(link, now_s, _LINK_MAX_AGE_S).says(
        "known ways to the ground",
        sum(any(report.known for report in way) for way in ways),
        "",
        lambda known: 0.0 if known else model.unknown,
    )
    return (
        *radio,
        *remote,
        ground,
        *_link_inputs(telemetry, now_s, model, memory),
        known_ways,
    )


def _radio_inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    radio = telemetry.radio
    told = heard(radio, now_s, _RADIO_MAX_AGE_S)
    return (
        told.says(
            "radio margin here",
            None if radio is None else _margin(radio.rssi, radio.noise),
            "",
            model.radio_margin.fraction,
        ),
        told.says(
            "radio margin there",
            None if radio is None else _margin(radio.remote_rssi, radio.remote_noise),
            "",
            model.radio_margin.fraction,
        ),
        told.says(
            "radio receive errors",
            _errors_hz(memory.radio, radio),
            "/s",
            model.receive_errors_hz.fraction,
        ),
        told.says(
            "radio transmit buffer",
            None if radio is None else radio.transmit_buffer_percent,
            "%",
            model.transmit_buffer_percent.fraction,
        ),
    )


def _remote_control_inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel
) -> tuple[InputReport, ...]:
    remote, readiness, link = telemetry.remote_control, telemetry.readiness, telemetry.link
    ok = None if readiness is None else readiness.remote_control_ok
    silence_s = None
    if remote is not None and link is not None:
        # While all is silent, it is not the transmitter that is.
        silence_s = max(0.0, link.received_s - remote.received_s)
    return (
        heard(remote, now_s, _REMOTE_CONTROL_MAX_AGE_S).says(
            "remote control",
            None if remote is None else remote.rssi,
            "of full signal",
            model.rc_rssi.fraction,
        ),
        heard(readiness, now_s, _REMOTE_CONTROL_MAX_AGE_S).says(
            "remote control lost", None if ok is None else float(not ok), YES_OR_NO, certain
        ),
        heard(link, now_s, _LINK_MAX_AGE_S).says(
            "remote control silence", silence_s, "s", model.remote_control_age_s.fraction
        ),
    )


def _link_inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    """Of our own link to the autopilot."""
    link, node = telemetry.link, telemetry.link_node
    told = heard(link, now_s, _LINK_MAX_AGE_S)
    return (
        told.says(
            "packet loss", _loss(memory.here, link), "of packets", model.packet_loss.fraction
        ),
        heard(node, now_s, _LINK_MAX_AGE_S).says(
            "packet loss to the autopilot",
            _loss(memory.there, node),
            "of packets",
            model.packet_loss.fraction,
        ),
        told.says(
            "data rate", _rate_to_usual(memory, link), "of the usual", model.data_rate.fraction
        ),
        heard(link, now_s, _SILENCE_MAX_AGE_S).says(
            "autopilot silence",
            None if link is None else max(0.0, now_s - link.received_s),
            "s",
            model.autopilot_age_s.fraction,
        ),
    )


def _margin(rssi: int | None, noise: int | None) -> float | None:
    return None if rssi is None or noise is None else float(rssi - noise)


def _window(
    window: tuple[_Source, ...],
    latest: _Source | None,
    count_of: Callable[[_Source], int],
) -> tuple[_Source, ...]:
    """The window with the latest counts, or the same one where nothing is to be added."""
    if latest is None:
        return window
    if window:
        if count_of(latest) < count_of(window[-1]):
            return (latest,)
        if latest.received_s - window[-1].received_s < _SAMPLE_S:
            return window
    begin_s = latest.received_s - _WINDOW_S
    return (*(count for count in window if count.received_s >= begin_s), latest)


def _loss(
    window: tuple[LinkStatistics, ...] | tuple[LinkNode, ...],
    latest: LinkStatistics | LinkNode | None,
) -> float | None:
    """The fraction of packets lost since the oldest remembered count."""
    if latest is None or not window:
        return None
    received = latest.packets_received - window[0].packets_received
    # A late packet was counted as lost before it came.
    lost = max(0, latest.packets_lost - window[0].packets_lost)
    return lost / (received + lost) if received + lost >= _PACKETS_MIN else None


def _rate_hz(window: tuple[LinkStatistics, ...], latest: LinkStatistics) -> float | None:
    """Packets of streams a second since the oldest remembered count."""
    if not window:
        return None
    elapsed_s = latest.received_s - window[0].received_s
    if elapsed_s < 0.5 * _WINDOW_S:
        return None
    return (_streamed(latest) - _streamed(window[0])) / elapsed_s


def _streamed(link: LinkStatistics) -> int:
    # A list of parameters in a burst is no usual rate, and its end no fall of it.
    return link.packets_received - link.off_stream


def _rate_to_usual(memory: CommunicationMemory, link: LinkStatistics | None) -> float | None:
    usual_hz = memory.usual_rate_hz
    if link is None or usual_hz is None or usual_hz * _WINDOW_S < _PACKETS_MIN:
        return None
    rate_hz = _rate_hz(memory.here, link)
    early = link.received_s - memory.usual_since_s < _USUAL_RATE_KNOWN_S
    return None if early or rate_hz is None else rate_hz / usual_hz


def _errors_hz(window: tuple[Radio, ...], radio: Radio | None) -> float | None:
    """Broken packets a second since the oldest remembered count."""
    if radio is None or not window:
        return None
    elapsed_s = radio.received_s - window[0].received_s
    if elapsed_s < 0.5 * _WINDOW_S:
        return None
    return (radio.receive_errors - window[0].receive_errors) / elapsed_s
