"""Pictures of plans: that they are drawn, and whole, whatever the site."""

import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.image import imread

from moar_companion import Planner, Site, Vehicle
from moar_companion.analysis.pictures.figure import DPI
from moar_companion.analysis.pictures.plan_picture import draw_plan
from moar_companion.planner.site import Conductor, Polygon, Workspace
from moar_companion.settings.config import shipped_configs
from moar_companion.types import Mission

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(CONFIGS / "vehicles" / "linedrone.yaml")
TOWER = Polygon(name="tower", vertices_m=((14.0, -6.0), (16.0, -6.0), (15.0, 19.0)))


def drawn(site, *, file_format="png", **problem):
    planner = Planner(site, VEHICLE)
    plan = planner.plan(**problem)
    stream = io.BytesIO()
    draw_plan(plan, site, VEHICLE, planner.maps, stream, file_format)
    return plan, stream.getvalue()


def pixels(content):
    return imread(io.BytesIO(content), format="png")


@pytest.mark.parametrize(
    "mission",
    [
        pytest.param(Mission.INSPECTION, marks=pytest.mark.slow),
        Mission.EXIT,
        pytest.param(Mission.EVACUATION, marks=pytest.mark.slow),
    ],
)
def test_a_plan_is_a_picture_of_many_colours(mission):
    plan, content = drawn(SITE, mission=mission, start=(14.0, 12.0), velocity=(2.0, -1.0))
    assert plan.status.value == "found"
    image = pixels(content)
    assert image.shape[1] == pytest.approx(11.2 * DPI, rel=0.02)
    colours = np.unique(np.round(image[::3, ::3, :3] * 15).reshape(-1, 3), axis=0)
    assert len(colours) > 60
    # Nothing is cut off: the rim of the page is white.
    rim = [image[0], image[-1], image[:, 0], image[:, -1]]
    assert all((edge[..., :3] == 1.0).all() for edge in rim)


@pytest.mark.parametrize(
    ("mission", "start", "status"),
    [
        pytest.param(Mission.INSPECTION, (9.2, 3.7), "start_occupied", marks=pytest.mark.slow),
        (Mission.EXIT, (500.0, -3.0), "out_of_bounds"),
    ],
)
def test_no_plan_is_a_picture_too(mission, start, status):
    plan, content = drawn(SITE, mission=mission, start=start)
    assert plan.status.value == status
    assert pixels(content).std() > 0.05


FAR = "a landing point far away"
MANY = "many conductors"
SITES = {
    "no obstacles": replace(
        SITE, obstacles=(), targets=(replace(SITE.targets[0], position_m=(5.0, 5.0)),)
    ),
    "a tower through the workspace": replace(SITE, obstacles=(*SITE.obstacles, TOWER)),
    "names in other scripts and with dollars": replace(
        SITE,
        name="$x_{1$ 送電線 " + "long " * 15 + "name",
        obstacles=(replace(SITE.obstacles[0], name="$\\frac"), *SITE.obstacles[1:]),
    ),
    FAR: replace(
        SITE, landing_m={Mission.EXIT: ((4_000.0, 30.0),), Mission.EVACUATION: ((-1e5, 5.0),)}
    ),
    "a tall workspace": replace(
        SITE, workspace=Workspace(lower_m=(20.0, 0.0), upper_m=(30.0, 90.0), resolution_m=0.5)
    ),
    "one cell": replace(
        SITE,
        obstacles=(),
        workspace=Workspace(lower_m=(26.9, 2.4), upper_m=(27.1, 2.6), resolution_m=0.3),
        targets=(replace(SITE.targets[0], position_m=(27.0, 2.5)),),
    ),
    MANY: replace(
        SITE,
        obstacles=tuple(
            Conductor(name=f"wire {x}-{z}", position_m=(5.0 + 0.4 * x, 8.0 + z), radius_m=0.02)
            for x in range(10)
            for z in range(8)
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == FAR else pytest.mark.slow) for name in SITES]
)
def test_any_site_can_be_drawn(name):
    mission = Mission.EXIT if name == FAR else Mission.INSPECTION
    _, content = drawn(SITES[name], mission=mission)
    height, width, _ = pixels(content).shape
    assert 0.4 < height / width < 1.3


@pytest.mark.parametrize("file_format", ["svg", pytest.param("pdf", marks=pytest.mark.slow)])
def test_drawings_for_print(file_format):
    _, content = drawn(SITE, mission="inspection", file_format=file_format)
    assert content.lstrip().startswith({"svg": b"<?xml", "pdf": b"%PDF"}[file_format])


@pytest.mark.slow
def test_a_picture_ignores_the_settings_of_its_user():
    with rc_context({"font.size": 30.0, "axes.facecolor": "red"}):
        _, changed = drawn(SITE, mission="exit")
    _, plain = drawn(SITE, mission="exit")
    assert pixels(changed).shape == pixels(plain).shape
