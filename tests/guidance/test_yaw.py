"""The heading that a flight should have, for each heading mode of the vehicle file and its turn."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.guidance.yaw import turned, wanted_yaw_rad
from moar_companion.planner.planner import Planner
from moar_companion.settings.vehicle import Guidance, YawMode
from moar_companion.types import PX4

from ..planner.problems import FRAME, make_site, make_vehicle

properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)
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


@pytest.mark.parametrize(
    ("case", "yaw_deg", "wanted_deg", "after_deg"),
    [
        ("to the right", 0.0, 90.0, 10.0),
        ("to the left", 0.0, -90.0, -10.0),
        ("over south the short way", 175.0, -175.0, -175.0),
        ("over south, farther than a step", 175.0, -160.0, -175.0),
        ("over south the other way", -175.0, 160.0, 175.0),
        ("near enough for one step", 20.0, 25.0, 25.0),
        ("there already", 42.0, 42.0, 42.0),
        ("a turn too many is none", 0.0, 365.0, 5.0),
    ],
)
def test_the_heading_turns_in_the_shorter_direction(case, yaw_deg, wanted_deg, after_deg):
    after = turned(math.radians(yaw_deg), math.radians(wanted_deg), math.radians(10.0))
    assert math.remainder(after - math.radians(after_deg), math.tau) == pytest.approx(0.0, abs=1e-9)


@properties
@given(
    yaw=st.floats(-math.pi, math.pi),
    wanted=st.floats(-10.0, 10.0),
    greatest=st.floats(0.001, 1.0),
)
def test_the_heading_is_reached_in_steps_within_the_limit(yaw, wanted, greatest):
    for _ in range(int(math.pi / greatest) + 2):
        after = turned(yaw, wanted, greatest)
        assert abs(math.remainder(after - yaw, math.tau)) <= greatest + 1e-9
        assert -math.pi <= after <= math.pi
        yaw = after
    assert math.remainder(yaw - wanted, math.tau) == pytest.approx(0.0, abs=1e-9)
