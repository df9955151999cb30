"""Every key of every file, wrong in every way: one line that names file, key, value and remedy.

A wrong value is put into all keys at once; `InputError.parts` has the errors one by one.
"""

from __future__ import annotations

import copy
import functools
import json

import pytest
import yaml

from moar_companion.errors import InputError
from moar_companion.planner.site import SiteFile
from moar_companion.settings.config import COMPANION_FILE
from moar_companion.settings.vehicle import VehicleFile
from moar_companion.settings.yaml_file import _schema_at, dotted, shown

from .files import EMPTY_IS_NONE, FILES, ONE_OF_TWO, REQUIRED, parent, walk

dump = functools.partial(yaml.dump, Dumper=yaml.CSafeDumper)
"""Thousands of files are written: by the compiled library."""

SCHEMAS = {
    "site.yaml": SiteFile,
    "vehicle.yaml": VehicleFile,
    "companion.yaml": COMPANION_FILE.schema,
}
FREE_NAMES = {("targets",)}
"""Mappings whose keys are the user's."""

KINDS = {"number": (int, float), "text": (str,), "boolean": (bool,)}
WRONG = [
    # title, kind of the value, as written, as reported, allowed values
    ("text", "number", "far", "'far'", "must be a"),
    ("a number in quotes", "number", "'3'", "'3' (text, not a number)", "must be a"),
    ("a decimal comma", "number", "'1,5'", "'1,5' (a decimal comma)", "must be a"),
    ("a decimal comma and a sign", "number", "-1,5", "'-1,5' (a decimal comma)", "must be a"),
    ("a number with its unit", "number", "3 m", "'3 m'", "must be a"),
    ("a number with underscores", "number", "1_000", "'1_000'", "must be a"),
    ("a hexadecimal number", "number", "0x10", "'0x10'", "must be a"),
    ("a time", "number", "12:30", "'12:30'", "must be a"),
    ("a date", "number", "2026-11-21", "'2026-11-21'", "must be a"),
    ("yes", "number", "yes", "true", "must be a"),
    ("false", "number", "false", "false", "must be a"),
    ("not a number", "number", ".nan", "nan", "must be a "),
    ("infinity", "number", ".inf", "inf", "must be a "),
    ("less than everything", "number", "-.inf", "-inf", "must be a "),
    ("a huge number", "number", "1e300", "1e+300", "must be a"),
    ("a hugely negative number", "number", "-1e300", "-1e+300", "must be "),
    ("digits without end", "number", "9" * 400, "inf", "must be a "),
    ("a list for a number", "number", "[1]", "a list", "must be a"),
    ("a mapping for a number", "number", "{a: 1}", "a mapping", "must be a"),
    ("nothing for a number", "number", "", "empty", "must be a"),
    ("a number for text", "text", "3", "3", "must be "),
    ("a boolean for text", "text", "on", "true", "must be "),
    ("empty text", "text", "''", "''", "must "),
    ("text of two lines", "text", '"a\\nb"', r"'a\nb'", "must be "),
    ("blanks around text", "text", "' a '", "' a '", "must be "),
    ("invisible text", "text", '"\\u200b"', r"'\u200b'", "must be "),
    ("a list for text", "text", "[a]", "a list", "must be "),
    ("nothing for text", "text", "null", "empty", "must be "),
    ("a number for a boolean", "boolean", "1", "1", "must be true or false"),
    ("a boolean in quotes", "boolean", "'true'", "'true'", "must be true or false"),
    ("a list for a boolean", "boolean", "[true]", "a list", "must be true or false"),
    ("nothing for a boolean", "boolean", "", "empty", "must be true or false"),
]
STRUCTURES = {
    dict: [("3", "3"), ("yes", "true"), ("a", "'a'"), ("[1, 2]", "a list"), ("", "empty")],
    list: [("3", "3"), ("yes", "true"), ("a", "'a'"), ("{a: 1}", "a mapping"), ("", "empty")],
}
"""Values written in place of a mapping or a list, and their texts."""

