"""The picture of a flight: what was decided, however little that is."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import image

from moar_companion.config import shipped_configs
from moar_companion.outlets.flight_picture import FlightStory, draw_flight
from moar_companion.planner.maps import build_maps
from moar_companion.site import Site
from moar_companion.vehicle import Vehicle

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
RISK = dict.fromkeys(("wind", "communication", "localization", "battery"), 0.5)


def decided(*records):
    """A story of records (time, kind, data)."""
    return FlightStory.of(
        {"time_s": time_s, "kind": kind, "data": data} for time_s, kind, data in records
    )


@pytest.mark.parametrize(
    "story",
    [
        decided(),
        decided((7.0, "status", {"risk": RISK})),
        decided((7.0, "state", {"state": "idle"}), (7.0, "status", {"risk": RISK})),
    ],
    ids=["of nothing", "of one instant", "of one state"],
)
def test_a_flight_of_zero_duration_can_be_drawn(story, tmp_path):
    picture = tmp_path / "flight.png"
    draw_flight(story, [], SITE, VEHICLE, build_maps(SITE, VEHICLE), picture)
    assert np.ptp(image.imread(picture)) > 0.0
