"""Names of modules and classes occur once in the product."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import moar_companion

FILES = sorted(Path(moar_companion.__file__).parent.rglob("*.py"))


def repeated(names):
    return {name for name, count in Counter(names).items() if count > 1}


def test_no_file_name_occurs_twice():
    assert repeated(path.name for path in FILES if not path.name.startswith("__")) == set()


def test_no_class_name_occurs_twice():
    names = [
        node.name
        for path in FILES
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    assert repeated(names) == set()
