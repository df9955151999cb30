"""The worked examples of the page for contributors still apply, and their tests pass."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / ".github" / "examples"
TESTS = {
    "condition": (
        "few satellites",
        "safety/test_checks_of_place.py",
        "safety/test_condition_texts.py",
    ),
    "message": ("test_vibration_is_the_greatest", "mavlink/test_translate_status.py"),
    "subcommand": ("test_each_target_is_listed", "commands/test_targets.py"),
}
"""Name of a test that the example brings, and the files that are run."""


@pytest.fixture
def copy(tmp_path):
    """A copy of what the examples change and their tests need."""
    skipped = shutil.ignore_patterns("__pycache__", "data", "benchmarks", "configs")
    for folder in ("moar_companion", "tests", "sitl"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=skipped)
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_each_example_is_in_the_page():
    page = (ROOT / ".github" / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert {path.stem for path in EXAMPLES.glob("*.diff")} == TESTS.keys()
    assert all(f"](examples/{name}.diff)" in page for name in TESTS)
    assert len(page.splitlines()) <= 150


@pytest.mark.slow
@pytest.mark.parametrize("name", TESTS)
def test_an_example_applies_and_its_tests_pass(name, copy):
    subprocess.run(["git", "apply", str(EXAMPLES / f"{name}.diff")], cwd=copy, check=True)
    new, *files = TESTS[name]
    options = ("-v", "-p", "no:cacheprovider", "-m", "not slow")
    out = printed(copy, "pytest", *options, *(f"tests/{file}" for file in files))
    assert any(new in line and "PASSED" in line for line in out.splitlines())
    changed = printed(copy, "moar_companion", "docs").splitlines()
    assert len(changed) == (name != "subcommand")
    assert printed(copy, "moar_companion", "docs", "--check") == ""


def printed(copy, module, *arguments):
    """What a module prints that runs in the copy; it ends with status 0."""
    run = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout
