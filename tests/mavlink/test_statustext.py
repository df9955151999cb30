from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.statustext import Severity, StatusTexts


def encoded(texts, text, now_s=0.0):
    return [(m.id, m.chunk_seq, m.text) for m in texts.messages(Severity.WARNING, text, now_s)]


def test_a_short_text_is_one_message_without_an_id():
    assert encoded(StatusTexts(), "x" * 50) == [(0, 0, "x" * 50)]
    assert StatusTexts().messages(Severity.WARNING, "x", 0.0)[0].severity == 4


@pytest.mark.parametrize(("length", "chunks"), [(51, 2), (99, 2), (100, 3), (101, 3), (5000, 21)])
def test_a_long_text_is_sent_in_chunks_and_the_last_one_ends_the_text(length, chunks):
    text = "".join(chr(97 + index % 26) for index in range(length))
    sent = encoded(StatusTexts(), text)
    assert [(number, sequence) for number, sequence, _ in sent] == [(1, i) for i in range(chunks)]
    assert "".join(part for _, _, part in sent) == text[:1000]
    assert len(sent[-1][2]) < 50


words = st.text(alphabet="abc019.,-", min_size=1, max_size=49)


@given(st.lists(words, min_size=1, max_size=30).map(" ".join))
def test_no_word_or_number_is_cut_whether_a_station_joins_the_chunks_or_shows_each(text):
    texts = [part for _, _, part in encoded(StatusTexts(), text[:990].rpartition(" ")[0] or "a")]
    whole = (text[:990].rpartition(" ")[0] or "a").split()
    assert "".join(texts).split() == whole
    assert [word for part in texts for word in part.split()] == whole
    assert all(len(part) == 50 for part in texts[:-1])


def test_a_text_is_cut_at_its_last_blank_before_the_end_of_a_chunk():
    text = "wind risk 0.92, path 1.4 m outward (was 0.31), the battery lasts 412 s"
    parts = [part for _, _, part in encoded(StatusTexts(), text)]
    first = "wind risk 0.92, path 1.4 m outward (was 0.31),    "
    assert parts == [first, "the battery lasts 412 s"]


def test_each_long_text_has_an_id_of_its_own():
    texts = StatusTexts()
    assert encoded(texts, "a" * 60)[0][0] == 1
    assert encoded(texts, "b" * 60)[0][0] == 2
    texts._last_id = 65535
    assert encoded(texts, "c" * 60)[0][0] == 1


def test_the_same_text_is_not_sent_again_within_10_seconds():
    texts = StatusTexts()
    assert encoded(texts, "wind", 0.0)
    assert not encoded(texts, "wind", 9.9)
    assert encoded(texts, "battery", 9.9)
    assert encoded(texts, "wind", 10.0)


def test_texts_that_differ_in_measured_values_alone_are_the_same():
    texts = StatusTexts()
    assert encoded(texts, "98 s left, wind 9.5 m/s, battery 0 at 15%, 3 m off", 0.0)
    assert not encoded(texts, "7 s left, wind 12.1 m/s, battery 0 at 9%, 12 m off", 2.0)
    assert encoded(texts, "7 s left, wind 12.1 m/s, battery 1 at 9%, 12 m off", 2.0)


def test_a_character_outside_ascii_becomes_a_question_mark():
    assert encoded(StatusTexts(), "45° left") == [(0, 0, "45? left")]


def test_a_new_text_is_sent_again_after_another_text_or_a_second():
    texts = StatusTexts()
    sent = [
        bool(texts.messages(Severity.NOTICE, text, now_s, is_new=True))
        for now_s, text in [
            (0.0, "MOAR flying"),
            (0.5, "MOAR flying"),
            (0.6, "MOAR holding"),
            (0.7, "MOAR flying"),
            (0.8, "MOAR flying"),
            (1.7, "MOAR flying"),
        ]
    ]
    assert sent == [True, False, True, True, False, True]


def test_a_text_of_an_answer_is_sent_with_each_answer():
    texts = StatusTexts()

    def is_sent(link):
        return bool(texts.messages(Severity.WARNING, "denied", 0.0, link=link))

    sent = [is_sent(link) for link in ("radio", "radio", "network", None, None)]
    assert sent == [True, True, True, True, False]


def test_memory_is_bounded_for_any_number_of_texts():
    texts = StatusTexts()
    for number in range(10_000):
        assert encoded(texts, f"parameter {number} is bad")
    assert len(texts._sent_s) == 256
    assert not encoded(texts, "parameter 9999 is bad")
