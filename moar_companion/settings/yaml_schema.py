"""Schemas of files: the base of their models, common types, and sections from dataclasses.

Only the input of files uses the models; `yaml_file.read` turns their errors into one line.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import re
import types
import typing
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, TypeVar

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
    """Schema of a mapping in a file. The text below a field describes its key."""

    settings: ClassVar[type | None] = None
    """The dataclass that it is derived from."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        frozen=True,
        # Built when a file is first read: nested models are built as parts of it.
        defer_build=True,
    )


def _printable(text: str) -> str:
    if not text.isprintable() or text != text.strip():
        raise ValueError("must be printable text without blanks at its ends")
    return text


Name = Annotated[str, StringConstraints(min_length=1, max_length=100), AfterValidator(_printable)]
LinkUrl = Annotated[
    str, StringConstraints(min_length=1, max_length=300), AfterValidator(_printable)
]
"""URL of a link: names in `/dev/serial/by-id` have up to 100 characters."""
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
    Field(json_schema_extra={"format": "path"}),
]
"""A path as in the file."""
Coordinate = Annotated[float, Field(ge=-_FAR_M, le=_FAR_M)]
Length = Annotated[float, Field(ge=0.0, le=_FAR_M)]
PositiveLength = Annotated[float, Field(gt=0.0, le=_FAR_M)]
Interval = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
"""`[low, high]`; the check of the file ensures that they differ."""


class Section(Generic[Record]):
    """A mapping of a file, derived from the frozen dataclass that it fills.

    Used as `guidance: Annotated[Guidance, Section(Guidance)] = Field(default_factory=Guidance)`,
    or for a whole file by `schema` and `filled`.

    A field is one key of the same name: its type, default and limits stand once, in the dataclass,
    and its description is the text below it. Angles are degrees in the file: `_rad` is written
    `_deg`, `_radps` `_deg_per_s`. An enumeration is its value; a dataclass of numbers without
    defaults is the list of them, another one a mapping; a tuple is a list; a path is a text, and
    `under` makes it relative to the file. `Annotated[..., Field(...)]` gives the limits in the
    units of the file, for every number of a list; without limits a number is not negative, and at
    most 1e6. A new field with a default needs nothing else.
    """

    def __init__(
        self, record: type[Record], *, optional: frozenset[str] = frozenset(), without: str = ""
    ) -> None:
        """optional: required fields that a file may lack. without: a field that is no key."""
        self.record = record
        hints = typing.get_type_hints(record, include_extras=True)
        hints.pop(without, None)
        self.names = {file_key(name): name for name in hints}
        """Fields by their keys."""
        self._hints = {name: _bare(hint)[0] for name, hint in hints.items()}
        needed = _needed(record) - optional
        definitions: dict[str, Any] = {
            key: (_file_type(hints[name]), ... if name in needed else None)
            for key, name in self.names.items()
        }
        definitions |= {key: (definitions[key][0] | None, None) for key in optional}
        self.schema: type[FileModel] = create_model(
            f"{record.__name__}File", __base__=FileModel, **definitions
        )
        self.schema.settings = record

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The mapping of the file, converted to the dataclass, which has the defaults."""
        mapping = handler.generate_schema(self.schema)
        return core_schema.no_info_after_validator_function(self.filled, mapping)

    def filled(self, section: FileModel, **given: Any) -> Record:
        """The dataclass of a mapping that was read. given: fields in place of the file's."""
        read = {
            self.names[key]: self._value(self.names[key], getattr(section, key))
            for key in section.model_fields_set
        }
        return self.record(**{**read, **given})

    def _value(self, name: str, value: Any) -> Any:
        degrees, hint = file_key(name) != name, self._hints[name]
        if isinstance(value, list):
            numbers = [math.radians(number) if degrees else number for number in value]
            if not dataclasses.is_dataclass(hint):
                return tuple(numbers)
            members = [member.name for member in dataclasses.fields(hint)]
            return typing.cast("Any", hint)(**dict(zip(members, numbers, strict=True)))
        return math.radians(value) if degrees and value is not None else value


