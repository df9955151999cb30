"""Messages of telemetry radios."""

from __future__ import annotations

import pytest

from moar_companion.mavlink import translate
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.radio import RadioChannels, RadioLink
from moar_companion.mavlink.telemetry import Telemetry
from moar_companion.settings.risk_model import RadioKind

STATS = {
    "target_system": 1,
    "target_component": 0,
    "flags": 1,
    "rx_LQ_rc": 98,
    "rx_LQ_ser": 90,
    "rx_rssi1": 85,
    "rx_snr1": 7,
    "tx_LQ_ser": 80,
    "tx_rssi1": 91,
    "tx_snr1": 127,
    "rx_rssi2": 70,
    "rx_snr2": 9,
    "tx_rssi2": 255,
    "tx_snr2": 127,
    "frequency1": 868.0e6,
    "frequency2": 0.0,
}


def received(message, sender=(51, 68)):
    header = message.get_header()
    header.srcSystem, header.srcComponent = sender
    return translate.update(Telemetry(), message, 5.0)


def link(**changes):
    return received(create("MLRS_RADIO_LINK_STATS", **STATS | changes)).radio_link


EXPECTED = RadioLink(
    received_s=5.0,
    quality=0.9,
    remote_quality=0.8,
    signal_dbm=-85.0,
    remote_signal_dbm=-91.0,
)


def test_link_statistics_of_mlrs_are_read():
    assert link() == EXPECTED


@pytest.mark.parametrize(
    ("changes", "field", "value"),
    [
        pytest.param({"flags": 1 | 2}, "signal_dbm", -70.0, id="antenna 2"),
        pytest.param({"flags": 1 | 16}, "remote_signal_dbm", -91.0, id="antenna 2 unknown"),
        pytest.param({"flags": 0}, "signal_dbm", None, id="no dBm"),
        pytest.param({"rx_rssi1": 255}, "signal_dbm", None, id="signal unknown"),
        pytest.param({"rx_rssi1": 0}, "signal_dbm", -255.0, id="no reception"),
        pytest.param({"rx_LQ_rc": 255}, "quality", 0.9, id="quality of control unknown"),
        pytest.param({"tx_LQ_ser": 255}, "remote_quality", None, id="quality unknown"),
        pytest.param({"rx_LQ_rc": 0}, "quality", 0.0, id="link lost"),
    ],
)
def test_each_field_of_the_statistics_has_its_unknown(changes, field, value):
    assert getattr(link(**changes), field) == value


def test_link_statistics_within_a_tunnel_are_the_same():
    kind = mavlink.mavlink_map[60045]
    content = kind.unpacker.pack(*(STATS[name] for name in kind.ordered_fieldnames))
    tunnel = {
        "target_system": 1,
        "target_component": 0,
        "payload_type": 208,
        "payload_length": len(content),
        "payload": list(content.ljust(128, b"\x00")),
    }
    assert received(create("TUNNEL", **tunnel)).radio_link == EXPECTED
    assert received(create("TUNNEL", **tunnel | {"payload_type": 209})).radio_link is None
    assert received(create("TUNNEL", **tunnel), sender=(1, 154)).radio_link is None


def test_the_failsafe_of_the_radios_channels_is_read():
    fields = {
        "target_system": 1,
        "target_component": 0,
        "time_last_update_ms": 7,
        "count": 16,
        "channels": [0] * 32,
    }
    for flags, failsafe in ((0, False), (1, True), (2, False)):
        channels = received(create("RADIO_RC_CHANNELS", **fields, flags=flags)).radio_channels
        assert channels == RadioChannels(received_s=5.0, failsafe=failsafe)


def test_the_kind_of_a_radio_is_recognised_by_its_ids():
    fields = {"rssi": 237, "remrssi": 31, "noise": 9, "remnoise": 0, "txbuf": 100}
    status = create("RADIO_STATUS", **fields, rxerrors=0, fixed=0)
    assert received(status, sender=(255, 68)).radio.kind is RadioKind.ELRS
    assert received(status, sender=(51, 68)).radio.kind is RadioKind.SIK
