"""Site and vehicle judged before a flight: every kind of finding by a site that has it."""

import re
from dataclasses import replace

import pytest

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.preflight.findings import Level, worst
from moar_companion.companion.preflight.site_check import site_findings
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Polygon, Site, Target
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, Mission
from tests.flights.lockstep import Lockstep
from tests.flights.operator import EXIT, INSPECTION
from tests.thorough import sampled
from tests.vehicles import named_vehicle

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
VEHICLE = named_vehicle("linedrone_uniform")
LIMITS = Supervision()
OK, NOTE, WARNING, NO_GO = Level


def as_flown(site, vehicle, limits=LIMITS):
    return Planner(flown_site(site, vehicle, limits), vehicle)


def found(site=SITE, vehicle=VEHICLE, limits=LIMITS):
    return {item.subject: item for item in site_findings(as_flown(site, vehicle, limits))}


def target(x_m, z_m):
    return Target(name="it", position_m=(x_m, z_m), dwell_s=5.0)


def wall(name, x_m):
    """A wall across the whole workspace."""
    corners = ((x_m, -1.0), (x_m + 1.0, -1.0), (x_m + 1.0, 21.0), (x_m, 21.0))
    return Polygon(name=name, vertices_m=corners, keep_out_m=0.6)


@pytest.mark.parametrize(
    "vehicle",
    [pytest.param("linedrone", marks=pytest.mark.slow), "linedrone_flight", "x500"],
)
@pytest.mark.parametrize(
    "site", ["120kv_single_circuit", "315kv_double_circuit", "horizontal_three_conductors"]
)
def test_the_shipped_sites_and_vehicles_have_no_no_go(site, vehicle):
    planner = as_flown(
        Site.load(CONFIGS / "sites" / f"{site}.yaml"),
        Vehicle.load(CONFIGS / "vehicles" / f"{vehicle}.yaml"),
    )
    assert worst(site_findings(planner)) < NO_GO


def test_the_site_of_the_shipped_configuration_has_no_warning():
    assert {item.level for item in found().values()} == {OK}


def test_a_target_is_reported_with_the_times_and_clearances_of_its_routes():
    assert found()["target splice-inner"].text == (
        "exit 56 s, evacuation 46 s, from splice-outer 41 s, 3.5 m from obstacles at least"
    )


def seconds(text):
    """The times in the text of a finding."""
    return [float(number) for number in re.findall(r"(\d+) s\b", text)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "site", sampled(["315kv_double_circuit"], ["315kv_double_circuit", "120kv_single_circuit"])
)
def test_the_times_are_those_of_a_flight(site):
    flight = Lockstep(site=site, vehicle="x500")
    everything = found(flight.site, flight.vehicle)
    flight.take_off()
    flight.operator.mission(INSPECTION)
    flight.give_mode()
    begun_s = flight.now_s
    flight.run_until_state("holding", 120.0)
    inspected_s = flight.now_s - begun_s
    flight.operator.mission(EXIT)
    flight.run_until_state("landing_leg", 60.0)
    flight.run_until_state("holding", 60.0)
    flown_s = flight.now_s - begun_s
    *_, outer_s = seconds(everything["target splice-outer"].text)
    exit_s, _, inner_s = seconds(everything["target splice-inner"].text)
    dwell_s = sum(item.dwell_s for item in flight.site.targets)
    assert outer_s + inner_s + dwell_s == pytest.approx(inspected_s, rel=0.2)
    assert exit_s == pytest.approx(flown_s - inspected_s, rel=0.2)
    reported_s, _ = seconds(everything["flight time"].text)
    assert reported_s == pytest.approx(flown_s, rel=0.2)


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("endurance_s", "reserve_s", "level"),
    [
        (90.0, 0.0, OK),
        (80.0, 0.0, WARNING),
        (140.0, 60.0, OK),
        (128.0, 60.0, WARNING),
    ],
)
@pytest.mark.parametrize("key", ["risk.endurance_s", "power.capacity_wh and hover_w"])
def test_the_escape_route_and_the_dwell_and_the_reserve_are_part_of_the_flight(
    endurance_s, reserve_s, level, key
):
    vehicle = Vehicle.load(CONFIGS / "vehicles" / "x500.yaml")
    risk, power = vehicle.risk, replace(vehicle.power, reserve_s=reserve_s)
    if key == "risk.endurance_s":
        risk = replace(risk, endurance_s=endurance_s)
    else:
        power = replace(power, hover_w=1000.0, capacity_wh=endurance_s / 3.6)
    finding = found(vehicle=replace(vehicle, risk=risk, power=power))["flight time"]
    assert finding.level is level
    assert seconds(finding.text) == [pytest.approx(68.0, abs=2.0), endurance_s]
    assert finding.remedy.endswith(key if level is WARNING else "")


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((40.0, 5.0), "(40, 5) is outside the workspace (x 0 to 30, z 0 to 19.8)"),
        ((15.0, 1.0), "(15, 1) is below workspace.min_altitude_m (2)"),
        ((9.17, 3.7), "0.00 m from left-lower, must be at least 3.40 m"),
        ((10.2, 3.7), "left-lower, must be at least 3.40 m (vehicle radius 0.6, keep_out_m 0.25, "),
    ],
    ids=["outside", "too low", "inside an obstacle", "within a keep-out"],
)
def test_a_place_without_any_path_is_reported(place, words):
    finding = found(replace(SITE, targets=(target(*place),)))["target it"]
    assert (finding.level, words in finding.text) == (NO_GO, True), finding.text
    finding = found(replace(SITE, start_m=place))["start"]
    assert (finding.level, words in finding.text) == (WARNING, True), finding.text


