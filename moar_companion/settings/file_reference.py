"""Reference of a file of settings, from its schema: descriptions, JSON schema, table of keys.

In: a `FileModel`, whose fields, or those of the dataclass that it is derived from, have a text
below each. Out: its JSON schema (draft 2020-12), and the table of its keys in Markdown.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import ModelSchema

from .yaml_schema import FileModel, as_written, file_key, is_list

_Schema = dict[str, Any]
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_FAR = 1e6
"""A greatest value that only keeps products finite: the table does not repeat it."""
_UNITS = {
    "deg_per_s": "deg/s", "per_s": "1/s", "per_m": "1/m", "mps2": "m/s²", "mps": "m/s",
    "rpm": "1/min", "percent": "%", "ohm": "Ω", "deg": "deg", "min": "min", "hz": "Hz",
    "mb": "MB", "gb": "GB", "wh": "Wh", "us": "µs", "w": "W", "v": "V", "m": "m", "s": "s",
}  # fmt: skip
"""Units by the ending of a key, the longest first."""


class _Described(GenerateJsonSchema):
    """Adds descriptions, and the defaults of a model's dataclass, to its JSON schema."""

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        """JSON schema of one model."""
        shown = super().model_schema(schema)
        _describe(schema["cls"], shown)
        return shown


def _describe(model: type[FileModel], shown: _Schema) -> None:
    shown["title"] = model.__name__.strip("_").removesuffix("File")
    texts, defaults = _texts(model.settings or model), _defaults(model.settings)
    for key, value in shown["properties"].items():
        value.pop("title", None)
        if model.settings is not None:
            value.pop("default", None)
        value.update(texts.get(key, {}), **defaults.get(key, {}))


def json_schema(model: type[FileModel], name: str, example: Any) -> _Schema:
    """The JSON schema of a file. name: its last name in the `$id`."""
    schema = model.model_json_schema(schema_generator=_Described)
    about = {"$schema": _DIALECT, "$id": f"urn:moar-companion:{name}"}
    return {**about, **schema, "examples": [example]}


@dataclass(frozen=True, kw_only=True)
class FileKey:
    """One key of a file. kind: JSON schema of its value, null left out; optional: may be null."""

    name: str
    """Dotted, as `guidance.yaw_rate_deg_per_s`."""
    unit: str
    default: Any
    """As in a file; None without one."""
    needed: bool
    optional: bool
    kind: _Schema
    description: str
    definitions: dict[str, _Schema]

    @property
    def row(self) -> str:
        """Row of the table of keys."""
        default = "required" if self.needed else "none"
        if self.default is not None:
            default = f"`{_written(self.default)}`"
        allowed = _range(self.kind, self.definitions)
        return f"| `{self.name}` | {self.unit} | {default} | {allowed} | {self.description} |"


def keys(model: type[FileModel]) -> dict[str, FileKey]:
    """The keys of a file by their dotted names; sections only where they are described."""
    schema = model.model_json_schema(schema_generator=_Described)
    return {key.name: key for key in _keys(schema, schema.get("$defs", {}), "")}


def table(model: type[FileModel]) -> str:
    """The keys of a file as a table: key, unit, default, range, meaning."""
    rows = ["| key | unit | default | range | meaning |", "|---|---|---|---|---|"]
    return "\n".join([*rows, *(key.row for key in keys(model).values())])


def _texts(source: type) -> dict[str, _Schema]:
    """The description of each key of a class: the text below its field."""
    (parsed,) = ast.parse(textwrap.dedent(inspect.getsource(source))).body
    assert isinstance(parsed, ast.ClassDef)
    return {
        file_key(field.target.id): {"description": " ".join(below.value.value.split())}
        for field, below in itertools.pairwise(parsed.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


def _defaults(settings: Any) -> dict[str, _Schema]:
    """The default of each key as in a file; not of sections, whose keys have their own."""
    found: dict[str, _Schema] = {}
    for member in dataclasses.fields(settings) if settings is not None else ():
        made = member.default_factory
        value = member.default if made is dataclasses.MISSING else made()
        section = dataclasses.is_dataclass(value) and not is_list(type(value))
        if value is not dataclasses.MISSING and value is not None and not section:
            key = file_key(member.name)
            found[key] = {"default": as_written(value, degrees=key != member.name, digits=3)}
    return found


def _keys(schema: _Schema, definitions: dict[str, _Schema], before: str) -> Iterator[FileKey]:
    for key, field in schema["properties"].items():
        name, kind = before + key, _resolved(field, definitions)
        below, listed = _below(kind, definitions)
        if below is None or listed or "description" in field:
            yield FileKey(
                name=name,
                unit=_unit(key),
                default=field.get("default"),
                needed=key in schema.get("required", ()),
                optional=any(choice.get("type") == "null" for choice in field.get("anyOf", ())),
                kind=kind,
                description=field.get("description", ""),
                definitions=definitions,
            )
        if below is not None:
            yield from _keys(below, definitions, f"{name}{listed}.")


def _resolved(field: _Schema, definitions: dict[str, _Schema]) -> _Schema:
    """The schema of a field without its reference, and without null."""
    choices = [choice for choice in field.get("anyOf", ()) if choice.get("type") != "null"]
    if choices:
        return _resolved(choices[0], definitions)
    if "$ref" in field:
        return definitions[field["$ref"].rpartition("/")[2]]
    return field


def _below(kind: _Schema, definitions: dict[str, _Schema]) -> tuple[_Schema | None, str]:
    """The schema of the keys below a field, and what stands in their names for a place in it."""
    if "properties" in kind:
        return kind, ""
    for part, listed in (("items", "[]"), ("additionalProperties", ".NAME")):
        inner = kind.get(part)
        if isinstance(inner, dict):
            below = _resolved(inner, definitions)
            if "properties" in below:
                return below, listed
    return None, ""


def _unit(key: str) -> str:
    return next((unit for end, unit in _UNITS.items() if key.endswith(f"_{end}")), "")


def _written(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_written(item)}' for key, item in value.items())}}}"
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _range(kind: _Schema, definitions: dict[str, _Schema]) -> str:
    """The permitted values of a field, in words."""
    if "enum" in kind:
        return ", ".join(f"`{value}`" for value in kind["enum"] if value is not None)
    if kind.get("format") == "path":
        return "path"
    if kind["type"] == "boolean":
        return "`true`, `false`"
    if kind["type"] == "string":
        return "text"
    if kind["type"] == "object":
        return "mapping of names" if isinstance(kind.get("additionalProperties"), dict) else ""
    if kind["type"] == "array":
        return _list_range(kind, definitions)
    return _number_range(kind)


def _list_range(kind: _Schema, definitions: dict[str, _Schema]) -> str:
    inner = _resolved(kind["items"], definitions)
    least, most = kind.get("minItems"), kind.get("maxItems")
    items = "" if "properties" in inner else _range(inner, definitions)
    if least is not None and least == most:
        return ", ".join(filter(None, (f"{least} numbers", items)))
    count = "" if most is None else f", {least or 0} … {most:,} of them"
    return (f"list of {items}" if items else "list") + count


def _number_range(kind: _Schema) -> str:
    low, above, high = kind.get("minimum"), kind.get("exclusiveMinimum"), kind.get("maximum")
    if high is not None and high >= _FAR:
        high = None
    if low is not None and low <= -_FAR:
        low = None
    if low is not None and high is not None:
        return f"{low:g} … {high:g}"
    begin = f"> {above:g}" if above is not None else f"≥ {low:g}" if low is not None else ""
    return ", ".join(filter(None, (begin, f"≤ {high:g}" if high is not None else "")))
