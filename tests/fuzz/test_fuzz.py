"""A small amount of each kind of hostile input; tests/benchmarks has the figures of long runs."""

from __future__ import annotations

from random import Random

import pytest

from tests.fuzz import coverage, flights, services

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("what", "count", "seed"),
    [("bytes", 60_000, 0), ("bytes", 60_000, 1), *[("messages", 2_500, seed) for seed in range(4)]],
)
def test_hostile_input_in_flight_raises_nothing_and_moves_nothing(what, count, seed):
    report = flights.run(what, count, [seed])
    assert report.given >= count
    assert report.found == []


def test_hostile_requests_to_the_services_raise_nothing_and_move_no_setpoint():
    report = services.run(10_000)
    assert report.given >= 10_000
    assert report.answers["FILE_TRANSFER_PROTOCOL"] > 100
    assert report.found == []


def test_no_input_of_codec_and_session_raises():
    pick = Random(1)
    seeds = coverage.seeds()
    for _ in range(500):
        data = bytearray(b"".join(pick.sample(seeds, 3)))
        for _ in range(pick.randrange(20)):
            data[pick.randrange(len(data))] = pick.randrange(256)
        coverage.feed(bytes(data))
