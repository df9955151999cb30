"""The random flights: a few seeds, and a judge that finds planted violations."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
import shapely

from moar_companion.planner.site import Polygon, Site
from moar_companion.settings.config import Authority, shipped_configs
from moar_companion.settings.vehicle import Vehicle

from ..thorough import sampled
from .campaign import AFTERMATH_S, DEVELOPMENT, HELD_OUT
from .campaign.command import main, row_of
from .campaign.drawing import LASTS_S, Draw, Fault, draw
from .campaign.flying import HOLDS_IN, RandomFlight, Record, Sent, held_wind_mps
from .campaign.judge import clearance_m, judge
from .campaign.kinds import KINDS, Breaks
from .campaign.report import summary
from .campaign.sites import generated_site
from .judging import shape
from .operator import Manner

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
STEP_S = 0.02
HERE_M = (28.0, 0.0, 9.0)
CONDUCTOR_M = (22.68, 0.0, 10.99)
"""right-middle: 17.5 mm, and a keep-out of 0.25 m."""
COUNT = 1000


# The judge --------------------------------------------------------------------------------------


def at_rest(place_m=HERE_M, **changes) -> Record:
    """20 s of a flight that holds at a place, with a setpoint at each step."""
    time_s = STEP_S * np.arange(1, COUNT + 1)
    values = {
        "draw": Draw(
            seed=0, site=SITE, vehicle="x500", manner=Manner.PX4, authority=Authority.STREAM,
            parameters={}, wind_mps=0.0, wind_from_deg=0.0, gust_mps=0.0, orders=(), faults=(),
        ),
        "vehicle": VEHICLE,
        "margin_m": 1.4,
        "held_wind_mps": 15.0,
        "time_s": time_s,
        "true_m": np.tile(np.array(place_m, dtype=float), (COUNT, 1)),
        "error_m": np.zeros((COUNT, 3)),
        "wind_mps": np.zeros((COUNT, 3)),
        "reported_m": np.full(COUNT, 0.3),
        "modes": ["OFFBOARD"] * COUNT,
        "airborne": np.ones(COUNT, dtype=bool),
        "states": ["flying"] * COUNT,
        "sent": [setpoint(t, place_m) for t in time_s],
        "ours": "OFFBOARD",
        "holds_in": HOLDS_IN[Manner.PX4],
        "began_s": {},
        "broken_s": {},
        "orders_s": [],
        "taken_reported_s": [],
        "forbidden": [],
        "notes": [],
    }  # fmt: skip
    return Record(**(values | changes))


def setpoint(time_s, place_m, aircraft_m=None, **changes) -> Sent:
    values = {
        "time_s": float(time_s),
        "state": "flying",
        "on_leg": False,
        "local_m": tuple(place_m),
        "moves": False,
        "reported_m": tuple(place_m),
        "aircraft_m": tuple(place_m if aircraft_m is None else aircraft_m),
        "position_age_s": 0.02,
        "mode_age_s": 0.1,
    }
    return Sent(**(values | changes))


def from_step(index, record, **changes) -> Record:
    """A record in which each setpoint from a step on is changed."""
    sent = [
        dataclasses.replace(item, **changes) if number >= index else item
        for number, item in enumerate(record.sent)
    ]
    return dataclasses.replace(record, sent=sent)


def flown_to(place_m, **changes) -> Record:
    """A flight from `HERE_M` to a place within 10 s, which then holds there."""
    part = np.clip(np.arange(COUNT) / 500.0, 0.0, 1.0)[:, None]
    true_m = (1.0 - part) * np.array(HERE_M) + part * np.array(place_m)
    return at_rest(true_m=true_m, **changes)


def rules(record):
    return {item.rule: item.outside for item in judge(record).violations}


def test_a_flight_that_holds_keeps_the_promise():
    judgement = judge(at_rest())
    assert judgement.verdict == "kept"
    assert judgement.greatest_step_mps == 0.0
    assert judgement.controlled_s == judgement.within_s == pytest.approx(20.0)
    distance_m = math.dist((28.0, 9.0), (22.68, 10.99)) - 0.0175 - VEHICLE.radius_m
    assert judgement.least_clearance_m == pytest.approx(distance_m, abs=1e-3)
    assert judgement.least_keep_out_m == pytest.approx(distance_m - 0.25, abs=1e-3)


def test_a_collision_is_found():
    judgement = judge(flown_to(CONDUCTOR_M))
    assert judgement.verdict == "broken"
    assert {item.rule for item in judgement.violations} == {"collision", "keep_out"}
    assert judgement.least_clearance_m < 0.0


def test_a_keep_out_that_is_entered_without_a_collision_is_found():
    beside_m = (CONDUCTOR_M[0] + 0.0175 + VEHICLE.radius_m + 0.2, 0.0, CONDUCTOR_M[2])
    assert rules(flown_to(beside_m)) == {"keep_out": ()}


def test_a_keep_out_that_is_only_approached_is_not():
    beside_m = (CONDUCTOR_M[0] + 0.0175 + VEHICLE.radius_m + 0.26, 0.0, CONDUCTOR_M[2])
    assert rules(flown_to(beside_m)) == {}


def test_a_collision_under_the_pilot_is_not_counted_against_the_companion():
    assert rules(flown_to(CONDUCTOR_M, modes=["POSCTL"] * COUNT, sent=[])) == {}


def test_a_collision_within_seconds_of_the_last_setpoint_is_counted_against_the_companion():
    modes = ["OFFBOARD"] * 450 + ["AUTO.LOITER"] * (COUNT - 450)
    record = flown_to(CONDUCTOR_M, modes=modes)
    assert "collision" in rules(dataclasses.replace(record, sent=record.sent[:450]))


OUTSIDE = {
    "position": {"error_m": np.tile([0.0, 0.0, 1.41], (COUNT, 1))},
    "wind": {"wind_mps": np.tile([15.1, 0.0, 0.0], (COUNT, 1))},
    "gust": {"wind_mps": np.outer(np.arange(COUNT) > 300, [4.5, 0.0, 0.0])},
    "aircraft": {"broken_s": {Breaks.AIRCRAFT: 1.0}},
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_outside_the_promise_a_collision_is_counted_with_the_broken_part_of_the_promise(name):
    record = flown_to(CONDUCTOR_M, **OUTSIDE[name])
    assert rules(record)["collision"] == (name,)
    assert judge(record).verdict == "outside"


def test_a_position_error_within_the_reported_accuracy_is_within_the_promise():
    reported = {"error_m": np.tile([0.0, 0.0, 1.9], (COUNT, 1)), "reported_m": np.full(COUNT, 2.0)}
    assert rules(flown_to(CONDUCTOR_M, **reported))["collision"] == ()


def test_an_obstacle_that_is_elsewhere_than_in_the_file_is_an_error_of_the_position():
    moved = dataclasses.replace(at_rest().draw, mapped=SITE, map_error_m=1.2)
    assert rules(flown_to(CONDUCTOR_M, draw=moved))["collision"] == ()
    error_m = np.tile([0.0, 0.0, 0.3], (COUNT, 1))
    assert rules(flown_to(CONDUCTOR_M, draw=moved, error_m=error_m))["collision"] == ("position",)


def test_setpoints_keep_out_of_the_obstacles_of_the_file_and_the_truth_of_the_true_ones():
    empty = dataclasses.replace(SITE, obstacles=())
    near_m = (CONDUCTOR_M[0] + 0.5, 0.0, CONDUCTOR_M[2])
    record = from_step(500, at_rest(), reported_m=near_m)
    unknown = dataclasses.replace(record.draw, mapped=empty)
    assert rules(dataclasses.replace(record, draw=unknown)) == {}
    assert set(rules(flown_to(CONDUCTOR_M, draw=unknown))) == {"collision", "keep_out"}


def test_the_promise_holds_again_some_time_after_it_was_broken():
    wind_mps = np.zeros((COUNT, 3))
    wind_mps[: round(4.0 / STEP_S)] = (20.0, 0.0, 0.0)
    late = flown_to(CONDUCTOR_M, wind_mps=wind_mps)
    found = next(item for item in judge(late).violations if item.rule == "collision")
    assert found.time_s < 4.0 + AFTERMATH_S
    assert found.outside == ("wind", "gust")
    longer_s = found.time_s - AFTERMATH_S - 2.1
    wind_mps[round(max(longer_s, 0.0) / STEP_S) :] = 0.0
    wind_mps[: round(longer_s / STEP_S) if longer_s > 0 else 0] = (20.0, 0.0, 0.0)
    assert rules(flown_to(CONDUCTOR_M, wind_mps=wind_mps))["collision"] == ()


def test_a_step_is_found_and_one_that_a_jump_explains_is_not():
    there_m = (28.0, 0.0, 8.5)
    record = from_step(500, at_rest(), local_m=there_m)
    assert rules(record) == {"step": ()}
    error_m = np.outer(np.arange(COUNT) >= 498, [0.0, 0.0, -0.5])
    assert rules(dataclasses.replace(record, error_m=error_m)) == {}


def test_a_stream_that_begins_elsewhere_after_a_pause_is_no_step():
    record = from_step(510, at_rest(), local_m=(28.0, 0.0, 8.5))
    sent = record.sent[:500] + record.sent[510:]
    assert rules(dataclasses.replace(record, sent=sent)) == {}


def test_a_stream_that_begins_far_from_its_aircraft_is_found():
    record = at_rest((28.0, 0.0, 9.0))
    far_m = (28.0, 0.0, 6.5)
    sent = [
        dataclasses.replace(item, local_m=far_m, reported_m=far_m, aircraft_m=HERE_M)
        for item in record.sent[510:]
    ]
    assert rules(dataclasses.replace(record, sent=record.sent[:500] + sent)) == {"begins": ()}


@pytest.mark.parametrize(("age_s", "moves", "found"), [
    (0.59, True, {}), (0.61, True, {"stale": ()}), (0.79, False, {}), (0.81, False, {"stale": ()}),
])  # fmt: skip
def test_a_setpoint_from_stale_input_is_found(age_s, moves, found):
    assert rules(from_step(500, at_rest(), position_age_s=age_s, moves=moves)) == found


def test_a_stream_that_restarts_after_a_state_without_a_stream_is_no_step():
    away_m = (HERE_M[0] + 0.5, *HERE_M[1:])
    record = from_step(500, at_rest(), local_m=away_m, reported_m=away_m, aircraft_m=away_m)
    assert rules(record) == {"step": ()}
    states = ["flying"] * COUNT
    states[499] = "idle"
    assert rules(dataclasses.replace(record, states=states)) == {}


def test_a_setpoint_at_rest_may_follow_the_aircraft_that_has_taken_it_along():
    blown_m = (HERE_M[0] + 4.0, *HERE_M[1:])
    taken_m, nearer_m = ((HERE_M[0] + away, *HERE_M[1:]) for away in (3.0, 3.2))
    away = from_step(500, at_rest(), aircraft_m=blown_m)
    taken = from_step(500, away, local_m=taken_m, reported_m=taken_m)
    along = from_step(501, taken, local_m=nearer_m, reported_m=nearer_m)
    assert "step" not in rules(along)
    assert "step" in rules(from_step(501, taken, local_m=nearer_m, reported_m=nearer_m, moves=True))


def test_a_setpoint_without_a_recent_mode_report_is_found():
    assert rules(from_step(500, at_rest(), mode_age_s=3.4)) == {"stale_mode": ()}


@pytest.mark.parametrize(
    "place_m", [(31.0, 0.0, 9.0), (28.0, 2.2, 9.0), (28.0, 0.0, 1.8), (28.0, 0.0, 20.2)]
)
def test_a_setpoint_outside_is_found_but_on_a_landing_leg(place_m):
    record = from_step(500, at_rest(), reported_m=place_m)
    assert rules(record) == {"outside": ()}
    assert rules(from_step(500, record, on_leg=True)) == {}


def test_the_rest_of_a_landing_leg_may_go_outside_for_some_time():
    outside_m = (30.1, 0.0, 9.0)
    record = from_step(500, from_step(400, at_rest(), on_leg=True), on_leg=False)
    assert rules(from_step(600, record, reported_m=outside_m)) == {}
    assert rules(from_step(700, record, reported_m=outside_m)) == {"outside": ()}


def test_a_stream_that_begins_outside_at_its_aircraft_may_go_inward_and_not_outward():
    outside_m, farther_m = (31.0, 0.0, 9.0), (31.1, 0.0, 9.0)
    assert rules(at_rest(outside_m)) == {}
    led_in = from_step(500, at_rest(outside_m), reported_m=HERE_M)
    assert rules(led_in) == {}
    assert rules(from_step(500, at_rest(outside_m), reported_m=farther_m)) == {"outside": ()}


def test_a_setpoint_in_a_keep_out_is_found():
    near_m = (CONDUCTOR_M[0] + 0.5, 0.0, CONDUCTOR_M[2])
    assert rules(from_step(500, at_rest(), reported_m=near_m)) == {"setpoint_keep_out": ()}


def taken_over_at(step, last_step, reported_after_s=0.0):
    """The pilot takes the mode, which is reported, and the stream continues for some time."""
    modes = ["OFFBOARD"] * step + ["POSCTL"] * (COUNT - step)
    record = at_rest(modes=modes, taken_reported_s=[STEP_S * (step + 1) + reported_after_s])
    return dataclasses.replace(record, sent=record.sent[:last_step])


def test_a_stream_that_goes_on_after_a_takeover_is_found():
    assert rules(taken_over_at(500, 512)) == {}
    assert rules(taken_over_at(500, 514)) == {"silence": ()}
    assert rules(taken_over_at(500, 528, reported_after_s=0.5)) == {}
    assert rules(taken_over_at(500, 534, reported_after_s=0.5)) == {"silence": ()}
    assert rules(taken_over_at(500, 700, reported_after_s=5.0)) == {"silence": ()}


def test_a_stream_that_comes_back_without_an_order_is_found():
    record = taken_over_at(500, 505)
    back = [setpoint(t, HERE_M) for t in record.time_s[800:]]
    again = dataclasses.replace(record, sent=record.sent + back)
    assert rules(again) == {"silence": ()}
    assert rules(dataclasses.replace(again, orders_s=[15.0])) == {}


def test_a_forbidden_request_to_the_autopilot_is_found():
    assert rules(at_rest(forbidden=[(5.0, "command 400")])) == {"authority: command 400": ()}


def test_forged_packets_excuse_setpoints():
    record = from_step(500, at_rest(), position_age_s=2.0)
    forged = dataclasses.replace(record, broken_s={Breaks.WORDS: 5.0})
    assert rules(forged) == {"stale": ("words",)}
    assert judge(forged).verdict == "outside"


@pytest.mark.parametrize(
    ("kind", "signed", "excused"),
    [
        ("forged_position", False, True),
        ("forged_position", True, False),
        ("origin_moved", False, True),
        ("origin_moved", True, True),
    ],
)
def test_on_a_signed_link_only_the_autopilots_own_words_excuse_setpoints(kind, signed, excused):
    fault = Fault(kind=kind, at_s=0.0, lasts_s=1.0, seed=1)
    drawn = dataclasses.replace(at_rest().draw, signed=signed, faults=(fault,))
    flight = RandomFlight(drawn)
    flight.run(1.0)
    flight._begin_fault(0, fault, [])
    assert (Breaks.WORDS in flight.broken_s) is excused


def test_distances_are_those_of_another_library():
    rng = np.random.default_rng(1)
    points_m = rng.uniform(-5.0, 25.0, (500, 2))
    notch = Polygon(
        name="notch", vertices_m=((2.0, 1.0), (12.0, 0.0), (10.0, 9.0), (7.0, 4.0), (3.0, 8.0))
    )
    for obstacle in (*SITE.obstacles, notch):
        ours, outline = clearance_m(obstacle, points_m), shape(obstacle)
        theirs = shapely.distance(outline, shapely.points(points_m))
        assert np.maximum(ours, 0.0) == pytest.approx(theirs, abs=1e-3)
        assert ((ours < 0.0) == shapely.contains_xy(outline, *points_m.T)).all()


# Drawn flights ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_there_are_enough_kinds_and_the_seeds_go_round_all_of_them():
    assert len(KINDS) >= 39
    drawn = {fault.kind for seed in range(1, 400) for fault in draw(seed).faults}
    assert drawn == set(KINDS)


def test_a_seed_is_the_same_flight_each_time_and_the_families_are_apart():
    assert repr(draw(7)) == repr(draw(7))
    assert repr(draw(7).faults) != repr(draw(8).faults)
    assert not set(DEVELOPMENT[-1:]) & set(HELD_OUT[:1])
    assert DEVELOPMENT.stop == HELD_OUT.start


def test_faults_end_before_the_flight_or_with_it():
    for seed in range(1, 100):
        assert all(0.0 < fault.at_s < LASTS_S for fault in draw(seed).faults)


def test_a_generated_site_leaves_room_to_take_off():
    import random

    for seed in range(30):
        site = generated_site(random.Random(seed), seed)
        column_m = np.column_stack([np.full(50, site.start_m[0]), np.linspace(0.0, 5.0, 50)])
        assert min(clearance_m(item, column_m).min() for item in site.obstacles) > 3.0


@pytest.mark.parametrize(("manner", "wind_mps"), [(Manner.PX4, 15.0), (Manner.ARDUPILOT, 8.0)])
def test_the_promised_wind_is_the_wind_that_the_autopilot_can_hold(manner, wind_mps):
    assert held_wind_mps(manner) == pytest.approx(wind_mps, abs=0.2)


# Flights ----------------------------------------------------------------------------------------

FLOWN = sampled(
    ("pilot_gives_back", "position_frozen"),
    ("pilot_gives_back", "position_frozen", "estimate_jump"),
)
SEED = 54
"""The remote control is lost."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", FLOWN)
def test_a_random_flight_keeps_the_promise(kind):
    record = RandomFlight(draw(2, [kind])).fly()
    judgement = judge(record)
    assert judgement.verdict in {"kept", "outside"}, judgement
    assert judgement.controlled_s > 0.0
    assert [note["kind"] for note in record.notes][:1] == [kind]


