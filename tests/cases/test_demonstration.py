"""The demonstration on sites of users, judged by the true course."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration.judge import FlightTruth, judge

RADIUS_M = 0.6
LEG = [(30.0, 6.0), (40.0, 2.0)]


def rows(*places):
    """A flight to the ground, a second between places."""
    flown = [
        FlightTruth(time_s=float(second), position_m=(x, 0.0, z), on_ground=False, armed=True)
        for second, (x, z) in enumerate(places)
    ]
    return [*flown, replace(flown[-1], on_ground=True, armed=False)]


def test_a_take_off_at_a_landing_point_outside_a_window_above_the_ground_is_no_fault():
    shipped = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    space = replace(shipped.workspace, lower_m=(0.0, 4.0))
    site = replace(shipped, workspace=space, targets=())
    first = rows((27.0, 0.5), (27.0, 5.0), (30.0, 6.0), (40.0, 2.0), (40.0, 0.1))
    # Taken off where it landed, it climbs beside its leg, and comes in from there.
    second = rows((40.3, 0.5), (40.3, 4.1), (33.0, 7.5), (28.0, 6.0), (30.0, 6.0), (40.0, 0.1))
    landings = [((40.0, 0.0),)] * 2
    assert judge(first + second, site, RADIUS_M, [LEG], landings).faults == ()
    astray = rows((40.3, 0.5), (43.0, 4.1), (28.0, 6.0), (30.0, 6.0), (40.0, 0.1))
    (fault,) = judge(first + astray, site, RADIUS_M, [LEG], landings).faults
    assert fault.startswith("left the workspace at 1.0 s, x 43.0 m")
