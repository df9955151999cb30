"""Communication risk CR (paper, Section IV-C (b)): the links from the ground to the aircraft.

Inputs from the ground: the telemetry radio's margin and link quality at both ends, as far as its
kind reports them, its broken packets and its transmit buffer; the pilot's transmitter; the age of
the ground station's last heartbeat. Inputs of the companion's own link to the autopilot: packets
lost both ways, its data rate and its silence. A good link to the autopilot does not prove a link to
the ground. Without any other input the number of known links to the ground is 0, and decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ..mavlink.radio import Radio, Signal, link_signal, signal
from ..mavlink.telemetry import LandedState, LinkNode, LinkStatistics, Telemetry
from ..settings.risk_model import RadioKind, RiskModel
from .input_reports import YES_OR_NO, InputReport, certain, source_of

_RADIO_MAX_AGE_S = 3.0
"""Maximum age of RADIO_STATUS: 3 periods at about 1 Hz."""
_UNITS_UNKNOWN = "this radio's units are not known, see risk.radio"
_REMOTE_CONTROL_MAX_AGE_S = 3.0
"""Maximum age of RC_CHANNELS (5 Hz) and SYS_STATUS (2 Hz): 3 periods at 1 Hz of a slow link."""
_LINK_MAX_AGE_S = 3.0
"""Maximum age of the slowest streams, the heartbeat and LINK_NODE_STATUS: 3 periods at 1 Hz."""
_SILENCE_MAX_AGE_S = math.inf
"""Maximum age of a silence: the age is the measurement itself, and never grows stale."""
_WINDOW_S = 3.0
"""Window of the packet counts: some hundred packets on a usual link, three of a radio."""
_SAMPLE_S = 0.5
"""Time between two stored counts, so that the window has six of them."""
_PACKETS_MIN = 20
"""Least packets for a loss rate: one lost in 20 is 5 %."""
_USUAL_RATE_S = 120.0
"""Time constant of the usual data rate: links fade within seconds, stream changes are permanent."""
_USUAL_RATE_KNOWN_S = 20.0
"""Time until the usual rate counts: requested streams start within some seconds."""


class _Counted(Protocol):
    @property
    def received_s(self) -> float: ...


_Source = TypeVar("_Source", bound=_Counted)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommunicationMemory:
    """Counts over the last `_WINDOW_S`, oldest first: received, sent to the autopilot, radio.

    usual_rate_hz: mean rate of streams on the companion's own link since `usual_since_s`, or over
    the last minutes; None before any count. A rate so low that it is a risk becomes usual only on
    the ground.
    """

    here: tuple[LinkStatistics, ...] = ()
    there: tuple[LinkNode, ...] = ()
    radio: tuple[Radio, ...] = ()
    usual_rate_hz: float | None = None
    usual_since_s: float = 0.0


def remember(
    memory: CommunicationMemory, telemetry: Telemetry, model: RiskModel
) -> CommunicationMemory:
    """Memory with the latest counts; counts that decrease start a new window.

    A window ends at its source's latest message, so that without a new one it stays the same.
    """
    here = _window(
        memory.here, telemetry.link, lambda link: (link.packets_received, _streamed(link))
    )
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
        there=_window(memory.there, telemetry.link_node, lambda node: (node.packets_received,)),
        radio=_window(memory.radio, telemetry.radio, lambda radio: (radio.receive_errors,)),
        usual_rate_hz=usual_rate_hz,
        usual_since_s=usual_since_s,
    )


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    """Normalised inputs of the communication risk; `memory` includes this telemetry."""
    radio = _radio_inputs(telemetry, now_s, model, memory)
    remote = _remote_control_inputs(telemetry, now_s, model)
    station, link = telemetry.ground_station, telemetry.link
    ground = source_of(station, now_s, _SILENCE_MAX_AGE_S).input_report(
        "ground station silence",
        None if station is None else max(0.0, now_s - station.received_s),
        "s",
        model.ground_station_age_s.fraction,
    )
    # Signals and heartbeats count: a free buffer or continuing channels prove no link to an
    # operator.
    to_ground = (radio[:4], remote[:2], (ground,))
    known_to_ground = source_of(link, now_s, _LINK_MAX_AGE_S).input_report(
        "known links to the ground",
        sum(any(report.known for report in reports) for reports in to_ground),
        "",
        lambda known: 0.0 if known else model.unknown,
    )
    return (
        *radio,
        *remote,
        ground,
        *_link_inputs(telemetry, now_s, model, memory),
        known_to_ground,
    )


def _radio_inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    radio, link = telemetry.radio, telemetry.radio_link
    source = of_signal = source_of(radio, now_s, _RADIO_MAX_AGE_S)
    kind, reported = model.radio, Signal()
    if radio is not None:
        kind = kind or radio.kind
        reported = signal(radio, kind)
    errors_hz = None if reported.receive_errors is None else _errors_hz(memory.radio, radio)
    if link is not None:
        of_signal, kind = source_of(link, now_s, _RADIO_MAX_AGE_S), RadioKind.MLRS
        reported = link_signal(link)
    margins = kind is not RadioKind.ELRS
    remark = _UNITS_UNKNOWN if kind is RadioKind.UNKNOWN else ""
    return (
        of_signal.input_report(
            "radio margin here",
            reported.margin,
            "",
            model.radio_margin.fraction,
            applies=margins,
            remark=remark,
        ),
        of_signal.input_report(
            "radio margin there",
            reported.remote_margin,
            "",
            model.radio_margin.fraction,
            applies=margins,
            remark=remark,
        ),
        *(
            of_signal.input_report(
                f"radio link quality {end}",
                quality,
                "of its packets",
                model.radio_quality.fraction,
                applies=quality is not None,
            )
            for end, quality in (
                ("here", reported.quality),
                ("there", reported.remote_quality),
            )
        ),
        source.input_report(
            "radio receive errors", errors_hz, "/s", model.receive_errors_hz.fraction
        ),
        source.input_report(
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
    channels = telemetry.radio_channels
    ok = None if readiness is None else readiness.remote_control_ok
    silence_s = None
    if remote is not None and link is not None:
        # While the whole link is silent, the transmitter does not count as silent.
        silence_s = max(0.0, link.received_s - remote.received_s)
    return (
        source_of(remote, now_s, _REMOTE_CONTROL_MAX_AGE_S).input_report(
            "remote control",
            None if remote is None else remote.rssi,
            "of full signal",
            model.rc_rssi.fraction,
        ),
        source_of(readiness, now_s, _REMOTE_CONTROL_MAX_AGE_S).input_report(
            "remote control lost", None if ok is None else float(not ok), YES_OR_NO, certain
        ),
        source_of(link, now_s, _LINK_MAX_AGE_S).input_report(
            "remote control silence", silence_s, "s", model.remote_control_age_s.fraction
        ),
        source_of(channels, now_s, _REMOTE_CONTROL_MAX_AGE_S).input_report(
            "remote control failsafe",
            None if channels is None else float(channels.failsafe),
            YES_OR_NO,
            certain,
            applies=channels is not None,
        ),
    )


def _link_inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    """Inputs of the companion's own link to the autopilot."""
    link, node = telemetry.link, telemetry.link_node
    source = source_of(link, now_s, _LINK_MAX_AGE_S)
    return (
        source.input_report(
            "packet loss", _loss(memory.here, link), "of packets", model.packet_loss.fraction
        ),
        source_of(node, now_s, _LINK_MAX_AGE_S).input_report(
            "packet loss to the autopilot",
            _loss(memory.there, node),
            "of packets",
            model.packet_loss.fraction,
        ),
        source.input_report(
            "data rate", _rate_to_usual(memory, link), "of the usual", model.data_rate.fraction
        ),
        source_of(link, now_s, _SILENCE_MAX_AGE_S).input_report(
            "autopilot silence",
            None if link is None else max(0.0, now_s - link.received_s),
            "s",
            model.autopilot_age_s.fraction,
        ),
    )