def under(folder: Path, record: Record) -> Record:
    """A dataclass of settings with its paths, and those of its sections, relative to a folder."""
    changes: dict[str, Any] = {}
    for member in dataclasses.fields(typing.cast("Any", record)):
        value = getattr(record, member.name)
        if isinstance(value, Path):
            changes[member.name] = folder / value
        elif dataclasses.is_dataclass(value):
            changes[member.name] = under(folder, value)
    return typing.cast("Record", dataclasses.replace(typing.cast("Any", record), **changes))


def as_written(value: Any, *, degrees: bool = False, digits: int | None = None) -> Any:
    """A value of settings as in a file: a section as a mapping of its keys, defaults included.

    degrees: the value is an angle in radians. digits: of degrees; None: as many as the same angle
    needs when it is read.
    """
    if isinstance(value, FileModel):
        given = {key: getattr(value, key) for key in type(value).model_fields}
        return {
            key: as_written(item)
            for key, item in given.items()
            if key in value.model_fields_set or dataclasses.is_dataclass(item)
        }
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, tuple):
        return [as_written(item, degrees=degrees, digits=digits) for item in value]
    if dataclasses.is_dataclass(value):
        members = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
        if is_list(type(value)):
            return as_written(tuple(members.values()), degrees=degrees, digits=digits)
        return {
            file_key(name): as_written(item, degrees=file_key(name) != name, digits=digits)
            for name, item in members.items()
        }
    if degrees and value is not None:
        shorter = (float(f"{math.degrees(value):.{count}g}") for count in range(1, 18))
        same = next((each for each in shorter if math.radians(each) == value), None)
        rounded = float(f"{math.degrees(value):.{digits or 17}g}")
        return rounded if digits is not None or same is None else same
    return value


def file_key(name: str) -> str:
    """The key of a dataclass field in a file."""
    return re.sub(r"_radps$", "_deg_per_s", re.sub(r"_rad$", "_deg", name))


def _bare(hint: Any) -> tuple[Any, tuple[Any, ...], bool]:
    """A type without `Annotated` and `| None`; what `Annotated` has; and whether it may be None."""
    metadata: tuple[Any, ...] = ()
    if typing.get_origin(hint) is Annotated:
        hint, metadata = hint.__origin__, hint.__metadata__
    arguments = typing.get_args(hint)
    if type(None) in arguments:
        (hint,) = (item for item in arguments if item is not type(None))
        return hint, metadata, True
    return hint, metadata, False


def _file_type(hint: Any) -> Any:
    """Type of a field in a file."""
    bare, limits, optional = _bare(hint)
    kind: Any
    if typing.get_origin(bare) is tuple:
        kind = _list_type(typing.get_args(bare), limits)
    elif is_list(bare):
        kind = _list_type((float,) * len(dataclasses.fields(bare)), limits)
    elif dataclasses.is_dataclass(bare):
        kind = Annotated[(bare, Section(typing.cast("Any", bare)), *limits)]
    elif isinstance(bare, type) and issubclass(bare, enum.Enum):
        kind = Annotated[(bare, Strict(strict=False), *limits)]
    else:
        long = any(isinstance(item, StringConstraints) for item in limits)
        name = str if long else Name
        kind = _limited({Path: FilePath, str: name}.get(bare, bare), limits)
    return kind | None if optional else kind


def is_list(record: Any) -> bool:
    """True for a dataclass that is a list in a file: of numbers, without defaults."""
    return (
        dataclasses.is_dataclass(record)
        and all(hint is float for hint in typing.get_type_hints(record).values())
        and len(_needed(record)) == len(dataclasses.fields(record))
    )


def _needed(record: Any) -> frozenset[str]:
    """The fields without a default."""
    return frozenset(
        member.name
        for member in dataclasses.fields(record)
        if member.default is member.default_factory is dataclasses.MISSING
    )


def _list_type(items: tuple[Any, ...], limits: tuple[Any, ...]) -> Any:
    """A list of any length, whose limits are the list's, or of numbers, whose limits are theirs."""
    if items[-1] is Ellipsis:
        return _limited(types.GenericAlias(list, (_file_type(items[0]),)), limits)
    numbers = types.GenericAlias(list, (_limited(float, limits),))
    return _limited(numbers, (Field(min_length=len(items), max_length=len(items)),))


def _limited(bare: Any, limits: tuple[Any, ...]) -> Any:
    if bare is float and not limits:
        limits = (Field(ge=0.0, le=1e6),)
    return Annotated[(bare, *limits)] if limits else bare
