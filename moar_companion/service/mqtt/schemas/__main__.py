"""Writes the schemas to their files."""

from __future__ import annotations

from . import FOLDER, schemas

for name, text in schemas().items():
    (FOLDER / name).write_text(text, encoding="utf-8")
