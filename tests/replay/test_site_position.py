"""Place of a recorded aircraft: until its position is too old, or too far from the site."""

from __future__ import annotations

import pytest

from moar_companion.analysis.replay.site_position import SitePosition
from moar_companion.commands import replay
from moar_companion.companion.error_margin import flown_site
from moar_companion.mavlink.telemetry import (
    Attitude,
    GlobalPosition,
    LocalOrigin,
    LocalPosition,
    Telemetry,
)
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import RiskIndices

from ..safety.telemetry import px4_status

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
RECEIVED_S = 100.0
PX4 = px4_status(RECEIVED_S)


def by_gnss(position_m):
    """Telemetry without the origin of the estimator."""
    point = SITE.frame.to_geodetic(position_m)
    return Telemetry(
        autopilot=PX4, global_position=GlobalPosition(received_s=RECEIVED_S, point=point)
    )


def by_its_estimator(position_m):
    """Telemetry with the origin of the estimator at the position of the aircraft."""
    still = (0.0, 0.0, 0.0)
    local = LocalPosition(
        received_s=RECEIVED_S, boot_s=50.0, position_ned_m=still, velocity_ned_mps=still
    )
    origin = LocalOrigin(received_s=RECEIVED_S, point=SITE.frame.to_geodetic(position_m))
    level = Attitude(received_s=RECEIVED_S, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0)
    return Telemetry(autopilot=PX4, attitude=level, local_position=local, local_origin=origin)


@pytest.fixture(scope="module")
def planner():
    return Planner(SITE, VEHICLE)


@pytest.fixture
def place_at(planner):
    """The place of telemetry at a time."""
    site_position = SitePosition(planner)
    return lambda telemetry, now_s: site_position.at(telemetry, RiskIndices(), now_s)


@pytest.mark.parametrize("telemetry_of", [by_gnss, by_its_estimator])
def test_a_position_is_valid_for_two_seconds(place_at, telemetry_of):
    telemetry = telemetry_of((26.0, 0.5, 5.0))
    assert place_at(telemetry, RECEIVED_S + 1.9).position_m == pytest.approx(
        (26.0, 0.5, 5.0), abs=0.1
    )
    assert place_at(telemetry, RECEIVED_S + 2.1) is None


@pytest.mark.parametrize("telemetry_of", [by_gnss, by_its_estimator])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0)], ids=["along", "across"])
def test_ten_kilometres_from_the_site_there_is_no_place(place_at, telemetry_of, direction):
    near, far = (tuple(reach_m * part for part in direction) for reach_m in (9_900.0, 10_100.0))
    assert place_at(telemetry_of(near), RECEIVED_S).position_m == pytest.approx(near, abs=30.0)
    assert place_at(telemetry_of(far), RECEIVED_S) is None


def test_without_a_position_there_is_no_place(place_at):
    assert place_at(Telemetry(), RECEIVED_S) is None
    assert place_at(Telemetry(autopilot=PX4), RECEIVED_S) is None


def test_an_escape_route_is_planned_with_the_margin_also_from_within_the_margin():
    """1.5 m below a conductor: an X500's hull is nearer to it than PX4's margin allows."""
    file = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
    site_position = replay.site_position_of(str(file), VEHICLE)
    assert site_position._planner.site == flown_site(SITE, VEHICLE, Supervision())
    x_m, z_m = SITE.obstacles[3].position_m
    near, free = (
        site_position.at(by_gnss((x_m, 0.0, z_m - below_m)), RiskIndices(), at_s)
        for below_m, at_s in ((1.5, RECEIVED_S), (3.6, RECEIVED_S + 2.0))
    )
    assert near.evacuation_s > free.evacuation_s
