"""A place marked by an aircraft: means of its positions, their spread, the fix that is needed."""

from __future__ import annotations

import random

import pytest

from moar_companion.perception.survey.marked_place import (
    MEAN_S,
    MEANS,
    RTK_FIXED,
    PlaceMarker,
)
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.types import GeodeticPoint

HERE = GeodeticPoint(latitude_deg=45.0, longitude_deg=-71.0, altitude_amsl_m=200.0)
FRAME = SiteFrame(origin=HERE, azimuth_deg=90.0)
RATE_HZ = 5.0


def marked(position_m, *, fix=lambda _: RTK_FIXED, seconds=60.0, **options):
    """A marker that gets the positions, (x, y, z) at a time, until it has enough."""
    marker = PlaceMarker(**options)
    for step in range(int(seconds * RATE_HZ)):
        time_s = step / RATE_HZ
        if not marker.done:
            marker.add(FRAME.to_geodetic(position_m(time_s)), time_s, fix(time_s))
    return marker


def test_noise_averages_out_and_the_spread_shows_what_is_left():
    rng = random.Random(1)
    marker = marked(lambda _: (rng.gauss(1.0, 0.02), rng.gauss(-2.0, 0.02), rng.gauss(3.0, 0.04)))
    assert marker.done
    place = marker.result()
    x_m, y_m = FRAME.place_of(place.point.latitude_deg, place.point.longitude_deg)
    assert (x_m, y_m) == pytest.approx((1.0, -2.0), abs=0.01)
    assert place.point.altitude_amsl_m == pytest.approx(203.0, abs=0.02)
    assert 0.0 < place.horizontal_m < 0.02
    assert place.positions >= MEANS * MEAN_S * RATE_HZ


def test_a_drift_is_seen_in_the_spread():
    place = marked(lambda time_s: (0.05 * time_s, 0.0, 0.1 * time_s)).result()
    # Five means, each 3 s and a step long: the outer ones are two of them from the middle.
    assert place.horizontal_m == pytest.approx(0.05 * 2 * (MEAN_S + 0.2), abs=0.01)
    assert place.vertical_m == pytest.approx(0.1 * 2 * (MEAN_S + 0.2), abs=0.01)
    assert "spread of the 5 means" in str(place)


def test_positions_without_the_fix_do_not_count_and_a_lost_fix_begins_the_mean_anew():
    assert not marked(lambda _: (0.0, 0.0, 0.0), fix=lambda _: 5).done
    assert not marked(lambda _: (0.0, 0.0, 0.0), fix=lambda _: None).done
    flicker = marked(lambda _: (0.0, 0.0, 0.0), fix=lambda time_s: 5 if time_s % 2 < 1 else 6)
    assert not flicker.done
    assert flicker.share == 0.0
    assert marked(lambda _: (0.0, 0.0, 0.0), fix=lambda _: 3, needs_rtk=False).done


def test_the_same_position_counts_once():
    marker = PlaceMarker()
    for _ in range(1000):
        marker.add(HERE, 1.0, RTK_FIXED)
    assert not marker.done
