"""Asks the package index whether all that the program needs at run time has wheels for aarch64.

A Jetson (JetPack 6: Ubuntu 22.04, glibc 2.35) has no compilers to wait for. Nothing is installed:
pip resolves the pins of constraints.txt for that platform, one Python after the other.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
GLIBC_MINOR = 35
PLATFORMS = (
    "manylinux2014_aarch64",
    *(f"manylinux_2_{minor}_aarch64" for minor in range(GLIBC_MINOR, 16, -1)),
)


def environment(python: str) -> dict[str, str]:
    """Values of the environment markers of requirements on the Jetson."""
    return {
        "extra": "",
        "implementation_name": "cpython",
        "implementation_version": f"{python}.0",
        "os_name": "posix",
        "platform_machine": "aarch64",
        "platform_python_implementation": "CPython",
        "platform_system": "Linux",
        "python_full_version": f"{python}.0",
        "python_version": python,
        "sys_platform": "linux",
    }


def needed(python: str) -> set[str]:
    """The names of all run-time dependencies and of the extras' ones, direct and transitive."""
    names: set[str] = set()
    todo = ["moar-companion"]
    while todo:
        package = todo.pop()
        extras = ("lidar", "plots", "ulog") if package == "moar-companion" else ("",)
        try:
            lines = requires(package) or []
        except PackageNotFoundError:  # only on another Python: asked for, not entered
            continue
        for requirement in map(Requirement, lines):
            name = canonicalize_name(requirement.name)
            marker, here = requirement.marker, environment(python)
            wanted = marker is None or any(
                marker.evaluate({**here, "extra": extra}) for extra in extras
            )
            if wanted and name not in names:
                names.add(name)
                todo.append(name)
    return names


def pins(python: str) -> dict[str, str]:
    """Name → `name==version` of the constraints that hold for a Python."""
    found = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate(environment(python)):
                name = canonicalize_name(requirement.name)
                found[name] = f"{name}{requirement.specifier}"
    return found


def ask(python: str) -> str | None:
    """None when every dependency has a wheel; otherwise what pip says."""
    names, pinned = needed(python), pins(python)
    if missing := sorted(names - pinned.keys()):
        return f"not in constraints.txt: {', '.join(missing)}"
    command = [sys.executable, "-m", "pip", "-qq", "install", "--dry-run", "--ignore-installed"]
    command += ["--no-deps", "--only-binary=:all:", "--python-version", python, "--report", "-"]
    command += [f"--platform={platform}" for platform in PLATFORMS]
    with tempfile.TemporaryDirectory() as nowhere:
        answer = subprocess.run(
            [*command, "--target", nowhere, *(pinned[name] for name in sorted(names))],
            capture_output=True,
            text=True,
            check=False,
        )
    if answer.returncode != 0:
        return answer.stderr.strip()
    wheels = [Path(item["download_info"]["url"]) for item in json.loads(answer.stdout)["install"]]
    built = sorted(wheel.name.split("-")[0] for wheel in wheels if "none-any" not in wheel.name)
    sys.stdout.write(f"  {len(wheels)} wheels, of these built for aarch64: {', '.join(built)}\n")
    return None


def main() -> int:
    """Ask for every Python; the exit status."""
    failed = False
    for python in PYTHONS:
        sys.stdout.write(f"Python {python}:\n")
        if problem := ask(python):
            failed = True
            sys.stdout.write(f"  FAILED: {problem}\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
