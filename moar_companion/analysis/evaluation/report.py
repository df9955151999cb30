"""The report: one HTML document with all figures and tables.

Inputs: sections of tables and pictures. Output: text; the document loads nothing from elsewhere.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .tables import Table

if TYPE_CHECKING:
    from .figures.drawing import Picture

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1d21; max-width: 76rem; margin: 2rem auto;
       padding: 0 1rem; }
img { max-width: 100%; }
figure { margin: 1.5rem 0; }
figcaption, .note { color: #55585e; max-width: 60rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2rem 0.6rem; text-align: right; border-bottom: 1px solid #dfe1e5; }
th:first-child, td:first-child { text-align: left; }
tr.spread td { background: #f3f4f6; }
"""
_SPREADS = {"n", "first quartile", "median", "third quartile"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportSection:
    """A part of the report: its tables, then its pictures."""

    title: str
    text: str
    tables: Sequence[Table]
    pictures: Sequence[Picture]


def document(title: str, sections: Sequence[ReportSection]) -> str:
    """The report as HTML."""
    parts = [
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{html.escape(title)}</h1>",
    ]
    for section in sections:
        parts.append(f"<h2>{html.escape(section.title)}</h2><p>{html.escape(section.text)}</p>")
        parts += [_table(table) for table in section.tables]
        parts += [_figure(picture) for picture in section.pictures]
    parts.append("</body></html>\n")
    return "\n".join(parts)


def text(value: str | float) -> str:
    """A cell of a table: numbers with three significant digits, a missing one as a dash."""
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value}"
    if not math.isfinite(value):
        return "-"
    return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in table.header)
    body = []
    for row in table.rows:
        cells = "".join(f"<td>{html.escape(text(value))}</td>" for value in row)
        kind = ' class="spread"' if row[0] in _SPREADS else ""
        body.append(f"<tr{kind}>{cells}</tr>")
    return (
        f"<h3>{html.escape(table.title)}</h3>"
        f'<p class="note">{html.escape(table.note)}</p>'
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode("ascii")
    return (
        f"<figure><h3>{html.escape(picture.title)}</h3>"
        f'<img alt="{html.escape(picture.title)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{html.escape(picture.caption)}</figcaption></figure>"
    )
