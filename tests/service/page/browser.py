"""A real browser before the page: Chromium, headless, driven by Playwright."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator

import pytest

SIZES = {"laptop": (1440, 900), "phone": (390, 844)}
PATIENCE_MS = 20_000.0


@contextlib.contextmanager
def chromium() -> Iterator:
    """The browser; the test is skipped where it is not installed."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright (extra dev)")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("needs chromium (apt-get install chromium)")
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=program, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened(
    browser, address: str, *, size: str = "laptop", theme: str = "light", fault: str | None = None
) -> Iterator:
    """A tab with the page; an error in its console or of its scripts fails the test.

    fault: a text of the only error that is expected.
    """
    width, height = SIZES[size]
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=theme,
        is_mobile=size == "phone",
        has_touch=size == "phone",
        accept_downloads=True,
    )
    context.set_default_timeout(PATIENCE_MS)
    tab = context.new_page()
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
    tab.goto(address)
    try:
        yield tab
        assert [each for each in faults if fault is None or fault not in each] == []
    finally:
        context.close()
