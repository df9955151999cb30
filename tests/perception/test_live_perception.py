"""The machine of live perception, fed by the simulated lidar: from packets and poses to reports."""

from __future__ import annotations

import math
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
import shapely

from moar_companion.perception.lidar_scan import PacketFault
from moar_companion.perception.live_perception import LivePerception
from moar_companion.planner.site import Conductor
from moar_companion.settings.perception_config import Perception, Sensor, SensorMount
from sitl.lidar import Box, LidarScene, Prism, Tree, Wire
from tests.perception.live import SITE, VELODYNE, Flight, Rig, last

pytest.importorskip("velodyne_decoder")

CRANE = Box(lower_m=(5.0, -2.0, 11.0), upper_m=(7.0, 2.0, 16.0))
WALL = Box(lower_m=(20.0, -30.0, 0.0), upper_m=(21.0, 30.0, 30.0))
CABLE = Wire(start_m=(-4.0, -100.0, 15.0), end_m=(-4.0, 100.0, 15.0))
AHEAD = Wire(start_m=(8.0, -40.0, 15.0), end_m=(8.0, 40.0, 15.0))
HOVER = Flight(at_m=(0.0, 0.0, 12.0))
SWAYING = replace(HOVER, velocity_mps=(1.0, 0.0, 0.3), tilt_rad=0.06, position_noise_m=0.03)
POINTS = Perception(sensor=Sensor.MAVLINK)


def wire(x_m, z_m):
    return Wire(start_m=(x_m, -40.0, z_m), end_m=(x_m, 40.0, z_m))


def place_of(wire):
    return wire.start_m[0], wire.start_m[2]


def with_conductors(wires):
    """The site with these wires."""
    conductors = (
        Conductor(name=f"{place_m}", position_m=place_m, radius_m=0.02, keep_out_m=1.0)
        for place_m in map(place_of, wires)
    )
    return replace(SITE, obstacles=tuple(conductors))


def solid(report):
    return shapely.union_all([shapely.Polygon(each.vertices_m) for each in report.solids])


def covers(report, x, z):
    return solid(report).covers(shapely.Point(x, z))


def extent_m(report, low, high):
    """A box between two corners: lower and upper x and z."""
    return solid(report).intersection(shapely.box(*low, *high)).bounds


@pytest.mark.slow
@pytest.mark.parametrize("flight", [HOVER, SWAYING], ids=["hovering", "flying and swaying"])
def test_a_box_beside_the_line_becomes_a_polygon_within_a_cell(flight):
    report = last(Rig(LidarScene(boxes=(CRANE,), wires=(CABLE,)), flight), 1.3)
    assert all(covers(report, 5.05, z) for z in np.arange(11.2, 15.9, 0.2))
    low_x, low_z, _, high_z = extent_m(report, (3.0, 5.0), (9.0, 20.0))
    assert low_x == pytest.approx(5.0, abs=0.45)
    assert (low_z, high_z) == pytest.approx((11.0, 16.0), abs=0.45)


@pytest.mark.uncounted
def test_an_obstacle_is_occupied_within_half_a_second():
    rig = Rig(LidarScene(boxes=(WALL,)), HOVER)
    last(rig, 1.0)
    rig.look_at(LidarScene(boxes=(WALL, CRANE)))
    assert covers(last(rig, 0.55), 5.05, 13.0)


@pytest.mark.slow
def test_an_obstacle_that_has_gone_is_cleared_within_three_seconds():
    rig = Rig(LidarScene(boxes=(WALL, CRANE)), HOVER)
    assert covers(last(rig, 1.5), 5.05, 13.0)
    rig.look_at(LidarScene(boxes=(WALL,)))
    report = last(rig, 3.0)
    assert not solid(report).intersects(shapely.box(3.0, 5.0, 9.0, 25.0))
    assert covers(report, 20.05, 13.0)


