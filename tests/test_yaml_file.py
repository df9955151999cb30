"""What no file may do, whichever kind it is: the loaders raise InputError, one line, or succeed."""

from __future__ import annotations

import copy
import dataclasses
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.config import CompanionConfig, Replanning, Supervision
from moar_companion.errors import InputError
from moar_companion.site import Site
from moar_companion.vehicle import Guidance, Range, RiskModel, Vehicle, YawMode
from moar_companion.yaml_file import dotted, shown
from moar_companion.yaml_schema import file_key


def section(record: Any) -> dict[str, Any]:
    """A section of a file with every key, from the defaults of its dataclass."""
    content = {}
    for member in dataclasses.fields(record):
        value = getattr(record, member.name)
        key = file_key(member.name)
        if isinstance(value, Range):
            value = [value.low, value.high]
        elif isinstance(value, YawMode):
            value = value.value
        elif value is None:
            value = 6
        if key != member.name:
            value = [math.degrees(x) for x in value] if isinstance(value, list) else value
            value = math.degrees(value) if isinstance(value, float) else value
        content[key] = value
    return content


WEIGHTS = {"safety": 0.4, "time": 0.3, "energy": 0.3}
SITE: dict[str, Any] = {
    "name": "Span 12",
    "frame": {
        "origin": {"latitude_deg": 45.4, "longitude_deg": -71.9, "altitude_amsl_m": 210.0},
        "azimuth_deg": 90.0,
    },
    "workspace": {
        "x_m": [0.0, 30.0],
        "z_m": [0.0, 20.0],
        "resolution_m": 0.3,
        "min_altitude_m": 2.0,
    },
    "obstacles": [
        {"conductor": {"name": "left", "x_m": 9, "z_m": 8, "radius_m": 0.03, "keep_out_m": 0.5}},
        {
            "polygon": {
                "name": "leg",
                "vertices_m": [[14.0, 0.0], [16.0, 0.0], [15.5, 19.0], [14.5, 19.0]],
                "keep_out_m": 0.2,
            }
        },
    ],
    "start": {"x_m": 27.0, "z_m": 2.5},
    "targets": {
        "splice-1": {"x_m": 9.0, "z_m": 14.0, "dwell_s": 3.0, "yaw_deg": 180.0},
        "splice-2": {"conductor": "left", "standoff_m": 2.0, "side": "left"},
    },
    "landing": {
        "exit": [{"x_m": 40.0, "z_m": 0.0}],
        "evacuation": [{"x_m": -8.0, "z_m": 0.0}, {"x_m": 40.0, "z_m": 0.0}],
    },
}
VEHICLE: dict[str, Any] = {
    "name": "LineDrone",
    "autopilot": "px4",
    "geometry": {"radius_m": 0.6},
    "safety": {
        "d_min_m": 1.2,
        "d_max_m": 3.0,
        "weights": {"collision": 0.3, "insertion": 0.2, "damage": 0.5},
    },
    "speed": {
        "min_mps": 0.5,
        "horizontal_mps": 10.0,
        "up_mps": 1.5,
        "down_mps": 1.5,
        "diagonal_up_mps": 2.5,
        "diagonal_down_mps": 2.5,
        "max_mps": 10.0,
    },
    "weights": {"inspection": WEIGHTS, "exit": dict(WEIGHTS), "evacuation": dict(WEIGHTS)},
    "guidance": section(Guidance()),
    "risk": section(RiskModel()),
}
COMPANION: dict[str, Any] = {
    "vehicle": "vehicles/linedrone.yaml",
    "site": "sites/span.yaml",
    "links": [{"url": "udp:127.0.0.1:14540", "role": "autopilot"}],
    "system_id": 1,
    "component_id": 195,
    "authority": "stream",
    "setpoint_rate_hz": 50.0,
    "resume": False,
    "replanning": section(Replanning()),
    "supervision": section(Supervision()),
    "recorder": {"directory": "flights"},
}
FILES: dict[str, tuple[Any, dict[str, Any]]] = {
    "site.yaml": (Site.load, SITE),
    "vehicle.yaml": (Vehicle.load, VEHICLE),
    "companion.yaml": (CompanionConfig.load, COMPANION),
}
REQUIRED = {
    "site.yaml": {
        "name", "frame", "frame.origin", "frame.origin.latitude_deg", "frame.origin.longitude_deg",
        "frame.origin.altitude_amsl_m", "frame.azimuth_deg", "workspace", "workspace.x_m",
        "workspace.z_m", "workspace.resolution_m", "obstacles", "obstacles[0].conductor.name",
        "obstacles[0].conductor.x_m", "obstacles[0].conductor.z_m",
        "obstacles[0].conductor.radius_m", "obstacles[1].polygon.name",
        "obstacles[1].polygon.vertices_m", "start", "start.x_m", "start.z_m",
        "targets.splice-1.x_m", "targets.splice-1.z_m", "targets.splice-2.conductor",
        "targets.splice-2.standoff_m", "targets.splice-2.side", "landing.exit[0].x_m",
        "landing.exit[0].z_m", "landing.evacuation[0].x_m", "landing.evacuation[0].z_m",
        "landing.evacuation[1].x_m", "landing.evacuation[1].z_m",
    },
    "vehicle.yaml": {
        "name", "geometry", "geometry.radius_m", "safety", "safety.d_min_m", "safety.d_max_m",
        "safety.weights", "safety.weights.collision", "safety.weights.insertion",
        "safety.weights.damage", "speed", "speed.min_mps", "speed.horizontal_mps", "speed.up_mps",
        "speed.down_mps", "speed.diagonal_up_mps", "speed.diagonal_down_mps", "weights",
        *(f"weights.{mission}" for mission in ("inspection", "exit", "evacuation")),
        *(
            f"weights.{mission}.{name}"
            for mission in ("inspection", "exit", "evacuation")
            for name in WEIGHTS
        ),
    },
    "companion.yaml": {"vehicle", "links[0].url"},
}  # fmt: skip
EMPTY_IS_NONE = {
    "site.yaml": {"workspace.min_altitude_m", "targets.splice-1.yaw_deg"},
    "vehicle.yaml": {"autopilot", "speed.max_mps", "risk.cells"},
    "companion.yaml": {"site", "recorder.directory"},
}
"""Keys whose default is nothing; `key:` without a value says the same."""

