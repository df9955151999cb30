"""The causes by themselves, of where the aircraft is, the air, the way and the plan: at each
limit and just beyond, and where a measurement is missing.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.config import Supervision
from moar_companion.service.causes import uncertainty_m, widening_m
from moar_companion.types import Heard, Landed, LandedState, Mission

from .seen import (
    HOVERING,
    IN_FLIGHT,
    NOW_S,
    accuracy,
    found,
    leaves,
    moves,
    receives,
    risk,
    told,
    uncertain,
    wind,
)

STORIES = [
    ("jumps of 3 m", replace(IN_FLIGHT, jumped_m=3.0), {}),
    (
        "jumps of more",
        replace(IN_FLIGHT, jumped_m=3.1),
        {"jump": "the position jumped 3.1 m, more than 3 m"},
    ),
    ("an uncertainty of 2 m", uncertain(2.0, 0.3, 0.9), {}),
    (
        "a greater one",
        uncertain(2.1, 0.3, 0.9),
        {"uncertainty": "position uncertainty 2.1 m, more than 2 m"},
    ),
    (
        "one that only the odometry tells yet",
        uncertain(0.3, 2.1, 0.9),
        {"uncertainty": "position uncertainty 2.1 m, more than 2 m"},
    ),
    ("a receiver that is worse than the estimator", uncertain(0.3, None, 5.0), {}),
    (
        "a receiver whose word is all there is",
        uncertain(None, None, 2.1),
        {"uncertainty": "position uncertainty 2.1 m, more than 2 m"},
    ),
    (
        "a height that is known worse than the place",
        uncertain(0.3, 0.3, 0.9, heights_m=(2.1, 0.3, 0.3)),
        {"uncertainty": "position uncertainty 2.1 m, more than 2 m"},
    ),
    (
        "one that only the odometry tells yet",
        uncertain(0.3, 0.3, 0.9, heights_m=(0.3, 2.1, 0.3)),
        {"uncertainty": "position uncertainty 2.1 m, more than 2 m"},
    ),
    (
        "a height that the receiver knows badly, and a barometer keeps",
        uncertain(None, None, 0.9, heights_m=(None, None, 5.0)),
        {},
    ),
    (
        "an uncertainty that is told no more",
        uncertain(None, None, 0.0, last=[accuracy("receiver", 2.4)]),
        {
            "uncertainty": "position uncertainty 2.4 m, more than 2 m",
            "unknown": "not told, not supervised: position accuracy",
        },
    ),
    (
        "an uncertainty that nobody tells",
        uncertain(None, None, 0.0),
        {"unknown": "not told, not supervised: position accuracy"},
    ),
    ("a receiver 3 s silent", receives(received_s=97.0), {}),
    (
        "a receiver silent for longer",
        receives(received_s=96.9),
        {"gnss": "the receiver is silent for 3.1 s"},
    ),
    ("no 3D fix", receives(fix_type=2), {"gnss": "the receiver has no 3D fix"}),
    (
        "a receiver's clock that stands still for 1.5 s",
        replace(IN_FLIGHT, risk=risk(wind(4.0), since_s=98.5)),
        {},
    ),
    (
        "for longer",
        replace(IN_FLIGHT, risk=risk(wind(4.0), since_s=98.4)),
        {"gnss": "the receiver stopped 1.6 s ago"},
    ),
    (
        "a receiver without a clock",
        replace(receives(receiver_s=None), risk=risk(wind(4.0), receiver_s=None, since_s=0.0)),
        {},
    ),
    (
        "a localization risk of 0.9",
        replace(IN_FLIGHT, risk=risk(wind(4.0), localization=0.9)),
        {},
    ),
    (
        "a greater one",
        replace(IN_FLIGHT, risk=risk(wind(4.0), localization=0.96)),
        {"localization": "localization risk 1.0, more than 0.9"},
    ),
    (
        "a wind of 15 m/s",
        replace(IN_FLIGHT, risk=risk(wind(4.0), wind(15.0, source="from tilt"))),
        {},
    ),
    (
        "the strongest measurement of more",
        replace(IN_FLIGHT, risk=risk(wind(15.1), wind(4.0, source="from tilt"))),
        {"wind": "wind reported 15.1 m/s, more than 15 m/s"},
    ),
    (
        "a wind by a drag that nobody measured",
        replace(IN_FLIGHT, risk=risk(wind(16.0, source="from tilt")._replace(remark="default"))),
        {"wind": "wind from tilt 16.0 m/s, more than 15 m/s (default)"},
    ),
    (
        "a wind that was too uncertain from the start",
        replace(IN_FLIGHT, risk=risk(wind(30.0, risk=None))),
        {"unknown": "not told, not supervised: wind"},
    ),
    (
        "a wind that is measured no more",
        replace(IN_FLIGHT, risk=risk(wind(4.0, risk=None), last=[wind(25.0)])),
        {
            "wind": "wind reported 25.0 m/s, more than 15 m/s",
            "unknown": "not told, not supervised: wind",
        },
    ),
    (
        "one that was strong, and is measured again",
        replace(IN_FLIGHT, risk=risk(wind(4.0), last=[wind(25.0)])),
        {},
    ),
    (
        "a ground station 10 s silent",
        told(ground_station=Heard(received_s=90.0, system_id=255)),
        {},
    ),
    (
        "silent for longer",
        told(ground_station=Heard(received_s=89.4, system_id=255)),
        {"ground_link": "no ground station is heard for 11 s"},
    ),
    (
        "never heard",
        told(ground_station=None),
        {"unknown": "not told, not supervised: ground station"},
    ),
    ("outside", replace(IN_FLIGHT, strays="1.6 m outside"), {"geofence": "1.6 m outside"}),
    ("outside before control", replace(HOVERING, strays="1.6 m outside"), {}),
    ("1.5 m beside the path", replace(IN_FLIGHT, error_m=1.5), {}),
    (
        "farther",
        replace(IN_FLIGHT, error_m=1.6),
        {"off_path": "off the path 1.6 m, more than 1.5 m"},
    ),
    (
        "a setpoint that stands, nobody knows how far from the aircraft",
        replace(IN_FLIGHT, stands=True, error_m=None),
        {"standing": "it stands on its way"},
    ),
    (
        "one that waits for the aircraft",
        replace(IN_FLIGHT, stands=True, error_m=1.4),
        {"standing": "it stands on its way, 1.4 m from its setpoint"},
    ),
    ("away from a hold that is offered", replace(HOVERING, error_m=1.6), {}),
    ("a plan awaited for 6 s", replace(IN_FLIGHT, plan_awaited_s=6.0), {}),
    (
        "for longer",
        replace(IN_FLIGHT, plan_awaited_s=12.0),
        {"planner_late": "a new plan is awaited for 12.0 s"},
    ),
    (
        "for more than 12 s",
        replace(IN_FLIGHT, plan_awaited_s=12.1),
        {
            "planner_late": "a new plan is awaited for 12.1 s",
            "planner": "a new plan is awaited for 12.1 s",
        },
    ),
    ("a keep-out touched", replace(IN_FLIGHT, room_m=0.0), {}),
    (
        "a keep-out entered",
        replace(IN_FLIGHT, room_m=-0.3),
        {"obstacle": "0.3 m too close to an obstacle"},
    ),
    ("room for the uncertainty", replace(uncertain(1.4, None, None), room_m=0.51), {}),
    (
        "too little room for it",
        replace(uncertain(1.4, None, None), room_m=0.3),
        {"obstacle": "0.2 m too close to an obstacle, position uncertainty 1.4 m"},
    ),
    ("no obstacle anywhere", replace(IN_FLIGHT, room_m=None), {}),
    ("a way out with time to spare", leaves(Mission.EVACUATION, 90.1), {}),
    (
        "with little",
        leaves(Mission.EVACUATION, 90.0),
        {"no_return_soon": "90 s of flight left after the evacuation, at 30 s it begins"},
    ),
    (
        "with none",
        leaves(Mission.EVACUATION, 30.0),
        {
            "no_return_evacuation": "30 s of flight left after the evacuation, the reserve is 30 s",
        },
    ),
    (
        "the exit with none",
        leaves(Mission.EXIT, -1.0),
        {
            "no_return_exit": "0 s of flight left after the exit, the reserve is 30 s",
        },
    ),
    (
        "an exit with none that is flown, and an evacuation",
        leaves(Mission.EVACUATION, 200.0, flown_left_s=29.0),
        {
            "no_return_evacuation": "29 s of flight left after the exit, the evacuation takes less",
        },
    ),
    ("a way out while nothing is known of the battery", leaves(Mission.EXIT, None), {}),
    ("a way out planned 15 s ago", leaves(Mission.EXIT, 600.0, age_s=15.0), {}),
    (
        "one planned earlier",
        leaves(Mission.EXIT, 10.0, age_s=15.1),
        {
            "no_return_exit": "10 s of flight left after the exit, the reserve is 30 s",
            "unknown": "not told, not supervised: way out",
        },
    ),
    (
        "no way out, and no word of the landed state",
        replace(told(landed=None), way_out=None),
        {"unknown": "not told, not supervised: way out"},
    ),
    ("2 m from the plane", moves(position_m=(5.0, -2.0, 5.0)), {}),
    (
        "farther",
        moves(position_m=(5.0, -2.1, 5.0)),
        {"plane": "2.1 m from the plane, more than 2 m"},
    ),
    ("farther in flight", moves(IN_FLIGHT, position_m=(5.0, 9.0, 5.0)), {}),
    ("moving at 1 m/s", moves(velocity_mps=(0.6, 0.0, 0.8)), {}),
    (
        "faster",
        moves(velocity_mps=(0.6, 0.9, 0.0)),
        {"moving": "moving at 1.1 m/s, more than 1 m/s: hover first"},
    ),
    ("faster in flight", moves(IN_FLIGHT, velocity_mps=(5.0, 0.0, 0.0)), {}),
    (
        "nothing of the aircraft but that it flies",
        replace(
            told(batteries={}, gnss=None, estimator=None, odometry=None), risk=risk(accuracies=())
        ),
        {"unknown": "not told, not supervised: wind, battery, position accuracy"},
    ),
    (
        "nothing of it on the ground",
        replace(
            told(
                HOVERING,
                batteries={},
                landed=Landed(received_s=NOW_S, state=LandedState.ON_GROUND),
            ),
            risk=risk(),
        ),
        {"ground": "on the ground", "not_flying": "not in the air"},
    ),
]


@pytest.mark.parametrize(("case", "seen", "expected"), STORIES, ids=[row[0] for row in STORIES])
def test_this_and_nothing_else_stands_against_a_flight(case, seen, expected):
    assert found(seen) == expected, case


@pytest.mark.parametrize(
    ("known", "uncertainty", "widening"),
    [
        ((0.3, 0.4, 5.0), 0.4, 0.0),
        ((1.4, 0.4, 5.0), 1.4, 0.5),
        ((None, 1.9, 5.0), 1.9, 1.0),
        ((None, None, 0.9), 0.9, 0.0),
        ((None, None, 0.0), None, 0.0),
        ((0.0, 0.0, 1.4), 1.4, 0.5),
    ],
)
def test_obstacles_grow_by_what_the_keep_outs_do_not_allow_for(known, uncertainty, widening):
    estimate = uncertain(*known).risk
    assert uncertainty_m(estimate) == uncertainty
    assert widening_m(estimate, Supervision()) == pytest.approx(widening)


@pytest.mark.parametrize(
    ("before", "now", "uncertainty"),
    [
        ({"estimator": 1.8}, (None, None, 0.9), 1.8),
        ({"estimator": 1.8}, (None, None, 2.5), 2.5),
        ({"estimator": 1.8}, (0.4, None, 2.5), 0.4),
        ({"estimator": 0.3, "odometry": 1.6}, (0.3, None, 0.9), 1.6),
        ({"receiver": 1.7}, (None, None, 0.0), 1.7),
        ({"receiver": 1.7}, (None, None, 1.1), 1.1),
    ],
)
def test_what_a_source_told_counts_until_it_tells_something_else(before, now, uncertainty):
    last = [accuracy(source, value_m) for source, value_m in before.items()]
    assert uncertainty_m(uncertain(*now, last=last).risk) == uncertainty


@pytest.mark.parametrize(
    ("known", "heights", "uncertainty"),
    [
        ((0.3, 0.4, 0.9), (1.4, 0.3, 5.0), 1.4),
        ((0.3, 0.4, 0.9), (0.3, 1.6, 5.0), 1.6),
        ((1.8, 0.4, 0.9), (1.4, 0.3, 5.0), 1.8),
        ((None, None, 0.9), (1.4, None, 5.0), 1.4),
        ((None, None, 1.7), (1.4, None, 5.0), 1.7),
        ((None, None, 0.9), (None, None, 5.0), 0.9),
    ],
)
def test_of_place_and_height_the_worse_counts(known, heights, uncertainty):
    assert uncertainty_m(uncertain(*known, heights_m=heights).risk) == uncertainty
