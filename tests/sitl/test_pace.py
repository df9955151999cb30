"""The speed of a demonstration that a machine keeps."""

import pytest

from sitl.demonstration import pace


@pytest.mark.parametrize(("wanted", "reached", "flown"), [(4.0, 4.0, 4.0), (4.0, 2.5, 2.0)])
def test_a_speed_that_is_not_reached_is_lowered(monkeypatch, wanted, reached, flown):
    monkeypatch.setattr(pace, "_reached", lambda _wanted: reached)
    assert pace.kept_speed(wanted) == flown


def test_no_speed_is_lowered_below_that_of_an_aircraft(monkeypatch):
    monkeypatch.setattr(pace, "_reached", lambda _wanted: 0.2)
    assert pace.kept_speed(3.0) == 1.0
    assert pace.kept_speed(0.5) == 0.5


def test_no_machine_reaches_every_speed(monkeypatch):
    monkeypatch.setattr(pace, "_MEASURED_S", 0.1)
    assert 0.0 < pace._reached(1e6) < 1e6
