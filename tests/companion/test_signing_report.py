"""Texts about refused packets: immediate, rate-limited, short enough for a pilot."""

from __future__ import annotations

import pytest

from moar_companion.companion.companion import Companion
from moar_companion.companion.reports import SigningReport
from moar_companion.mavlink.signing import Signing, SigningKey, SigningRefusal, timestamp_at
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from moar_companion.settings.vehicle import Vehicle
from moar_companion.texts.text_format import pilot_text

from ..mavlink.signed import SECRET, SignedPeer
from .desk import LINK

NONE_BEHIND = {"a": {}}


def refused(**counts):
    return {reason: counts.get(reason.name.lower(), 0) for reason in SigningRefusal}


def test_the_first_refusal_is_reported_at_once_and_the_next_after_half_a_minute():
    refusals = SigningReport()
    assert refusals.texts({"a": refused()}, NONE_BEHIND, 0.0) == []
    assert refusals.texts({"a": refused(unsigned=1)}, NONE_BEHIND, 1.0) == [
        "1 packet refused: unsigned"
    ]
    assert refusals.texts({"a": refused(unsigned=500)}, NONE_BEHIND, 30.9) == []
    assert refusals.texts({"a": refused(unsigned=501)}, NONE_BEHIND, 31.0) == [
        "500 packets refused: unsigned"
    ]
    assert refusals.texts({"a": refused(unsigned=501)}, NONE_BEHIND, 90.0) == []


def test_each_reason_is_reported_separately_summed_over_all_links():
    found = {"a": refused(wrong=2, old=1), "b": refused(wrong=3)}
    assert SigningReport().texts(found, NONE_BEHIND, 1.0) == [
        "5 packets refused: wrong signature",
        "1 packet refused: old or replayed",
    ]


def test_all_refusal_reports_fit_into_one_text():
    found = {"a": refused(unsigned=999_999_999, wrong=999_999_999, old=999_999_999)}
    for words in SigningReport().texts(found, NONE_BEHIND, 1.0):
        assert words in pilot_text(words)


def test_a_signer_whose_clock_is_behind_is_named_with_the_time_difference():
    behind_s = {"a": {1: 119.7, 255: 61.0}, "b": {}}
    (words,) = SigningReport().texts({"a": refused(old=12)}, behind_s, 1.0)
    assert words == "system 1 signs 120 s behind (12 packets refused: old or replayed)"
    assert pilot_text(words) == "MOAR: system 1 signs 120 s behind"


@pytest.mark.parametrize(
    ("ahead_s", "reported"),
    [
        (120.0, "MOAR: signing.json 2 min ahead of the clock"),
        (5 * 3600.0, "MOAR: signing.json 5.0 h ahead of the clock"),
        (26_800 * 86400.0, "MOAR: signing.json 26800 d ahead of the clock"),
    ],
)
def test_a_stored_time_ahead_of_the_clock_is_reported_with_the_remedy(ahead_s, reported):
    behind_s = {"a": {1: 120.0}}
    (words,) = SigningReport().texts({"a": refused(old=12)}, behind_s, 1.0, ahead_s=ahead_s)
    assert "where it is right delete signing.json, and restart; system 1 signs" in words
    assert pilot_text(words) == reported


def test_a_clock_that_was_briefly_ahead_is_reported_when_senders_are_refused_for_it():
    wall_s, day_s = 1_800_000_000.0, 86400.0
    config = CompanionConfig(vehicle=shipped_configs(), links=(LinkConfig(url=LINK, signed=True),))
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    signing = Signing(key=SigningKey(SECRET), wall_s=wall_s)
    companion = Companion(config, vehicle, None, signing=signing)
    for reported_s in (wall_s + 700 * day_s, wall_s):
        companion.note_wall_clock(reported_s)
    station = SignedPeer(255, 190, timestamp=timestamp_at(wall_s))
    companion.receive(LINK, station.ground_heartbeat(), 1.0)
    companion.tick(1.0)
    reasons = [item.data["reason"] for item in companion.decisions() if item.kind == "text"]
    assert any(reason.startswith("signing.json 700 d ahead") for reason in reasons)
