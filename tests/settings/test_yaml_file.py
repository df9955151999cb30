"""Rules for every file: the loaders raise InputError, one line, or succeed."""

from __future__ import annotations

import copy
import os
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner.site import Site

from ..errors.files import FILES, parent, walk

SITE = FILES["site.yaml"][1]


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


def test_each_of_several_findings_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(yaml.safe_dump(SITE | {"name": 3, "obstacles": "none"}, sort_keys=False))
    with pytest.raises(InputError) as caught:
        Site.load(path)
    assert [str(part) for part in caught.value.parts] == [
        f"{path}: name: is 3, must be text (in quotes)",
        f"{path}: obstacles: is 'none', must be a list",
    ]


def test_a_single_finding_is_its_own_part(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Site.load(tmp_path / "nowhere.yaml")
    assert caught.value.parts == (caught.value,)


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
        ("start: &a {x_m: *a}", "is nested too deeply"),
        (
            "start: {x_m: 9,5, z_m: 2}",
            "start: has '5' as a key (line 1), must be text in quotes (a",
        ),
        ("start:\n\tx_m: 9", "is not YAML: line 2, column 1: found a tab, must be blanks"),
        ("name:a\nstart: 3", "is not YAML: line 2, column 6: found a colon out of place, must be"),
        ("name:a\n# here\nstart: 3", "is not YAML: line 3, column 1: found a key after text, must"),
        (f"a: &a [{'1, ' * 999}1]\nb: [{'*a, ' * 999}*a]", "has more than 100000 values, aliases"),
        pytest.param("[" * 20_000, "is nested too deeply", marks=pytest.mark.slow),
        ("#" * 1_000_001, "is larger than 1000000 bytes"),
    ],
)
def test_a_file_that_is_no_mapping_with_text_keys(text: str, problem: str, tmp_path: Path) -> None:
    assert line_of("site.yaml", text, tmp_path).startswith(problem)


@pytest.mark.parametrize("load", [load for load, _ in FILES.values()])
def test_a_file_that_cannot_be_read_is_refused(load: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.yaml: no such file$"):
        load(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match=r": is a directory, must be a file$"):
        load(str(tmp_path))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r": cannot be read: Not a directory$"):
        load(tmp_path / "file" / "site.yaml")
    with pytest.raises(InputError, match=r": cannot be read: not a valid path$"):
        load("a\0b")
    (tmp_path / "latin.yaml").write_bytes("name: Québec".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin\.yaml: is not UTF-8 text \(byte 8\)$"):
        load(tmp_path / "latin.yaml")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_refused(tmp_path: Path) -> None:
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


@settings(max_examples=50, deadline=None)
@given(content=st.binary(max_size=200), file=st.sampled_from(sorted(FILES)))
def test_no_bytes_raise_anything_else(content: bytes, file: str, folder: Path) -> None:
    refused_or_loaded(file, content, folder)


@settings(max_examples=50, deadline=None)
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


@settings(max_examples=50, deadline=None)
@given(data=st.data(), value=VALUES, file=st.sampled_from(sorted(FILES)))
def test_no_structure_raises_anything_else(
    data: st.DataObject, value: Any, file: str, folder: Path
) -> None:
    content = copy.deepcopy(FILES[file][1])
    key = data.draw(st.sampled_from([key for key, _ in walk(content) if key]))
    parent(content, key)[key[-1]] = value
    refused_or_loaded(file, yaml.safe_dump(content, allow_unicode=True).encode(), folder)


@settings(max_examples=50, deadline=None)
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
