"""Lines with conductors close to each other, low and medium voltage: each wire is found."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.perception.spans import find_power_line
from sitl.lidar import LidarScene
from sitl.lidar import Wire as LidarWire
from tests.perception.live import Flight, Rig, last
from tests.perception.scenes import Scene, Wire

HEIGHT_M = 9.0


def row(count, apart_m):
    return [(apart_m * (number - (count - 1) / 2), HEIGHT_M) for number in range(count)]


def column(count, apart_m):
    return [(0.0, HEIGHT_M + apart_m * number) for number in range(count)]


def triangle(apart_m):
    return [(-apart_m / 2, HEIGHT_M), (apart_m / 2, HEIGHT_M), (0.0, HEIGHT_M + 0.87 * apart_m)]


@pytest.mark.parametrize(
    "places",
    [row(3, 0.35), row(3, 0.87), row(7, 0.87), column(3, 0.5), triangle(0.5), triangle(1.2)],
    ids=["3 at 0.35 m", "3 at 0.87 m", "7 at 0.87 m", "column", "triangle", "wide triangle"],
)
def test_a_survey_finds_each_wire(places):
    wires = [Wire(lateral_m=x, lowest_m=z, constant_m=500.0, per_m=5.0) for x, z in places]
    scene = Scene(0, length_m=60.0).with_wires(wires, noise_m=0.02).with_ground(0.3, 20.0)
    line = find_power_line(scene.with_tree(30.0, 8.0, 10.0, count=500).cloud)
    found = [
        wire for span in line.spans for conductor in span.conductors for wire in conductor.wires
    ]
    along = np.linspace(5.0, 55.0, 20)
    for wire in wires:
        places_m = np.array([scene.place(s, wire.lateral_m, scene.height(wire, s)) for s in along])
        miss_m = [
            np.median(np.hypot(*each.residuals(each.coordinates(places_m)).T)) for each in found
        ]
        assert min(miss_m) < 0.1
    for conductor in found:
        middle = conductor.points_at(np.array([np.mean(conductor.extent_m)]))[0]
        across = middle[:2] @ scene.left
        assert min(np.hypot(across - x, middle[2] - z) for x, z in places) < 0.3, "no tree is one"


@pytest.mark.slow
@pytest.mark.parametrize(
    "places",
    [row(3, 0.5), column(3, 0.5), triangle(0.87), row(3, 0.87), row(7, 0.87)],
    ids=["3 at 0.5 m", "column", "triangle", "3 at 0.87 m", "7 at 0.87 m"],
)
def test_a_lidar_finds_each_wire(places):
    pytest.importorskip("velodyne_decoder")
    wires = tuple(
        LidarWire(start_m=(8.0 + x, -60.0, 5.0 + z), end_m=(8.0 + x, 60.0, 5.0 + z))
        for x, z in places
    )
    seen = last(Rig(LidarScene(wires=wires), Flight(at_m=(0.0, 0.0, 10.0))), 1.2).conductors
    for x, z in places:
        miss_m = [np.hypot(8.0 + x - at[0], 5.0 + z - at[1]) for at in (c.position_m for c in seen)]
        assert min(miss_m) < 0.2
