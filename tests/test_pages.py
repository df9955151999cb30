"""Pages for people: their links lead somewhere, and the first one is short."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [
    path.relative_to(ROOT)
    for folder in (".", ".github", "configs", "sitl", "systemd", "tests", "moar_companion")
    for path in sorted((ROOT / folder).rglob("*.md") if folder != "." else ROOT.glob("*.md"))
    if not path.is_relative_to(ROOT / "moar_companion" / "configs")
]


def without_code(page):
    """The text of a page without its code blocks."""
    return re.sub(r"(?ms)^```.*?^```", "", page.read_text(encoding="utf-8"))


def anchors(page):
    """Anchors of the headings of a page, as a forge makes them: of equal ones the second has -1."""
    found = []
    for heading in re.findall(r"(?m)^#+ (.+)$", without_code(page)):
        plain = re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", heading).lower()
        anchor = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        found.append((anchor, sum(before == anchor for before, _ in found)))
    return {f"{anchor}-{number}" if number else anchor for anchor, number in found}


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_each_link_of_a_page_leads_to_a_file_and_a_heading(page):
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(ROOT / page)):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = ((ROOT / page).parent / name).resolve() if name else ROOT / page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert broken == []


def test_the_first_page_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
