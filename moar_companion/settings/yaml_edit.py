"""Values in the text of a YAML file, replaced; every other character stays. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from ..errors import InputError


def with_values(text: str, source: str, values: Mapping[str, str]) -> str:
    """The text with other values of top-level keys; keys that it lacks are appended.

    values: by key, as YAML on one line. Raises InputError for a text that is no block of keys, and
    for one of which any other value would change.
    """
    old = text
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError:
        root = None
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        raise InputError(source, "", "cannot be edited: must be keys and values, one below another")
    nodes = {name.value: value for name, value in root.value}
    for key in sorted(nodes.keys() & values.keys(), key=lambda key: -nodes[key].start_mark.index):
        start, end = nodes[key].start_mark.index, end_of(nodes[key])
        # After a colon, and on a line of its own, a value is indented.
        indent = " " if text[start - 1] in ":\n" else ""
        text = f"{text[:start]}{indent}{values[key]}{text[end:]}"
    missing = [key for key in values if key not in nodes]
    if missing and not text.endswith("\n"):
        text += "\n"
    text += "".join(f"{key}: {values[key]}\n" for key in missing)
    try:
        wanted = {key: yaml.safe_load(value) for key, value in values.items()}
        done = yaml.safe_load(text) == yaml.safe_load(old) | wanted
    except (yaml.YAMLError, ValueError):
        done = False
    if not done:
        raise InputError(source, "", "cannot be edited: must be written as the shipped one is")
    return text


def end_of(node: Any) -> int:
    """Index after the last character of a value; the mark of a block is past later comments."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return end_of(last[1] if isinstance(last, tuple) else last)
