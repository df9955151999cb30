"""Of much that is alike `.ci/run` takes some; MOAR_THOROUGH=1 takes all."""

from __future__ import annotations

import os

import pytest

_THOROUGH = bool(os.environ.get("MOAR_THOROUGH"))
thorough = pytest.mark.skipif(not _THOROUGH, reason="MOAR_THOROUGH=1 runs it")


def sampled(some, everything):
    """The first, or with MOAR_THOROUGH the second: cases, examples, seconds between looks."""
    return everything if _THOROUGH else some
