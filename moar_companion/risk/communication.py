"""Communication risk CR (paper, Section IV-C (b)): the ways by which people reach the aircraft.

Inputs: the telemetry radio's margin at both ends and its transmit buffer, the pilot's transmitter,
the age of the ground station's last heartbeat, packets lost on our own link. On an IP link there
is no radio and those inputs stay unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..types import LinkStatistics, Telemetry
from ..vehicle import RiskModel
from .inputs import InputReport, at_least_unknown_alone, measured

RADIO_MAX_AGE_S = 3.0
"""A telemetry radio sends RADIO_STATUS about once a second: 3 periods."""
REMOTE_CONTROL_MAX_AGE_S = 3.0
"""RC_CHANNELS comes at 5 Hz, on a slow link at 1 Hz: 3 periods."""
LINK_MAX_AGE_S = 3.0
"""An autopilot's slowest stream is its heartbeat, once a second: 3 periods."""
LOSS_WINDOW_S = 5.0
"""Over which losses are counted: some hundred packets on a usual link."""
LOSS_SAMPLE_S = 0.5
"""Between two remembered counts, so that the window is ten of them."""
LOSS_PACKETS_MIN = 20
"""Fewer are no statistics: one packet in 20 lost is 5 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommunicationMemory:
    """Counts of our own link over the last `LOSS_WINDOW_S`, oldest first."""

    counts: tuple[LinkStatistics, ...] = ()


def remember(memory: CommunicationMemory, telemetry: Telemetry) -> CommunicationMemory:
    """The memory with the latest counts; counts that went back begin a new window.

    The window ends at the latest packet, so that without a new one nothing changes.
    """
    link, counts = telemetry.link, memory.counts
    if link is None:
        return memory
    if counts and _went_back(counts[-1], link):
        counts = ()
    begin_s = link.received_s - LOSS_WINDOW_S
    counts = tuple(count for count in counts if count.received_s >= begin_s)
    if not counts or link.received_s - counts[-1].received_s >= LOSS_SAMPLE_S:
        counts = (*counts, link)
    return CommunicationMemory(counts=counts)


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: CommunicationMemory
) -> tuple[InputReport, ...]:
    """The normalised inputs of the communication risk; `memory` includes this telemetry."""
    radio, remote, ground = telemetry.radio, telemetry.remote_control, telemetry.ground_station
    radio_s = None if radio is None else radio.received_s
    silence_s = None if ground is None else max(0.0, now_s - ground.received_s)
    people = (
        measured(
            "radio margin here",
            None if radio is None else _margin(radio.rssi, radio.noise),
            "",
            received_s=radio_s,
            now_s=now_s,
            max_age_s=RADIO_MAX_AGE_S,
            risk=model.radio_margin.fraction,
        ),
        measured(
            "radio margin there",
            None if radio is None else _margin(radio.remote_rssi, radio.remote_noise),
            "",
            received_s=radio_s,
            now_s=now_s,
            max_age_s=RADIO_MAX_AGE_S,
            risk=model.radio_margin.fraction,
        ),
        measured(
            "radio transmit buffer",
            None if radio is None else radio.transmit_buffer_percent,
            "%",
            received_s=radio_s,
            now_s=now_s,
            max_age_s=RADIO_MAX_AGE_S,
            risk=model.transmit_buffer_percent.fraction,
        ),
        measured(
            "remote control",
            None if remote is None else remote.rssi,
            "",
            received_s=None if remote is None else remote.received_s,
            now_s=now_s,
            max_age_s=REMOTE_CONTROL_MAX_AGE_S,
            risk=model.rc_rssi.fraction,
        ),
        measured(
            "ground station silence",
            silence_s,
            "s",
            received_s=None if ground is None else ground.received_s,
            now_s=now_s,
            max_age_s=math.inf,  # silence is the measurement: it never grows stale
            risk=model.ground_station_age_s.fraction,
        ),
    )
    # A good link to the autopilot alone does not say that anyone reaches it from the ground.
    loss = measured(
        "packet loss",
        _loss(memory, telemetry.link),
        "",
        received_s=None if telemetry.link is None else telemetry.link.received_s,
        now_s=now_s,
        max_age_s=LINK_MAX_AGE_S,
        risk=at_least_unknown_alone(model.packet_loss.fraction, people, model.unknown),
    )
    return *people, loss


def _margin(rssi: int | None, noise: int | None) -> float | None:
    return None if rssi is None or noise is None else float(rssi - noise)


def _loss(memory: CommunicationMemory, link: LinkStatistics | None) -> float | None:
    """The fraction of packets lost since the oldest remembered count."""
    if link is None or not memory.counts:
        return None
    received = link.packets_received - memory.counts[0].packets_received
    lost = link.packets_lost - memory.counts[0].packets_lost
    if received + lost < LOSS_PACKETS_MIN:
        return None
    return lost / (received + lost)


def _went_back(before: LinkStatistics, after: LinkStatistics) -> bool:
    return (
        after.packets_received < before.packets_received or after.packets_lost < before.packets_lost
    )
