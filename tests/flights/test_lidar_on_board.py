"""The lidar of a flight in lockstep: seen obstacles are on the maps; a silent lidar is detected."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.perceive import lidar_scene

from .lockstep import Lockstep

pytest.importorskip("velodyne_decoder")
SITE = Site.load(shipped_configs() / "sites" / "horizontal_three_conductors.yaml")


def hovering(site):
    """In the air at a site file without obstacles; the lidar is on from now on."""
    flight = Lockstep(
        site=replace(site, obstacles=()),
        vehicle="x500",
        options={"yaw_deg": site.frame.azimuth_deg},
        lidar_scene=lidar_scene(site),
    )
    flight.blind = True
    flight.take_off()
    flight.blind = False
    return flight


@pytest.mark.slow
def test_seen_obstacles_are_on_the_maps_before_an_order_and_a_silent_lidar_is_detected():
    flight = hovering(SITE)
    assert flight.lidar.reports == []
    flight.run(3.5)
    for site in (
        flight.planners.exact.site,
        flight.companion.state.routes.limits.site_maps.site,
    ):
        assert len(site.obstacles) == len(SITE.obstacles)
        for item in SITE.obstacles:
            places = [seen.position_m for seen in site.obstacles]
            assert min(math.dist(item.position_m, place) for place in places) < 0.6
    assert not holds(flight)
    flight.blind = True
    flight.run(1.5)
    assert holds(flight)


def holds(flight):
    """True while the condition of a silent sensor acts."""
    conditions = [item.data for item in flight.decisions if item.kind == "condition"]
    return [data["began"] for data in conditions if data["name"] == "perception"][-1]
