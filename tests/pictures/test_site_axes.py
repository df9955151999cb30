"""The plane on any axes: what is seen of it, and names that do not overlap."""

from dataclasses import replace

from moar_companion import Planner, Site, Vehicle
from moar_companion.analysis.pictures.figure import Page
from moar_companion.analysis.pictures.labels import place_labels
from moar_companion.analysis.pictures.plan_marks import draw_goal, draw_path, draw_start
from moar_companion.analysis.pictures.site_axes import draw_plane, view_of
from moar_companion.planner.site import Polygon
from moar_companion.settings.config import shipped_configs

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(CONFIGS / "vehicles" / "linedrone.yaml")
TOWER = Polygon(name="tower", vertices_m=((14.0, -6.0), (16.0, -6.0), (15.0, 19.0)))


def test_a_plane_on_other_axes_has_names_that_do_not_overlap():
    planner = Planner(SITE, VEHICLE)
    plan = planner.plan(mission="inspection", start=(27.0, 2.5))
    axes = Page(8.0, 6.0).figure.add_subplot()
    draw_plane(axes, SITE, planner.maps, view_of(SITE, VEHICLE, [(27.0, 2.5)]))
    draw_goal(axes, SITE, planner.maps, plan.mission, plan.request.target, None)
    colours = draw_path(axes, plan, greatest_mps=12.0)
    draw_start(axes, (27.0, 2.5), (0.0, 0.0))
    place_labels(axes, plan.waypoints.position_m)
    assert colours.norm.vmax == 12.0
    texts = [text for text in axes.texts if text.get_text()]
    assert {"left-lower", "splice-outer", "start"} <= {text.get_text() for text in texts}
    boxes = [text.get_window_extent() for text in texts if text.get_visible()]
    assert len(boxes) == 9
    assert not any(a.overlaps(b) for n, a in enumerate(boxes) for b in boxes[:n])


def test_the_view_holds_the_flown_region_and_no_distant_obstacle():
    near = view_of(SITE, VEHICLE, [(27.0, 2.5), (40.0, 0.0)])
    assert near[0] < 0.0
    assert near[1] > 40.0
    far = view_of(SITE, VEHICLE, [(4_000.0, 0.0)])
    assert far[1] - far[0] < 2.0 * 30.0
    # The foot of the tower is shown as far as it costs safety (3 m).
    assert -5.0 < view_of(replace(SITE, obstacles=(TOWER,)), VEHICLE, [])[2] < -3.0
