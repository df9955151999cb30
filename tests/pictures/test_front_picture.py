"""Pictures of trade-offs: that they are drawn, and whole, also where there is no path."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from moar_companion import Planner, Site, Vehicle
from moar_companion.analysis.pictures.front_picture import draw_front
from moar_companion.planner.analysis.pareto import pareto_front
from moar_companion.planner.whole_front import whole_front
from moar_companion.settings.config import shipped_configs

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "horizontal_three_conductors.yaml")
VEHICLE = Vehicle.load(CONFIGS / "vehicles" / "linedrone.yaml")


@pytest.mark.slow
@pytest.mark.parametrize(("start", "found"), [((27.0, 4.0), True), ((7.0, 10.0), False)])
def test_a_trade_off_is_a_picture_of_many_colours(start, found):
    planner = Planner(SITE, VEHICLE)
    plan = planner.plan(mission="inspection", start=start)
    front = pareto_front(planner, plan.request)
    assert bool(front) == found
    stream = io.BytesIO()
    draw_front(plan, front, whole_front(planner, plan.request), SITE, VEHICLE, planner.maps, stream)
    image = imread(io.BytesIO(stream.getvalue()), format="png")
    colours = np.unique(np.round(image[::3, ::3, :3] * 15).reshape(-1, 3), axis=0)
    assert len(colours) > (60 if found else 30)
    # Nothing is cut off: the rim of the page is white.
    rim = [image[0], image[-1], image[:, 0], image[:, -1]]
    assert all((edge[..., :3] == 1.0).all() for edge in rim)
