"""The project's programs as processes: started as their users do, ended whatever happens."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


@contextlib.contextmanager
def process(module, *arguments, environment=None, **options):
    """A module as a process. Its output is read from pipes as text, unless `options` differ.

    environment: additional variables. A process that still runs at the end is killed.
    """
    with subprocess.Popen(
        [sys.executable, "-m", module, *map(str, arguments)],
        text=True,
        env={**os.environ, **(environment or {})},
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    ) as running:
        try:
            yield running
        finally:
            running.kill()


def output_of(source, *arguments):
    """Output of Python source in a process of its own, where no other test has run."""
    return subprocess.run(
        [sys.executable, "-B", "-c", source, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def companion(*arguments, **options):
    """`moar-companion` as a process."""
    return process("moar_companion", *arguments, **options)


@contextlib.contextmanager
def simulator(*arguments, **options):
    """The fake autopilot as a process, once it runs."""
    with process("sitl", *arguments, cwd=ROOT, **options) as running:
        assert running.stdout.readline().startswith("sitl:")
        yield running
