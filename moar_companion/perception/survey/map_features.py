"""Points that were drawn or surveyed on a map: KML, GeoJSON and CSV, and back.

A feature has a kind, a name and points. The kind is the property or column `kind`. In KML it is
also the folder's name, or the first word of the placemark's ("conductor left-lower").
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree as ET

from ...errors import InputError
from ...types import GeodeticPoint

KINDS = (
    "conductor", "tower", "obstacle", "outline", "ground", "target", "start", "exit", "evacuation",
)  # fmt: skip
"""outline: of an obstacle in the plane; ground: a point at z = 0; exit, evacuation: landing."""
LENGTHS = ("radius_m", "keep_out_m")
"""Optional properties of a feature."""
_COLUMNS = ("kind", "name", "latitude_deg", "longitude_deg", "altitude_amsl_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapFeature:
    """A feature of a map: its points in order.

    radius_m: of a conductor, half the width of a tower; keep_out_m: of an obstacle in the site
    file. None where the map lacks the value.
    """

    kind: str
    name: str
    points: tuple[GeodeticPoint, ...]
    radius_m: float | None = None
    keep_out_m: float | None = None


def features_of(text: str, source: str, ending: str) -> tuple[MapFeature, ...]:
    """Features in a file's text; raises InputError that names the faulty feature."""
    readers = {".csv": _of_csv, ".geojson": _of_geojson, ".json": _of_geojson, ".kml": _of_kml}
    found: dict[tuple[str, str], MapFeature] = {}
    for feature in readers[ending](text, source):
        if feature.kind not in KINDS:
            raise InputError(
                source,
                feature.name,
                f"kind is {feature.kind!r}, must be one of {', '.join(KINDS)}",
            )
        if not feature.name or not feature.points:
            lacking = "name" if not feature.name else "points"
            raise InputError(source, feature.name or feature.kind, f"has no {lacking}")
        key = (feature.kind, feature.name)
        found[key] = _joined(found[key], feature) if key in found else feature
    return tuple(found.values())


def _joined(before: MapFeature, after: MapFeature) -> MapFeature:
    """One feature of two pieces, with the greater of their lengths."""
    lengths: dict[str, Any] = {}
    for name in LENGTHS:
        known = [value for each in (before, after) if (value := getattr(each, name)) is not None]
        lengths[name] = max(known, default=None)
    return replace(before, points=before.points + after.points, **lengths)


def _of_csv(text: str, source: str) -> Iterator[MapFeature]:
    reader = csv.DictReader(io.StringIO(text))
    missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise InputError(
            source, "", f"has no column {', '.join(missing)}; needed are {','.join(_COLUMNS)}"
        )
    for row in reader:
        where = f"line {reader.line_num}"
        values = [row[name] for name in _COLUMNS[2:]]
        yield MapFeature(
            kind=(row["kind"] or "").strip(),
            name=(row["name"] or "").strip(),
            points=(_point(values, source, where),),
            **_lengths(row, source, f"{where}, "),
        )


def _of_geojson(text: str, source: str) -> Iterator[MapFeature]:
    try:
        document = json.loads(text)
    except ValueError as error:
        raise InputError(source, "", f"is no JSON: {error}") from None
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise InputError(source, "features", "is missing: must be a GeoJSON FeatureCollection")
    for number, feature in enumerate(features):
        where = f"features[{number}]"
        properties, geometry = (_member(feature, key) for key in ("properties", "geometry"))
        coordinates = geometry.get("coordinates")
        if geometry.get("type") == "Point":
            coordinates = [coordinates]
        elif geometry.get("type") != "LineString":
            raise InputError(
                source, where, f"is a {geometry.get('type')}, must be a Point or a LineString"
            )
        if not isinstance(coordinates, list):
            raise InputError(source, where, "has no list of coordinates")
        if properties.get("kind") == "path":
            continue
        yield MapFeature(
            kind=str(properties.get("kind", "")),
            name=str(properties.get("name", where)),
            points=tuple(_swapped(each, source, where) for each in coordinates),
            **_lengths(properties, source, f"{where}."),
        )


def _member(feature: Any, key: str) -> dict[str, Any]:
    """An object within a feature; an empty one where it is missing."""
    value = feature.get(key) if isinstance(feature, dict) else None
    return value if isinstance(value, dict) else {}


def _of_kml(text: str, source: str) -> Iterator[MapFeature]:
    try:
        root = ET.fromstring(text)  # noqa: S314 -- expat limits the expansion of entities
    except ET.ParseError as error:
        raise InputError(source, "", f"is no KML: {error}") from None
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]  # in any namespace
    yield from _of_folder(root, source, "")