def test_trees_are_solid_and_no_conductors():
    trees = (Tree(centre_m=(8.0, 0.0, 6.0), radius_m=3.0),)
    report = last(Rig(LidarScene(trees=trees), HOVER), 1.5)
    assert covers(report, 6.5, 8.0)
    low_x, _, _, high_z = solid(report).bounds
    assert low_x > 4.5
    assert high_z < 9.6
    assert report.conductors == ()


@pytest.mark.parametrize("slope", [0.0, 0.15], ids=["flat", "slope"])
@pytest.mark.parametrize("height_error_m", [1.5, -1.5])
def test_the_ground_is_no_obstacle(slope, height_error_m):
    bank = Prism(
        vertices_m=((-60.0, -30.0), (60.0, -30.0), (60.0, 60.0 * slope), (-60.0, -60.0 * slope)),
        lower_y_m=-60.0,
        upper_y_m=60.0,
    )
    low = replace(HOVER, at_m=(0.0, 0.0, 6.0), height_error_m=height_error_m)
    post = replace(CRANE, lower_m=(5.0, -2.0, -1.0))
    scene = LidarScene(boxes=(post,), prisms=(bank,), ground_m=None)
    report = last(Rig(scene, low), 1.0)
    assert len(report.solids) == 1
    assert extent_m(report, (-25.0, -5.0), (30.0, 30.0))[0] > 4.5


@pytest.mark.uncounted
def test_ground_far_away_is_no_obstacle():
    far = replace(HOVER, at_m=(-22.0, 0.0, 17.0), tilt_rad=0.08)
    assert all(each.solids == () for each in Rig(LidarScene(), far).run(1.5))


def test_an_isolated_object_in_the_air_is_not_taken_for_the_ground():
    report = last(Rig(LidarScene(boxes=(CRANE,), ground_m=None), HOVER), 1.0)
    assert covers(report, 5.05, 11.2)


@pytest.mark.uncounted
def test_points_of_conductors_are_not_in_the_solids():
    report = last(Rig(LidarScene(wires=(CABLE,)), SWAYING), 1.5)
    assert len(report.conductors) == 1
    assert report.solids == ()


@pytest.mark.slow
def test_rain_is_no_obstacle():
    rig = Rig(LidarScene(rain_per_m=0.005), SWAYING)
    assert all(each.solids == () and each.conductors == () for each in rig.run(3.0))


def test_echoes_of_the_airframe_are_no_obstacle():
    legs = Box(lower_m=(0.6, -0.2, 11.5), upper_m=(0.7, 0.2, 11.9))
    assert last(Rig(LidarScene(boxes=(legs,)), HOVER), 1.0).solids == ()


def test_a_mounted_sensor_sees_the_same():
    mount = SensorMount(position_m=(0.4, 0.1, -0.3), roll_pitch_yaw_deg=(-90.0, 20.0, 0.0))
    settings = replace(VELODYNE, mount=mount)
    report = last(Rig(LidarScene(wires=(CABLE,)), SWAYING, settings=settings), 1.0)
    assert report.conductors[0].position_m == pytest.approx((-4.0, 15.0), abs=0.1)


def test_a_turned_nose_changes_no_place():
    turned = replace(SWAYING, yaw_error_rad=0.3)
    report = last(Rig(LidarScene(wires=(CABLE,), boxes=(CRANE,)), turned), 1.0)
    assert report.conductors[0].position_m == pytest.approx((-4.0, 15.0), abs=0.1)
    assert covers(report, 5.05, 13.0)


@pytest.mark.slow
def test_a_conductor_that_is_gone_from_in_front_of_a_wall_is_dropped_within_three_seconds():
    rig = Rig(LidarScene(boxes=(WALL,), wires=(AHEAD,)), SWAYING)
    assert len(last(rig, 1.0).conductors) == 1
    rig.look_at(LidarScene(boxes=(WALL,)))
    assert last(rig, 3.0).conductors == ()


LINE = (wire(7.0, 10.0), wire(7.0, 13.5), wire(7.0, 17.0))
BESIDE = wire(-6.0, 13.0)


