"""Versions of the program, and of what it runs on: `--version`, and the archive of `diagnose`."""

from __future__ import annotations

import importlib.metadata
import platform
import re

PROGRAM = "moar-companion"
_FLYING_EXTRAS = {None, "lidar", "ouster"}
"""Extras that a flight may need; None: needed by all."""
_REQUIREMENT = re.compile(r"""([\w.-]+)(?:.*extra == "(\w+)")?""")


def program_version() -> str:
    """Version of the installed program, from the git tag it was built from."""
    return _version_of(PROGRAM) or "(not installed)"


def version_lines() -> list[str]:
    """Lines of `name version`: the program first, then Python, the system, the libraries."""
    found = {name: _version_of(name) for name in sorted(_libraries())}
    return [
        f"{PROGRAM} {program_version()}",
        f"python {platform.python_version()}",
        f"{platform.system().lower()} {platform.release()} {platform.machine()}",
        *(f"{name} {version}" for name, version in found.items() if version is not None),
    ]


def _libraries() -> set[str]:
    """Names of the libraries that a flight may need."""
    try:
        requirements = importlib.metadata.requires(PROGRAM) or []
    except importlib.metadata.PackageNotFoundError:
        return set()
    parts = [match.groups() for match in map(_REQUIREMENT.match, requirements) if match]
    return {name for name, extra in parts if extra in _FLYING_EXTRAS}


def _version_of(name: str) -> str | None:
    """Version of an installed distribution; None if it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