ONE_OF_TWO = {"conductor", "polygon", "x_m", "z_m", "standoff_m", "side", "vehicle"}
"""Keys that something else may stand for: without a value they are as good as missing."""

TEXT = "text"
WRONG: dict[type, list[Any]] = {
    float: [True, False, "3", TEXT, math.nan, math.inf, -math.inf, -1e9, 1e9, [1.0], {}],
    bool: [1, 0.5, "true", [True], {}],
    str: [3, 0.5, True, "", "a\nb", " a", "a" * 5_000, ["a"], {}],
    list: [3, True, TEXT, {}],
    dict: [3, True, TEXT, [1, 2]],
}
WRONG[int] = WRONG[float]


def walk(
    value: Any, key: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Every key of a file with its value, the file itself first."""
    yield key, value
    if isinstance(value, dict | list):
        for part, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from walk(item, (*key, part))


def parent(content: Any, key: tuple[str | int, ...]) -> Any:
    for part in key[:-1]:
        content = content[part]
    return content


def keys_of(*kinds: type) -> list[Any]:
    """Every key of every file whose value is of one of the kinds."""
    return [
        pytest.param(file, key, id=f"{file}: {dotted(key) or 'top'}")
        for file, (_, content) in FILES.items()
        for key, value in walk(content)
        if isinstance(value, kinds)
    ]


def line_of(file: str, content: Any, folder: Path) -> str:
    """The one line with which a file is refused."""
    path = folder / file
    text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
    path.write_text(text)
    with pytest.raises(InputError) as raised:
        FILES[file][0](path)
    line = str(raised.value)
    assert line.isprintable()
    assert line.startswith(f"{path}: ")
    return line.removeprefix(f"{path}: ")


@pytest.mark.parametrize("file", FILES)
def test_a_file_with_every_key_loads(file: str, tmp_path: Path) -> None:
    load, content = FILES[file]
    (tmp_path / file).write_text(yaml.safe_dump(content))
    load(tmp_path / file)


@pytest.mark.parametrize(("file", "key"), [entry for entry in keys_of(object) if entry.values[1]])
def test_a_wrong_value_is_named_with_what_is_allowed(
    file: str, key: tuple[str | int, ...], tmp_path: Path
) -> None:
    content = copy.deepcopy(FILES[file][1])
    wrong = WRONG[type(parent(content, key)[key[-1]])]
    nothing = [] if dotted(key) in EMPTY_IS_NONE[file] else [None]
    for bad in [*wrong, *nothing]:
        parent(content, key)[key[-1]] = bad
        line = line_of(file, content, tmp_path)
        if bad is None and key[-1] in ONE_OF_TWO:
            assert "is missing" in line or "must " in line
            continue
        assert line.startswith(f"{dotted(key)}: is {shown(bad)}, must be ") or (
            isinstance(bad, str)
            and line.startswith(
                (
                    f"{dotted(key)}: is {shown(bad)}, must not be empty",
                    f"{dotted(key)}: is {shown(bad)} (text, not a number), must be ",
                    f"{dotted(key)}: has {len(bad)} characters, must have ",
                )
            )
        )


@pytest.mark.parametrize(("file", "key"), keys_of(dict))
def test_an_unknown_key_is_named(file: str, key: tuple[str | int, ...], tmp_path: Path) -> None:
    content = copy.deepcopy(FILES[file][1])
    parent(content, (*key, "zzz"))["zzz"] = 1
    line = line_of(file, content, tmp_path)
    if key == ("targets",):  # a target may have any name
        assert line == "targets.zzz: is 1, must be a mapping"
    else:
        assert line.startswith(f"{dotted((*key, 'zzz'))}: is not a known key, must be one of ")


@pytest.mark.parametrize(("file", "key"), keys_of(dict))
def test_only_a_required_key_must_be_there(
    file: str, key: tuple[str | int, ...], tmp_path: Path
) -> None:
    for name in parent(FILES[file][1], (*key, "")):
        content = copy.deepcopy(FILES[file][1])
        del parent(content, (*key, name))[name]
        missing = dotted((*key, name))
        if missing in REQUIRED[file]:
            assert line_of(file, content, tmp_path) == f"{missing}: is missing"
        elif name in ("conductor", "polygon"):
            expected = f"{dotted(key)}: must have one key, conductor or polygon"
            assert line_of(file, content, tmp_path).startswith(expected)
        else:
            (tmp_path / file).write_text(yaml.safe_dump(content))
            FILES[file][0](tmp_path / file)


@pytest.mark.parametrize(
    ("misspelt", "meant"),
    [("nmae", "name"), ("obstacle", "obstacles"), ("landings", "landing"), ("Start", "start")],
)
def test_the_nearest_key_is_suggested(misspelt: str, meant: str, tmp_path: Path) -> None:
    content = {misspelt if key == meant else key: value for key, value in SITE.items()}
    line = line_of("site.yaml", content, tmp_path)
    assert line.startswith(f"{misspelt}: is not a known key, did you mean {meant}?")


def test_a_key_that_is_there_already_is_not_suggested(tmp_path: Path) -> None:
    content = copy.deepcopy(SITE)
    content["start"]["y_m"] = 0.0
    line = line_of("site.yaml", content, tmp_path)
    assert line == "start.y_m: is not a known key, must be one of x_m, z_m"


def test_the_first_of_several_findings_in_file_order(tmp_path: Path) -> None:
    content = {key: copy.deepcopy(SITE[key]) for key in reversed(SITE)}
    content["name"] = 3
    content["start"]["x_m"] = "far"
    content["landing"]["exit"][0]["z_m"] = True
    line = line_of("site.yaml", content, tmp_path)
    assert line == "landing.exit[0].z_m: is true, must be a number (and 2 more)"


def test_a_name_with_blanks_is_quoted_in_the_key(tmp_path: Path) -> None:
    content = copy.deepcopy(SITE)
    content["targets"]["upper splice"] = {"x_m": 1.0, "z_m": -1e7}
    line = line_of("site.yaml", content, tmp_path)
    assert line == "targets['upper splice'].z_m: is -10000000.0, must be at least -1000000"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "is empty, must be a mapping with the keys name, "),
        ("# only a comment\n", "is empty, must be a mapping with the keys name, "),
        ("[1, 2]", "is a list, must be a mapping with the keys name, "),
        ("just text", "is 'just text', must be a mapping with the keys name, "),
        ("name: [1", "is not YAML: line 1, column 9: "),
        ("a: b: c", "is not YAML: line 1, column 5: "),
        ("name: a\n---\nname: b\n", "is not YAML: line 2, column 1: "),
        ("name: \x07", "is not YAML: unacceptable character"),
        ("name: *nowhere", "is not YAML: line 1, column 7: found undefined alias"),
        ("<<: 3", "is not YAML: line 1, column 5: "),
        ("name: a\nstart: {x_m: 1, x_m: 2}", "start.x_m: is given twice (lines 2 and 2)"),
        ("name: a\nname: b", "name: is given twice (lines 1 and 2)"),
        ("targets: {12: {x_m: 1}}", "targets: has '12' as a key (line 1), must be text"),
        ("{yes: 1}", "has 'yes' as a key (line 1), must be text in quotes"),
        ("? [a]\n: 1", "has a list as a key (line 1), must be text in quotes"),
        ("name: !!int three", "name: has the tag 'tag:yaml.org,2002:int', must have none"),
        ("name: !!binary '%'", "name: has the tag 'tag:yaml.org,2002:binary', must have none"),
        ("!!python/object:os.system {}", "has the tag 'tag:yaml.org,2002:python/object"),
        ("start: &a {x_m: *a}", "start.x_m: is a mapping, must be a number (and "),
        ("[" * 20_000, "is nested too deeply"),
        ("#" * 1_000_001, "is larger than 1000000 bytes"),
    ],
)
def test_a_file_that_is_no_mapping_with_text_keys(text: str, problem: str, tmp_path: Path) -> None:
    assert line_of("site.yaml", text, tmp_path).startswith(problem)


@pytest.mark.parametrize("load", [load for load, _ in FILES.values()])
def test_a_file_that_cannot_be_read(load: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.yaml: no such file$"):
        load(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match=r": is a directory, must be a file$"):
        load(str(tmp_path))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r": cannot be read: Not a directory$"):
        load(tmp_path / "file" / "site.yaml")
    with pytest.raises(InputError, match=r": cannot be read: embedded null byte$"):
        load("a\0b")
    (tmp_path / "latin.yaml").write_bytes("name: Québec".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin\.yaml: is not UTF-8 text \(byte 8\)$"):
        load(tmp_path / "latin.yaml")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission(tmp_path: Path) -> None:
    path = tmp_path / "secret.yaml"
    path.write_text("name: a")
    path.chmod(0)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        Site.load(path)


@pytest.mark.parametrize(
    ("written", "value"),
    [("1e1", 10.0), ("010", 10.0), ("+2.5E0", 2.5), (".5", 0.5), ("3.", 3.0), ("0x10", None)],
)
def test_numbers_are_those_of_yaml_1_2(written: str, value: float | None, tmp_path: Path) -> None:
    text = yaml.safe_dump(SITE).replace("x_m: 27.0", f"x_m: {written}")
    if value is None:
        assert (
            line_of("site.yaml", text, tmp_path) == f"start.x_m: is '{written}', must be a number"
        )
    else:
        (tmp_path / "site.yaml").write_text(text)
        assert Site.load(tmp_path / "site.yaml").start_m == (value, 2.5)


def test_anchors_merges_and_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    content = {key: value for key, value in SITE.items() if key != "landing"}
    text = yaml.safe_dump(content).replace("start:", "start: &start")
    text += "landing: {exit: [{<<: *start, z_m: 0.5}]}\n"
    (tmp_path / "site.yaml").write_text("\ufeff" + text, encoding="utf-8")
    site = Site.load(tmp_path / "site.yaml")
    assert list(site.landing_m.values()) == [((27.0, 0.5),)]


def refused_or_loaded(file: str, content: bytes, folder: Path) -> None:
    path = folder / file
    path.write_bytes(content)
    try:
        FILES[file][0](path)
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@settings(max_examples=200, deadline=None)
@given(content=st.binary(max_size=200), file=st.sampled_from(sorted(FILES)))
def test_no_bytes_raise_anything_else(content: bytes, file: str, folder: Path) -> None:
    refused_or_loaded(file, content, folder)


@settings(max_examples=300, deadline=None)
@given(
    text=st.text(alphabet="name: x_m[]{},-?*&!|>'\"#%@\n\t 01.e~<é\u2028", max_size=60),
    file=st.sampled_from(sorted(FILES)),
)
def test_no_text_raises_anything_else(text: str, file: str, folder: Path) -> None:
    refused_or_loaded(file, text.encode(), folder)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10) | st.dates(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=5) | st.sampled_from(["x_m", "z_m"]), inner, max_size=4)
    ),
    max_leaves=8,
)


@settings(max_examples=500, deadline=None)
@given(data=st.data(), value=VALUES, file=st.sampled_from(sorted(FILES)))
def test_no_structure_raises_anything_else(
    data: st.DataObject, value: Any, file: str, folder: Path
) -> None:
    content = copy.deepcopy(FILES[file][1])
    key = data.draw(st.sampled_from([key for key, _ in walk(content) if key]))
    parent(content, key)[key[-1]] = value
    refused_or_loaded(file, yaml.safe_dump(content, allow_unicode=True).encode(), folder)


@settings(max_examples=300, deadline=None)
@given(
    data=st.data(),
    value=st.floats(allow_nan=False, allow_infinity=False) | st.integers(-3, 300),
    file=st.sampled_from(sorted(FILES)),
)
def test_no_number_raises_anything_else(
    data: st.DataObject, value: float, file: str, folder: Path
) -> None:
    content = copy.deepcopy(FILES[file][1])
    numbers = [key for key, old in walk(content) if isinstance(old, int | float)]
    key = data.draw(st.sampled_from(numbers))
    parent(content, key)[key[-1]] = value
    refused_or_loaded(file, yaml.safe_dump(content).encode(), folder)
