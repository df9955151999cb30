"""Input of YAML files: a file in, a checked model out, or one line that states the error.

`read(path, schema)` is the only input of files. The schema is a pydantic model (`FileModel`:
strict, no unknown keys, no NaN). Every failure is an `InputError` that names the file, the key as a
dotted path, the value, and the permitted values.

Numbers follow YAML 1.2 (`1e3` is a number, `010` is ten, `1:30` is text); a mapping has text keys,
each once.
"""

from __future__ import annotations

import itertools
import os
import re
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..errors import InputError
from .input_file import open_file, unreadable
from .yaml_schema import Section

Key = tuple[str | int, ...]
"""Path of a value in a file: names of mappings and indices of lists."""

Model = TypeVar("Model", bound=BaseModel)

_MAX_BYTES = 1_000_000
"""Configurations are a few kilobytes; a larger file is not one."""
_MAX_SHOWN = 40
"""Characters of a text value that a message repeats."""
HEXADECIMAL_KEY = re.compile("[0-9A-Fa-f]{64}")
"""Text of 64 digits, which may be a key (`signing`): logs and terminals must not have it."""
_MAX_INTEGER_DIGITS = 18
"""Longer integers become floats, which the schemas then refuse by range."""
_MAX_VALUES = 100_000
"""Aliases repeat their values: a small file may expand beyond the memory."""

_TEXT_TAG = "tag:yaml.org,2002:str"
_MERGE_TAG = "tag:yaml.org,2002:merge"
_INTEGER_TAG = "tag:yaml.org,2002:int"
_REAL_TAG = "tag:yaml.org,2002:float"
_NULL_TAG = "tag:yaml.org,2002:null"
_KEPT_TAGS = (_MERGE_TAG, "tag:yaml.org,2002:bool", _NULL_TAG)
_PLAIN_WORDS = {
    "found character '\\t' that cannot start any token": "found a tab, must be blanks",
    "mapping values are not allowed here": (
        "found a colon out of place, must be `key: value` with a blank, text with a colon in quotes"
    ),
    "expected '<document start>', but found '<block mapping start>'": (
        "found a key after text, must be `key: value` with a blank"
    ),
}
"""PyYAML's messages for the commonest errors, in plain words."""


class FileFinding(NamedTuple):
    """One error in a file: its key, and a problem that completes `key: …`."""

    key: Key
    problem: str


def read(
    path: str | os.PathLike[str],
    schema: type[Model],
    check: Callable[[Model], Iterable[FileFinding]] = lambda _: (),
) -> Model:
    """The file's content as the schema's model: `parsed` of its text."""
    return parsed(text_of(path), os.fspath(path), schema, check)


def parsed(
    text: str,
    source: str,
    schema: type[Model],
    check: Callable[[Model], Iterable[FileFinding]] = lambda _: (),
) -> Model:
    """The text of a file as the schema's model; `source` is the file's name.

    `check` finds errors across keys; it is called once every key is valid by itself.
    Raises InputError with the first finding in file order, and the number of the others.
    """
    keys = ", ".join(schema.model_fields)
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            raise InputError(source, "", f"is empty, must be a mapping with the keys {keys}")
        if not isinstance(root, yaml.MappingNode):
            raise InputError(
                source, "", f"is {_kind(root)}, must be a mapping with the keys {keys}"
            )
        if _count_values(root, {}) > _MAX_VALUES:
            raise InputError(source, "", f"has more than {_MAX_VALUES} values, aliases spelt out")
        findings = list(loader.findings(root))
        if not findings:
            found = validated(loader.construct_document(root), schema, check)
            if not isinstance(found, list):
                return found
            findings = found
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        plain = _PLAIN_WORDS.get(error.problem or "")
        problem = plain or ", ".join(filter(None, (error.context, error.problem)))
        raise InputError(source, "", f"is not YAML: {where}{problem}") from None
    except yaml.YAMLError as error:
        raise InputError(source, "", f"is not YAML: {str(error).splitlines()[0]}") from None
    except RecursionError:
        raise InputError(source, "", "is nested too deeply") from None
    places = _places(root)
    findings.sort(key=lambda finding: _place(finding.key, places))
    raise _refused(source, findings)


def accepted(
    data: Any,
    source: str,
    schema: type[Model],
    check: Callable[[Model], Iterable[FileFinding]] = lambda _: (),
) -> Model:
    """Content as of a file, from elsewhere, as the schema's model; errors as of `parsed`."""
    found = validated(data, schema, check)
    if isinstance(found, list):
        raise _refused(source, found)
    return found


def _refused(source: str, findings: Sequence[FileFinding]) -> InputError:
    """The first finding, and the number of the others."""
    more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
    parts = tuple(InputError(source, dotted(item.key), item.problem) for item in findings)
    return InputError(source, parts[0].key, parts[0].problem + more, parts=parts)


