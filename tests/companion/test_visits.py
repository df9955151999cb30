"""Visits of targets and views: their order, and the stops for which the energy does not suffice."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.planner.planner import Planner
from moar_companion.planner.site import TargetView
from moar_companion.settings.config import Inspection, Supervision, VisitOrder
from moar_companion.types import Mission

from .desk import INSPECTION, LINK, Desk, usual_planner
from .test_published_state import plotted

BEST, FILE = Inspection(), Inspection(order=VisitOrder.FILE)


def site_with(*targets):
    return replace(usual_planner().site, targets=targets)


def viewed(target, *offsets_m):
    """The target with a view at each offset from its place."""
    x_m, z_m = target.position_m
    return [
        replace(
            target,
            name=f"{target.name}/{number}",
            position_m=(x_m + dx_m, z_m + dz_m),
            dwell_s=0.0,
            view=TargetView(
                target=target.name, number=number, aim_m=target.look_at_m, pictures=1, video_s=0.0
            ),
        )
        for number, (dx_m, dz_m) in enumerate(offsets_m, start=1)
    ]


OUTER, INNER = usual_planner().site.targets
VIEWS = Planner(
    site_with(*viewed(OUTER, (0.0, 0.0), (0.5, -2.0), (0.0, 1.0)), INNER), usual_planner().vehicle
)
"""A target with three views, the nearest second, and another target."""


def stops_of(desk):
    return desk.companion.status.task.stops


def tours(desk):
    return [item.data["stops"] for item in desk.decisions if item.kind == "tour"]


def ready(planner, inspection, index=-1.0, **config):
    desk = Desk(planner=planner, inspection=inspection, **config).run(1.2)
    return desk.order(INSPECTION, index).run_until("ready")


def test_the_best_order_is_that_of_least_cost_whatever_the_files():
    usual = usual_planner()
    other = Planner(site_with(INNER, OUTER), usual.vehicle)
    first, second = ready(usual, BEST), ready(other, BEST)
    assert stops_of(first) == stops_of(second)
    assert tours(first) == tours(second) == [list(stops_of(first))]
    assert first.jobs[0].request.mission is Mission.INSPECTION


def test_the_files_order_is_kept_where_it_is_set():
    for targets in ((INNER, OUTER), (OUTER, INNER)):
        desk = ready(Planner(site_with(*targets), usual_planner().vehicle), FILE)
        assert stops_of(desk) == tuple(target.name for target in targets)
        assert tours(desk) == []


def test_an_order_by_index_visits_all_views_of_the_target():
    assert stops_of(ready(VIEWS, FILE, 0.0)) == (
        "splice-outer/1",
        "splice-outer/2",
        "splice-outer/3",
    )
    desk = ready(VIEWS, BEST, 0.0)
    assert sorted(stops_of(desk)) == ["splice-outer/1", "splice-outer/2", "splice-outer/3"]
    assert stops_of(desk)[0] == "splice-outer/2"
    assert stops_of(ready(VIEWS, FILE, 1.0)) == ("splice-inner",)


def test_the_flown_target_is_counted_by_targets_not_by_views():
    for index, stop in ((0, "splice-outer/1"), (1, "splice-inner")):
        desk = ready(VIEWS, FILE, float(index)).run(1.2)
        assert stops_of(desk)[0] == stop
        assert plotted(desk, LINK)["M_TARGET"] == index


# Energy ------------------------------------------------------------------------------------------


def at_eleven_percent(**config):
    """A flight whose charge suffices for a target and the way out, and for the rest without it."""
    desk = Desk(wind_mps=2.0, supervision=Supervision(battery_reserve=0.0), **config)
    desk.contingencies = True
    return desk.set(battery_percent=60).come_to("flying", then_s=2.0).set(battery_percent=11)


@pytest.mark.slow
def test_a_stop_for_which_the_energy_does_not_suffice_is_left_out_after_a_while():
    desk = at_eleven_percent().run(8.0)
    assert stops_of(desk) == ("splice-outer", "splice-inner")
    desk.run(4.0)
    assert stops_of(desk) == ("splice-outer",)
    assert desk.said("MOAR: no energy for splice-inner, left out")
    left_out = [item.data for item in desk.decisions if item.kind == "left_out"]
    assert left_out == [{"stops": ["splice-inner"], "reason": "energy"}]
    assert desk.state in {"flying", "at_target"}
    desk.run(7.0)
    assert desk.said("MOAR: stops not done: 1, holding")


@pytest.mark.slow
def test_a_charge_that_is_low_for_some_seconds_leaves_nothing_out():
    desk = at_eleven_percent().run(5.0).set(battery_percent=60).run(6.0)
    assert desk.companion.state.risk_monitor.fitting_stops is None
    assert stops_of(desk)[-1] == "splice-inner"


@pytest.mark.slow
def test_the_charge_of_the_exit_counts_for_the_stops():
    """Enough for all stops and the way out, but the exit would begin before the last stop."""
    desk = Desk(wind_mps=2.0, supervision=Supervision(battery_reserve=0.5))
    desk.contingencies = True
    desk.set(battery_percent=60).come_to("flying", then_s=2.0).set(battery_percent=52)
    desk.run(12.0)
    assert stops_of(desk) == ("splice-outer",)
