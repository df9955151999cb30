"""The site and its maps for displays: every value is the planner's, to the last of 254 steps."""

from __future__ import annotations

import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.planner.maps import build_maps
from moar_companion.planner.site_view import maps_view, site_view

from .problems import conductor, make_site, make_vehicle, polygon

SITE = make_site(
    conductor(5.0, 4.0, name="wire", keep_out=0.5),
    polygon((7.0, 0.0), (8.0, 0.0), (7.5, 3.0), name="tower"),
    size=(10.0, 8.0),
    resolution=0.5,
    exits=[(14.0, 0.0)],
)


@pytest.mark.parametrize("site", [SITE, make_site()], ids=["obstacles", "none"])
def test_maps_are_bytes_of_all_cells_from_the_lowest_row(site):
    maps = build_maps(site, make_vehicle())
    view = json.loads(json.dumps(maps_view(maps), allow_nan=False))
    assert (view["columns"], view["rows"]) == maps.grid.shape
    for name, values in (("safety", maps.safety_cost), ("speed_mps", maps.speed_limit_mps)):
        data = np.frombuffer(base64.b64decode(view[name]["data"]), dtype=np.uint8)
        shown = data.reshape(view["rows"], view["columns"]).T
        np.testing.assert_array_equal(shown == 255, maps.occupied)
        free = ~maps.occupied
        np.testing.assert_allclose(
            shown[free] * view[name]["scale"], values[free], atol=0.51 * view[name]["scale"]
        )


def test_ground_with_a_profile_has_its_points_in_the_workspace_and_the_least_heights_above():
    profile = ((-5.0, 0.0), (5.0, 4.0), (20.0, 1.0))
    space = replace(SITE.workspace, min_altitude_m=1.5, ground_m=profile)
    view = site_view(replace(SITE, workspace=space))
    ground = json.loads(json.dumps(view, allow_nan=False))["workspace"]["ground"]
    assert ground["profile_m"] == [[0.0, 2.0], [5.0, 4.0], [10.0, 3.0]]
    x_m, floor_m = np.array(ground["floor_m"]).T
    assert (x_m[0], x_m[-1]) == (0.0, 10.0)
    np.testing.assert_allclose(floor_m, space.floor_m(x_m))
    assert site_view(SITE)["workspace"]["ground"] is None


def test_a_site_has_each_obstacle_target_and_landing_point():
    view = json.loads(json.dumps(site_view(SITE), allow_nan=False))
    wire, tower = view["obstacles"]
    assert wire == {
        "kind": "conductor",
        "name": "wire",
        "x_m": 5.0,
        "z_m": 4.0,
        "radius_m": 0.03,
        "keep_out_m": 0.5,
    }
    assert tower["vertices_m"] == [[7.0, 0.0], [8.0, 0.0], [7.5, 3.0]]
    assert view["targets"][0]["name"] == "target"
    assert view["landing"] == {"exit": [{"x_m": 14.0, "z_m": 0.0}]}
    assert view["frame"]["azimuth_deg"] == 90.0
