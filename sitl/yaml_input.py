"""The simulator's input files: YAML, checked by models; one line for the user on a bad one."""

import reprlib
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

import yaml
from pydantic import BaseModel, ValidationError

from sitl.input_file import NotAFileError, open_file

_MAX_BYTES: Final = 100_000
"""Some thousand entries; more would take seconds to read."""
_MESSAGES: Final = {
    "model_type": "must be keys and values",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "missing": "is missing",
}

_Model = TypeVar("_Model", bound=BaseModel)


class BadInputError(ValueError):
    """A file that cannot be used; the text is one line for the user."""


def load_yaml(path: Path) -> object:
    """The data of a YAML file; `BadInputError` when it cannot be read."""
    try:
        with open_file(path) as file:
            text = file.read(_MAX_BYTES + 1)
        if len(text) > _MAX_BYTES:
            raise BadInputError(f"{path}: larger than {_MAX_BYTES} bytes")
        data: object = yaml.safe_load(text.decode())
    except NotAFileError as error:
        raise BadInputError(f"{path}: {error.strerror}") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BadInputError(f"{path}: cannot be read: {reason}") from None
    except RecursionError:
        raise BadInputError(f"{path}: nested too deeply") from None
    except yaml.YAMLError as error:
        raise BadInputError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    return data


def validated(model: type[_Model], data: object, source: str) -> _Model:
    """The model of YAML data; a `BadInputError` names file, key, value and the allowed values."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"{source}: {_first(error, model)}") from None


def _first(error: ValidationError, model: type[BaseModel]) -> str:
    """The first finding in one line: key, value, allowed values."""
    detail = error.errors()[0]
    key = "".join(
        f"[{part}]" if isinstance(part, int) else f".{part}" for part in detail["loc"]
    ).lstrip(".")
    if detail["type"] == "extra_forbidden":
        fields = _model_at(model, detail["loc"][:-1]).model_fields
        return f"{key}: unknown key; allowed: {', '.join(fields)}"
    words = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    message = _MESSAGES.get(detail["type"], words)
    value = detail["input"]
    if isinstance(value, dict | list) or value is None:
        return f"{key or 'file'}: {message}"
    return f"{key or 'file'}: {reprlib.repr(value)}: {message}"


def _model_at(model: type[BaseModel], place: tuple[int | str, ...]) -> type[BaseModel]:
    """The model of the keys at a place in the data."""
    for part in place:
        if isinstance(part, str):
            model = _model_in(model.model_fields[part].annotation) or model
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The first model that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for each in get_args(annotation) if (found := _model_in(each))), None)