def drifting(rig, seconds, up_m):
    """Runs while the estimate's height drifts by `up_m`."""
    began_m, steps = rig.flight.height_error_m, round(10 * seconds)
    for step in range(1, steps + 1):
        rig.flight = replace(rig.flight, height_error_m=began_m + up_m * step / steps)
        list(rig.run(0.1))


def assert_hang(report, *wires):
    """The conductors of a report are these wires, and no others."""
    seen_m = [each.position_m for each in report.conductors]
    assert len(seen_m) == len(wires), seen_m
    for place_m in map(place_of, wires):
        assert min(math.dist(place_m, each) for each in seen_m) < 0.15, seen_m


@pytest.fixture
def at_the_line():
    """Hovers before the line, with its place by it, and a wire beside the line."""
    scene, settings = LidarScene(wires=(*LINE, BESIDE)), replace(VELODYNE, fly_by_line=True)
    rig = Rig(scene, HOVER, settings=settings)
    rig.perception = LivePerception(rig.settings, with_conductors(LINE))
    assert_hang(last(rig, 2.0), *LINE, BESIDE)
    return rig


@pytest.mark.slow
def test_after_a_gap_in_which_the_estimate_has_drifted_conductors_are_where_they_were(at_the_line):
    at_the_line.look_at(LidarScene())
    drifting(at_the_line, 5.0, 1.2)
    at_the_line.look_at(LidarScene(wires=LINE))
    report = last(at_the_line, 3.0)
    assert_hang(report, *LINE, BESIDE)
    assert report.line.offset_m == pytest.approx((0.0, -1.2), abs=0.1)


@pytest.mark.slow
def test_what_was_seen_in_the_gap_of_the_line_moves_with_the_offset(at_the_line):
    at_the_line.look_at(LidarScene(wires=(BESIDE,)))
    drifting(at_the_line, 7.0, 1.5)
    at_the_line.look_at(LidarScene(wires=LINE))
    assert_hang(last(at_the_line, 2.0), *LINE, BESIDE)


@pytest.mark.slow
def test_after_a_gap_in_which_wires_were_seen_elsewhere_they_have_their_names(at_the_line):
    """One wire of three shows no place: until more are seen it counts as another one."""
    before = {each.name for each in last(at_the_line, 0.2).conductors}
    at_the_line.packets_flow = False
    drifting(at_the_line, 11.0, 1.5)
    at_the_line.packets_flow = True
    at_the_line.look_at(LidarScene(wires=(LINE[0], BESIDE)))
    assert len(last(at_the_line, 1.0).conductors) == 6
    at_the_line.look_at(LidarScene(wires=(*LINE, BESIDE)))
    report = last(at_the_line, 1.0)
    assert_hang(report, *LINE, BESIDE)
    assert {each.name for each in report.conductors} == before


@pytest.mark.slow
def test_a_jump_while_nothing_of_the_line_is_known_moves_nothing_for_good(at_the_line):
    at_the_line.packets_flow = False
    list(at_the_line.run(11.0))
    at_the_line.packets_flow = True
    at_the_line.look_at(LidarScene())
    at_the_line.jump((1.2, 0.0, -1.4))
    list(at_the_line.run(0.5))
    at_the_line.look_at(LidarScene(wires=LINE))
    assert_hang(last(at_the_line, 3.0), *LINE, BESIDE)


@pytest.mark.slow
def test_by_the_line_a_heading_that_becomes_wrong_hides_and_moves_no_wire(at_the_line):
    """Beside the plane, where a turn moves what is seen across it."""
    at_the_line.flight = replace(HOVER, at_m=(0.0, 1.2, 12.0))
    for degrees in range(2, 31, 2):
        at_the_line.heading_error_rad = math.radians(degrees)
        report = last(at_the_line, 0.4)
        assert_hang(report, *LINE, BESIDE)
    assert report.line.seen_s > at_the_line.time_s - 0.4
    assert math.degrees(report.line.turned_rad) == pytest.approx(-30.0, abs=3.0)
    assert math.hypot(*report.line.offset_m) < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("boxes", [(), (WALL,)], ids=["sky", "a wall"])
