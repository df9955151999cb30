"""The flight with perception: the given site, the true obstacles, and the added ones."""

import math
from dataclasses import replace

import pytest
import yaml

from moar_companion.errors import InputError
from moar_companion.planner.site import Conductor, Polygon, Site
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.perception_config import Sensor
from sitl.demonstration import fly as demonstration
from sitl.demonstration.perceive import (
    ADDED,
    Sightings,
    added_obstacles,
    given_document,
    lidar_scene,
    prepare,
)
from sitl.demonstration.settings import read_settings
from sitl.lidar_scene import PlacedScene
from tests.flights.lockstep import as_simulated
from tests.flights.operator import Manner
from tests.vehicles import named_vehicle

SITES = sorted((shipped_configs() / "sites").glob("*.yaml"))
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
TOWER = Polygon(name="tower", vertices_m=((2.0, 0.0), (4.0, 0.0), (3.0, 9.0)))


def vehicle(manner=Manner.ARDUPILOT):
    return as_simulated(named_vehicle("x500"), manner)


def test_the_given_site_has_only_frame_workspace_and_rough_targets(tmp_path):
    file = tmp_path / "site.yaml"
    file.write_text(yaml.safe_dump(given_document(SITE), sort_keys=False))
    given = Site.load(file)
    assert given.obstacles == ()
    assert [target.position_m for target in given.targets] == [(26.5, 11.0), (11.5, 11.0)]
    assert [(target.name, target.dwell_s) for target in given.targets] == [
        (target.name, target.dwell_s) for target in SITE.targets
    ]
    assert all(target.look_at_m is None for target in given.targets)
    assert (given.frame, given.workspace, given.start_m, given.landing_m) == (
        SITE.frame, SITE.workspace, SITE.start_m, SITE.landing_m,
    )  # fmt: skip


def test_each_conductor_is_a_wire_that_hangs_lowest_where_it_crosses_the_plane():
    thin = Conductor(name="thin", position_m=(5.0, 15.0), radius_m=0.001)
    scene = lidar_scene(SITE.with_obstacles((*SITE.obstacles, thin))).scene
    for wire, conductor in zip(scene.wires, (*SITE.obstacles, thin), strict=True):
        lowest = min(wire.ends(), key=lambda place: place[2])
        assert tuple(lowest) == pytest.approx(
            (conductor.position_m[0], 0.0, conductor.position_m[1])
        )
    assert [wire.diameter_m for wire in scene.wires] == [0.035] * 6 + [0.015]


def test_a_polygon_is_a_solid_across_the_plane():
    placed = lidar_scene(SITE.with_obstacles((TOWER,)))
    (prism,) = placed.scene.prisms
    assert prism.vertices_m == TOWER.vertices_m
    assert (prism.lower_y_m, prism.upper_y_m) == (-3.0, 3.0)
    assert (placed.azimuth_deg, placed.origin.latitude_deg) == (
        SITE.frame.azimuth_deg, SITE.frame.origin.latitude_deg,
    )  # fmt: skip


def test_trees_and_a_house_stand_beyond_the_landing_points():
    scene = lidar_scene(SITE).scene
    xs = [point[0] for points in SITE.landing_m.values() for point in points]
    for tree in scene.trees:
        assert not min(xs) - 5.0 < tree.centre_m[0] - tree.radius_m < max(xs) + 5.0
    (house,) = scene.boxes
    assert house.upper_m[0] <= min(xs) - 5.0


@pytest.mark.slow
@pytest.mark.parametrize("manner", list(Manner))
@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_added_obstacles_block_the_straight_path_and_are_not_visible_from_the_start(path, manner):
    site = Site.load(path)
    jib, cable = added_obstacles(site, vehicle(manner))
    start_m, target_m = site.start_m, site.targets[0].position_m
    centre_m = [sum(corner[axis] for corner in jib.vertices_m) / 4 for axis in (0, 1)]
    length_m = math.dist(start_m, target_m)
    beside_m = abs(
        (target_m[0] - start_m[0]) * (centre_m[1] - start_m[1])
        - (target_m[1] - start_m[1]) * (centre_m[0] - start_m[0])
    )
    assert beside_m / length_m < 3.5
    (wire,) = lidar_scene(site.with_obstacles((cable,))).scene.wires
    assert math.dist(cable.position_m, start_m) > wire.visible_m
    assert (jib.name, cable.name) == ADDED


def test_the_added_obstacles_are_always_the_same():
    assert added_obstacles(SITE, vehicle()) == added_obstacles(SITE, vehicle())


def test_a_site_without_room_for_an_obstacle_is_refused():
    here = replace(SITE.targets[0], position_m=SITE.start_m)
    with pytest.raises(InputError, match="315 kV double circuit has no room for an obstacle"):
        added_obstacles(replace(SITE, targets=(here,)), vehicle())


def test_simulator_and_service_load_the_files(tmp_path):
    perceiving = prepare(tmp_path, SITE, vehicle(), 2371)
    given = Site.load(perceiving.given)
    assert given.obstacles == ()
    assert {item.name for item in perceiving.site.obstacles} > set(ADDED)
    placed = PlacedScene.load(perceiving.scene)
    assert len(placed.scene.wires) == len(SITE.obstacles) + 1
    assert len(placed.scene.prisms) == 1
    assert perceiving.arguments() == (
        "--lidar", "127.0.0.1:2371", "--lidar-scene", str(tmp_path / "scene.yaml"),
    )  # fmt: skip
    file = tmp_path / "companion.yaml"
    shipped = shipped_configs() / "vehicles" / "x500.yaml"
    values = {
        "vehicle": str(shipped),
        "site": "site.yaml",
        "links": [{"url": "udp:127.0.0.1:14540", "role": "autopilot"}],
        "perception": perceiving.configuration(),
    }
    file.write_text(yaml.safe_dump(values))
    perception = CompanionConfig.load(file).perception
    assert (perception.sensor, perception.data_port) == (Sensor.VELODYNE, 2371)
    assert perception.mount.roll_pitch_yaw_deg == placed.mount.roll_pitch_yaw_deg


def test_each_sighting_is_printed_once():
    seen = Sightings()
    texts = ["MOAR: planning inspection", "MOAR: wire 1 at x 9.2, z 18.3, avoided"]
    assert seen.lines(texts) == ["seen: wire 1 at x 9.2, z 18.3, avoided"]
    assert seen.lines(texts) == []
    assert seen.lines([*texts, "MOAR: wire 2 at x 1.0, z 2.0, avoided"]) == [
        "seen: wire 2 at x 1.0, z 2.0, avoided"
    ]


def test_the_scan_plane_stands_across_the_line_throughout(tmp_path):
    settings = read_settings(["--perceive", "--out", str(tmp_path)])
    flown = demonstration._vehicle(settings, SITE)
    assert flown.guidance.yaw_mode.value == "fixed"
    assert flown.guidance.fixed_yaw_rad == pytest.approx(math.radians(SITE.frame.azimuth_deg))