FAR = 1e6 + 1.0
"""A thousand kilometres is too far, and too much of anything."""
OUTSIDE = {
    "site.yaml": {
        "latitude_deg": (-90.1, 90.1),
        "longitude_deg": (-180.1, 180.1),
        "altitude_amsl_m": (-1000.1, 10_000.1),
        "azimuth_deg": (-0.1, 360.1),
        **dict.fromkeys(("x_m", "z_m", "min_altitude_m", "vertices_m", "ground"), (-FAR, FAR)),
        **dict.fromkeys(("resolution_m", "radius_m", "standoff_m"), (0.0, FAR)),
        "keep_out_m": (-0.1, FAR),
        "dwell_s": (-0.1, 86_400.1),
        "yaw_deg": (-180.1, 360.1),
        "pictures": (-1, 1001),
        "video_s": (-0.1, 3600.1),
        "zoom_percent": (-0.1, 100.1),
        **dict.fromkeys(("north_m", "east_m", "up_m"), (-100.1, 100.1)),
    },
    "vehicle.yaml": {
        "radius_m": (-0.1, 100.1),
        **dict.fromkeys(("d_min_m", "d_max_m"), (0.009, 100.1)),
        "exposure": (-0.1, 10.1),
        **dict.fromkeys(
            ("collision", "insertion", "damage", "safety", "time", "energy"), (-0.1, FAR)
        ),
        **dict.fromkeys(
            (
                "min_mps",
                "horizontal_mps",
                "up_mps",
                "down_mps",
                "diagonal_up_mps",
                "diagonal_down_mps",
                "max_mps",
            ),
            (0.049, 100.1),
        ),
        "acceleration_mps2": (0.0, 20.1),
        "yaw_rate_deg_per_s": (0.9, 360.1),
        "fixed_yaw_deg": (-180.1, 360.1),
        **dict.fromkeys(
            ("tracking_slow_m", "tracking_hold_m", "off_path_m", "leash_m"), (0.009, 100.1)
        ),
        "recovery_m": (0.09, 500.1),
        "tracking_margin_m": (-0.1, 100.1),
        "landing_height_m": (-0.1, 20.1),
        **dict.fromkeys(
            (
                "unknown",
                "motor_fraction",
                "rc_rssi",
                "radio_quality",
                "packet_loss",
                "data_rate",
                "receiver_lost",
                "magnetic_change",
                "battery_remaining",
            ),
            (-0.1, 1.1),
        ),
        **dict.fromkeys(("drag_per_s", "endurance_s"), (0.0, FAR)),
        "drag_per_m": (-0.1, 10.1),
        **dict.fromkeys(("hover_w", "cruise_w", "climb_w", "descent_w", "capacity_wh"), (0.0, FAR)),
        "reserve_s": (-0.1, 3600.1),
        "cell_resistance_ohm": (-0.1, 1.1),
        "tilt_deg": (-0.1, 90.1),
        "cells": (0, 101),
        **dict.fromkeys(
            (
                "wind_mps",
                "gust_mps",
                "motor_pulse_us",
                "motor_rpm",
                "tracking_error_m",
                "radio_margin",
                "receive_errors_hz",
                "transmit_buffer_percent",
                "remote_control_age_s",
                "ground_station_age_s",
                "autopilot_age_s",
                "satellites",
                "hdop",
                "vdop",
                "horizontal_accuracy_m",
                "vertical_accuracy_m",
                "innovation",
                "position_resets",
                "cell_voltage_v",
                "home_margin_s",
            ),
            (-0.1, FAR),
        ),
    },
    "companion.yaml": {
        **dict.fromkeys(("system_id", "component_id", "systems", "components"), (0, 256)),
        "setpoint_rate_hz": (19.9, 100.1),
        **dict.fromkeys(
            (
                "position_timeout_s",
                "heartbeat_timeout_s",
                "mode_timeout_s",
                "armed_timeout_s",
            ),
            (0.0, 3600.1),
        ),
        **dict.fromkeys(
            ("ready_timeout_s", "ground_link_lost_s", "exposure_limit_s", "plan_stale_s"),
            (0.9, 3600.1),
        ),
        **dict.fromkeys(("period_s", "min_interval_s"), (0.09, 3600.1)),
        "wind_limit_mps": (0.09, 100.1),
        "localization_limit": (0.009, 1.1),
        "position_uncertainty_m": (-0.1, 100.1),
        "position_uncertainty_limit_m": (0.009, 100.1),
        "battery_reserve": (-0.1, 1.1),
        "fence_margin_m": (-0.1, 100.1),
        "exposure_reserve_s": (-0.1, 3600.1),
        "jump_limit_m": (0.0, 1000.1),
        **dict.fromkeys(("disk_free_mb", "memory_free_mb"), (-0.1, FAR)),
        "part_mb": (0.9, 1e6 + 1.0),
        "part_min": (0.9, 1e4 + 1.0),
        "keep_gb": (0.09, 1e6 + 1.0),
        "floor_mb": (-0.1, 1e6 + 1.0),
        "risk_change": (0.0009, 1.1),
        "improvement": (-0.1, 1.1),
        "plane_tolerance_m": (0.09, 1000.1),
        "window_s": (0.9, 300.1),
        "port": (0, 65_536),
        "position_m": (-FAR, FAR),
        "roll_pitch_yaw_deg": (-360.1, 360.1),
        **dict.fromkeys(("keep_out_m", "target_slack_m"), (-0.1, FAR)),
        **dict.fromkeys(("gate_m", "moved_m", "sight_m"), (0.0, FAR)),
        **dict.fromkeys(("timeout_s", "late_s"), (0.0, 3600.1)),
        "least_returns": (-0.1, 1.1),
        "aim_deg": (0.09, 45.1),
        "speed_mps": (0.01, 5.1),
        "turn_rate_dps": (0.09, 90.1),
        "settle_s": (-0.1, 60.1),
    },
}
"""The greatest number too small and the least too great, by the last name of a key."""


