"""Values to JSON and back without loss: the dataclasses that enter and leave the machine.

A float is its shortest decimal that reads back as the same number (`repr`); one that is not finite
is the text `inf`, `-inf` or `nan`. Bytes are hexadecimal, an enumeration is its value, a dataclass
a mapping of its fields. `decoded` needs the type: a dataclass, or a type of its annotations.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np

_UNIONS = (typing.Union, types.UnionType)


def encoded(value: Any) -> Any:
    """A value in a form for JSON. Raises TypeError for other objects, as a function or a key."""
    if isinstance(value, enum.Enum):
        return value.value
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else repr(float(value))
    if dataclasses.is_dataclass(value):
        return {item.name: encoded(getattr(value, item.name)) for item in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(encoded(key)): encoded(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [encoded(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((encoded(item) for item in value), key=repr)
    if isinstance(value, np.ndarray):
        return encoded(value.tolist())
    if isinstance(value, (bytes, bytearray)):
        return value.hex()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} is no value")


def decoded(hint: Any, data: Any) -> Any:
    """The value of a type from the data of `encoded`. Raises ValueError or TypeError otherwise."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return decoded(arguments[0], data)
    if origin in _UNIONS:
        return _one_of(arguments, data)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = _fields(hint)
        return hint(**{name: decoded(hints[name], item) for name, item in data.items()})
    if origin is tuple:
        kinds = arguments[:1] * len(data) if arguments[1:] == (...,) else arguments
        return tuple(decoded(kind, item) for kind, item in zip(kinds, data, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, item = arguments
        return {decoded(key, name): decoded(item, found) for name, found in data.items()}
    if hint is float:
        return float(data) if isinstance(data, str) else data
    if hint is bytes:
        return bytes.fromhex(data)
    if isinstance(hint, type) and issubclass(hint, (enum.Enum, Path)):
        return hint(data)
    return data


def _one_of(kinds: tuple[Any, ...], data: Any) -> Any:
    """A value of a union: None, a plain value, or the dataclass that has these fields."""
    if data is None:
        return None
    kinds = tuple(kind for kind in kinds if kind is not type(None))
    if len(kinds) > 1:
        if not isinstance(data, dict):
            return data
        records: list[Any] = [kind for kind in kinds if dataclasses.is_dataclass(kind)]
        kinds = tuple(kind for kind in records if _fields(kind).keys() == data.keys())
    return decoded(kinds[0], data)


@functools.cache
def _fields(kind: Any) -> dict[str, Any]:
    """Types of the fields of a dataclass, by name."""
    hints = typing.get_type_hints(kind)
    return {item.name: hints[item.name] for item in dataclasses.fields(kind)}
