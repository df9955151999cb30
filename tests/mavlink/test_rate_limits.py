from __future__ import annotations

from moar_companion.mavlink.commands import Sender
from moar_companion.mavlink.rate_limits import RateLimit, SenderLimit


def sender(system_id, link="radio"):
    return Sender(link=link, system_id=system_id, component_id=190)


def test_a_burst_is_allowed_and_then_the_limited_rate():
    limit = RateLimit(burst=3, rate_hz=2.0)
    assert [limit.allows("a", 0.0) for _ in range(4)] == [True, True, True, False]
    assert [limit.allows("a", 0.5) for _ in range(2)] == [True, False]
    assert [limit.allows("a", 60.0) for _ in range(4)] == [True, True, True, False]


def test_each_key_has_its_own_limit():
    limit = RateLimit(burst=1, rate_hz=1.0)
    assert limit.allows("a", 0.0)
    assert not limit.allows("a", 0.0)
    assert limit.allows("b", 0.0)


def test_a_time_that_goes_back_adds_no_allowance():
    limit = RateLimit(burst=1, rate_hz=1.0)
    assert limit.allows("a", 10.0)
    assert not limit.allows("a", 5.0)


def test_memory_is_bounded_for_any_number_of_keys():
    limit = RateLimit(burst=1, rate_hz=1.0)
    for key in range(10_000):
        limit.allows(key, 0.0)
    assert len(limit._left) == 64


def test_a_sender_beyond_its_limit_uses_none_of_its_links_limit():
    limit = SenderLimit(burst=2, rate_hz=1.0, link_burst=3, link_rate_hz=1.0)
    assert sum(limit.allows(sender(255), 0.0) for _ in range(100)) == 2
    assert limit.allows(sender(254), 0.0)
    assert not limit.allows(sender(253), 0.0)  # the link's three
    assert limit.allows(sender(255, "network"), 0.0)