def test_a_conductor_is_kept_while_the_nose_points_along_it(boxes):
    rig = Rig(LidarScene(boxes=boxes, wires=(AHEAD,)), replace(HOVER, tilt_rad=0.03))
    assert len(last(rig, 1.0).conductors) == 1
    rig.flight = replace(rig.flight, yaw_error_rad=np.pi / 2.0)
    assert len(last(rig, 3.0).conductors) == 1


def test_a_scan_waits_for_the_poses_of_its_last_point():
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    before_s = last(rig, 1.0).health.scan_s
    rig.poses_flow = False
    assert last(rig, 0.25).health.scan_s <= before_s + 0.1
    rig.poses_flow = True
    report = last(rig, 0.05)
    assert report.health.scan_s > before_s + 0.1
    assert report.health.late == 0


def test_scans_without_poses_are_dropped_and_counted():
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    rig.poses_flow = False
    report = last(rig, 1.0)
    assert report.health.scan_s is None
    assert report.health.received_s == pytest.approx(report.time_s, abs=0.01)
    assert 3 <= report.health.late <= 6
    assert report.solids == ()


def test_an_attitude_of_the_far_future_costs_few_scans():
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    last(rig, 0.5)
    rig.perception.note_attitude(4_294_968.3, 0.0, 0.0, 0.0)
    report = last(rig, 0.6)
    assert report.health.scan_s > report.time_s - 0.2
    assert report.health.late <= 2


@pytest.mark.parametrize("step_s", [1790.0, -1790.0, -0.3])
def test_a_step_of_the_sensors_clock_costs_one_scan(step_s):
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    last(rig, 0.55)
    rig.sensor_clock_s = step_s
    report = last(rig, 0.5)
    assert report.health.scan_s > report.time_s - 0.15
    assert report.health.late == 1


@pytest.mark.uncounted
def test_of_many_scans_that_wait_the_newest_are_kept():
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    with mock.patch.object(rig.perception, "step", return_value=None):
        assert list(rig.run(1.95)) == []
    assert rig.perception.step(rig.time_s).health.late == 3


def test_reports_continue_while_the_sensor_is_silent():
    rig = Rig(LidarScene(boxes=(CRANE,)), HOVER)
    seen = last(rig, 1.0)
    rig.packets_flow = False
    reports = list(rig.run(1.0))
    assert len(reports) == pytest.approx(5, abs=1)
    assert reports[-1].health.scan_s <= seen.health.scan_s + 0.1
    assert reports[-1].health.received_s == pytest.approx(1.0, abs=0.01)
    assert reports[-1].solids == seen.solids


def test_the_share_of_returns_is_reported():
    assert last(Rig(LidarScene(), HOVER), 0.5).health.returns == pytest.approx(0.45, abs=0.05)
    box = Box(lower_m=(-15.0, -15.0, 0.0), upper_m=(15.0, 15.0, 30.0))
    inside = last(Rig(LidarScene(boxes=(box,), dropout=0.0), HOVER), 0.5)
    assert inside.health.returns <= 1.0


@pytest.mark.slow
def test_a_covered_sensor_has_no_returns():
    rig = Rig(LidarScene(wires=(CABLE,)), HOVER)
    seen = last(rig, 1.0)
    near = [
        Box(lower_m=(x, -3.0, z), upper_m=(x + w, 3.0, z + h))
        for x, z, w, h in ((0.6, 11.0, 0.1, 2.0), (-0.7, 11.0, 0.1, 2.0),
                           (-0.7, 12.6, 1.4, 0.1), (-0.7, 11.3, 1.4, 0.1))
    ]  # fmt: skip
    rig.look_at(LidarScene(boxes=tuple(near)))
    report = last(rig, 4.0)
    assert report.health.returns < 0.05
    place = seen.conductors[0].position_m
    assert report.conductors[0].position_m == pytest.approx(place, abs=0.05)
    assert report.solids == ()


