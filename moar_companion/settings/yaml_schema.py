"""Schemas of files: the base of their models, common types, and sections from dataclasses.

Only the input of files uses the models; `yaml_file.read` turns their errors into one line.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import re
import typing
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    Strict,
    StringConstraints,
    create_model,
)
from pydantic_core import CoreSchema, core_schema

Record = TypeVar("Record")

_FAR_M = 1e6
"""Greatest coordinate or length: a thousand kilometres keep all products finite."""


class FileModel(BaseModel):
    """Schema of a mapping in a file."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        frozen=True,
        # Built when a file is first read: nested models are built as parts of it.
        defer_build=True,
    )

    def arguments(self, folder: Path, **converted: Any) -> dict[str, Any]:
        """Arguments of the class that the mapping fills: its keys in the file, and `converted`.

        Relative paths are relative to `folder`; lists become tuples. A key that the class lacks
        raises TypeError there: none is accepted and then ignored.
        """
        values = {name: getattr(self, name) for name in self.model_fields_set - converted.keys()}
        return {name: _argument(value, folder) for name, value in values.items()} | converted


def _argument(value: Any, folder: Path) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return folder / value if isinstance(value, Path) else value


def _printable(text: str) -> str:
    if not text.isprintable() or text != text.strip():
        raise ValueError("must be printable text without blanks at its ends")
    return text


Name = Annotated[str, StringConstraints(min_length=1, max_length=100), AfterValidator(_printable)]
_PathText = Annotated[
    str, StringConstraints(min_length=1, max_length=4_000), AfterValidator(_printable)
]
FilePath = Annotated[
    Path,
    GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(
            Path, handler.generate_schema(_PathText)
        )
    ),
]
"""A path as in the file."""
Coordinate = Annotated[float, Field(ge=-_FAR_M, le=_FAR_M)]
Length = Annotated[float, Field(ge=0.0, le=_FAR_M)]
PositiveLength = Annotated[float, Field(gt=0.0, le=_FAR_M)]
Interval = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
"""`[low, high]`; the check of the file ensures that they differ."""


class Section(Generic[Record]):
    """An optional section of a file, derived from the frozen dataclass that it fills.

    Used as `guidance: Annotated[Guidance, Section(Guidance)] = Field(default_factory=Guidance)`.

    A field is one key of the same name. Angles are degrees in the file: `_rad` is written `_deg`,
    `_radps` `_deg_per_s`. An enumeration is its value, a nested dataclass of numbers the list of
    its fields. `Annotated[..., Field(...)]` on a field gives its limits in the units of the
    file, for every number of a list; without limits a number is not negative, and at most 1e6.
    A new field with a default needs nothing else.
    """

    def __init__(self, record: type[Record]) -> None:
        self._record = record
        hints = typing.get_type_hints(record, include_extras=True)
        self._names = {file_key(name): name for name in hints}
        self._hints = {name: _bare(hint)[0] for name, hint in hints.items()}
        definitions: dict[str, Any] = {
            key: (_file_type(hints[name]), None) for key, name in self._names.items()
        }
        self.schema: type[FileModel] = create_model(
            f"{record.__name__}File", __base__=FileModel, **definitions
        )

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The mapping of the file, converted to the dataclass, which has the defaults."""
        mapping = handler.generate_schema(self.schema)
        return core_schema.no_info_after_validator_function(self._filled, mapping)

    def _filled(self, section: FileModel) -> Record:
        return self._record(
            **{
                self._names[key]: self._value(self._names[key], getattr(section, key))
                for key in section.model_fields_set
            }
        )

    def _value(self, name: str, value: Any) -> Any:
        degrees = file_key(name) != name
        if isinstance(value, list):
            numbers = [math.radians(number) if degrees else number for number in value]
            members = dataclasses.fields(self._hints[name])
            return self._hints[name](
                **{member.name: number for member, number in zip(members, numbers, strict=True)}
            )
        return math.radians(value) if degrees and value is not None else value


def file_key(name: str) -> str:
    """The key of a dataclass field in a file."""
    return re.sub(r"_radps$", "_deg_per_s", re.sub(r"_rad$", "_deg", name))


def _bare(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type and the limits that `Annotated` puts on it; of a class of ours or None, the class."""
    if typing.get_origin(hint) is Annotated:
        return hint.__origin__, hint.__metadata__
    ours = [
        item for item in typing.get_args(hint) if dataclasses.is_dataclass(item) or _is_enum(item)
    ]
    return (ours[0] if ours else hint), ()


def _is_enum(item: Any) -> bool:
    return isinstance(item, type) and issubclass(item, enum.Enum)


def _file_type(hint: Any) -> Any:
    """Type of a field in a file."""
    bare, limits = _bare(hint)
    if dataclasses.is_dataclass(bare):
        count = len(dataclasses.fields(bare))
        numbers: Any = _limited(float, limits)
        return Annotated[list[numbers], Field(min_length=count, max_length=count)]
    if _is_enum(bare):
        limits = (*limits, Strict(strict=False))
    return _limited(bare, limits)


def _limited(bare: Any, limits: tuple[Any, ...]) -> Any:
    if bare is float and not limits:
        limits = (Field(ge=0.0, le=1e6),)
    arguments = (bare, *limits)
    return Annotated[arguments] if limits else bare
