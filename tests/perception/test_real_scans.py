"""Real airborne scans with labels: the share of the wires that is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moar_companion.perception.spans import PointClass, find_power_line

DATA = Path(__file__).parents[3] / "shared" / "data" / "lidar_powerline"
WIRE, TOWER = 14, 15

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"no real scans in {DATA}"),
]


@pytest.mark.parametrize(
    ("name", "spans"),
    [
        ("07CZ2_14_realonly", [([3, 3], 2), ([3, 3], 2)]),
        pytest.param("12AN2_20_realonly", [([3, 3], 2)], marks=pytest.mark.slow),
    ],
)
def test_wires_of_a_real_line(name, spans):
    laspy = pytest.importorskip("laspy")
    cloud = laspy.read(DATA / f"{name}.laz")
    line = find_power_line(np.column_stack((cloud.x, cloud.y, cloud.z)))
    wires = np.asarray(cloud.classification) == WIRE
    found = np.isin(line.classes, (PointClass.CONDUCTOR, PointClass.EARTH_WIRE))
    assert (found & wires).sum() / found.sum() >= 0.97
    assert (found & wires).sum() / wires.sum() >= 0.97
    whole = [
        ([len(circuit) for circuit in span.circuits], len(span.earth_wires))
        for span in line.spans
        if max(each.curve.length_m for each in span.conductors) > 100.0
    ]
    assert whole == spans
