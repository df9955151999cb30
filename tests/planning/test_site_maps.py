"""Room of a hull on the maps of a site."""

from __future__ import annotations

import pytest

from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.planning.site_maps import SiteMaps

from ..companion.desk import usual_planner


def room_m(x_m, z_m):
    planner = usual_planner()
    pose = Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
    return SiteMaps(site=planner.site, maps=planner.maps).room_m(pose, planner.vehicle.radius_m)


def test_the_clearance_at_the_centre_of_a_cell_is_that_of_the_map():
    maps = usual_planner().maps
    for cell in ((60, 20), (80, 45), (30, 60)):
        assert room_m(*maps.grid.centre_m(cell)) == pytest.approx(maps.room_m[cell], abs=1e-6)


def test_the_clearance_is_continuous_across_cells():
    grid = usual_planner().maps.grid
    x_m, z_m = grid.centre_m((60, 20))
    border_m = x_m + 0.5 * grid.resolution_m
    assert grid.cell_of((border_m - 0.01, z_m)) != grid.cell_of((border_m + 0.01, z_m))
    assert abs(room_m(border_m - 0.01, z_m) - room_m(border_m + 0.01, z_m)) <= 0.02
