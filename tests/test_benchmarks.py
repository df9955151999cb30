"""Benchmarks are run by hand: what they import has to be there all the same."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

BENCHMARKS = sorted(path.stem for path in (Path(__file__).parent / "benchmarks").glob("*.py"))
OF_PEERS = ("networkx", "ompl", "skimage")
"""Packages of the extra `peers`, which the tests do not install."""


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_can_be_loaded(name):
    try:
        importlib.import_module(f"tests.benchmarks.{name}")
    except ModuleNotFoundError as error:
        if error.name not in OF_PEERS:
            raise
        pytest.skip(f"needs {error.name}")
