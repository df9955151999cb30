"""Kinds of telemetry radios, and what their fields mean."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.radio import Radio, RadioLink, kind_of, link_signal, signal
from moar_companion.settings.risk_model import RadioKind

SIK, MLRS, ELRS, UNKNOWN = RadioKind.SIK, RadioKind.MLRS, RadioKind.ELRS, RadioKind.UNKNOWN


def kind(sender, remote_rssi, noise, remote_noise, errors=0, before=None):
    return kind_of(
        sender,
        remote_rssi=remote_rssi,
        noise=noise,
        remote_noise=remote_noise,
        errors=errors,
        before=before,
    )


@pytest.mark.parametrize(
    ("sender", "remote_rssi", "noise", "remote_noise", "errors", "expected"),
    [
        pytest.param((51, 68), 190, 40, 41, 7, SIK, id="SiK"),
        pytest.param((51, 68), 0, 40, 0, 0, SIK, id="SiK without its peer"),
        pytest.param((51, 68), 180, 3, 255, 0, MLRS, id="mLRS"),
        pytest.param((51, 68), 255, 127, 255, 0, MLRS, id="mLRS without its peer"),
        pytest.param((255, 68), 60, 10, 0, 0, ELRS, id="ExpressLRS"),
        pytest.param((1, 68), 108, 248, 0, 0, ELRS, id="ExpressLRS, negative SNR, another id"),
        pytest.param((255, 68), 0, 0, 0, 0, ELRS, id="ExpressLRS, link lost"),
        pytest.param((1, 240), 0, 0, 3, 9, UNKNOWN, id="MavESP8266"),
        pytest.param((1, 68), 200, 160, 158, 0, UNKNOWN, id="another firmware of a radio"),
        pytest.param((51, 68), 255, 255, 255, 0, SIK, id="all four unknown"),
        pytest.param(None, 190, 40, 41, 7, SIK, id="SiK in a log"),
        pytest.param(None, 180, 3, 255, 0, MLRS, id="mLRS in a log"),
        pytest.param(None, 60, 10, 0, 0, ELRS, id="ExpressLRS in a log"),
        pytest.param(None, 0, 0, 0, 0, UNKNOWN, id="zeros in a log"),
    ],
)
def test_a_radio_is_recognised(sender, remote_rssi, noise, remote_noise, errors, expected):
    assert kind(sender, remote_rssi, noise, remote_noise, errors) is expected


def test_an_expresslrs_link_that_is_lost_in_a_log_stays_one():
    assert kind(None, 0, 10, 0) is SIK
    assert kind(None, 0, 10, 0, before=ELRS) is ELRS


def radio(rssi, remote_rssi, noise, remote_noise):
    return Radio(
        received_s=0.0,
        rssi=rssi,
        remote_rssi=remote_rssi,
        noise=noise,
        remote_noise=remote_noise,
        receive_errors=5,
        transmit_buffer_percent=90,
    )


def test_sik_reports_signal_and_noise():
    assert signal(radio(180, 90, 40, 100), SIK)[:2] == (140.0, 0.0)
    assert signal(radio(180, None, None, 100), SIK)[:2] == (None, None)
    assert signal(radio(180, 90, 40, 100), SIK).receive_errors == 5


def test_mlrs_reports_its_signal_from_minus_120_to_minus_50_dbm():
    heard = signal(radio(254, 0, 3, None), MLRS)
    assert heard.margin == pytest.approx(1.9 * 55.0)
    assert heard.remote_margin == 0.0
    assert heard[2:] == (None, None, None)
    assert signal(radio(None, None, 3, None), MLRS).margin is None


def test_expresslrs_reports_its_link_quality():
    assert signal(radio(237, 31, 9, 0), ELRS).quality == pytest.approx(0.93, abs=0.002)
    assert signal(radio(None, 30, 10, 0), ELRS).quality == 1.0
    assert signal(radio(0, 108, 248, 0), ELRS)._replace(quality=None) == (None,) * 5


def test_the_fields_of_an_unknown_radio_mean_nothing():
    assert signal(radio(200, 150, 60, 3), UNKNOWN) == (None,) * 5


def test_link_statistics_report_quality_and_signal_at_both_ends():
    link = RadioLink(
        received_s=0.0,
        quality=0.9,
        remote_quality=0.8,
        signal_dbm=-90.0,
        remote_signal_dbm=-255.0,
    )
    assert link_signal(link) == (pytest.approx(28.5), 0.0, 0.9, 0.8, None)
