"""The supervisor: the table row by row, the order of actions, and overrides by operators."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.safety.condition_types import Action, Override
from moar_companion.companion.safety.conditions import CONDITIONS, conditions
from moar_companion.companion.safety.supervisor import HEALTHY, overridden, step
from moar_companion.settings.config import LinkLoss, Supervision
from moar_companion.types import Mission

ROWS = pytest.mark.parametrize("row", CONDITIONS, ids=lambda row: row.name)
LASTING = pytest.mark.parametrize(
    "row", [row for row in CONDITIONS if row.after_s], ids=lambda row: row.name
)
LINGERING = pytest.mark.parametrize(
    "row", [row for row in CONDITIONS if row.over_s], ids=lambda row: row.name
)
TICK_S = 0.02


class Watched:
    """A supervisor that is run at given times."""

    def __init__(self, table=CONDITIONS):
        self.table = table
        self.watches = HEALTHY
        self.now_s = 100.0
        self.causes = {}
        self.look()

    def look(self, seconds=0.0, **causes):
        self.now_s += seconds
        assert causes.keys() <= {row.name for row in CONDITIONS}
        self.causes |= causes
        self.watches, self.ruling = step(self.watches, self.causes, self.now_s, self.table)
        return self

    def wait(self, seconds):
        """Runs the supervisor for a time, as often as in flight."""
        for _ in range(round(seconds / TICK_S)):
            self.look(TICK_S)
        return self

    def order(self):
        self.watches = overridden(self.watches, self.table, known=self.ruling.names)
        return self.look()


# Row by row -------------------------------------------------------------------------------------


def test_every_condition_has_a_name_of_its_own():
    names = [row.name for row in CONDITIONS]
    assert len(set(names)) == len(names)


@ROWS
def test_a_condition_acts_after_its_time_and_not_before(row):
    watched = Watched().look(**{row.name: "trouble 1.2 m"})
    if row.after_s:
        assert not watched.ruling.conditions
        watched.look(row.after_s - 0.01)
        assert not watched.ruling.conditions
        watched.look(0.02)
    assert watched.ruling.action is row.action
    assert watched.ruling.reason == "trouble 1.2 m"
    assert watched.ruling.acts(row.name)


@LASTING
def test_a_cause_that_ended_long_enough_ago_restarts_its_time(row):
    watched = Watched()
    for _ in range(5):
        watched.look(0.0, **{row.name: "trouble"}).look(0.9 * row.after_s)
        watched.look(TICK_S, **{row.name: None}).look(min(row.after_s, row.over_s))
        assert not watched.ruling.conditions


@pytest.mark.parametrize(
    "row", [row for row in CONDITIONS if row.after_s and row.over_s], ids=lambda row: row.name
)
def test_an_intermittent_cause_acts_after_its_time_too(row):
    watched = Watched()
    for _ in range(4):
        assert not watched.ruling.conditions
        watched.look(0.0, **{row.name: "trouble"}).look(0.2 * row.after_s)
        watched.look(TICK_S, **{row.name: None})
        watched.look(0.9 * min(row.over_s, 0.1 * row.after_s))
    watched.look(0.0, **{row.name: "trouble"})
    assert watched.ruling.acts(row.name)
    assert not watched.look(TICK_S, **{row.name: None}).look(row.over_s).ruling.conditions


def test_wind_that_blows_two_seconds_of_three_is_a_hold():
    watched = Watched()
    for _ in range(3):
        watched.look(wind="wind 30 m/s").wait(2.0).look(wind=None).wait(1.0)
    assert watched.ruling.action is Action.HOLD


@ROWS
def test_a_condition_clears_after_its_time_and_not_before(row):
    watched = Watched().look(**{row.name: "trouble"}).look(row.after_s)
    watched.look(TICK_S, **{row.name: None})
    if row.over_s or row.latched:
        assert watched.ruling.acts(row.name)
        watched.look(row.over_s - 0.01)
        assert watched.ruling.acts(row.name)
        watched.look(0.02)
    assert watched.ruling.acts(row.name) is row.latched
    watched.look(3600.0)
    assert watched.ruling.acts(row.name) is row.latched


@LINGERING
def test_a_cause_that_returns_restarts_the_time_to_clear(row):
    watched = Watched().look(**{row.name: "trouble"}).look(row.after_s)
    for _ in range(5):
        watched.look(0.6 * row.over_s, **{row.name: None})
        watched.look(0.6 * row.over_s)
        watched.look(0.0, **{row.name: "again"})
        if row.after_s == 0.0:
            assert watched.ruling.reason == "again"
        watched.look(row.after_s)
        assert watched.ruling.acts(row.name)


@ROWS
def test_an_order_overrides_a_condition_until_the_condition_restarts(row):
    watched = Watched().look(**{row.name: "trouble"}).look(row.after_s).order()
    may = row.override is not Override.NONE
    assert watched.ruling.acts(row.name) is not may
    watched.wait(1.0)
    assert watched.ruling.acts(row.name) is not may
    if may:
        watched.look(**{row.name: None}).look(row.over_s)
        watched.look(**{row.name: "again"}).look(row.after_s)
        assert watched.ruling.acts(row.name)


@ROWS
def test_the_override_of_a_condition_decides_which_missions_may_be_ordered(row):
    watched = Watched().look(**{row.name: "trouble"}).look(row.after_s)
    against = {mission: watched.ruling.against(mission) for mission in Mission}
    for mission, reason in against.items():
        free = row.override is Override.ORDER or (
            row.override is Override.SAFER and mission is not Mission.INSPECTION
        )
        assert reason == (None if free else "trouble")
    # An override by a safer order does not allow another inspection.
    watched.order()
    assert {mission: watched.ruling.against(mission) for mission in Mission} == against


@ROWS
def test_only_a_release_has_its_own_end_of_the_stream(row):
    releases = row.action is Action.RELEASE
    assert releases or (row.last_setpoint and row.rest is MissionState.RELEASED)
    assert not (releases and row.latched)  # the state latches


# Together ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("grave", CONDITIONS, ids=lambda row: row.name)
def test_the_graver_action_goes_before(grave):
    for mild in CONDITIONS:
        if mild.action < grave.action:
            watched = Watched().look(**{mild.name: "mild"}).look(20.0)
            watched.look(**{grave.name: "grave"}).look(20.0)
            assert (watched.ruling.action, watched.ruling.reason) == (grave.action, "grave")
            assert watched.ruling.acts(mild.name)


def test_of_equal_actions_the_first_in_the_table_gives_the_reason():
    watched = Watched().look(autopilot_link_lost="late", position="stale", attitude="unknown")
    assert watched.ruling.reason == "late"


def test_no_last_setpoint_where_one_of_the_releases_forbids_it():
    watched = Watched().look(position="stale")
    assert watched.ruling.last_setpoint
    watched.look(failsafe_took_mode="autopilot in failsafe")
    assert watched.ruling.reason == "stale"
    assert not watched.ruling.last_setpoint


def test_a_lost_ground_station_is_a_hold_until_it_returns():
    watched = Watched()
    watched.look(6.0)  # the ground station is received
    assert watched.ruling.action is Action.CONTINUE
    watched.look(6.0, ground_link="no ground station for 10 s")  # link lost: hold
    assert watched.ruling.action is Action.HOLD
    watched.look(1.0, ground_link=None)  # one heartbeat is not enough
    assert watched.ruling.action is Action.HOLD
    watched.look(2.0)  # the link is back: continue
    assert watched.ruling.action is Action.CONTINUE


def test_a_draining_battery_is_an_exit_and_then_an_evacuation():
    watched = Watched().look(battery_reserve="battery 0 at 20% <= 20%").wait(3.1)
    assert watched.ruling.action is Action.EXIT
    watched.look(battery_critical="battery 0 is critical").wait(1.1)
    assert watched.ruling.action is Action.EVACUATION
    watched.order()  # an exit that the operator prefers
    assert watched.ruling.action is Action.CONTINUE
    assert watched.ruling.against(Mission.INSPECTION) == "battery 0 is critical"
    watched.wait(60.0)
    assert watched.ruling.action is Action.CONTINUE


@pytest.mark.parametrize("action", LinkLoss)
def test_the_action_of_a_lost_ground_station_is_configured(action):
    watched = Watched(conditions(Supervision(ground_link_action=action)))
    watched.look(ground_link="no ground station for 10 s")
    assert watched.ruling.action.name.lower() == action.value
