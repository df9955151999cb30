"""The picture of a flight: what was decided, however little that is."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure

from moar_companion.analysis.pictures.flight_picture import FlightStory, _name_changes, draw_flight
from moar_companion.planner.maps import build_maps
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle

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


def test_a_jump_of_an_index_is_named_and_so_is_an_unknown_one():
    axes = Figure().add_subplot()
    risk = [0.1] * 20 + [0.4, 0.8, 0.9] + [0.9] * 20 + [0.5] * 4
    _name_changes(axes, np.arange(len(risk)) * 0.5, np.array(risk), 0.5, "wind", "blue")
    assert [text.get_text() for text in axes.texts] == ["wind 0.10 to 0.90", "unknown"]
