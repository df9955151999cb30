"""The heading that a flight should have, for each heading mode of the vehicle file."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.guidance.yaw import wanted_yaw_rad
from moar_companion.planner.planner import Planner
from moar_companion.settings.vehicle import Guidance, YawMode
from moar_companion.types import PX4

from ..planner.problems import FRAME, make_site, make_vehicle

PLANE = PlaneToLocal.between(FRAME, FRAME.origin, PX4)
"""x leads east."""
EAST_RAD = 0.5 * math.pi
SITE = make_site(targets={"target": (4.5, 4.5)})
POSE = Pose(position_m=(1.0, 0.0, 4.5), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.3)


def plan():
    return Planner(SITE, make_vehicle()).plan(mission="inspection")


def wanted(guidance, plan, *, site=SITE, velocity_mps=(0.0, 0.0, 0.0), arrived=False):
    return wanted_yaw_rad(
        site, guidance, plan, POSE, PLANE, velocity_mps=velocity_mps, arrived=arrived
    )


def test_a_fixed_heading_is_kept_with_and_without_a_plan():
    guidance = Guidance(yaw_mode=YawMode.FIXED, fixed_yaw_rad=1.2)
    assert wanted(guidance, None) == 1.2
    assert wanted(guidance, plan(), velocity_mps=(-2.0, 0.0, 0.0)) == 1.2


def test_a_heading_along_the_path_follows_the_setpoints_horizontal_motion():
    guidance, planned = Guidance(yaw_mode=YawMode.PATH), plan()
    ahead = wanted(guidance, planned, velocity_mps=(1.0, 0.0, 0.4))
    assert ahead == pytest.approx(EAST_RAD, abs=1e-3)
    back = wanted(guidance, planned, velocity_mps=(-1.0, 0.0, 0.4))
    assert back == pytest.approx(-EAST_RAD, abs=1e-3)


def test_a_heading_along_the_path_is_kept_in_a_climb_and_at_rest():
    guidance, planned = Guidance(yaw_mode=YawMode.PATH), plan()
    assert wanted(guidance, planned, velocity_mps=(0.0, 0.0, 1.0)) is None
    assert wanted(guidance, planned, velocity_mps=(0.05, 0.0, 0.0)) is None


def test_the_heading_of_the_site_file_counts_only_at_the_target():
    site = replace(SITE, targets=(replace(SITE.targets[0], yaw_deg=-30.0),))
    planned = plan()
    assert wanted(Guidance(), planned, site=site) == pytest.approx(EAST_RAD, abs=1e-3)
    arrived = wanted(Guidance(), planned, site=site, arrived=True)
    assert arrived == pytest.approx(math.radians(-30.0))