def keys_of(*kinds):
    """All keys of all files with a value of one of the kinds."""
    return [
        pytest.param(file, key, id=f"{file}: {dotted(key)}")
        for file, (_, content) in FILES.items()
        for key, value in walk(content)
        if key and type(value) in kinds
    ]


def refusal(file, text, folder, capsys):
    """The error with which a file is refused, which printed and wrote nothing."""
    path = folder / file
    path.write_text(text)
    with pytest.raises(InputError) as raised:
        FILES[file][0](path)
    error = raised.value
    for line in (str(error), *map(str, error.parts)):
        assert line.isprintable()
        assert line.startswith(f"{path}: ")
    assert str(error).startswith(str(error.parts[0]))
    assert list(folder.iterdir()) == [path]
    assert capsys.readouterr() == ("", "")
    return error


def outside(file, key):
    """The greatest number too small and the least too great."""
    return OUTSIDE[file][next(part for part in reversed(key) if isinstance(part, str))]


def changed(file, key, value):
    """The content of a file with another value at a key."""
    content = copy.deepcopy(FILES[file][1])
    parent(content, key)[key[-1]] = value
    return content


def with_all(file, kinds, as_written):
    """The text of a file with something written at all keys of some kinds; and those keys."""
    content = copy.deepcopy(FILES[file][1])
    keys = [key for key, value in walk(content) if type(value) in kinds]
    for key in keys:
        parent(content, key)[key[-1]] = "@"
    return dump(content, sort_keys=False).replace("'@'", as_written), keys


def test_the_files_here_have_every_key_of_the_schemas():
    for file, (load, content) in FILES.items():
        names = {}
        for key, value in walk(content):
            if isinstance(value, dict) and key not in FREE_NAMES:
                names.setdefault(_schema_at(SCHEMAS[file], key), set()).update(value)
        assert names == {schema: set(schema.model_fields) for schema in names}
        assert load