def test_a_target_behind_a_wall_is_a_no_go():
    site = replace(SITE, obstacles=(wall("wall", 14.0),), targets=(target(5.0, 10.0),))
    finding = found(site)["target it"]
    assert finding.level is NO_GO
    assert finding.text == "no free path: exit, from the start"


def test_a_wall_between_two_targets_is_reported():
    far = Target(name="far", position_m=(5.0, 10.0), dwell_s=5.0)
    site = replace(SITE, obstacles=(wall("wall", 14.0),), targets=(target(25.0, 10.0), far))
    assert "from it" in found(site)["target far"].text


def test_targets_are_not_judged_from_a_start_without_any_path():
    finding = found(replace(SITE, start_m=(99.0, 5.0)))["target splice-outer"]
    assert finding.level is OK
    assert "from" not in finding.text.split(", 3.")[0]


def test_a_site_without_targets_or_landing_points_is_reported_with_the_missing_missions():
    everything = found(replace(SITE, targets=(), landing_m={}))
    for subject in ("targets", "landing exit", "landing evacuation"):
        assert everything[subject].level is WARNING
    assert "flight time" not in everything


def test_a_landing_point_next_to_a_conductor_is_a_no_go():
    site = replace(SITE, landing_m={Mission.EXIT: ((9.17, 4.5),)})
    finding = found(site)["landing exit 0"]
    assert finding.level is NO_GO
    assert "0.78 m from left-lower" in finding.text


def test_a_landing_point_that_no_cell_sees_is_reported_and_the_rest_are_used():
    corners = ((33.0, -1.0), (34.0, -1.0), (34.0, 30.0), (33.0, 30.0))
    between = Polygon(name="house", vertices_m=corners)
    site = replace(
        SITE,
        obstacles=(*SITE.obstacles, between),
        landing_m={Mission.EXIT: ((40.0, 0.0), (-10.0, 2.5))},
    )
    everything = found(site)
    assert everything["landing exit 0"].level is NO_GO
    assert "no free border cell sees" in everything["landing exit 0"].text
    assert everything["landing exit 1"].level is OK
    assert "exit" in everything["target splice-inner"].text


def test_cells_too_coarse_for_an_obstacle_are_reported():
    bare = tuple(
        replace(item, keep_out_m=0.0) for item in SITE.obstacles if isinstance(item, Conductor)
    )
    coarse = replace(SITE.workspace, resolution_m=1.0)
    exact = Supervision(position_uncertainty_m=0.0)
    vehicle = replace(VEHICLE, guidance=replace(VEHICLE.guidance, tracking_margin_m=0.0))
    site = replace(SITE, obstacles=bare, workspace=coarse)
    finding = found(site, vehicle, exact)["obstacle left-lower"]
    assert finding.level is NO_GO
    assert "required clearance 0.6 m" in finding.text
    assert "may be 0.00 m" in finding.text
    assert "obstacle left-lower" not in found(replace(SITE, obstacles=bare), vehicle, exact)
    assert "obstacle left-lower" not in found(site)


@pytest.mark.uncounted
def test_the_margin_is_reported_with_a_warning_if_it_is_less_than_the_measured_error():
    finding = found()["margin"]
    reported = "2.55 m beyond every keep_out_m: position error 1.4 m, tracking error 1.15 m"
    assert (finding.level, finding.text) == (OK, reported)
    ardupilot = replace(VEHICLE, autopilot=ARDUPILOT)
    assert found(vehicle=ardupilot)["margin"].text.startswith("1.40 m beyond")
    finding = found(limits=Supervision(position_uncertainty_m=0.2))["margin"]
    assert finding.level is WARNING
    assert finding.text.endswith(
        f"; to be expected of an unknown autopilot: {reported.partition(': ')[2]}"
    )
    finding = found(vehicle=ardupilot, limits=Supervision(position_uncertainty_m=0.4))["margin"]
    assert finding.level is WARNING


def test_an_acceleration_with_a_px4_error_above_the_margin_is_a_warning():
    quick = replace(VEHICLE, guidance=replace(VEHICLE.guidance, acceleration_mps2=2.5))
    finding = found(vehicle=quick)["margin"]
    assert finding.level is WARNING
    assert "tracking error 1.45 m" in finding.text


def test_a_flight_that_is_longer_than_its_battery_is_a_warning():
    long = replace(SITE, targets=(replace(SITE.targets[0], dwell_s=2000.0),))
    finding = found(long)["flight time"]
    assert finding.level is WARNING
    assert "a full battery lasts 1200 s" in finding.text


def test_a_speed_that_is_never_reached_is_a_note():
    fast = Vehicle.load(CONFIGS / "vehicles" / "linedrone.yaml")
    assert found(vehicle=fast)["speed"].level is NOTE


def test_large_maps_are_a_warning(monkeypatch):
    monkeypatch.setattr("moar_companion.companion.preflight.site_check._LARGE_BYTES", 1_000_000)
    finding = found()["workspace"]
    assert finding.level is WARNING
    assert "100 x 66 cells of 0.3 m" in finding.text


def test_a_site_without_obstacles_has_no_finding():
    everything = found(replace(SITE, obstacles=()))
    assert worst(everything.values()) is OK
    assert "obstacles" not in everything["target splice-outer"].text
