"""Values of options: text in, a checked value out, or an InputError with the allowed values."""

from __future__ import annotations

import argparse
import importlib
import math
import re
from collections.abc import Callable

from ..errors import InputError, without_extra
from ..types import RiskIndices

_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_RISKS = tuple(RiskIndices().as_dict())


def refused(option: str, value: str, allowed: str) -> InputError:
    """The error of an option's value."""
    return InputError(option, "", f"is {value!r}, {allowed}")


def require(source: str, module: str, extra: str) -> None:
    """Raises InputError if a module of an extra is missing; `source` is the option or the file."""
    try:
        importlib.import_module(module)
    except ModuleNotFoundError:
        raise without_extra(source, "", module, extra) from None


def number(text: str) -> float | None:
    """A finite decimal number; None for anything else."""
    text = text.strip()
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def numbers(option: str, form: str, what: str) -> Callable[[str], tuple[float, ...]]:
    """A type for argparse: finite numbers separated by commas, as many as `form` has parts."""
    count = len(form.split(","))

    def parse(text: str) -> tuple[float, ...]:
        values = [number(part) for part in text.split(",")]
        known = tuple(value for value in values if value is not None)
        if len(values) != count or len(known) != count:
            raise refused(option, text, f"must be {form}: {count} finite numbers, {what}")
        return known

    return parse


def risk_indices(option: str) -> Callable[[str], dict[str, float]]:
    """A type for argparse: `name=index,...`, each name once, each index in [0, 1]."""

    def parse(text: str) -> dict[str, float]:
        indices: dict[str, float] = {}
        for part in text.split(","):
            name, equals, value = (word.strip() for word in part.partition("="))
            if not equals or not name:
                raise refused(option, text, f"must be name=index,... with {', '.join(_RISKS)}")
            if name not in _RISKS:
                known = ", ".join(_RISKS)
                raise refused(option, text, f"{name!r} is no risk, must be one of {known}")
            if name in indices:
                raise refused(option, text, f"names {name} twice, must name it once")
            index = number(value)
            if index is None or not 0.0 <= index <= 1.0:
                raise refused(option, text, f"{name} must be a number in [0, 1]")
            indices[name] = index
        return indices

    return parse


def file_name(option: str) -> Callable[[str], str]:
    """A type for argparse: the name of a file."""

    def parse(text: str) -> str:
        if not text or "\0" in text:
            raise refused(option, text, "must be the name of a file")
        return text

    return parse


def add_json(parser: argparse._ActionsContainer, meaning: str) -> None:
    """The option of a report for programs, beside the text for people."""
    parser.add_argument(
        "--json",
        metavar="FILE|-",
        type=file_name("--json"),
        help=f"{meaning} (-: to stdout, and the text to stderr)",
    )


def add_file(parser: argparse._ActionsContainer, option: str, meaning: str) -> None:
    """An option that names a file."""
    parser.add_argument(option, metavar="FILE", type=file_name(option), help=meaning)
