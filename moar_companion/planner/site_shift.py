"""A site file whose frame is moved in the world, with the record of the shift. Pure.

In: the text of a site file, a shift. Out: the text with a moved `frame.origin` and the shift
appended to `frame.shifts`; every other character stays.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import yaml

from ..errors import InputError
from ..settings.yaml_edit import end_of
from ..types import GeodeticPoint
from .site import FrameShift, Site

_LATITUDE_DIGITS = 9
"""0.1 mm."""
_ALTITUDE_DIGITS = 4


def shifted_text(text: str, source: str, shift: FrameShift) -> str:
    """The text of a site file with its frame moved; InputError where it cannot be edited."""
    site = Site.of_text(text, source)
    origin = site.frame.moved(shift.north_m, shift.east_m, shift.up_m).origin
    moved = GeodeticPoint(
        latitude_deg=round(origin.latitude_deg, _LATITUDE_DIGITS),
        longitude_deg=round(origin.longitude_deg, _LATITUDE_DIGITS),
        altitude_amsl_m=round(origin.altitude_amsl_m, _ALTITUDE_DIGITS),
    )
    shifts = (*site.shifts, shift)
    expected = replace(site, frame=replace(site.frame, origin=moved), shifts=shifts)
    try:
        edited = _edited(text, moved, shifts)
        done = Site.of_text(edited, source) == expected
    except (InputError, LookupError):
        done = False
    if not done:
        raise InputError(source, "frame", "cannot be edited: write it as the shipped sites do")
    return edited


def _edited(text: str, origin: GeodeticPoint, shifts: tuple[FrameShift, ...]) -> str:
    frame = _entry(yaml.compose(text, Loader=yaml.SafeLoader), "frame")
    file_origin = _entry(frame, "origin")
    edits = []
    for name in ("latitude_deg", "longitude_deg", "altitude_amsl_m"):
        node = _entry(file_origin, name)
        edits.append((node.start_mark.index, node.end_mark.index, repr(getattr(origin, name))))
    record = f"[{', '.join(map(_flow, shifts))}]"
    if "shifts" in [name.value for name, _ in frame.value]:
        node = _entry(frame, "shifts")
        edits.append((node.start_mark.index, end_of(node), record))
    else:
        end = end_of(frame.value[-1][1])
        separator = ", "
        if not frame.flow_style:
            end = text.find("\n", end) if "\n" in text[end:] else len(text)
            separator = "\n" + " " * frame.start_mark.column
        edits.append((end, end, f"{separator}shifts: {record}"))
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _flow(shift: FrameShift) -> str:
    """A shift as a mapping of YAML on one line."""
    pairs = (
        f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in asdict(shift).items()
    )
    return f"{{{', '.join(pairs)}}}"


def _entry(mapping: Any, key: str) -> Any:
    """Node of a key of a mapping node; LookupError where it comes from a merged mapping."""
    return {name.value: value for name, value in mapping.value}[key]