@pytest.mark.parametrize("file", FILES)
def test_a_file_with_every_key_loads(file, tmp_path):
    load, content = FILES[file]
    (tmp_path / file).write_text(dump(content))
    load(tmp_path / file)


@pytest.mark.parametrize(
    ("kind", "bad", "reported", "allowed", "file"),
    [
        pytest.param(kind, *reported, file, id=f"{file}: {title}")
        for title, kind, *reported in WRONG
        for file, (_, content) in FILES.items()
        if any(type(value) in KINDS[kind] for _, value in walk(content))
    ],
)
def test_a_wrong_value_is_named_with_the_allowed_values(
    kind, bad, reported, allowed, file, tmp_path, capsys
):
    text, keys = with_all(file, KINDS[kind], bad)
    fine = EMPTY_IS_NONE[file] | ONE_OF_TWO[file] if reported == "empty" else ()
    lines = [
        f"{tmp_path / file}: {dotted(key)}: is {reported}, {allowed}"
        for key in keys
        if dotted(key) not in fine
    ]
    parts = refusal(file, text, tmp_path, capsys).parts
    assert len(parts) == len(lines)
    for part, line in zip(parts, lines, strict=True):
        assert str(part).startswith(line)


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("side", [0, 1], ids=["too small", "too great"])
def test_a_number_out_of_range_is_named_with_its_limit(side, file, tmp_path, capsys):
    content = copy.deepcopy(FILES[file][1])
    keys = [key for key, value in walk(content) if type(value) in KINDS["number"]]
    for key in keys:
        parent(content, key)[key[-1]] = outside(file, key)[side]
    parts = refusal(file, dump(content, sort_keys=False), tmp_path, capsys).parts
    assert len(parts) == len(keys)
    word = ("must be at least", "must be greater than") if side == 0 else ("must be at most",)
    for part, key in zip(parts, keys, strict=True):
        value = shown(outside(file, key)[side])
        start = f"{tmp_path / file}: {dotted(key)}: is {value}, "
        assert str(part).startswith(tuple(start + each for each in word))


@pytest.mark.parametrize(("file", "key"), keys_of(dict, list))
def test_a_value_that_is_no_mapping_or_list_is_named(file, key, tmp_path, capsys):
    kind = type(parent(FILES[file][1], key)[key[-1]])
    word = "a mapping" if kind is dict else "a list"
    for bad, reported in STRUCTURES[kind]:
        if reported == "empty" and dotted(key) in EMPTY_IS_NONE[file]:
            continue
        text = dump(changed(file, key, "@"), sort_keys=False).replace("'@'", bad)
        path = tmp_path / file
        if reported == "empty" and dotted(key) in ONE_OF_TWO[file]:
            must = f"{dotted(key[:-1])}: must have one key, conductor or polygon"
        else:
            must = f"{dotted(key)}: is {reported}, must be {word}"
        assert str(refusal(file, text, tmp_path, capsys)).startswith(f"{path}: {must}")


@pytest.mark.parametrize(("file", "key"), keys_of(*KINDS["text"]))
def test_text_that_is_too_long_is_not_repeated(file, key, tmp_path, capsys):
    line = str(refusal(file, dump(changed(file, key, "a" * 5000)), tmp_path, capsys))
    assert line.startswith(f"{tmp_path / file}: {dotted(key)}: ")
    assert " must " in line
    assert "a" * 50 not in line