def validated(
    data: Any, schema: type[Model], check: Callable[[Model], Iterable[FileFinding]]
) -> Model | list[FileFinding]:
    """The schema's model of a file's content, or the errors in it; check: as in `read`."""
    try:
        model = schema.model_validate(data)
    except ValidationError as error:
        return [_finding(details, schema, data) for details in error.errors()]
    return list(check(model)) or model


def dotted(key: Key) -> str:
    """A key as a user reads it: `obstacles[0].conductor.radius_m`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        elif re.fullmatch(r"[\w-]+", part) and not HEXADECIMAL_KEY.search(part):
            text += f".{part}" if text else part
        else:
            text += f"[{_shown_text(part)}]"
    return text


def shown(value: object) -> str:
    """A value in the form for messages: short, on one line."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _shown_text(value)
    return "a mapping" if isinstance(value, dict) else "a list"


def nearest(word: str, words: Iterable[str]) -> str:
    """`, did you mean …?` for a misspelt word, in capitals or not, or an empty text."""
    import difflib  # noqa: PLC0415 - 0.1 MB, which only an error needs

    known = {each.lower(): each for each in words}
    found = difflib.get_close_matches(word.lower(), known, n=1)
    return f", did you mean {known[found[0]]}?" if found else ""


def text_of(path: str | os.PathLike[str]) -> str:
    """The text of a file; InputError where it cannot be read."""
    source = os.fspath(path)
    try:
        with open_file(source) as file:
            content = file.read(_MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        problem = unreadable(error)
    else:
        if len(content) > _MAX_BYTES:
            raise InputError(source, "", f"is larger than {_MAX_BYTES} bytes")
        try:
            return content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            problem = f"is not UTF-8 text (byte {error.start})"
    raise InputError(source, "", problem)


class _Loader(yaml.SafeLoader):
    """The safe loader with the numbers of YAML 1.2 and without dates."""

    yaml_implicit_resolvers = {  # noqa: RUF012 (an attribute of the class there, too)
        first: [entry for entry in entries if entry[0] in _KEPT_TAGS]
        for first, entries in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def integer(self, node: yaml.ScalarNode) -> int | float:
        """Decimal number, also with leading zeros."""
        digits = self.construct_scalar(node)
        return int(digits) if len(digits) <= _MAX_INTEGER_DIGITS else float(digits)

    def real(self, node: yaml.ScalarNode) -> float:
        """Real number, also `.inf` and `.nan`: the schema refuses them."""
        return float(self.construct_scalar(node).replace(".inf", "inf").replace(".nan", "nan"))

    def findings(self, root: yaml.MappingNode) -> Iterator[FileFinding]:
        """Keys that are no text or given twice, and tags; a shared node is checked once."""
        seen: set[int] = set()
        pending: list[tuple[Key, yaml.Node]] = [((), root)]
        while pending:
            key, node = pending.pop()
            if id(node) in seen:
                continue
            seen.add(id(node))
            if node.tag not in self._fitting_tags(node):
                yield FileFinding(key, f"has the tag {node.tag!r}, must have none")
            elif isinstance(node, yaml.SequenceNode):
                pending.extend(((*key, index), item) for index, item in enumerate(node.value))
            elif isinstance(node, yaml.MappingNode):
                yield from self._key_findings(key, node)
                pending.extend(
                    (key if name.tag == _MERGE_TAG else (*key, name.value), item)
                    for name, item in node.value
                    if isinstance(name, yaml.ScalarNode)
                )

    def _fitting_tags(self, node: yaml.Node) -> tuple[str, ...]:
        if isinstance(node, yaml.ScalarNode):
            return _TEXT_TAG, self._untagged(yaml.ScalarNode, node.value)
        return (self._untagged(type(node), None),)

    def _untagged(self, kind: type[yaml.Node], value: str | None) -> str:
        tag: str = self.resolve(kind, value, (True, False))  # type: ignore[no-untyped-call]
        return tag

    def _key_findings(self, key: Key, mapping: yaml.MappingNode) -> Iterator[FileFinding]:
        lines: dict[str, int] = {}
        for name, value in mapping.value:
            line = name.start_mark.line + 1
            if name.tag == _MERGE_TAG:
                continue
            if name.tag != _TEXT_TAG:
                lone_number = name.tag == _INTEGER_TAG and value.tag == _NULL_TAG
                hint = " (a number has a decimal point, no comma)" if lone_number else ""
                problem = f"has {_kind(name)} as a key (line {line}), must be text in quotes{hint}"
                yield FileFinding(key, problem)
            elif name.value in lines:
                problem = f"is given twice (lines {lines[name.value]} and {line}), must be once"
                yield FileFinding((*key, name.value), problem)
            else:
                lines[name.value] = line


def _kind(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return _shown_text(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


_Loader.add_implicit_resolver(_INTEGER_TAG, re.compile(r"[-+]?[0-9]+\Z"), list("-+0123456789"))
_Loader.add_implicit_resolver(
    _REAL_TAG,
    re.compile(r"([-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan)\Z"),
    list("-+.0123456789"),
)
_Loader.add_constructor(_INTEGER_TAG, _Loader.integer)
_Loader.add_constructor(_REAL_TAG, _Loader.real)


def _count_values(node: yaml.Node, counts: dict[int, int]) -> int:
    """Number of values and keys of a node with every alias expanded.

    Raises RecursionError for a node that contains itself.
    """
    if id(node) not in counts:
        children: Iterable[yaml.Node] = ()
        if isinstance(node, yaml.CollectionNode):
            children = itertools.chain.from_iterable(
                item if isinstance(item, tuple) else (item,) for item in node.value
            )
        counts[id(node)] = 1 + sum(_count_values(child, counts) for child in children)
    return counts[id(node)]


class _Place(NamedTuple):
    """Line and column of the beginning of a key, and of the end of its value."""

    start: tuple[int, int]
    end: tuple[int, int]


def _places(root: yaml.Node) -> dict[Key, _Place]:
    """Places of all keys of the file."""
    places: dict[Key, _Place] = {}
    pending: list[tuple[Key, yaml.Node, yaml.Mark]] = [((), root, root.start_mark)]
    while pending:
        key, node, start = pending.pop()
        end = node.end_mark
        places[key] = _Place((start.line, start.column), (end.line, end.column))
        if isinstance(node, yaml.SequenceNode):
            pending.extend(
                ((*key, index), item, item.start_mark) for index, item in enumerate(node.value)
            )
        elif isinstance(node, yaml.MappingNode):
            pending.extend(
                ((*key, name.value), item, name.start_mark)
                for name, item in node.value
                if isinstance(name, yaml.ScalarNode)
            )
    return places


def _place(key: Key, places: dict[Key, _Place]) -> tuple[int, int]:
    """Beginning of a key in the file; a missing key has the end of its mapping."""
    if key in places:
        return places[key].start
    while key not in places:
        key = key[:-1]
    return places[key].end


def _finding(details: ErrorDetails, schema: type[BaseModel], data: Any) -> FileFinding:
    """One error of pydantic as a finding."""
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    key = tuple(part for part in details["loc"] if part != "[key]")
    if kind == "missing":
        return FileFinding(key, "is missing")
    if kind == "extra_forbidden":
        for part in key[:-1]:
            data = data[part]
        known = _schema_at(schema, key[:-1]).model_fields
        likely = nearest(str(key[-1]), [name for name in known if name not in data])
        return FileFinding(
            key, f"is not a known key{likely or ', must be one of ' + ', '.join(known)}"
        )
    if kind in ("too_short", "too_long"):
        limit = context.get("min_length", context.get("max_length"))
        bound = "at least" if kind == "too_short" else "at most"
        return FileFinding(
            key, f"has a length of {context['actual_length']}, must be {bound} {limit}"
        )
    if kind in _LIMITS:
        word, limit = _LIMITS[kind]
        return FileFinding(key, f"is {shown(value)}, must be {word} {context[limit]:.10g}")
    if kind == "string_too_short":
        return FileFinding(key, f"is {shown(value)}, must not be empty")
    if kind == "string_too_long":
        return FileFinding(
            key, f"has {len(value)} characters, must have {context['max_length']} at most"
        )
    if kind in ("literal_error", "enum"):
        return FileFinding(key, f"is {shown(value)}, must be {context['expected']}")
    if kind == "value_error":
        return FileFinding(key, f"is {shown(value)}, {context['error']}")
    if kind in _TYPES:
        return FileFinding(
            key, f"is {shown(value)}{_why_text(kind, value)}, must be {_TYPES[kind]}"
        )
    return FileFinding(key, f"is {shown(value)}: {details['msg']}")


_TYPES = {
    "bool_type": "true or false",
    "dict_type": "a mapping",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a mapping",
    "string_type": "text (in quotes)",
}
_LIMITS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}


def _why_text(kind: str, value: object) -> str:
    """Reason why a text that resembles a number is none; empty for other values."""
    if kind in ("float_type", "int_type") and isinstance(value, str):
        if re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", value):
            return " (text, not a number)"
        if re.fullmatch(r"\s*[-+]?[0-9]*,[0-9]+\s*", value):
            return " (a decimal comma)"
    return ""


def _schema_at(schema: type[BaseModel], key: Key) -> type[BaseModel]:
    """The model that describes the mapping at a key."""
    for part in key:
        if isinstance(part, str) and part in schema.model_fields:
            schema = model_of(schema.model_fields[part]) or schema
    return schema


def model_of(field: FieldInfo) -> type[BaseModel] | None:
    """The model of the mapping, or of the mappings in the list, that a field is; None: no such."""
    return next(filter(None, map(_model_in, (*field.metadata, field.annotation))), None)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model inside a list, a mapping or an option."""
    if isinstance(annotation, Section):
        return annotation.schema
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    parts = (*typing.get_args(annotation), *getattr(annotation, "__metadata__", ()))
    return next(filter(None, map(_model_in, parts)), None)


def _shown_text(text: str) -> str:
    if HEXADECIMAL_KEY.search(text):
        return "64 hexadecimal digits (not shown)"
    return repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…")
