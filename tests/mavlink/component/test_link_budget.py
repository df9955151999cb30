"""Bytes that answers take of a link."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.component.link_budget import LinkBudget, size_bytes
from moar_companion.mavlink.dialect import create

PING = create("PING", time_usec=1, seq=2, target_system=0, target_component=0)


def sent_bytes(link, duration_s, period_s=0.02):
    """Bytes that a link takes in a while where something always waits."""
    budget, sent = LinkBudget(link), 0
    for cycle in range(round(duration_s / period_s)):
        while budget.is_open(cycle * period_s):
            budget.spend(PING)
            sent += size_bytes(PING)
    return sent


@pytest.mark.parametrize(
    ("link", "bytes_per_s"),
    [
        ("serial:/dev/ttyTHS1:57600", 1440.0),
        ("serial:/dev/ttyTHS1:921600", 23_040.0),
        ("udp:0.0.0.0:14550", 20_000.0),
        ("tcp:127.0.0.1:5760", 20_000.0),
        ("mqtt", 20_000.0),
    ],
)
def test_a_serial_line_gives_a_quarter_of_its_rate_and_a_network_a_fixed_one(link, bytes_per_s):
    assert sent_bytes(link, 10.0) == pytest.approx(10.0 * bytes_per_s, rel=0.02)


def test_an_idle_link_saves_no_more_than_one_cycles_bytes():
    budget = LinkBudget("serial:/dev/ttyTHS1:57600")
    assert budget.is_open(0.0)
    assert budget.is_open(1000.0)
    budget.spend(PING)
    assert not budget.is_open(1000.0)


def test_the_largest_packet_takes_one_cycle_of_a_slow_line():
    assert LinkBudget("serial:/dev/ttyTHS1:57600").largest_bytes == 115
    assert LinkBudget("serial:/dev/ttyTHS1:9600").largest_bytes == 100
    assert LinkBudget("udp:0.0.0.0:14550").largest_bytes == 280
