"""Telemetry radios: their reports as values, and the meaning of the fields by kind of radio. Pure.

RADIO_STATUS has no units: each firmware fills its fields in its own way, and none names itself.
`kind_of` recognises a firmware by its ids and by fields that it alone leaves at 0 or 255; `signal`
gives what its fields mean. Sources: SiK (ids "3" and "D", 51 and 68; RFD900x as it), mLRS
(mavlink_interface_rx.h, rssi_i8_to_ap, docs/LINK_STATS), ExpressLRS (SerialMavlink.cpp). WLAN
bridges such as MavESP8266 and wfb-ng (proxy.py: signed dBm) use the fields for yet other values:
unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..settings.risk_model import RadioKind

_SIK_IDS = (51, 68)
"""Also of mLRS. ExpressLRS has the system id that users give it, 255 by default."""
_TELEMETRY_RADIO = 68
"""MAV_COMP_ID_TELEMETRY_RADIO."""
_UNKNOWN_U8 = 255
_SIK_PER_DB = 1.9
"""SiK's unit: signal in dBm is about rssi / 1.9 - 127 (ArduPilot's page on SiK radios)."""
_MLRS_DBM = (-120, -50)
"""Signals that mLRS reports as 0 and 254."""
_MLRS_SENSITIVITY_DBM = -105
"""Weakest signal that mLRS receives in its 50 Hz mode; its slower modes receive weaker ones."""
_MLRS_MOST_NOISE = 127
"""Greatest noise that mLRS reports."""
_ELRS_MOST_DBM = 127
"""Weakest signal that ExpressLRS can report, without its sign: greater is a negative number."""
_ELRS_MOST_SNR_DB = 40
"""Above any signal-to-noise ratio of ExpressLRS, which reports it as a signed byte in `noise`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Radio:
    """RADIO_STATUS of a telemetry radio, in the radio's own units."""

    received_s: float
    rssi: int | None
    remote_rssi: int | None
    noise: int | None
    remote_noise: int | None
    receive_errors: int
    transmit_buffer_percent: int | None
    kind: RadioKind = RadioKind.SIK
    """Recognised by its messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioLink:
    """MLRS_RADIO_LINK_STATS: link quality and signal at this radio and at its peer.

    quality, remote_quality: fraction of packets received, the worse of control and telemetry.
    """

    received_s: float
    quality: float | None
    remote_quality: float | None
    signal_dbm: float | None
    remote_signal_dbm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioChannels:
    """RADIO_RC_CHANNELS: the radio's channels of the pilot's transmitter.

    failsafe: True while the transmitter is not received.
    """

    received_s: float
    failsafe: bool


class Signal(NamedTuple):
    """Meaning of a radio's report; None: not reported.

    margin, remote_margin: of the signal over noise or sensitivity, in SiK units, at least 0.
    quality, remote_quality: fraction of packets received. receive_errors: count of broken packets.
    """

    margin: float | None = None
    remote_margin: float | None = None
    quality: float | None = None
    remote_quality: float | None = None
    receive_errors: int | None = None


def kind_of(
    sender: tuple[int, int] | None,
    *,
    remote_rssi: int,
    noise: int,
    remote_noise: int,
    errors: int,
    before: RadioKind | None,
) -> RadioKind:
    """Kind of the radio that sent a RADIO_STATUS, by its fields.

    sender: its ids; None in a log, which has none. errors: broken and corrected packets. before:
    the kind of the radio until now.
    """
    may_be_elrs = (
        remote_noise == 0
        and errors == 0
        and remote_rssi <= _ELRS_MOST_DBM
        and min(noise, 256 - noise) <= _ELRS_MOST_SNR_DB
    )
    if sender not in {None, _SIK_IDS}:
        of_radio = sender is not None and sender[1] == _TELEMETRY_RADIO
        return RadioKind.ELRS if of_radio and may_be_elrs else RadioKind.UNKNOWN
    if errors == 0 and remote_noise == _UNKNOWN_U8 and noise <= _MLRS_MOST_NOISE:
        return RadioKind.MLRS
    # A SiK radio that receives its peer never reports a noise of 0 there.
    received = remote_rssi > 0 or before is RadioKind.ELRS
    if sender is None and may_be_elrs and received:
        return RadioKind.ELRS
    return RadioKind.SIK if noise > 0 else RadioKind.UNKNOWN


def signal(radio: Radio, kind: RadioKind) -> Signal:
    """Meaning of a RADIO_STATUS of this kind of radio."""
    if kind is RadioKind.SIK:
        return Signal(
            margin=_above(radio.rssi, radio.noise),
            remote_margin=_above(radio.remote_rssi, radio.remote_noise),
            receive_errors=radio.receive_errors,
        )
    if kind is RadioKind.MLRS:
        return Signal(
            margin=_mlrs_margin(_mlrs_dbm(radio.rssi)),
            remote_margin=_mlrs_margin(_mlrs_dbm(radio.remote_rssi)),
        )
    if kind is RadioKind.ELRS:
        # 255 is a quality of 100 %, and not the unknown value of other radios.
        return Signal(quality=1.0 if radio.rssi is None else radio.rssi / _UNKNOWN_U8)
    return Signal()


def link_signal(link: RadioLink) -> Signal:
    """Meaning of link statistics."""
    return Signal(
        margin=_mlrs_margin(link.signal_dbm),
        remote_margin=_mlrs_margin(link.remote_signal_dbm),
        quality=link.quality,
        remote_quality=link.remote_quality,
    )


def _above(rssi: int | None, noise: int | None) -> float | None:
    return None if rssi is None or noise is None else float(max(0, rssi - noise))


def _mlrs_dbm(rssi: int | None) -> float | None:
    if rssi is None:
        return None
    low, high = _MLRS_DBM
    return low + (high - low) * rssi / (_UNKNOWN_U8 - 1)


def _mlrs_margin(signal_dbm: float | None) -> float | None:
    if signal_dbm is None:
        return None
    return max(0.0, _SIK_PER_DB * (signal_dbm - _MLRS_SENSITIVITY_DBM))
