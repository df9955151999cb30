"""Record of an inspection: a row for each picture, video and view, and the same as maps and tables.

Pure. In: what was known when the picture was asked for, and the camera's confirmation. Out: dicts
fit for JSON, a GeoJSON feature, a line of CSV. `service/inspection_files` writes them.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from ...mavlink.camera import Image
from ...types import GeodeticPoint, RiskIndices, Vector

KINDS = frozenset({"picture", "video", "view"})
"""Kinds of decisions that belong to the record of the inspection."""

CSV_COLUMNS = (
    "label",
    "latitude",
    "longitude",
    "altitude",
    "yaw",
    "pitch",
    "roll",
    "accuracy_m",
    "number",
    "utc",
    "target",
    "view",
)
"""Columns as photogrammetry programs import references of cameras: label, WGS84 degrees, metres
above mean sea level, angles of the camera in degrees; beside them what names the picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """What was known when a picture was asked for, or a video began.

    camera_pitch_rad, camera_heading_rad: of the camera's axis; None where not reported.
    aim_error_rad: from there to the aim point. accuracy_m: of the position, as reported.
    wind_ne_mps: velocity of the air.
    """

    time_s: float
    target: str
    view: int
    stop: str
    aim_m: tuple[float, float]
    place: GeodeticPoint
    position_m: Vector
    attitude_rad: Vector
    camera_pitch_rad: float | None
    camera_heading_rad: float | None
    aim_error_rad: float | None
    distance_m: float
    conductor: str | None
    conductor_m: float | None
    accuracy_m: float | None
    risk: RiskIndices
    wind_ne_mps: tuple[float, float] | None

    def row(self) -> dict[str, Any]:
        """The row without a picture; angles in degrees, as files have them."""
        roll_deg, pitch_deg, yaw_deg = (math.degrees(angle) for angle in self.attitude_rad)
        wind = self.wind_ne_mps
        return {
            "target": self.target,
            "view": self.view,
            "stop": self.stop,
            "latitude_deg": round(self.place.latitude_deg, 9),
            "longitude_deg": round(self.place.longitude_deg, 9),
            "altitude_amsl_m": round(self.place.altitude_amsl_m, 3),
            "position_m": [round(value, 3) for value in self.position_m],
            "roll_deg": round(roll_deg, 2),
            "pitch_deg": round(pitch_deg, 2),
            "yaw_deg": _compass_deg(yaw_deg),
            "camera_pitch_deg": _degrees(self.camera_pitch_rad),
            "camera_heading_deg": None
            if self.camera_heading_rad is None
            else _compass_deg(math.degrees(self.camera_heading_rad)),
            "aim_m": list(self.aim_m),
            "aim_error_deg": _degrees(self.aim_error_rad),
            "distance_m": round(self.distance_m, 3),
            "conductor": self.conductor,
            "conductor_distance_m": _rounded(self.conductor_m),
            "position_accuracy_m": _rounded(self.accuracy_m),
            "risk": {name: round(value, 3) for name, value in self.risk.as_dict().items()},
            "wind_mps": None if wind is None else round(math.hypot(*wind), 2),
            "wind_from_deg": None
            if wind is None
            else _compass_deg(math.degrees(math.atan2(-wind[1], -wind[0]))),
        }


def picture_row(shot: Shot | None, image: Image, *, count: int, marks: list[str]) -> dict[str, Any]:
    """Row of a confirmed picture. shot: None for one that the companion did not ask for.

    count: pictures of the view so far, this one included; 0 for one that does not count. marks:
    what is wrong with it; empty for a good picture.
    """
    utc_s = image.utc_s
    return {
        "number": image.number,
        "file": image.file,
        "camera_utc": None if utc_s is None else iso_utc(utc_s),
        "count": count,
        "marks": marks,
        **({} if shot is None else shot.row()),
    }


def iso_utc(utc_s: float) -> str:
    """Seconds since 1970 as `2026-11-28T14:05:09.250Z`."""
    moment = datetime.fromtimestamp(utc_s, tz=timezone.utc)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def geojson(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A FeatureCollection of the pictures and videos; rows as in `inspection.jsonl`."""
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "geometry": {
                    "type": "Point",
                    "coordinates": [
                        row["longitude_deg"],
                        row["latitude_deg"],
                        row["altitude_amsl_m"],
                    ],
                },
                "properties": {key: value for key, value in row.items() if key not in _PLACE},
            }
            for row in rows
            if "latitude_deg" in row
        ],
    }


_PLACE = frozenset({"longitude_deg", "latitude_deg", "altitude_amsl_m"})


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Pictures as a table with `CSV_COLUMNS`; the label is the file's name, else the number."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for row in rows:
        if row["kind"] != "picture" or "latitude_deg" not in row:
            continue
        pitch_deg, heading_deg = row["camera_pitch_deg"], row["camera_heading_deg"]
        writer.writerow(
            [
                row["file"].rpartition("/")[2] or row["number"],
                row["latitude_deg"],
                row["longitude_deg"],
                row["altitude_amsl_m"],
                "" if heading_deg is None else heading_deg,
                "" if pitch_deg is None else pitch_deg,
                0.0 if pitch_deg is not None else row["roll_deg"],
                "" if row["position_accuracy_m"] is None else row["position_accuracy_m"],
                row["number"],
                row["utc"],
                row["target"],
                row["view"],
            ]
        )
    return text.getvalue()


def _compass_deg(angle_deg: float) -> float:
    return round(angle_deg % 360.0, 2) % 360.0


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad), 2)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
