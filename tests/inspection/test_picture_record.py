"""The record of pictures: rows, map and table say the same."""

from __future__ import annotations

import csv
import io
import json
import math

from moar_companion.companion.inspection.picture_record import (
    Shot,
    csv_text,
    geojson,
    picture_row,
)
from moar_companion.mavlink.camera import Image
from moar_companion.service.inspection_files import rows_of
from moar_companion.service.recorder import Recorder
from moar_companion.types import GeodeticPoint, RiskIndices

SHOT = Shot(
    time_s=4.0,
    target="splice",
    view=2,
    stop="splice/2",
    aim_m=(6.0, 11.0),
    place=GeodeticPoint(latitude_deg=45.3781, longitude_deg=-71.9291, altitude_amsl_m=221.0),
    position_m=(10.0, 0.1, 11.2),
    attitude_rad=(0.01, -0.02, -math.pi / 2.0),
    camera_pitch_rad=math.radians(-3.0),
    camera_heading_rad=math.radians(-90.0),
    aim_error_rad=math.radians(0.4),
    distance_m=4.0,
    conductor="left",
    conductor_m=3.98,
    accuracy_m=0.3,
    risk=RiskIndices(wind=0.25),
    wind_ne_mps=(-3.0, 0.0),
)
IMAGE = Image(received_s=4.5, number=7, file="http://camera/DCIM/IMG_0007.JPG", utc_s=1.75e9)


def rows(offset_s=1.7e9):
    picture = picture_row(SHOT, IMAGE, count=1, marks=[])
    unasked = picture_row(None, Image(received_s=9.0, number=8), count=0, marks=["not asked for"])
    decisions = [(4.5, "picture", picture), (5.0, "text", {}), (9.0, "picture", unasked)]
    return rows_of(decisions, offset_s)


def test_a_row_has_the_picture_and_where_it_was_taken():
    picture, unasked = rows()
    assert (picture["number"], picture["stop"], picture["count"]) == (7, "splice/2", 1)
    assert picture["utc"] == "2023-11-14T22:13:24.500Z"
    assert picture["camera_utc"] == "2025-06-15T15:06:40.000Z"
    assert (picture["yaw_deg"], picture["camera_heading_deg"]) == (270.0, 270.0)
    assert (picture["wind_mps"], picture["wind_from_deg"]) == (3.0, 0.0)
    assert "latitude_deg" not in unasked


def test_the_map_has_each_picture_that_has_a_place():
    [feature] = geojson(rows())["features"]
    assert feature["geometry"]["coordinates"] == [-71.9291, 45.3781, 221.0]
    assert feature["properties"]["number"] == 7
    assert "latitude_deg" not in feature["properties"]


def test_the_table_is_labelled_by_the_files_name():
    [line] = csv.DictReader(io.StringIO(csv_text(rows())))
    assert line["label"] == "IMG_0007.JPG"
    assert (line["latitude"], line["yaw"], line["pitch"]) == ("45.3781", "270.0", "-3.0")


def test_the_files_are_beside_the_recording(tmp_path):
    recorder = Recorder(tmp_path, 1.7e9, 0.0)
    recorder.write([], [(4.5, "picture", picture_row(SHOT, IMAGE, count=1, marks=[]))])
    recorder.close()
    lines = (recorder.folder / "inspection.jsonl").read_text().splitlines()
    assert [json.loads(line)["number"] for line in lines] == [7]
    assert json.loads((recorder.folder / "inspection.geojson").read_text())["features"]
    assert "IMG_0007.JPG" in (recorder.folder / "inspection.csv").read_text()
    other = Recorder(tmp_path, 1.7e9, 9.0)
    other.write([], [(9.0, "text", {})])
    other.close()
    assert not (other.folder / "inspection.jsonl").exists()
