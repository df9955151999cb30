"""The same examples every time, and none remembered; what real time asks of the machine."""

from __future__ import annotations

import pytest
from hypothesis import settings

from tests.real_time import inconclusive, witness  # noqa: F401 - a fixture of all tests

settings.register_profile(
    "repeatable", max_examples=50, derandomize=True, database=None, deadline=None
)
settings.load_profile("repeatable")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """A test in real time that the machine never gave a chance is skipped, with the reason."""
    report = yield
    if report.failed and (reason := inconclusive(item)):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1], f"Skipped: {reason}")
    return report
