"""The tables of conditions and texts in the manual, written to the page in the argument.

python -m moar_companion.companion.safety.conditions_doc configs/README.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from ...texts.pilot_texts import TEXTS
from .condition_texts import examples
from .condition_types import Action
from .conditions import CONDITIONS


def documentation() -> str:
    """Returns CONDITIONS as the table of configs/README.md."""
    rows = ["| condition | starts when | action | acts after | clears | overridden by |"]
    rows.append("|---|---|---|---|---|---|")
    for row in CONDITIONS:
        clears = "by a new order" if row.latched else _seconds("over for", row.over_s, "at once")
        if row.action is Action.RELEASE:
            clears = f"{row.rest.value} until a new order{' or `continue`' if row.passing else ''}"
        after = _seconds("", row.after_s, "at once")
        rows.append(
            f"| `{row.name}` | {row.starts} | {row.action.name.lower()} | {after} | {clears} "
            f"| {row.override.value} |"
        )
    return "\n".join(rows)


def texts() -> str:
    """Returns the texts of all conditions as the table `texts` of configs/README.md."""
    rows = ["| condition | text |", "|---|---|"]
    rows += [f"| `{row.name}` | `{text}` |" for row in CONDITIONS for text in examples(row)]
    return "\n".join(rows)


def other_texts() -> str:
    """Returns the texts of no condition as the table `other texts` of configs/README.md."""
    rows = ["| text | meaning | what can be done |", "|---|---|---|"]
    rows += [f"| `{text.example}` | {text.meaning} | {text.remedy} |" for text in TEXTS.values()]
    return "\n".join(rows)


def _seconds(word: str, seconds: float, none: str) -> str:
    return f"{word} {seconds:g} s".strip() if seconds else none


_TABLES = {"conditions": documentation, "texts": texts, "other texts": other_texts}


def updated(page: str) -> str:
    """Returns the page with each table made anew between its two marks.

    Raises ValueError if a mark is missing, or stands twice.
    """
    for mark, table in _TABLES.items():
        begin, end = f"<!-- {mark} -->\n", f"\n<!-- end of {mark} -->"
        if (page.count(begin), page.count(end)) != (1, 1):
            raise ValueError(f"the page needs one {begin.strip()} and one {end.strip()}")
        before, _, rest = page.partition(begin)
        _, _, after = rest.partition(end)
        page = before + begin + table() + end + after
    return page


if __name__ == "__main__":
    (name,) = sys.argv[1:]
    manual = Path(name)
    manual.write_text(updated(manual.read_text(encoding="utf-8")), encoding="utf-8")