def _window(
    window: tuple[_Source, ...],
    latest: _Source | None,
    counts_of: Callable[[_Source], tuple[int, ...]],
) -> tuple[_Source, ...]:
    """Window with the latest counts, or the same window if there is none to add."""
    if latest is None:
        return window
    if window:
        counts = zip(counts_of(latest), counts_of(window[-1]), strict=True)
        if any(now < before for now, before in counts):
            return (latest,)
        if latest.received_s - window[-1].received_s < _SAMPLE_S:
            return window
    begin_s = latest.received_s - _WINDOW_S
    return (*(count for count in window if count.received_s >= begin_s), latest)


def _loss(
    window: tuple[LinkStatistics, ...] | tuple[LinkNode, ...],
    latest: LinkStatistics | LinkNode | None,
) -> float | None:
    """Fraction of packets lost since the oldest stored count."""
    if latest is None or not window:
        return None
    received = latest.packets_received - window[0].packets_received
    # A late packet counts as lost before its arrival.
    lost = max(0, latest.packets_lost - window[0].packets_lost)
    return lost / (received + lost) if received + lost >= _PACKETS_MIN else None


def _rate_hz(window: tuple[LinkStatistics, ...], latest: LinkStatistics) -> float | None:
    """Packets of streams a second since the oldest stored count."""
    if not window:
        return None
    elapsed_s = latest.received_s - window[0].received_s
    if elapsed_s < 0.5 * _WINDOW_S:
        return None
    return (_streamed(latest) - _streamed(window[0])) / elapsed_s


def _streamed(link: LinkStatistics) -> int:
    # A burst of parameters does not change the usual rate, and its end is no drop.
    return link.packets_received - link.off_stream


def _rate_to_usual(memory: CommunicationMemory, link: LinkStatistics | None) -> float | None:
    usual_hz = memory.usual_rate_hz
    if link is None or usual_hz is None or usual_hz * _WINDOW_S < _PACKETS_MIN:
        return None
    rate_hz = _rate_hz(memory.here, link)
    early = link.received_s - memory.usual_since_s < _USUAL_RATE_KNOWN_S
    return None if early or rate_hz is None else rate_hz / usual_hz


def _errors_hz(window: tuple[Radio, ...], radio: Radio | None) -> float | None:
    """Broken packets a second since the oldest stored count."""
    if radio is None or not window:
        return None
    elapsed_s = radio.received_s - window[0].received_s
    if elapsed_s < 0.5 * _WINDOW_S:
        return None
    return (radio.receive_errors - window[0].receive_errors) / elapsed_s