@pytest.mark.parametrize("file", FILES)
def test_only_a_required_key_must_be_there(file, tmp_path, capsys):
    load, content = FILES[file]
    path = tmp_path / file
    for key, _ in walk(content):
        if not key or isinstance(key[-1], int):
            continue
        smaller = copy.deepcopy(content)
        del parent(smaller, key)[key[-1]]
        text = dump(smaller, sort_keys=False)
        if dotted(key) in REQUIRED[file]:
            assert (
                str(refusal(file, text, tmp_path, capsys)) == f"{path}: {dotted(key)}: is missing"
            )
        elif key[-1] == "min_altitude_m":
            must = f"{path}: {dotted(key)}: is missing: "
            assert str(refusal(file, text, tmp_path, capsys)).startswith(must)
        elif key[0] == "obstacles" and key[-1] in ("conductor", "polygon"):
            must = f"{path}: {dotted(key[:-1])}: must have one key, conductor or polygon"
            assert str(refusal(file, text, tmp_path, capsys)).startswith(must)
        else:
            path.write_text(text)
            load(path)


@pytest.mark.parametrize("file", FILES)
def test_an_unknown_key_is_named_with_the_known_keys(file, tmp_path, capsys):
    content = copy.deepcopy(FILES[file][1])
    mappings = [key for key, value in walk(content) if type(value) is dict]
    for key in mappings:
        parent(content, (*key, "zzz"))["zzz"] = 1
    parts = refusal(file, dump(content, sort_keys=False), tmp_path, capsys).parts
    lines = {str(part).removeprefix(f"{tmp_path / file}: ") for part in parts}
    assert len(parts) == len(lines) == len(mappings)
    for key in mappings:
        if key in FREE_NAMES:
            assert f"{dotted(key)}.zzz: is 1, must be a mapping" in lines
        else:
            known = ", ".join(_schema_at(SCHEMAS[file], key).model_fields)
            assert f"{dotted((*key, 'zzz'))}: is not a known key, must be one of {known}" in lines


MISSPELT = {
    "without a letter": lambda name: name[:1] + name[2:],
    "with a letter twice": lambda name: name[:2] + name[1:],
    "in capitals": str.upper,
    "with blanks": lambda name: name.replace("_", " ").title(),
}


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize(
    "slip",
    [
        pytest.param(slip, marks=() if slip == "without a letter" else pytest.mark.slow)
        for slip in MISSPELT
    ],
)
def test_a_misspelt_key_is_named_with_the_key_that_was_meant(slip, file, tmp_path, capsys):
    keys = [
        (key, type(value) in (dict, list))
        for key, value in walk(FILES[file][1])
        if key and isinstance(key[-1], str) and key[:-1] not in FREE_NAMES
    ]
    # All values at once, and each section by itself: what is in one that is misspelt is not read.
    values = [key for key, is_section in keys if not is_section]
    for group in [values, *([key] for key, is_section in keys if is_section)]:
        content = copy.deepcopy(FILES[file][1])
        expected = set()
        for key in group:
            misspelt = (*key[:-1], MISSPELT[slip](key[-1]))
            parent(content, misspelt)[misspelt[-1]] = parent(content, key).pop(key[-1])
            meant = f"is not a known key, did you mean {key[-1]}?"
            expected.add(f"{tmp_path / file}: {dotted(misspelt)}: {meant}")
        text = dump(content, sort_keys=False)
        found = {str(part) for part in refusal(file, text, tmp_path, capsys).parts}
        assert expected <= found, expected - found


def twice(value):
    """As YAML in which every key of every mapping is given a second time, on the same line."""
    if isinstance(value, dict):
        pairs = (
            f"{json.dumps(key)}: {twice(item)}, {json.dumps(key)}: 0" for key, item in value.items()
        )
        return "{" + ", ".join(pairs) + "}"
    return f"[{', '.join(map(twice, value))}]" if isinstance(value, list) else json.dumps(value)


@pytest.mark.parametrize("file", FILES)
def test_a_key_given_twice_is_named_with_both_lines(file, tmp_path, capsys):
    keys = [key for key, _ in walk(FILES[file][1]) if key and isinstance(key[-1], str)]
    parts = refusal(file, twice(FILES[file][1]), tmp_path, capsys).parts
    assert sorted(map(str, parts)) == sorted(
        f"{tmp_path / file}: {dotted(key)}: is given twice (lines 1 and 1), must be once"
        for key in keys
    )
