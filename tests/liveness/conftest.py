"""An aircraft in the air for the tests of a module; each test may leave it anywhere."""

from __future__ import annotations

import contextlib

import pytest

from .rig import Rig


@pytest.fixture(scope="module")
def in_the_air(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        rig = Rig(tmp_path_factory.mktemp("rig"), stack)
        rig.take_off()
        yield rig


@pytest.fixture
def rig(in_the_air):
    """A hovering aircraft with an idle service."""
    in_the_air.hover()
    return in_the_air
