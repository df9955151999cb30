"""Messages of telemetry radios to `Telemetry`. Pure.

Part of `translate`. RADIO_STATUS is of every radio; mLRS sends its link statistics as a message of
the storm32 dialect or within TUNNEL, and the transmitter's channels to the autopilot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from .dialect import Message, id_of, mavlink
from .radio import Radio, RadioChannels, RadioLink, kind_of
from .telemetry import Telemetry

_UNKNOWN_U8 = 255
_TELEMETRY_RADIO = int(mavlink.MAV_COMP_ID_TELEMETRY_RADIO)
_LINK_STATS = id_of("MLRS_RADIO_LINK_STATS")
_LINK_STATS_IN_TUNNEL = 208
"""Payload type of mLRS (MLRS_TUNNEL_PAYLOAD_TYPE_RADIO_LINK_STATS): the message's own fields."""
_RSSI_IN_DBM, _RECEIVES_BY_ANTENNA_2, _PEER_RECEIVES_BY_ANTENNA_2 = 1, 2, 16
"""MLRS_RADIO_LINK_STATS_FLAGS."""
_FAILSAFE = 1
"""RADIO_RC_CHANNELS_FLAGS."""


def _radio_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    sender = message.get_srcSystem(), message.get_srcComponent()
    return with_radio(
        telemetry,
        now_s,
        sender=sender if sender[0] else None,
        here=(message.rssi, message.noise),
        there=(message.remrssi, message.remnoise),
        receive_errors=message.rxerrors,
        corrected=message.fixed,
        free_percent=message.txbuf,
    )


def with_radio(
    telemetry: Telemetry,
    now_s: float,
    *,
    here: tuple[int, int],
    there: tuple[int, int],
    receive_errors: int,
    corrected: int,
    free_percent: int,
    sender: tuple[int, int] | None = None,
) -> Telemetry:
    """Telemetry with a radio's status. here, there: signal and noise in the radio's units.

    corrected: count of corrected packets. sender: None in a log.
    """
    before = telemetry.radio
    known = before is not None and before.remote_rssi is not None
    # A radio reports 0 and 0 for its peer if it has lost the peer or never had one.
    remote = known or max(there) > 0
    return replace(
        telemetry,
        radio=Radio(
            received_s=now_s,
            rssi=_signal(here[0]),
            remote_rssi=_signal(there[0]) if remote else None,
            noise=_signal(here[1]),
            remote_noise=_signal(there[1]) if remote else None,
            receive_errors=receive_errors,
            transmit_buffer_percent=free_percent if free_percent <= 100 else None,
            kind=kind_of(
                sender,
                remote_rssi=there[0],
                noise=here[1],
                remote_noise=there[1],
                errors=receive_errors + corrected,
                before=None if before is None else before.kind,
            ),
        ),
    )


def _signal(value: int) -> int | None:
    return None if value == _UNKNOWN_U8 else value


def _link_stats(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    here = message.flags & _RECEIVES_BY_ANTENNA_2
    there = message.flags & _PEER_RECEIVES_BY_ANTENNA_2
    in_dbm = bool(message.flags & _RSSI_IN_DBM)
    link = RadioLink(
        received_s=now_s,
        quality=_quality(message.rx_LQ_rc, message.rx_LQ_ser),
        remote_quality=_quality(message.tx_LQ_ser),
        signal_dbm=_dbm(message.rx_rssi1, message.rx_rssi2 if here else None) if in_dbm else None,
        remote_signal_dbm=_dbm(message.tx_rssi1, message.tx_rssi2 if there else None)
        if in_dbm
        else None,
    )
    return replace(telemetry, radio_link=link)


def _quality(*percents: int) -> float | None:
    known = [percent for percent in percents if percent <= 100]
    return min(known) * 0.01 if known else None


def _dbm(first: int, second: int | None) -> float | None:
    """Signal of the receiving antenna, given without its sign; 0, no reception, is the weakest."""
    rssi = first if second in {None, _UNKNOWN_U8} else second
    if rssi is None or rssi == _UNKNOWN_U8:
        return None
    return -float(rssi or _UNKNOWN_U8)


def _tunnel(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if (
        message.get_srcComponent() != _TELEMETRY_RADIO
        or message.payload_type != _LINK_STATS_IN_TUNNEL
    ):
        return telemetry
    kind = mavlink.mavlink_map[_LINK_STATS]
    values = kind.unpacker.unpack(bytes(message.payload)[: kind.unpacker.size])
    return _link_stats(telemetry, kind(*(values[index] for index in kind.orders)), now_s)


def _channels(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    channels = RadioChannels(received_s=now_s, failsafe=bool(message.flags & _FAILSAFE))
    return replace(telemetry, radio_channels=channels)


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    int(mavlink.MAVLINK_MSG_ID_RADIO_STATUS): _radio_status,
    # With the same content, of radios before 2014.
    int(mavlink.MAVLINK_MSG_ID_RADIO): _radio_status,
    _LINK_STATS: _link_stats,
    int(mavlink.MAVLINK_MSG_ID_TUNNEL): _tunnel,
    id_of("RADIO_RC_CHANNELS"): _channels,
}
RADIO_IDS = frozenset(TRANSLATORS)
"""Messages that radios send, under ids of their own."""
