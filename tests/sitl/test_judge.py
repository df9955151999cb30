from dataclasses import replace

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.autopilot import FakeAutopilot, Options
from sitl.demonstration.judge import FlightTruth, judge, read_truth
from sitl.truth_log import TruthLog

SHIPPED = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
SITE = replace(SHIPPED, targets=())
LEG = [(30.0, 14.0), (40.0, 4.5)]
RADIUS_M = 0.6


def flight(*places, landed=True):
    rows = [
        FlightTruth(time_s=float(n), position_m=(x, 0.0, z), on_ground=False, armed=True)
        for n, (x, z) in enumerate(places)
    ]
    end = replace(rows[-1], on_ground=True, armed=False) if landed else rows[-1]
    return [*rows, end]


def judged(rows, *legs, site=SITE, landings=()):
    return judge(rows, site, RADIUS_M, list(legs), list(landings))


GOOD = [(27.0, 1.0), (27.0, 10.0), (29.9, 14.0), (35.0, 9.0), (40.0, 4.0), (40.0, 0.1)]


def test_a_flight_that_ends_over_its_landing_leg_has_no_fault():
    verdict = judged(flight(*GOOD), LEG)
    assert verdict.faults == ()
    assert verdict.least_clearance_m > 3.0


def test_a_simulator_whose_ground_is_uneven_has_not_left_the_workspace_at_take_off():
    assert judged(flight((27.0, -0.03), *GOOD), LEG).faults == ()


def test_the_climb_into_a_workspace_that_begins_high_belongs_to_the_take_off():
    high = replace(SITE, workspace=replace(SITE.workspace, lower_m=(0.0, 4.0)))
    climb = (27.3, 2.0)
    assert judged(flight(climb, *GOOD), LEG, site=high).faults == ()
    aside = judged(flight(climb, (24.0, 0.5), *GOOD), LEG, site=high).faults
    assert aside == ("left the workspace at 1.0 s, x 24.0 m, z 0.5 m",)


@pytest.mark.parametrize(
    ("rows", "legs", "fault"),
    [
        (flight(GOOD[0], (22.9, 11.0), *GOOD), [LEG], "touched an obstacle"),
        (flight((27.0, 3.0), (32.5, 3.0), *GOOD), [LEG], "left the workspace at 1.0 s"),
        (flight(*GOOD), [], "left the workspace at 3.0 s"),
        (flight((27.0, 3.0), (15.0, 21.0)), [LEG], "left the workspace"),
        (flight(*GOOD, landed=False), [LEG], "did not land"),
        ([replace(row, on_ground=True) for row in flight(*GOOD)], [LEG], "never flew"),
    ],
)
def test_each_fault_is_named(rows, legs, fault):
    faults = judged(rows, *legs).faults
    assert len(faults) == 1
    assert faults[0].startswith(fault)


def test_a_target_that_was_not_reached_is_named():
    (fault,) = judged(flight(*GOOD), LEG, site=SHIPPED).faults
    assert fault.startswith("target splice-inner was not reached: 15.7 m")
    inside = [*GOOD[:2], (27.0, 15.0), (15.0, 15.0), (12.5, 12.0), (15.0, 15.0), *GOOD[1:]]
    assert judged(flight(*inside), LEG, site=SHIPPED).faults == ()


WEST_LEG = [(0.0, 14.0), (-10.0, 4.5)]
EAST, WEST = ((40.0, 2.5),), ((-10.0, 2.5),)
BACK = [(40.0, 2.0), (40.0, 4.5), (35.0, 8.0), (30.0, 11.5), (15.0, 14.6), (0.0, 14.0)]
ON = [(-5.0, 9.25), (-10.0, 4.5), (-10.0, 0.1)]


def tour(*paths):
    """Flights one after the other, each to the ground."""
    rows = [row for path in paths for row in flight(*path)]
    return [replace(row, time_s=float(number)) for number, row in enumerate(rows)]


def test_two_landings_and_the_return_between_them_have_no_fault():
    flown = tour(GOOD, [*BACK, *ON])
    assert judged(flown, LEG, WEST_LEG, landings=[EAST, WEST]).faults == ()


@pytest.mark.parametrize(
    ("rows", "landings", "fault"),
    [
        (tour(GOOD), [EAST, WEST], "landing 2 was to be at x -10 m: not flown"),
        (tour(GOOD), [WEST], "landing 1 was to be at x -10 m: landed at 40.0 m"),
        (tour(GOOD), [(*WEST, (36.0, 2.5))], "landing 1 was to be at x -10 or 36 m: landed"),
        (tour(GOOD, [*BACK[:2], (43.0, 9.0), *BACK[3:], *ON]), [EAST], "left the workspace at 9."),
    ],
)
def test_a_missing_landing_and_a_return_that_goes_farther_away_are_named(rows, landings, fault):
    (found,) = judged(rows, LEG, WEST_LEG, landings=landings).faults
    assert found.startswith(fault)


def test_any_of_several_landing_points_is_accepted():
    assert judged(flight(*GOOD), LEG, landings=[(*WEST, *EAST)]).faults == ()


def test_the_truth_log_is_read_in_the_frame_of_the_site(tmp_path):
    home = SITE.frame.to_geodetic((27.0, 0.0, 0.0))
    options = Options(
        latitude_deg=home.latitude_deg,
        longitude_deg=home.longitude_deg,
        altitude_amsl_m=home.altitude_amsl_m,
    )
    vehicle = FakeAutopilot(options)
    log = TruthLog(tmp_path / "truth.csv", options)
    vehicle.step(1.0)
    log.step(vehicle.truth)
    log.close()
    (row,) = read_truth(tmp_path / "truth.csv", SITE)
    assert row.position_m == pytest.approx((27.0, 0.0, 0.0), abs=1e-3)
    assert row.on_ground
    assert not row.armed