def test_damaged_packets_are_counted():
    rig = Rig(LidarScene(), HOVER)
    rig.perception.receive(b"\xff\xee" + bytes(100), 0.0)
    rig.perception.receive(bytes(1206), 0.0)
    health = last(rig, 0.3).health
    assert health.refused == 2


def test_a_reason_is_reported_while_all_packets_are_refused():
    rig = Rig(LidarScene(), HOVER)
    assert last(rig, 0.3).health.refusal is None
    rig.packets_flow = False
    other, spoilt = bytes(1206), b"\xff\xee" + bytes(1203) + b"\x22"
    health = []
    for time_s in np.arange(0.3, 2.0, 0.02):
        rig.perception.receive(spoilt, time_s)
        rig.perception.receive(other if time_s < 0.4 else spoilt, time_s)
        if (report := rig.perception.step(time_s)) is not None:
            health.append((time_s, report.health.refusal))
    assert {refusal for time_s, refusal in health if time_s < 0.7} == {None}
    assert {refusal for time_s, refusal in health if time_s > 0.9} == {PacketFault.MARKS}
    assert rig.perception.step(2.6).health.refusal is None, "none arrives any more"


@pytest.mark.slow
def test_in_the_frame_of_a_line_that_is_known_a_jump_of_the_estimate_moves_nothing():
    scene = LidarScene(wires=(CABLE,), boxes=(CRANE,))
    rig = Rig(scene, HOVER, settings=replace(VELODYNE, fly_by_line=True))
    before = last(rig, 3.8)
    rig.jump((2.05, 0.0, -1.37))
    after = last(rig, 1.0)
    assert [each.name for each in after.conductors] == [each.name for each in before.conductors]
    assert after.conductors[0].position_m == pytest.approx((-4.0, 15.0), abs=0.1)
    assert after.line.offset_m == pytest.approx((-2.05, 1.37), abs=0.1)
    assert len(after.solids) == len(before.solids)
    assert solid(after).bounds == pytest.approx(solid(before).bounds, abs=0.31)


@pytest.mark.slow
@pytest.mark.parametrize(("by_line", "wires"), [(True, ()), (False, (CABLE,))])
def test_without_a_line_a_jump_of_the_estimate_moves_everything_with_it(by_line, wires):
    settings = replace(VELODYNE, fly_by_line=by_line)
    rig = Rig(LidarScene(wires=wires, boxes=(CRANE,)), HOVER, settings=settings)
    before = last(rig, 1.5)
    rig.jump((2.05, 0.4, -1.37))
    after = last(rig, 1.0)
    assert after.line.seen_s is None
    assert after.line.offset_m == (0.0, 0.0)
    assert len(after.solids) == len(before.solids)
    bounds = np.array(solid(before).bounds) + np.array([2.05, -1.37, 2.05, -1.37])
    assert solid(after).bounds == pytest.approx(bounds, abs=0.31)


def test_the_same_inputs_give_the_same_reports():
    scene = LidarScene(wires=(CABLE,), boxes=(CRANE,), rain_per_m=0.002)
    first, second = (list(Rig(scene, SWAYING).run(0.6)) for _ in range(2))
    assert first == second


def hover(perception, from_s, until_s):
    for time_s in np.arange(from_s, until_s, 0.03):
        perception.note_position(time_s, (0.0, 0.0, 12.0))
        perception.note_attitude(time_s, 0.0, 0.0, np.radians(SITE.frame.azimuth_deg))


def test_single_points_become_obstacles_and_clear_up_to_them():
    perception = LivePerception(POINTS, SITE)
    for number in range(10):
        hover(perception, 0.1 * number, 0.1 * number + 0.1)
        perception.note_points([(6.0, 0.0, 0.1)], 0.1 * number)
        report = perception.step(0.1 * number + 0.11)
    assert covers(report, 6.0, 12.1)
    assert report.conductors == ()
    assert report.health.returns == 1.0
    assert report.health.scan_s == pytest.approx(0.9)
    for number in range(10, 45):
        hover(perception, 0.1 * number, 0.1 * number + 0.1)
        perception.note_points([(9.0, 0.0, 0.1)], 0.1 * number)
        report = perception.step(0.1 * number + 0.11)
    assert not covers(report, 6.0, 12.1)
    assert covers(report, 9.0, 12.1)