def _of_folder(element: ET.Element, source: str, folder: str) -> Iterator[MapFeature]:
    for child in element:
        tag = child.tag
        if tag in ("Document", "Folder"):
            yield from _of_folder(child, source, (child.findtext("name") or "").strip())
        elif tag == "Placemark" and folder.lower().rstrip("s") != "path":
            yield _of_placemark(child, source, folder)


def _of_placemark(element: ET.Element, source: str, folder: str) -> MapFeature:
    name = (element.findtext("name") or "").strip()
    given = {
        str(data.get("name")): (data.findtext("value") or "").strip()
        for data in element.iter("Data")
    }
    first, _, rest = name.partition(" ")
    kind = given.get("kind") or folder.lower().rstrip("s")
    if kind not in KINDS and first.lower() in KINDS:
        kind, name = first.lower(), rest or first
    mode = next((each.text for each in element.iter("altitudeMode")), None)
    if mode != "absolute":
        raise InputError(
            source,
            name,
            f"altitudeMode is {mode or 'clampToGround'}, must be absolute (above mean sea level)",
        )
    coordinates = " ".join(each.text or "" for each in element.iter("coordinates")).split()
    return MapFeature(
        kind=kind,
        name=name,
        points=tuple(_swapped(each.split(","), source, name) for each in coordinates),
        **_lengths(given, source, f"{name}, "),
    )


def _swapped(values: Any, source: str, where: str) -> GeodeticPoint:
    """The point with this longitude, latitude and height."""
    if not isinstance(values, list) or len(values) < 3:
        raise InputError(
            source, where, f"has {values!r}, must have longitude, latitude and height (AMSL)"
        )
    longitude, latitude, altitude = values[:3]
    return _point([latitude, longitude, altitude], source, where)


def _point(values: list[Any], source: str, where: str) -> GeodeticPoint:
    names = ("latitude_deg", "longitude_deg", "altitude_amsl_m")
    limits = (90.0, 180.0, 10_000.0)
    read = []
    for name, value, limit in zip(names, values, limits, strict=True):
        number = _number(value, source, f"{where}, {name}")
        if abs(number) > limit:
            raise InputError(
                source, f"{where}, {name}", f"is {number:g}, must be within ±{limit:g}"
            )
        read.append(number)
    return GeodeticPoint(latitude_deg=read[0], longitude_deg=read[1], altitude_amsl_m=read[2])


def _lengths(given: Mapping[str, Any], source: str, where: str) -> dict[str, float]:
    """Lengths of a feature; an empty text counts as missing."""
    lengths = {
        name: _number(given[name], source, f"{where}{name}")
        for name in LENGTHS
        if given.get(name) not in (None, "")
    }
    for name, length in lengths.items():
        if length < 0.0:
            raise InputError(source, f"{where}{name}", f"is {length:g}, must be 0 or more")
    return lengths


def _number(value: Any, source: str, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(source, where, f"is {value!r}, must be a finite number")
    return number


def geojson_of(features: tuple[MapFeature, ...]) -> str:
    """A GeoJSON FeatureCollection (RFC 7946)."""
    return json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "properties": _properties(each),
                    "geometry": {
                        "type": "Point" if len(each.points) == 1 else "LineString",
                        "coordinates": _coordinates(each)[0]
                        if len(each.points) == 1
                        else _coordinates(each),
                    },
                }
                for each in features
            ],
        },
        indent=1,
    )


def kml_of(name: str, features: tuple[MapFeature, ...]) -> str:
    """KML 2.2, one folder per kind, heights above mean sea level."""
    root = ET.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ET.SubElement(root, "Document")
    ET.SubElement(document, "name").text = name
    for kind in dict.fromkeys(each.kind for each in features):
        folder = ET.SubElement(document, "Folder")
        ET.SubElement(folder, "name").text = f"{kind}s"
        for feature in features:
            if feature.kind != kind:
                continue
            mark = ET.SubElement(folder, "Placemark")
            ET.SubElement(mark, "name").text = feature.name
            extended = ET.SubElement(mark, "ExtendedData")
            for key, value in _properties(feature).items():
                if key != "name":
                    data = ET.SubElement(extended, "Data", name=key)
                    ET.SubElement(data, "value").text = str(value)
            shape = ET.SubElement(mark, "Point" if len(feature.points) == 1 else "LineString")
            ET.SubElement(shape, "altitudeMode").text = "absolute"
            ET.SubElement(shape, "coordinates").text = " ".join(
                ",".join(map(str, each)) for each in _coordinates(feature)
            )
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _properties(feature: MapFeature) -> dict[str, Any]:
    lengths = {name: getattr(feature, name) for name in LENGTHS}
    known = {name: length for name, length in lengths.items() if length is not None}
    return {"kind": feature.kind, "name": feature.name} | known


def _coordinates(feature: MapFeature) -> list[list[float]]:
    return [
        [round(each.longitude_deg, 8), round(each.latitude_deg, 8), round(each.altitude_amsl_m, 3)]
        for each in feature.points
    ]
