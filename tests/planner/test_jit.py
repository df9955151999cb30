"""The jit policy: what the cache of compiled kernels must notice."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import moar_companion
from moar_companion.planner import jit, polyline
from moar_companion.settings.config import shipped_configs
from tests.processes import output_of

ELSEWHERE = """
from typing import NamedTuple

LIMIT = {limit}

class Pair(NamedTuple):
    {fields[0]}: float
    {fields[1]}: float

class Outer(NamedTuple):
    pair: Pair
"""
CALLED = """
from moar_companion.planner.jit import F8, jit

@jit(F8, F8)
def scaled(value):
    return {factor} * value
"""
KERNELS = """
from elsewhere import LIMIT, Outer, Pair
from moar_companion.planner.jit import F8, fields, jit
from called import scaled

PAIR = fields(Pair, F8, F8)
OUTER = fields(Outer, PAIR)

@jit(F8, F8)
def beyond(value):
    return value - LIMIT

@jit(PAIR, F8, F8)
def as_pair(first, second):
    return Pair(first, second)

@jit(F8, OUTER)
def difference(outer):
    return scaled(beyond(outer.pair.first) - outer.pair.second)

pair = as_pair(*(5.0 if name == "first" else 2.0 for name in Pair._fields))
print(difference(Outer(pair)), pair.first)
"""


@pytest.mark.slow
def test_kernels_are_compiled_again_if_what_they_take_from_other_files_changes(tmp_path):
    def run(limit, *fields, factor=1.0):
        (tmp_path / "called.py").write_text(CALLED.format(factor=factor), encoding="utf-8")
        source = ELSEWHERE.format(limit=limit, fields=fields)
        (tmp_path / "elsewhere.py").write_text(source, encoding="utf-8")
        checkout = Path(moar_companion.__file__).parents[1]
        answer = subprocess.run(
            [sys.executable, "-B", str(tmp_path / "kernels.py")],
            env={
                **os.environ,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "PYTHONPATH": str(checkout),
            },
            check=True,
            capture_output=True,
            text=True,
        )
        return tuple(float(word) for word in answer.stdout.split())

    (tmp_path / "kernels.py").write_text(KERNELS, encoding="utf-8")
    assert run(1.0, "first", "second") == (2.0, 5.0)
    compiled = sorted((tmp_path / "cache").rglob("*.nbc"))
    assert run(1.0, "first", "second") == (2.0, 5.0)
    assert sorted((tmp_path / "cache").rglob("*.nbc")) == compiled
    assert run(1.0, "second", "first") == (2.0, 5.0), "the fields have changed places"
    assert run(3.0, "first", "second") == (0.0, 5.0), "what a called kernel knows has changed"
    assert run(1.0, "first", "second", factor=4.0) == (8.0, 5.0), "a called kernel has changed"


CACHED = """
from moar_companion.planner.jit import F8, jit

@jit(F8, F8)
def twice(value):
    return 2.0 * value

print(twice.is_cached)
twice(1.0)
"""


@pytest.mark.slow
def test_machine_code_for_another_processor_is_not_taken_for_cached(tmp_path):
    """As on a copied SD card."""
    (tmp_path / "kernels.py").write_text(CACHED, encoding="utf-8")

    def is_cached(**environment):
        answer = subprocess.run(
            [sys.executable, "-B", str(tmp_path / "kernels.py")],
            env={
                **os.environ,
                **environment,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "PYTHONPATH": str(Path(moar_companion.__file__).parents[1]),
            },
            check=True,
            capture_output=True,
            text=True,
        )
        return answer.stdout.strip() == "True"

    assert not is_cached(NUMBA_CPU_NAME="generic")
    assert not is_cached()
    assert is_cached()
    assert is_cached(NUMBA_CPU_NAME="generic")


class Numba:
    """Numba where no folder may be written."""

    def njit(self, *, cache=False, **_options):
        def compiled(function):
            if cache:
                raise RuntimeError("cannot cache function: no locator available")
            return function

        return compiled


def test_without_a_writable_cache_a_kernel_is_compiled_each_time(monkeypatch):
    monkeypatch.setattr(jit, "_numba", Numba)
    kernel = jit.Kernel.__new__(jit.Kernel)
    kernel.py_func, kernel.is_helper = abs, False
    assert kernel._dispatcher is abs


RELEASED = """
from moar_companion import Mission, Planner, Site, Vehicle
from moar_companion.planner.jit import KERNELS, release_bitcode
from moar_companion.service.compiling import make_ready
import sys, threading

def kept():
    libraries = [
        compiled.library
        for kernel in KERNELS
        if not kernel.is_helper and "ready" in vars(kernel)
        for compiled in kernel.ready.overloads.values()
    ]
    return sum(library._shared_module is not None for library in libraries)

planner = Planner(Site.load(sys.argv[1]), Vehicle.load(sys.argv[2]))
first = planner.plan(mission=Mission.EXIT)
release_bitcode()
print(kept() > 0)
make_ready(lambda *_: None, threading.Event())
release_bitcode()
print(kept())
print(planner.plan(mission=Mission.EXIT).cost == first.cost)
"""


@pytest.mark.slow
def test_bitcode_is_released_once_all_kernels_are_loaded_and_they_still_run():
    configs = shipped_configs()
    files = [configs / "sites/315kv_double_circuit.yaml", configs / "vehicles/x500.yaml"]
    assert output_of(RELEASED, *files).split() == ["True", "0", "True"]


def test_kernels_that_the_service_loads_later_call_only_each_other():
    """The bitcode of the others is released by then."""
    kernels = [kernel for kernel in jit.KERNELS if kernel.py_func.__module__ == polyline.__name__]
    assert kernels
    for kernel in kernels:
        function = kernel.py_func
        used = [function.__globals__.get(name) for name in function.__code__.co_names]
        called = {each.py_func.__module__ for each in used if isinstance(each, jit.Kernel)}
        assert called <= {polyline.__name__}