def test_points_of_several_messages_at_once_are_one_set():
    perception = LivePerception(POINTS, SITE)
    hover(perception, 0.0, 1.0)
    for number in range(8):
        perception.note_points([(6.0, 0.0, 0.1)], 0.1 + 0.001 * number)
    assert perception.step(0.3).solids == ()


def test_a_message_without_points_shows_that_the_sensor_works():
    perception = LivePerception(POINTS, SITE)
    hover(perception, 0.0, 1.0)
    perception.note_points([], 0.5)
    assert perception.step(0.7).health.scan_s == 0.5


def test_points_of_another_sensor_do_not_show_that_the_lidar_works():
    perception = LivePerception(VELODYNE, SITE)
    hover(perception, 0.0, 1.0)
    perception.note_points([(6.0, 0.0, 0.1)], 0.5)
    health = perception.step(0.7).health
    assert (health.scan_s, health.received_s) == (None, None)


def test_points_without_poses_are_dropped_and_counted():
    perception = LivePerception(POINTS, SITE)
    perception.note_points([(6.0, 0.0, 0.1)], 0.5)
    perception.step(0.7)
    assert perception.step(1.2).health.late == 1


def seen_once(at_m, *, distances=8, site=SITE):
    """Perception of a point at this place in the aircraft's frame, and its report."""
    perception = LivePerception(POINTS, site)
    for number in range(distances):
        hover(perception, 0.1 * number, 0.1 * number + 0.1)
        perception.note_points([at_m], 0.1 * number)
        report = perception.step(0.1 * number + 0.11)
    return perception, report


def test_a_jump_that_comes_with_a_position_moves_the_obstacles_with_it():
    perception, before = seen_once((6.0, 0.0, 0.1))
    assert covers(before, 6.0, 12.1)
    perception.note_position(0.9, (0.0, 0.0, 12.0), (0.0, 0.0, 0.0))
    assert covers(perception.step(1.2), 6.0, 12.1)
    perception.note_position(1.3, (3.0, 0.0, 9.0), (3.0, 0.0, -3.0))
    after = perception.step(1.5)
    assert covers(after, 9.0, 9.1)
    assert not covers(after, 6.0, 12.1)
    perception.note_position(1.6, (3.0, 0.0, 9.0), (3.0, 0.0, -3.0))
    assert perception.step(1.8).solids == after.solids


def test_lidar_packets_beside_a_sensor_without_packets_are_ignored():
    perception = LivePerception(POINTS, SITE)
    perception.receive(bytes(1206), 0.1)
    health = perception.step(0.2).health
    assert (health.refused, health.received_s, health.scan_s) == (0, None, None)


def test_points_beyond_the_reach_are_no_obstacle():
    workspace = replace(SITE.workspace, upper_m=(80.0, SITE.workspace.upper_m[1]))
    wide = replace(SITE, workspace=workspace)
    assert seen_once((39.5, 0.0, 0.1), site=wide)[1].solids != ()
    assert seen_once((40.5, 0.0, 0.1), site=wide)[1].solids == ()


def test_a_turn_of_the_lidar_without_any_echo_is_a_scan_without_returns():
    health = last(Rig(LidarScene(ground_m=None), HOVER), 0.25).health
    assert (health.returns, health.late, health.refused) == (0.0, 0, 0)
    assert health.scan_s == pytest.approx(0.1, abs=0.01)


def test_an_ouster_is_decoded_by_its_metadata():
    settings = Perception(sensor=Sensor.OUSTER)
    with mock.patch("moar_companion.perception.live_perception.OusterStream") as decoder:
        decoder.return_value = mock.Mock(packets=0, refused={"damaged": 3})
        report = LivePerception(settings, SITE, "the metadata").step(0.2)
    decoder.assert_called_once_with("the metadata")
    assert report.health.refused == 3
