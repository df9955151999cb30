"""Shifts of a site's frame: the file keeps its form, the places move, the record stays."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.errors import InputError
from moar_companion.planner.site import FrameShift, Site
from moar_companion.planner.site_shift import shifted_text
from moar_companion.settings.config import shipped_configs

SHIPPED = (shipped_configs() / "sites" / "315kv_double_circuit.yaml").read_text()
SHIFT = FrameShift(
    north_m=3.0, east_m=-4.0, up_m=0.25, reason='base "moved", 1/2 ü', date="2026-05-31"
)
FRAME = """\
frame:
  origin: {latitude_deg: 45.3781, longitude_deg: -71.9295, altitude_amsl_m: 210.0}
  azimuth_deg: 90.0
"""
FORMS = {
    "shipped": FRAME,
    "block": "frame:\n    azimuth_deg: 90.0\n    origin:  # surveyed\n"
    "        altitude_amsl_m: 210.0\n        latitude_deg: 45.3781   # by RTK\n"
    "        longitude_deg: -71.9295\n    # the end of the frame\n",
    "flow": "frame: {origin: {latitude_deg: 45.3781, longitude_deg: -71.9295, "
    "altitude_amsl_m: 210.0}, azimuth_deg: 90.0,}  # one line\n",
    "recorded": FRAME + "  shifts:\n    - {north_m: 1.0, reason: first, date: 2026-05-01}  # May\n"
    "    - north_m: -0.5\n      reason: second\n      date: 2026-05-02\n\n# next\n",
    "empty record": FRAME + "  shifts: []\n",
    "windows": FRAME.replace("\n", "\r\n"),
}


def with_frame(form):
    assert FRAME in SHIPPED
    return SHIPPED.replace(FRAME, form)


@pytest.mark.parametrize("form", FORMS)
def test_the_frame_moves_and_every_other_line_of_the_file_stays(form):
    text = with_frame(FORMS[form])
    before, moved = Site.of_text(text, "site"), shifted_text(text, "site", SHIFT)
    after = Site.of_text(moved, "site")
    assert after.shifts == (*before.shifts, SHIFT)
    assert replace(after, frame=before.frame, shifts=before.shifts) == before
    origin = after.frame.origin
    east_m, left_m = before.frame.place_of(origin.latitude_deg, origin.longitude_deg)
    assert (left_m, east_m) == pytest.approx((3.0, -4.0), abs=2e-4)  # +x points east
    assert origin.altitude_amsl_m == 210.25
    kept = [line for line in text.splitlines() if "_deg" not in line and "altitude" not in line]
    if form != "recorded":
        assert [line for line in kept if "shifts" not in line] == [
            line
            for line in moved.splitlines()
            if "_deg" not in line and "altitude" not in line and "shifts" not in line
        ]
    assert moved.count("#") == text.count("#") - (form == "recorded")


def test_shifts_add_up_and_back_again():
    text = SHIPPED
    for sign in (1.0, 1.0, -2.0):
        shift = FrameShift(north_m=5.0 * sign, up_m=sign, reason="again", date="2026-05-31")
        text = shifted_text(text, "site", shift)
    site, shipped = Site.of_text(text, "site"), Site.of_text(SHIPPED, "site")
    assert len(site.shifts) == 3
    assert math.dist(
        (site.frame.origin.latitude_deg, site.frame.origin.altitude_amsl_m),
        (shipped.frame.origin.latitude_deg, shipped.frame.origin.altitude_amsl_m),
    ) == pytest.approx(0.0, abs=1e-8)


def test_a_file_whose_frame_is_merged_from_elsewhere_is_refused_in_one_line():
    merged = with_frame(
        "frame:\n  <<: &base\n    origin: {latitude_deg: 45.3781, longitude_deg: -71.9295, "
        "altitude_amsl_m: 210.0}\n  azimuth_deg: 90.0\n"
    )
    Site.of_text(merged, "site")
    with pytest.raises(InputError, match="cannot be edited: write it as the shipped sites do"):
        shifted_text(merged, "site", SHIFT)


def test_a_shift_is_shown_with_directions():
    assert str(SHIFT) == '3 m N, 4 m W, 0.25 m up on 2026-05-31: base "moved", 1/2 ü'
    down = FrameShift(east_m=0.5, up_m=-0.1, reason="x", date="2026-05-31")
    assert str(down) == "0.5 m E, 0.1 m down on 2026-05-31: x"
