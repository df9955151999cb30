"""Texts about refused packets: at once, seldom, and short enough for a pilot."""

from __future__ import annotations

from moar_companion.mavlink.signing import Refusal
from moar_companion.mavlink.texts import pilot_text
from moar_companion.service.refusals import Refusals

NOBODY = {"a": {}}


def refused(**counts):
    return {reason: counts.get(reason.name.lower(), 0) for reason in Refusal}


def test_the_first_is_told_at_once_and_the_next_after_half_a_minute():
    refusals = Refusals()
    assert refusals.texts({"a": refused()}, NOBODY, 0.0) == []
    assert refusals.texts({"a": refused(unsigned=1)}, NOBODY, 1.0) == ["1 packet refused: unsigned"]
    assert refusals.texts({"a": refused(unsigned=500)}, NOBODY, 30.9) == []
    assert refusals.texts({"a": refused(unsigned=501)}, NOBODY, 31.0) == [
        "500 packets refused: unsigned"
    ]
    assert refusals.texts({"a": refused(unsigned=501)}, NOBODY, 90.0) == []


def test_each_reason_is_told_by_itself_over_all_links():
    found = {"a": refused(wrong=2, old=1), "b": refused(wrong=3)}
    assert Refusals().texts(found, NOBODY, 1.0) == [
        "5 packets refused: wrong signature",
        "1 packet refused: old or replayed",
    ]


def test_they_fit_into_one_text():
    found = {"a": refused(unsigned=999_999_999, wrong=999_999_999, old=999_999_999)}
    for words in Refusals().texts(found, NOBODY, 1.0):
        assert words in pilot_text(words)


def test_a_signer_whose_clock_is_behind_is_named_with_how_far_that_is():
    behind_s = {"a": {1: 119.7, 255: 61.0}, "b": {}}
    (words,) = Refusals().texts({"a": refused(old=12)}, behind_s, 1.0)
    assert words == "system 1 signs 120 s behind (12 packets refused: old or replayed)"
    assert pilot_text(words) == "MOAR: system 1 signs 120 s behind"
