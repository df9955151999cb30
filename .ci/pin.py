"""Writes constraints.txt anew, with the newest packages that fit together.

    .venv/bin/python .ci/pin.py python3.10 python3.11 python3.12 python3.13

Asks pip what it would install for each of these interpreters (names or paths), and merges the
answers. Constraints are for repeatable checks; who installs the wheel does not need them.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HEADER = """\
# What the scripts and CI install: exact versions, for Linux and Python 3.10 to 3.13.
# Not edited by hand: .ci/pin.py writes this file.
"""


def resolve(interpreter: str) -> tuple[str, dict[str, str]]:
    """The version of an interpreter, and name → version of all that would be installed."""
    pip = [sys.executable, "-m", "pip", "-qq", "--python", interpreter]
    what = ["install", "--dry-run", "--ignore-installed", "--only-binary=:all:", "--report", "-"]
    answer = subprocess.run(
        [*pip, *what, "--editable", ".[dev]", "pip", "setuptools", "setuptools-scm"],
        stdout=subprocess.PIPE,
        check=True,
        cwd=ROOT,
    )
    report = json.loads(answer.stdout)
    versions = {}
    for package in report["install"]:
        metadata = package["metadata"]
        versions[re.sub(r"[-_.]+", "-", metadata["name"]).lower()] = metadata["version"]
    del versions["moar-companion"]
    return report["environment"]["python_version"], versions


def marker(users: list[str], pythons: list[str]) -> str:
    """For which of these Pythons a line is."""
    if users == pythons:
        return ""
    if users == pythons[-len(users) :]:
        return f' ; python_version >= "{users[0]}"'
    return " ; " + " or ".join(f'python_version == "{python}"' for python in users)


def main() -> None:
    """Resolve for each interpreter and write the union."""
    if len(sys.argv) == 1:
        sys.exit(__doc__)
    found = dict(resolve(interpreter) for interpreter in sys.argv[1:])
    pythons = sorted(found, key=lambda python: int(python.split(".")[1]))
    lines = []
    for name in sorted({name for versions in found.values() for name in versions}):
        users = defaultdict(list)
        for python in pythons:
            if name in found[python]:
                users[found[python][name]].append(python)
        lines += [f"{name}=={version}{marker(users[version], pythons)}\n" for version in users]
    (ROOT / "constraints.txt").write_text(HEADER + "".join(lines))


if __name__ == "__main__":
    main()