@pytest.mark.slow
def test_setpoints_until_a_restart_is_noticed_are_in_the_frame_before_it():
    """After its restart in the air the autopilot has another origin, 13 m higher."""
    row = row_of(1_001_379)
    assert [fault["kind"] for fault in row["faults"]] == ["autopilot_reboot"]
    assert row["verdict"] == "kept"


@pytest.mark.slow
def test_the_command_writes_the_same_row_each_time_and_flies_it_once(tmp_path, capsys):
    words = ["--seeds", f"{SEED}:{SEED + 1}", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "1 kept" in capsys.readouterr().out
    written = (tmp_path / "flights.jsonl").read_bytes()
    row = json.loads(written)
    assert (row["seed"], row["verdict"]) == (SEED, "kept")
    assert row["controlled_s"] > 0.0
    again = json.loads(json.dumps(row_of(SEED)))
    assert again == {name: value for name, value in row.items() if name not in {"code", "cpu_s"}}
    assert main(words) == 0
    assert (tmp_path / "flights.jsonl").read_bytes() == written
    assert {file.name for file in tmp_path.iterdir()} == {
        "flights.jsonl", "flights.parquet", "report.html", "summary.md",
    }  # fmt: skip


def test_the_summary_names_the_flights_that_broke_the_promise():
    row = {
        "seed": 5, "site": "s", "vehicle": "x500", "manner": "px4", "verdict": "broken",
        "faults": [{"kind": "gps_no_fix", "at_s": 2.0}], "least_clearance_m": 0.5,
        "least_keep_out_m": -0.1, "greatest_step_mps": None, "controlled_s": 5.0, "within_s": 5.0,
        "reached": False, "why": "holding: MOAR: wind 12.3 m/s > 10, holding", "cpu_s": 10.0,
        "violations": [
            {
                "rule": "keep_out", "value": -0.1, "time_s": 9.0, "state": "flying", "outside": [],
                "times": 2,
            },
        ],
    }  # fmt: skip
    text = summary([row])
    assert "seed 5 (px4, x500, s): keep_out -0.1 at 9.0 s (flying). Faults: gps_no_fix" in text
    assert "| keep_out | within the promise | 2 | 1: 5 |" in text
    assert "| gps_no_fix | 1 | 1 | 0 | 0 | 0.50 | 0.50 | -0.10 | -0.10 |  |  |" in text
    assert "| holding: MOAR: wind # m/s > #, holding | 1 |" in text
    assert "1,000 flights: 2.8 h" in text
