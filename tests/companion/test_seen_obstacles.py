"""Obstacles that a sensor sees in flight: new maps, another path, holds, texts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.estimation.pose import Setpoint
from moar_companion.companion.planning.map_jobs import SettingsJob, answer_map_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.companion.status import LatestDecisions
from moar_companion.perception.perception_report import PerceptionReport
from moar_companion.perception.pose_notes import AttitudeNote, PointsNote, PositionNote
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Margin, Polygon
from moar_companion.settings.perception_config import Perception, Sensor
from tests.companion.desk import (
    EXIT,
    INSPECTION,
    KEEP_OUT_M,
    USER_1,
    Desk,
)
from tests.companion.scripted_autopilot import POSCTL
from tests.companion.watched import SETTINGS, Watched, ahead, conductor, copied, nearest_m
from tests.mavlink.peer import Peer

WALL = Polygon(
    name="seen-solid-1", vertices_m=((19.0, -1.0), (19.6, -1.0), (19.6, 21.0), (19.0, 21.0))
)


@pytest.fixture(scope="module")
def flight():
    """A flight of two seconds towards the inner splice."""
    return Watched().fly()


@pytest.fixture
def desk(flight):
    return copied(flight)


@pytest.mark.uncounted
def test_a_conductor_in_the_path_moves_the_path_before_the_aircraft_comes_to_it(desk):
    x_m, z_m = ahead(desk)
    desk.conductors = (conductor(x_m, z_m),)
    desk.run(1.0)
    assert desk.state == "flying"
    assert np.hypot(*(desk.ahead_m - (x_m, z_m)).T).min() > 1.4
    least_m = math.inf
    while desk.place_m[0] > x_m - 2.0:
        desk.step()
        least_m = min(least_m, math.dist(desk.place_m[::2], (x_m, z_m)))
    assert desk.state == "flying"
    kept_m = desk.vehicle.radius_m + SETTINGS.keep_out_m + desk.site.margin.total_m
    assert least_m > kept_m - 0.3


def test_the_aircraft_brakes_for_an_obstacle_just_ahead_and_takes_another_path(desk):
    x_m, z_m = ahead(desk, 1.0)
    desk.solids = (
        Polygon(
            name="seen-solid-1",
            vertices_m=((x_m, z_m), (x_m + 0.3, z_m), (x_m + 0.3, z_m + 0.3), (x_m, z_m + 0.3)),
        ),
    )
    desk.run(1.0)
    start_m = desk.place_m
    assert math.dist(start_m[::2], (x_m, z_m)) > desk.vehicle.radius_m
    began_m = math.dist(start_m[::2], (x_m, z_m))
    assert nearest_m(desk, (x_m, z_m), 10.0) >= began_m - 0.3
    assert desk.state == "flying"
    assert desk.place_m[0] < x_m - 1.0


@pytest.mark.uncounted
def test_without_a_path_round_an_obstacle_the_mission_holds_until_the_obstacle_is_gone(desk):
    desk.solids = (WALL,)
    desk.run(3.0)
    assert desk.state == "holding"
    assert "MOAR: no path round seen-solid-1, holding" in desk.texts()
    assert desk.place_m[0] > 20.0
    desk.solids = ()
    desk.run(4.0)
    assert desk.state == "flying"
    assert desk.ahead_m[-1][0] < 19.0


def test_a_sensor_that_is_lost_holds_and_its_return_resumes(desk):
    desk.works = False
    desk.run(1.5)
    assert desk.state == "holding"
    assert any("lidar scan age" in text or "lidar silent" in text for text in desk.texts())
    desk.handle(desk.operator.command(USER_1, EXIT, -1))
    desk.run(1.0)
    assert desk.companion.status.task.mission.value == "exit"


def test_a_sensor_that_returns_resumes_the_inspection(desk):
    desk.works = False
    desk.run(1.5)
    desk.works = True
    desk.run(4.0)
    assert desk.state == "flying"


def test_without_data_of_the_sensor_no_inspection_begins():
    desk = Watched()
    desk.works = False
    desk.run(1.0)
    desk.handle(desk.operator.command(USER_1, INSPECTION, 1))
    desk.run(1.0)
    assert desk.state == "idle"
    assert any("no data of the lidar" in text for text in desk.texts())


def test_a_conductor_beside_its_place_in_the_file_is_reported_and_both_places_are_avoided(desk):
    name = "left-middle"
    (known,) = (item for item in desk.site.obstacles if item.name == name)
    x_m, z_m = known.position_m
    desk.conductors = (conductor(x_m + 1.0, z_m),)
    desk.run(1.0)
    assert "MOAR: left-middle 1.0 m off the file, avoided" in desk.texts()
    obstacles = desk.map_jobs[-1].site.obstacles
    assert known in obstacles
    (seen,) = (item for item in obstacles if item.name == "seen-1")
    assert seen.position_m == (x_m + 1.0, z_m)
    assert seen.keep_out_m == known.keep_out_m


def test_a_conductor_at_its_place_in_the_file_changes_nothing(desk):
    conductors = [item for item in desk.site.obstacles if item.name.startswith("left")]
    desk.conductors = tuple(
        conductor(item.position_m[0] + 0.1, item.position_m[1] - 0.1, f"seen-{number}")
        for number, item in enumerate(conductors)
    )
    desk.run(1.0)
    assert desk.map_jobs == []


def test_a_conductor_in_no_file_is_reported_once(desk):
    desk.conductors = (conductor(3.0, 14.5),)
    desk.run(2.0)
    assert desk.texts().count("MOAR: wire 1 at x 3.0, z 14.5, avoided") == 1
    assert len(desk.map_jobs) == 1
    desk.conductors = (conductor(3.1, 14.5),)
    desk.run(1.0)
    assert len(desk.map_jobs) == 1, "it moves by less than its place is known"
    desk.conductors = (conductor(3.3, 14.5),)
    desk.run(1.0)
    assert len(desk.map_jobs) == 2


def test_each_of_several_conductors_seen_at_once_is_reported(desk):
    desk.conductors = tuple(conductor(2.0 + n, 14.0, f"seen-{n}") for n in range(1, 5))
    desk.run(0.5)
    assert sum("MOAR: wire" in text for text in desk.texts()) == 4


@pytest.mark.slow
def test_a_target_in_a_seen_keep_out_is_moved_and_still_looked_at():
    desk = Watched(height_m=9.0, east_m=-10.0).fly(0.5)
    target = desk.site.target("splice-inner")
    x_m, z_m = target.position_m
    desk.conductors = (conductor(x_m + 0.6, z_m),)
    desk.run_until("at_target", 90.0)
    end_x_m, _, end_z_m = desk.place_m
    moved_m = math.dist((end_x_m, end_z_m), target.position_m)
    assert 0.4 < moved_m < SETTINGS.target_slack_m + 0.3
    kept_m = desk.vehicle.radius_m + SETTINGS.keep_out_m
    assert math.dist((end_x_m, end_z_m), (x_m + 0.6, z_m)) > kept_m - 0.2


def test_a_seen_obstacle_that_is_not_on_the_maps_holds_and_is_not_reported_as_avoided(desk):
    desk.maps_made = False
    desk.conductors = (conductor(3.0, 14.5),)
    desk.run(2.0)
    assert len(desk.map_jobs) > 3
    assert desk.state == "holding"
    assert any("obstacle unmapped for" in text for text in desk.texts())
    assert not any("avoided" in text for text in desk.texts())
    desk.maps_made = True
    desk.run(4.0)
    assert desk.state == "flying"
    assert "MOAR: wire 1 at x 3.0, z 14.5, avoided" in desk.texts()


def test_maps_that_come_late_hold_and_are_taken(desk):
    desk.map_delay_s = 2.5
    x_m, z_m = ahead(desk)
    desk.conductors = (conductor(x_m, z_m),)
    desk.run(1.5)
    assert desk.state == "holding"
    desk.run(5.0)
    assert desk.companion.state.routes.limits.site_maps.site.obstacles[-1].name == "seen-1"


def test_an_obstacle_reported_while_other_maps_are_made_counts_as_missing_from_then_on(desk):
    desk.map_delay_s = 0.95
    desk.conductors = (conductor(2.0, 15.0),)
    while not desk.map_jobs:
        desk.step()
    desk.conductors += (conductor(*TWO_M[1], "seen-2"),)
    desk.run(0.1 + SETTINGS.timeout_s + 0.2)
    assert "perception" in desk.companion.ruling.names


def test_an_obstacle_whose_removal_failed_is_removed_later(desk):
    desk.conductors = (conductor(3.0, 14.5),)
    desk.run(0.5)
    desk.conductors, desk.maps_made = (), False
    desk.run(0.5)
    desk.maps_made = True
    desk.run(0.5)
    names = [item.name for item in desk.companion.state.routes.limits.site_maps.site.obstacles]
    assert "seen-1" not in names


def test_a_sensor_restart_removes_nothing_from_the_maps_until_landing(desk):
    def seen():
        site = desk.companion.state.routes.limits.site_maps.site
        return sum(item.name.startswith("seen") for item in site.obstacles)

    desk.conductors = (conductor(3.0, 14.5),)
    desk.run(0.5)
    desk.began_s, desk.scans, desk.conductors = desk.now_s, False, ()
    desk.run(0.5)
    assert seen() == 1
    desk.scans = True
    desk.run(1.0)
    assert seen() == 1, "the new process has not looked there yet"
    desk.set(mode=POSCTL, armed=False, landed_state=1)
    desk.run(1.5)
    assert seen() == 0


def seen_m(desk):
    """Places of the seen conductors on the maps."""
    site = desk.companion.state.routes.limits.site_maps.site
    return [item.position_m for item in site.obstacles if item.name.startswith("seen")]


TWO_M = ((3.0, 14.5), (6.0, 16.5))


def two_wires(desk, first_m, second_m):
    """Two wires, reported ten times with a noise of 1 cm."""
    for number in range(10):
        off_m = 0.01 * (number % 3 - 1)
        desk.conductors = tuple(
            conductor(x_m + off_m, z_m, name)
            for (x_m, z_m), name in ((first_m, "seen-1"), (second_m, "seen-2"))
        )
        desk.run(0.1)


def test_obstacles_that_a_restarted_process_finds_again_need_no_maps_whatever_their_names(desk):
    two_wires(desk, *TWO_M)
    made = len(desk.map_jobs)
    texts = desk.texts()
    for _ in range(3):
        desk.began_s = desk.now_s
        two_wires(desk, *reversed(TWO_M))
    assert (len(desk.map_jobs), len(seen_m(desk)), desk.texts()) == (made, 2, texts)


def test_obstacles_whose_maps_failed_outlast_a_restart_of_the_process(desk):
    desk.conductors, desk.maps_made = (conductor(*TWO_M[0]),), False
    desk.run(0.5)
    desk.began_s, desk.conductors, desk.maps_made = desk.now_s, (), True
    desk.run(0.5)
    assert seen_m(desk) == [TWO_M[0]]


def test_obstacles_of_a_process_that_has_ended_move_with_a_jump_of_the_estimate(desk):
    desk.conductors = (conductor(*TWO_M[0]),)
    desk.run(0.5)
    desk.began_s, desk.conductors = desk.now_s, ()
    desk.run(0.2)
    before_m = desk.place_m
    desk.set(estimate_off_ned_m=(0.0, 2.0, -0.5)).run(0.4)
    jump_m = [after - before for after, before in zip(desk.place_m, before_m, strict=True)]
    ((x_m, z_m),) = seen_m(desk)
    assert (x_m - TWO_M[0][0], z_m - TWO_M[0][1]) == pytest.approx((jump_m[0], jump_m[2]), abs=0.3)
    assert math.hypot(x_m - TWO_M[0][0], z_m - TWO_M[0][1]) > 1.5


def test_a_conductor_at_the_tolerance_of_its_place_does_not_rebuild_the_maps_repeatedly(desk):
    (known,) = (item for item in desk.site.obstacles if item.name == "left-middle")
    x_m, z_m = known.position_m
    for number in range(40):
        desk.conductors = (conductor(x_m + (0.24 if number % 2 else 0.26), z_m),)
        desk.run(0.1)
    assert len(desk.map_jobs) == 1


def test_two_conductors_near_one_of_the_file_are_reported_once_each(desk):
    (known,) = (item for item in desk.site.obstacles if item.name == "left-middle")
    x_m, z_m = known.position_m
    desk.conductors = (conductor(x_m + 0.8, z_m), conductor(x_m - 1.2, z_m, "seen-2"))
    desk.run(3.0)
    reported = [
        item for item in desk.decisions if item.kind == "text" and "off the file" in str(item)
    ]
    assert len(reported) == 2


def test_poses_are_noted_each_at_its_own_time():
    desk = Watched()
    desk.run(1.0)
    positions = [note for note in desk.notes if isinstance(note, PositionNote)]
    attitudes = [note for note in desk.notes if isinstance(note, AttitudeNote)]
    assert len(positions) == pytest.approx(25, abs=3)
    assert len(attitudes) == pytest.approx(25, abs=3)
    assert np.diff([note.time_s for note in positions]) == pytest.approx(0.04, abs=1e-3)
    assert positions[-1].time_s == pytest.approx(desk.now_s, abs=0.05)
    assert positions[-1].position_m == pytest.approx(desk.place_m)


def test_a_jump_of_the_estimate_is_noted_with_each_later_position():
    desk = Watched().run(1.0)
    desk.set(estimate_off_ned_m=(0.0, 1.0, 0.0))
    desk.run(0.4)
    desk.set(estimate_off_ned_m=(0.0, 0.0, 0.0))
    desk.run(0.2)
    jumps_m = [note.jumped_m[0] for note in desk.notes if isinstance(note, PositionNote)]
    assert jumps_m[0] == 0.0
    assert jumps_m[-6] == pytest.approx(1.0, abs=0.2)
    assert jumps_m[-1] == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("sensor", list(Sensor))
def test_obstacle_distances_are_noted_only_when_they_are_the_configured_sensor(sensor):
    desk = Desk(perception=Perception(sensor=sensor, metadata=Path("lidar.json")))
    desk.run(1.0)
    desk.companion.pose_notes()
    message = mavlink.MAVLink_obstacle_distance_message(
        0, 0, [300, *[65535] * 71], 0, 20, 2000, 5.0, 0.0, mavlink.MAV_FRAME_BODY_FRD
    )
    desk.handle(Peer(1, 196).pack(message)).run(0.1)
    points = [note for note in desk.companion.pose_notes() if isinstance(note, PointsNote)]
    assert len(points) == (sensor is Sensor.MAVLINK)
    for note in points:
        assert note.points_m == (pytest.approx((3.0, 0.0, 0.0)),)
        assert note.time_s == pytest.approx(desk.now_s, abs=0.11)


def test_without_a_sensor_nothing_is_noted():
    desk = Desk().run(1.0)
    assert desk.companion.pose_notes() == []


def test_reports_without_a_site_change_nothing():
    desk = Desk(with_site=False, perception=SETTINGS)
    desk.companion.perceived(
        replace(PerceptionReport(time_s=0.0), conductors=(conductor(1.0, 2.0),))
    )
    desk.run(0.5)
    assert desk.map_jobs == []


def test_the_status_has_the_seen_obstacles(desk):
    desk.conductors = (conductor(3.0, 14.5),)
    desk.solids = (WALL,)
    desk.run(0.2)
    status = LatestDecisions().status_of(
        desk.companion, desk.now_s, clock_offset_s=0.0, recorder=None
    )
    seen = status["perception"]
    assert seen["scan_age_s"] == pytest.approx(0.1, abs=0.06)
    assert [(item["name"], item["x_m"]) for item in seen["conductors"]] == [("seen-1", 3.0)]
    assert (seen["returns"], seen["solids"]) == (0.5, 1)
    assert Desk().companion.state.seen_obstacles.report is None


def test_a_second_wall_after_an_exit_over_the_first_holds_again(desk):
    desk.solids = (WALL,)
    desk.run(3.0)
    desk.handle(desk.operator.command(USER_1, EXIT, -1))
    desk.run(2.0)
    assert desk.state in {"flying", "landing_leg"}
    x_m = desk.place_m[0]
    box = ((x_m + 1.9, -1.0), (x_m + 2.2, -1.0), (x_m + 2.2, 21.0), (x_m + 1.9, 21.0))
    desk.solids = (WALL, Polygon(name="seen-solid-2", vertices_m=box))
    desk.run(3.0)
    assert desk.state == "holding"
    assert any("no path round seen-solid-2" in text for text in desk.texts())


@pytest.mark.uncounted
def test_a_silent_planner_does_not_let_the_aircraft_fly_into_a_seen_obstacle(desk):
    desk.plan_delay_s = None
    x_m, z_m = ahead(desk, 3.0)
    desk.conductors = (conductor(x_m, z_m),)
    assert nearest_m(desk, (x_m, z_m), 10.0) >= desk.vehicle.radius_m + SETTINGS.keep_out_m + 0.02


def test_a_seen_conductor_that_is_gone_permits_no_setpoint_nearer_to_the_file_conductor(desk):
    limits = desk.companion.state.routes.limits

    def passable_m():
        (known,) = (item for item in desk.site.obstacles if item.name == "left-middle")
        x_m, z_m = known.position_m
        for off_m in np.arange(0.3, 4.0, 0.05):
            place = Setpoint(
                position_m=(x_m + off_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0
            )
            if limits.volume.refusal(place, (), plane_tolerance_m=1.0, widened_m=0.0) is None:
                return off_m
        raise AssertionError

    before_m = passable_m()
    desk.conductors = (conductor(3.0, 18.5),)
    desk.run(0.5)
    desk.conductors = ()
    desk.run(0.5)
    assert passable_m() == before_m


def wanted(desk, radius_m):
    """Requests maps for another radius."""
    state = desk.companion.state
    state.seen_obstacles.want(replace(state.vehicle, radius_m=radius_m), state.margin)


def test_an_obstacle_seen_while_maps_for_settings_are_made_counts_as_missing(desk):
    desk.map_delay_s = 3.0
    wanted(desk, 0.4)
    desk.run(0.1)
    desk.conductors = (conductor(*ahead(desk)),)
    desk.run(SETTINGS.timeout_s + 0.3)
    assert desk.state == "holding"
    assert any("obstacle unmapped for" in text for text in desk.texts())


def test_slow_maps_for_settings_hold_nothing_where_the_sensor_sees_nothing_new(desk):
    desk.conductors = (conductor(*TWO_M[0]),)
    desk.run(1.0)
    desk.map_delay_s = 4.0
    wanted(desk, 0.4)
    desk.run(SETTINGS.timeout_s + 2.0)
    assert desk.companion.state.seen_obstacles.settings_asked
    assert desk.companion.state.seen_obstacles.unmapped_s(desk.now_s) is None
    assert desk.state == "flying"


def test_an_obstacle_that_maps_for_settings_lack_counts_as_missing_until_maps_have_it(desk):
    desk.map_delay_s = 0.95
    wanted(desk, 0.4)
    desk.run(0.1)
    desk.conductors = (conductor(2.0, 15.0),)
    desk.run(0.1 + SETTINGS.timeout_s + 0.2)
    assert "perception" in desk.companion.ruling.names
    desk.run(4.0)
    assert "perception" not in desk.companion.ruling.names


def test_settings_that_change_all_the_time_keep_no_obstacle_off_the_maps(desk):
    desk.map_delay_s = 0.2
    desk.conductors = (conductor(*TWO_M[0]),)
    for number in range(60):
        wanted(desk, 0.4 + 0.001 * number)
        desk.step()
    assert seen_m(desk) == [TWO_M[0]]
    assert sum(isinstance(job, SettingsJob) for job in desk.map_jobs) >= 2


def test_changed_settings_and_what_is_seen_are_on_the_same_maps(desk):
    desk.conductors = (conductor(*ahead(desk)),)
    desk.run(1.0)
    seen, margin = desk.companion.state.seen_obstacles, Margin(position_m=1.0)
    vehicle = replace(desk.vehicle, radius_m=0.9)
    seen.want(vehicle, margin)
    seen.update(desk.now_s, on_ground=False)
    (job,) = seen.jobs()
    kept_m = {item.name: item.keep_out_m for item in job.site.obstacles}
    assert (job.vehicle, job.site.margin) == (vehicle, margin)
    assert kept_m["seen-1"] == SETTINGS.keep_out_m + 1.0
    assert kept_m["right-lower"] == pytest.approx(KEEP_OUT_M + 1.0)
    seen.answered(answer_map_job(PlannerSet(Planner(desk.site, desk.vehicle)), job))
    assert seen.taken(desk.now_s).vehicle is vehicle
    seen.take(replace(seen.report, conductors=()))
    seen.update(desk.now_s, on_ground=False)
    (job,) = seen.jobs()
    assert not isinstance(job, SettingsJob)
    assert "seen-1" not in [item.name for item in job.site.obstacles]
    assert job.site.margin == margin
