"""Telemetry radios that use RADIO_STATUS in their own way."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from moar_companion.settings.risk_model import RadioKind

from .flown import ARDUPILOT, VEHICLE, hover

_FLIGHT_S = 30.0


def _elrs(
    quality_percent: float, signal_dbm: float, snr_db: float
) -> m.MAVLink_radio_status_message:
    """As ExpressLRS reports."""
    return m.MAVLink_radio_status_message(
        int(quality_percent * 2.55), int(-signal_dbm), 100, int(snr_db) & 255, 0, 0, 0
    )


@cache
def _fading(sender: tuple[int, int], kind: RadioKind | None = None):
    """A flight of half a minute in which the quality falls from 100 to 20 %."""

    def also(packets, time_s):
        share = time_s / _FLIGHT_S
        status = _elrs(100.0 - 80.0 * share, -30.0 - 78.0 * share, 10.0 - 18.0 * share)
        packets.put(time_s, status, by=sender)

    flown = hover(duration_s=_FLIGHT_S, rate_hz=5, autopilot=ARDUPILOT, also=also)
    vehicle = replace(VEHICLE, risk=replace(VEHICLE.risk, radio=kind))
    replay, _ = flown.played(vehicle)
    return replay


@cache
def _wfb_ng(signal_dbm: int):
    """wfb-ng: the signal in dBm as a signed byte, in both fields; healthy, then with repairs."""

    def also(packets, time_s):
        repaired = 0 if time_s < 10.0 else 3
        rssi = signal_dbm & 255
        status = m.MAVLink_radio_status_message(rssi, rssi, 100, 0, 0, 0, repaired)
        packets.put(time_s, status, by=(3, 68))

    flown = hover(duration_s=20.0, rate_hz=5, autopilot=ARDUPILOT, also=also)
    return flown.played(VEHICLE)


@pytest.mark.parametrize("signal_dbm", [-30, -75, -110])
def test_wfb_ng_is_unknown_with_and_without_repairs(signal_dbm):
    replay, listener = _wfb_ng(signal_dbm)
    assert listener.telemetry.radio.kind is RadioKind.UNKNOWN
    assert "radio link quality here" not in replay.measures["communication"]
    assert replay.measures["communication"]["radio margin here"].greatest_risk is None


@pytest.mark.parametrize("sender", [(1, 68), (255, 68)])
def test_the_risk_rises_as_the_link_quality_of_expresslrs_falls(sender):
    replay = _fading(sender)
    risks = [sample.risk["communication"] for sample in replay.samples if sample.time_s > 10.0]
    assert risks == sorted(risks)
    quality_93, quality_49 = (
        next(s.risk["communication"] for s in replay.samples if s.time_s >= time_s)
        for time_s in (6.0, 20.0)
    )
    assert quality_93 < 0.2
    assert quality_49 > 0.9


def test_no_margin_is_made_of_a_link_quality():
    measures = _fading((255, 68)).measures["communication"]
    assert not [name for name in measures if "margin" in name and measures[name].greatest_risk]
    assert measures["radio link quality here"].greatest_risk == 1.0
    assert measures["radio receive errors"].greatest_risk is None


def test_a_radio_that_is_not_recognised_is_unknown_until_the_vehicle_file_names_it():
    unknown = _fading((7, 9))
    measures = unknown.measures["communication"]
    assert measures["radio margin here"].greatest_risk is None
    assert "radio link quality here" not in measures
    assert _fading((7, 9), RadioKind.ELRS).samples[-1].risk["communication"] > 0.9
