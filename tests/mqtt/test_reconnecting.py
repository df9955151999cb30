"""Times of reconnections to the broker, and their log."""

from itertools import pairwise

import pytest

from moar_companion.service.mqtt_client import Backoff, ConnectionLog


def test_pauses_double_up_to_half_a_minute():
    backoff = Backoff()
    pauses = [backoff.pause_s(1.0, 0.0) for _ in range(8)]
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]


@pytest.mark.parametrize("random", [0.0, 0.25, 0.999])
def test_random_pauses_spread_the_reconnections_of_a_fleet(random):
    backoff, usual = Backoff(), Backoff()
    for _ in range(8):
        pause_s, whole_s = backoff.pause_s(random, 0.0), usual.pause_s(1.0, 0.0)
        assert pause_s == pytest.approx(whole_s * (0.5 + 0.5 * random))


def test_a_connection_that_lasted_makes_the_next_pause_short_again():
    backoff = Backoff()
    for _ in range(6):
        backoff.pause_s(1.0, 0.0)
    assert backoff.pause_s(1.0, 60.0) == 1.0


def test_connections_that_end_at_once_do_not():
    backoff = Backoff()
    pauses = [backoff.pause_s(1.0, 0.5) for _ in range(6)]
    assert all(later >= earlier for earlier, later in pairwise(pauses))


def test_one_line_is_logged_per_change():
    log = ConnectionLog("mqtt://a:1883")
    reported = [
        log.lost("connection refused"),
        log.lost("connection refused"),
        log.lost("certificate verify failed"),
        log.lost("connection refused"),
        log.connected(),
        log.lost("connection refused"),
    ]
    assert reported == [
        "MQTT: no connection: mqtt://a:1883: connection refused; flying on, trying again",
        None,
        "MQTT: no connection: mqtt://a:1883: certificate verify failed; flying on, trying again",
        None,
        "MQTT: connected to mqtt://a:1883",
        "MQTT: lost: mqtt://a:1883: connection refused; flying on, trying again",
    ]
