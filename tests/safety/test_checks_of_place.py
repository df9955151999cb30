"""Causes of the position, the air, the route and the plan, one by one: at each limit, just
beyond, and where a measurement is missing.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.companion.safety.check_inputs import Unmeasured
from moar_companion.companion.safety.position_checks import widening_m
from moar_companion.mavlink.telemetry import Landed, LandedState, PeerHeartbeat
from moar_companion.perception.perception_report import LineOffset
from moar_companion.planner.site import Margin
from moar_companion.risk.wind import USUAL_DRAG
from moar_companion.types import Mission

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
    uncertain,
    wind,
    with_telemetry,
)


def by_line(**changes):
    """In flight with a place by the line."""
    return replace(IN_FLIGHT, line=LineOffset(**{"seen_s": NOW_S - 0.1, "wires": 4} | changes))


STORIES = [
    ("jumps of 3 m", replace(IN_FLIGHT, jumped_m=3.0), {}),
    ("an origin that moved less", replace(IN_FLIGHT, origin_moved_m=0.9, origin_margin_m=0.9), {}),
    (
        "an origin that moved farther than the margin",
        replace(IN_FLIGHT, origin_moved_m=1.2, origin_margin_m=0.93),
        {"origin_moved": "the origin moved 1.2 m > 0.9"},
    ),
    ("a line 6 m off", by_line(offset_m=(3.6, -4.8)), {}),
    (
        "a line farther off than any drift",
        by_line(offset_m=(-4.4, 4.5)),
        {"line": "line off by 6.3 m > 6"},
    ),
    ("wires that fit nowhere for a moment", by_line(contradicted_s=NOW_S - 2.0), {}),
    (
        "wires that fit nowhere",
        by_line(contradicted_s=NOW_S - 2.1),
        {"line": "wires off the line for 2.1 s > 2"},
    ),
    ("a line of which nothing is known", by_line(offset_m=(9.0, 0.0), seen_s=None), {}),
    ("local and global position as apart as they are", replace(IN_FLIGHT, global_off_m=0.5), {}),
    (
        "local and global position apart",
        replace(IN_FLIGHT, global_off_m=0.61, home_off_m=3.0),
        {"position_disagreement": "global position off 0.6 m > 0.5"},
    ),
    (
        "a home that is not where its origin says",
        replace(IN_FLIGHT, global_off_m=0.1, home_off_m=3.0),
        {"position_disagreement": "home position off 3.0 m > 0.5"},
    ),
    (
        "jumps of more",
        replace(IN_FLIGHT, jumped_m=3.1),
        {"position_jump": "the position jumped 3.1 m > 3"},
    ),
    (
        "blown off with its setpoint",
        replace(IN_FLIGHT, drifted_m=12.4),
        {"control_saturated": "wind too strong, drifting 12 m"},
    ),
    ("leaning at its limit, on its path", replace(IN_FLIGHT, saturated=True, error_m=1.5), {}),
    (
        "leaning at its limit, off its path",
        replace(IN_FLIGHT, saturated=True, error_m=1.6),
        {
            "control_saturated": "wind too strong, 1.6 m off path",
            "off_path": "off the path 1.6 m > 1.5",
        },
    ),
    (
        "off its path, not leaning at its limit",
        replace(IN_FLIGHT, error_m=1.9),
        {"off_path": "off the path 1.9 m > 1.5"},
    ),
    (
        "more wind than it holds with a margin, less than the limit",
        replace(IN_FLIGHT, risk=risk(wind(10.4)), held_wind_mps=12.9),
        {"wind": "wind reported 10.4 m/s > 10.3"},
    ),
    ("an uncertainty of 2 m", uncertain(2.0, 0.3, 0.9), {}),
    (
        "a greater one",
        uncertain(2.1, 0.3, 0.9),
        {"uncertainty": "uncertainty 2.1 m > 2"},
    ),
    ("one that will be 2 m soon", replace(IN_FLIGHT, uncertainty_soon_m=2.0), {}),
    (
        "one that will be greater soon",
        replace(IN_FLIGHT, uncertainty_soon_m=3.3),
        {"uncertainty_grows": "uncertainty grows: 3.3 m in 8 s"},
    ),
    (
        "one that will be greater soon on an escape route",
        replace(IN_FLIGHT, uncertainty_soon_m=3.3, escaping=True),
        {},
    ),
    (
        "one that will reach an obstacle",
        replace(IN_FLIGHT, uncertainty_soon_m=3.3, error_hits="right-middle"),
        {
            "uncertainty_grows": "uncertainty grows: 3.3 m in 8 s",
            "error_reach": "3.3 m error would hit right-middle",
        },
    ),
    (
        "one that will reach an obstacle on an escape route",
        replace(IN_FLIGHT, uncertainty_soon_m=3.3, error_hits="right-middle", escaping=True),
        {"error_reach": "3.3 m error would hit right-middle"},
    ),
    (
        "one that will reach an obstacle before control",
        replace(HOVERING, uncertainty_soon_m=3.3, error_hits="right-middle"),
        {"uncertainty_grows": "uncertainty grows: 3.3 m in 8 s"},
    ),
    (
        "a blind landing that hits an obstacle",
        replace(IN_FLIGHT, blind_hit="no fix: descent hits wire"),
        {"blind_landing": "no fix: descent hits wire"},
    ),
    (
        "a battery's landing before the way out is clear",
        replace(IN_FLIGHT, battery_landing="landing 27 s < 41 to leave"),
        {"battery_landing": "landing 27 s < 41 to leave"},
    ),
    (
        "both before control",
        replace(HOVERING, blind_hit="words", battery_landing="words"),
        {},
    ),
    (
        "one that only the odometry tells yet",
        uncertain(0.3, 2.1, 0.9),
        {"uncertainty": "uncertainty 2.1 m > 2"},
    ),
    ("a receiver that is worse than the estimator", uncertain(0.3, None, 5.0), {}),
    (
        "a receiver whose word is all there is",
        uncertain(None, None, 2.1),
        {"uncertainty": "uncertainty 2.1 m > 2"},
    ),
    (
        "a height that is known worse than the place",
        uncertain(0.3, 0.3, 0.9, heights_m=(2.1, 0.3, 0.3)),
        {"uncertainty": "uncertainty 2.1 m > 2"},
    ),
    (
        "one that only the odometry tells yet",
        uncertain(0.3, 0.3, 0.9, heights_m=(0.3, 2.1, 0.3)),
        {"uncertainty": "uncertainty 2.1 m > 2"},
    ),
    (
        "a height that the receiver knows badly, and a barometer keeps",
        uncertain(None, None, 0.9, heights_m=(None, None, 5.0)),
        {},
    ),
    (
        "an uncertainty that is reported no more",
        uncertain(None, None, 0.0, last=[accuracy("receiver", 2.4)]),
        {
            "uncertainty": "uncertainty 2.4 m > 2",
            "unmonitored": "unknown: position accuracy",
        },
    ),
    (
        "an uncertainty that nobody tells",
        uncertain(None, None, 0.0),
        {"unmonitored": "unknown: position accuracy"},
    ),
    ("a receiver 3 s silent", receives(received_s=97.0), {}),
    (
        "a receiver silent for longer",
        receives(received_s=96.9),
        {"gnss": "GNSS receiver silent for 3.1 s"},
    ),
    ("no 3D fix", receives(fix_type=2), {"gnss": "GNSS receiver has no 3D fix"}),
    (
        "a receiver's clock that stands still for 1.5 s",
        replace(IN_FLIGHT, risk=risk(wind(4.0), since_s=98.5)),
        {},
    ),
    (
        "for longer",
        replace(IN_FLIGHT, risk=risk(wind(4.0), since_s=98.4)),
        {"gnss": "GNSS receiver stopped 1.6 s ago"},
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
        {"localization": "localization risk 1.0 > 0.9"},
    ),
    (
        "a wind of 15 m/s",
        replace(IN_FLIGHT, risk=risk(wind(4.0), wind(15.0, source="from tilt"))),
        {},
    ),
    (
        "the strongest measurement of more",
        replace(IN_FLIGHT, risk=risk(wind(15.1), wind(4.0, source="from tilt"))),
        {"wind": "wind reported 15.1 m/s > 15"},
    ),
    (
        "a wind by a drag that nobody measured",
        replace(IN_FLIGHT, risk=risk(wind(16.0, source="from tilt")._replace(remark=USUAL_DRAG))),
        {"wind": "wind 16.0 m/s, drag not measured (wind from tilt 16.0 m/s > 15)"},
    ),
    (
        "a wind that was too uncertain from the start",
        replace(IN_FLIGHT, risk=risk(wind(30.0, risk=None))),
        {"unmonitored": "unknown: wind"},
    ),
    (
        "a wind that is measured no more",
        replace(IN_FLIGHT, risk=risk(wind(4.0, risk=None), last=[wind(25.0)])),
        {
            "wind": "wind reported 25.0 m/s > 15",
            "unmonitored": "unknown: wind",
        },
    ),
    (
        "one that was strong, and is measured again",
        replace(IN_FLIGHT, risk=risk(wind(4.0), last=[wind(25.0)])),
        {},
    ),
    (
        "a ground station 10 s silent",
        with_telemetry(ground_station=PeerHeartbeat(received_s=90.0, system_id=255)),
        {},
    ),
    (
        "silent for longer",
        with_telemetry(ground_station=PeerHeartbeat(received_s=89.4, system_id=255)),
        {"ground_link": "no ground station for 11 s"},
    ),
    (
        "never heard",
        with_telemetry(ground_station=None),
        {"unmonitored": "unknown: ground station"},
    ),
    (
        "outside",
        replace(IN_FLIGHT, excursion="1.6 m outside the workspace"),
        {"outside_workspace": "1.6 m outside the workspace"},
    ),
    (
        "a path that leaves the autopilot's fence",
        replace(IN_FLIGHT, faults=Unmeasured(autopilot_fence="path past FENCE_ALT_MAX 9 m")),
        {"autopilot_fence": "path past FENCE_ALT_MAX 9 m"},
    ),
    (
        "before control another one is planned",
        replace(HOVERING, faults=Unmeasured(autopilot_fence="path past FENCE_ALT_MAX 9 m")),
        {},
    ),
    (
        "an autopilot that does not tell its uploaded fence",
        replace(IN_FLIGHT, fence_silent=True),
        {"unmonitored": "unknown: uploaded fence"},
    ),
    ("outside before control", replace(HOVERING, excursion="1.6 m outside the workspace"), {}),
    ("1.5 m beside the path", replace(IN_FLIGHT, error_m=1.5), {}),
    (
        "farther",
        replace(IN_FLIGHT, error_m=1.6),
        {"off_path": "off the path 1.6 m > 1.5"},
    ),
    (
        "a setpoint that is at rest, nobody knows how far from the aircraft",
        replace(IN_FLIGHT, stopped=True, error_m=None),
        {"no_progress": "no progress"},
    ),
    (
        "one that waits for the aircraft",
        replace(IN_FLIGHT, stopped=True, error_m=1.4),
        {"no_progress": "no progress, 1.4 m from setpoint"},
    ),
    ("away from a hold that is offered", replace(HOVERING, error_m=1.6), {}),
    ("a plan awaited for 6 s", replace(IN_FLIGHT, plan_awaited_s=6.0), {}),
    (
        "for longer",
        replace(IN_FLIGHT, plan_awaited_s=12.0),
        {"planner_late": "no new plan for 12.0 s > 6"},
    ),
    (
        "for more than 12 s",
        replace(IN_FLIGHT, plan_awaited_s=12.1),
        {
            "planner_late": "no new plan for 12.1 s > 12",
            "planner": "no new plan for 12.1 s > 12",
        },
    ),
    ("a keep-out touched", replace(IN_FLIGHT, room_m=0.0), {}),
    (
        "a keep-out entered",
        replace(IN_FLIGHT, room_m=-0.3),
        {"obstacle": "0.3 m too close to an obstacle"},
    ),
    (
        "room for the uncertainty",
        replace(uncertain(1.4, None, None), room_m=0.51, widening_m=0.5),
        {},
    ),
    (
        "a keep-out hardly entered",
        replace(IN_FLIGHT, room_m=-1e-4),
        {"obstacle": "0.01 m too close to an obstacle"},
    ),
    (
        "too little room for it",
        replace(uncertain(1.4, None, None), room_m=0.3, widening_m=0.5),
        {"obstacle": "0.2 m too close to an obstacle (position uncertainty 1.4 m)"},
    ),
    ("no obstacle anywhere", replace(IN_FLIGHT, room_m=None), {}),
    ("an escape route with time to spare", leaves(Mission.EVACUATION, 90.1), {}),
    (
        "with little",
        leaves(Mission.EVACUATION, 90.0),
        {"energy_low_soon": "evacuation leaves 90 s, due at 30"},
    ),
    (
        "with none",
        leaves(Mission.EVACUATION, 30.0),
        {
            "energy_evacuation": "evacuation leaves 30 s <= 30",
        },
    ),
    (
        "the exit with none",
        leaves(Mission.EXIT, -1.0),
        {
            "energy_exit": "exit leaves no flight time",
        },
    ),
    (
        "an exit with none that is flown, and an evacuation",
        leaves(Mission.EVACUATION, 200.0, flown_left_s=29.0),
        {
            "energy_evacuation": "exit leaves 29 s (the evacuation takes less)",
        },
    ),
    ("an escape route while nothing is known of the battery", leaves(Mission.EXIT, None), {}),
    ("an escape route planned 15 s ago", leaves(Mission.EXIT, 600.0, age_s=15.0), {}),
    (
        "one planned earlier",
        leaves(Mission.EXIT, 10.0, age_s=15.1),
        {
            "energy_exit": "exit leaves 10 s <= 30",
            "unmonitored": "unknown: escape route",
        },
    ),
    (
        "no escape route, and no word of the landed state",
        replace(with_telemetry(landed=None), escape_route=None),
        {"unmonitored": "unknown: escape route"},
    ),
    ("2 m from the plane", moves(position_m=(5.0, -2.0, 5.0)), {}),
    (
        "farther",
        moves(position_m=(5.0, -2.1, 5.0)),
        {"off_plane": "2.1 m right of plane > 2"},
    ),
    (
        "hardly farther",
        moves(position_m=(5.0, -2.001, 5.0)),
        {"off_plane": "over 2 m right of plane"},
    ),
    ("farther in flight", moves(IN_FLIGHT, position_m=(5.0, 9.0, 5.0)), {}),
    ("moving at 1 m/s", moves(velocity_mps=(0.6, 0.0, 0.8)), {}),
    (
        "faster",
        moves(velocity_mps=(0.6, 0.9, 0.0)),
        {"not_hovering": "moving at 1.1 m/s > 1, hover"},
    ),
    ("faster in flight", moves(IN_FLIGHT, velocity_mps=(5.0, 0.0, 0.0)), {}),
    (
        "nothing of the aircraft but that it flies",
        replace(
            with_telemetry(batteries={}, gnss=None, estimator=None, odometry=None),
            risk=risk(accuracies=()),
        ),
        {"unmonitored": "unknown: wind, battery and 1 more (position accuracy)"},
    ),
    (
        "nothing of it on the ground",
        replace(
            with_telemetry(
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
def test_exactly_the_expected_causes_are_found(case, seen, expected):
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
def test_obstacles_are_inflated_by_the_uncertainty_beyond_the_keep_outs(
    known, uncertainty, widening
):
    estimate = uncertain(*known).risk
    assert estimate.position_uncertainty_m == uncertainty
    assert widening_m(estimate, Margin(position_m=0.9, tracking_m=1.0)) == pytest.approx(widening)


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
def test_the_last_accuracy_of_a_source_counts_until_its_next_one(before, now, uncertainty):
    last = [accuracy(source, value_m) for source, value_m in before.items()]
    assert uncertain(*now, last=last).risk.position_uncertainty_m == uncertainty


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
def test_the_worse_of_horizontal_and_height_accuracy_counts(known, heights, uncertainty):
    assert uncertain(*known, heights_m=heights).risk.position_uncertainty_m == uncertainty
