"""The same examples every time, and none remembered."""

from __future__ import annotations

from hypothesis import settings

from tests.real_time import witness  # noqa: F401 - a fixture of all tests

settings.register_profile("repeatable", derandomize=True, database=None, deadline=None)
settings.load_profile("repeatable")
