"""`moar-companion docs`: reference and schemas are those of the code, and good for editors."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from moar_companion.commands.cli import main
from tests.errors.files import FILES

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "configs" / "schemas"


@pytest.fixture
def checkout(tmp_path):
    """A copy of what `docs` reads and writes."""
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    schemas = "moar_companion/service/mqtt/schemas"
    shutil.copytree(ROOT / schemas, tmp_path / schemas)
    return tmp_path


def test_the_files_of_the_checkout_are_those_of_the_code(capsys):
    """To update them: `moar-companion docs`."""
    assert (main(["docs", "--check", str(ROOT)]), capsys.readouterr().out) == (0, "")


@pytest.mark.parametrize(
    "file",
    [
        "configs/reference.md",
        "configs/schemas/vehicle.json",
        "moar_companion/service/mqtt/schemas/risk.json",
    ],
)
def test_a_file_that_differs_is_named_and_written(file, checkout, capsys):
    text = (checkout / file).read_text()
    (checkout / file).write_text(text.replace("risk", "danger"))
    assert main(["docs", "--check", str(checkout)]) == 1
    assert capsys.readouterr().out == f"{checkout / file}: differs from the code\n"
    assert main(["docs", str(checkout)]) == 0
    assert (checkout / file).read_text() == text


def test_a_folder_that_is_no_checkout_is_refused(tmp_path, capsys):
    assert main(["docs", str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith(": is no checkout of this program\n")


@pytest.mark.parametrize("name", ["companion", "vehicle", "site"])
def test_a_schema_is_valid_describes_every_key_and_has_its_example(name):
    schema = json.loads((SCHEMAS / f"{name}.json").read_text())
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for content in (*schema["examples"], FILES[f"{name}.yaml"][1]):
        assert list(validator.iter_errors(content)) == []
    sections = [schema, *schema["$defs"].values()]
    bare = [
        f"{section['title']}.{key}"
        for section in sections
        for key, value in section.get("properties", {}).items()
        if "description" not in value and not _is_section(value)
    ]
    assert bare == []


def _is_section(value):
    """A mapping with keys of its own."""
    return "$ref" in value or any("$ref" in choice for choice in value.get("anyOf", ()))


@pytest.mark.parametrize(
    "file", [path.relative_to(ROOT) for path in sorted(ROOT.glob("configs/**/*.yaml"))], ids=str
)
def test_a_shipped_file_names_its_schema_and_follows_it(file):
    first, _, text = (ROOT / file).read_text().partition("\n")
    assert first.startswith("# yaml-language-server: $schema=")
    schema = json.loads((ROOT / file).parent.joinpath(first.partition("=")[2]).read_text())
    assert list(Draft202012Validator(schema).iter_errors(yaml.safe_load(text))) == []


def test_a_wrong_key_and_a_value_out_of_range_are_against_the_schema():
    schema = json.loads((SCHEMAS / "companion.json").read_text())
    wrong = {"vehicle": "v.yaml", "setpoint_rate_hz": 300, "supervison": {}}
    messages = sorted(error.message for error in Draft202012Validator(schema).iter_errors(wrong))
    assert messages == [
        "300 is greater than the maximum of 100.0",
        "Additional properties are not allowed ('supervison' was unexpected)",
    ]
