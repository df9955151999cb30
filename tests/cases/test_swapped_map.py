"""Maps with latitude and longitude in the wrong order, or with points far away."""

from __future__ import annotations

import pytest

from moar_companion.commands.cli import main

HEADER = "kind,name,latitude_deg,longitude_deg,altitude_amsl_m"
ROWS = [
    ("conductor", "a", 45.4000, -71.90, 30),
    ("conductor", "a", 45.4003, -71.90, 30),
    ("target", "t", 45.4001, -71.90005, 30),
    ("start", "s", 45.4001, -71.9001, 12),
    ("exit", "x", 45.4001, -71.9002, 12),
]


def made(tmp_path, rows, *options):
    survey = tmp_path / "survey.csv"
    text = [HEADER, *(",".join(map(str, row)) for row in rows)]
    survey.write_text("\n".join(text))
    out = str(tmp_path / "site.yaml")
    return main(["site", "from-map", str(survey), "--out", out, *options])


def test_place_azimuth_and_distances_are_printed(tmp_path, capsys):
    assert made(tmp_path, ROWS) == 0
    printed = capsys.readouterr().out
    assert "x = 0 at 45.400100, -71.900050 (latitude, longitude), x to 90 deg" in printed
    assert "exit x: 11.7 m from t, -18.0 m in height, 0.0 m beside the plane" in printed


def test_swapped_rows_show_another_place(tmp_path, capsys):
    swapped = [(kind, name, east, north, up) for kind, name, north, east, up in ROWS]
    made(tmp_path, swapped)
    assert "x = 0 at -71.900050, 45.400100 (latitude, longitude)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("far", "problem"),
    [
        (("exit", "x", 45.45, -71.9, 12), "x: is 5546 m from the target, must be within 500 m"),
        (("conductor", "a", 45.45, -71.9, 30), "a: has points 5524 m apart, must be at most 500 m"),
        (("exit", "x", -71.9, 45.4, 12), "km"),
    ],
)
def test_a_point_that_cannot_be_is_refused_unless_permitted(far, problem, tmp_path, capsys):
    rows = [row for row in ROWS if row[0] != far[0] or row[0] == "conductor"]
    assert made(tmp_path, [*rows, far]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    if problem != "km":
        assert problem in line
    assert "are latitude and longitude in the wrong order? --reach M permits more" in line
    if far[1] == "x" and problem != "km":
        assert made(tmp_path, [*rows, far], "--reach", "6000") == 0
