"""Branches are counted in the first case of each test: counting makes a flight 2.7 times slower."""

from __future__ import annotations

import sys

import pytest

_UNCOUNTED = {"test_any_input.py"}
"""Long searches for what must never happen: other tests pass through the same branches."""
_counted = set()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Every case is run; of those that are not counted no line is traced."""
    if item.path.name not in _UNCOUNTED and item.function not in _counted:
        _counted.add(item.function)
        return (yield)
    tracer = sys.gettrace()
    sys.settrace(None)
    try:
        return (yield)
    finally:
        sys.settrace(tracer)
