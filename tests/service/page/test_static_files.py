"""The page's files: small, and complete without any other computer."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from moar_companion.service.page import static_files

FILES = sorted((Path(static_files.__file__).parent / "static").iterdir())
MOST_BYTES = 300_000
NAMESPACE = "http://www.w3.org/2000/svg"


def test_all_files_together_are_small():
    assert sum(path.stat().st_size for path in FILES) <= MOST_BYTES


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.name)
def test_no_file_refers_to_another_computer(file):
    text = file.read_text(encoding="utf-8").replace(NAMESPACE, "")
    assert not re.search(r"https?:|['\"(]//", text)


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.name)
def test_every_file_that_is_named_is_served(file):
    served, text = static_files.StaticFiles(), file.read_text(encoding="utf-8")
    named = {
        *re.findall(r'(?:href|src)="static/([^"]+)"', text),
        *re.findall(r'from "\./([^"]+)"', text),
    }
    assert all(served.file(name) for name in named)
    assert served.file(file.name)
