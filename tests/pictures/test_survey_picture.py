"""The picture of a survey."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from moar_companion.analysis.pictures.survey_picture import draw_survey, legend_of
from moar_companion.perception.survey.survey_view import SurveyMark, SurveyView

WIRE = {"name": "left", "x_m": -4.0, "z_m": 12.0, "radius_m": 0.02, "keep_out_m": 1.0}
DOCUMENT = {
    "name": "drawn",
    "frame": {"azimuth_deg": 90.0},
    "workspace": {"x_m": [-16.0, 12.0], "z_m": [0.0, 20.0]},
    "obstacles": [{"conductor": WIRE}],
    "start": {"x_m": 10.0, "z_m": 2.5},
    "targets": {"$splice_": {"x_m": 0.0, "z_m": 12.0}},
    "landing": {"exit": [], "evacuation": []},
}
RED = (0xA3, 0x27, 0x1B)


def mark(kind, name, *points, left_out_m=None):
    return SurveyMark(kind=kind, name=name, points_m=np.array(points), left_out_m=left_out_m)


LINE = mark("conductor", "left", (-25.0, -4.0, 12.5), (25.0, -4.0, 12.5))
TARGET = mark("target", "$splice_", (0.0, 0.0, 12.0))
TOWER = mark("tower", "T2", (-34.0, -5.0, 18.0), left_out_m=34.2)


def picture(survey):
    stream = io.BytesIO()
    draw_survey(survey, stream)
    stream.seek(0)
    return imread(stream)[..., :3]


def pixels(image, colour):
    """Rows and columns of a colour."""
    return np.argwhere(abs(image - np.array(colour) / 255.0).max(axis=2) < 0.02)


def labels(survey):
    return [each.get_label() for each in legend_of(survey)]


def test_the_legend_names_the_parts_left_out_with_their_distance():
    shown = labels(SurveyView(document=DOCUMENT, marks=(LINE, TARGET, TOWER)))
    assert shown == [
        "conductor", "target", "tower, obstacle", "keep-out of a conductor", "workspace", "plane",
        "left out: tower T2, 34 m from the plane",
    ]  # fmt: skip


def test_lone_points_are_counted_in_the_legend():
    one = SurveyView(document=DOCUMENT, left_out_m=np.zeros((1, 2)))
    two = SurveyView(document=DOCUMENT, left_out_m=np.zeros((2, 2)))
    assert labels(one)[-1] == "left out: 1 lone point"
    assert labels(two)[-1] == "left out: 2 lone points"


@pytest.mark.slow
def test_a_tower_away_from_the_plane_is_crossed_out_in_all_three_views():
    with_tower = picture(SurveyView(document=DOCUMENT, marks=(LINE, TARGET, TOWER)))
    near = mark("tower", "T2", *TOWER.points_m)
    without = picture(SurveyView(document=DOCUMENT, marks=(LINE, TARGET, near)))
    assert with_tower.shape == without.shape
    red = [len(pixels(each, RED)) for each in (with_tower, without)]
    one_cross = 40
    assert red[0] - red[1] > 3 * one_cross


def test_the_target_of_a_cloud_is_marked_in_the_plan_view():
    points = np.array([(-50.0, -10.0, 0.0), (50.0, 10.0, 0.0)])
    image = picture(
        SurveyView(document=DOCUMENT, points_m=points, classes=np.array([2, 2], dtype=np.uint8))
    )
    rows = pixels(image, RED)[:, 0]
    assert (rows < image.shape[0] / 3).sum() > 20


@pytest.mark.slow
def test_the_arrow_points_to_the_north():
    def tip(azimuth_deg):
        document = DOCUMENT | {"frame": {"azimuth_deg": azimuth_deg}}
        image = picture(SurveyView(document=document, marks=(LINE, TARGET)))
        blank = picture(SurveyView(document=DOCUMENT, marks=(LINE, TARGET)))
        changed = np.argwhere(abs(image - blank).max(axis=2) > 0.2)
        return changed.mean(axis=0) if len(changed) else None

    assert tip(90.0) is None
    up, down = tip(0.0), tip(180.0)
    assert up[0] < down[0]
