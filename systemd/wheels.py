"""The wheels that run the program on a Python and an architecture, by the pins of constraints.txt.

    .venv/bin/python systemd/wheels.py

Asks the package index whether all of them exist for the Python of each supported system, on amd64
and arm64: a companion computer has no compilers to wait for. Nothing is installed. Markers are
evaluated here, since pip evaluates them for the Python that it runs on.
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
MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
"""Machine of a platform tag, by Debian's name of the architecture."""
GLIBC_MINOR = 35
"""glibc 2.35 of Ubuntu 22.04, the oldest of the supported systems: JetPack 6."""


def wanted(python: str, architecture: str, extras: set[str]) -> list[str]:
    """`name==version` of all dependencies, direct and transitive, with those of the extras.

    Raises LookupError for a dependency without a pin.
    """
    names, pinned = _needed(python, architecture, extras), _pins(python, architecture)
    if missing := sorted(names - pinned.keys()):
        raise LookupError(f"not in constraints.txt: {', '.join(missing)}")
    return [pinned[name] for name in sorted(names)]


def pip_install(python: str, architecture: str, folder: Path) -> list[str]:
    """The pip command that installs wheels of another Python or architecture into a folder."""
    machine = MACHINES[architecture]
    platforms = [f"manylinux2014_{machine}"]
    platforms += [f"manylinux_2_{minor}_{machine}" for minor in range(GLIBC_MINOR, 16, -1)]
    command = [sys.executable, "-m", "pip", "-qq", "install", "--no-deps", "--no-compile"]
    command += ["--only-binary=:all:", "--python-version", python, "--target", str(folder)]
    return command + [f"--platform={platform}" for platform in platforms]


def _environment(python: str, architecture: str) -> dict[str, str]:
    """Values of the environment markers of requirements there."""
    return {
        "extra": "",
        "implementation_name": "cpython",
        "implementation_version": f"{python}.0",
        "os_name": "posix",
        "platform_machine": MACHINES[architecture],
        "platform_python_implementation": "CPython",
        "platform_system": "Linux",
        "python_full_version": f"{python}.0",
        "python_version": python,
        "sys_platform": "linux",
    }


def _needed(python: str, architecture: str, extras: set[str]) -> set[str]:
    """Names of all run-time dependencies, direct and transitive, by what is installed here."""
    here = _environment(python, architecture)
    names: set[str] = set()
    seen: set[tuple[str, str]] = set()
    todo = [("moar-companion", extra) for extra in {"", *extras}]
    while todo:
        package, extra = todo.pop()
        if (package, extra) in seen:
            continue
        seen.add((package, extra))
        try:
            lines = requires(package) or []
        except PackageNotFoundError:  # only on another Python: asked for, not entered
            continue
        for requirement in map(Requirement, lines):
            marker = requirement.marker
            if marker is None or marker.evaluate({**here, "extra": extra}):
                name = canonicalize_name(requirement.name)
                names.add(name)
                todo += [(name, each) for each in {"", *requirement.extras}]
    return names


def _pins(python: str, architecture: str) -> dict[str, str]:
    """Name → `name==version` of the constraints that hold there."""
    here, found = _environment(python, architecture), {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate(here):
                name = canonicalize_name(requirement.name)
                found[name] = f"{name}{requirement.specifier}"
    return found


def _ask(python: str, architecture: str) -> str:
    """Names of the wheels that are built for the architecture; raises LookupError without one."""
    with tempfile.TemporaryDirectory() as nowhere:
        command = pip_install(python, architecture, Path(nowhere))
        command += ["--dry-run", "--ignore-installed", "--report", "-"]
        answer = subprocess.run(
            [*command, *wanted(python, architecture, {"lidar", "plots", "ulog"})],
            capture_output=True,
            text=True,
            check=False,
        )
    if answer.returncode != 0:
        raise LookupError(answer.stderr.strip())
    wheels = [Path(item["download_info"]["url"]) for item in json.loads(answer.stdout)["install"]]
    built = sorted(wheel.name.split("-")[0] for wheel in wheels if "none-any" not in wheel.name)
    return f"{len(wheels)} wheels, of these built for {architecture}: {', '.join(built)}"


def main() -> int:
    """Ask for every Python and architecture; the exit status."""
    failed = False
    for python in PYTHONS:
        for architecture in MACHINES:
            try:
                found = _ask(python, architecture)
            except LookupError as error:
                found, failed = f"FAILED: {error}", True
            sys.stdout.write(f"Python {python}: {found}\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
