"""Error text where this Python cannot run the simulator; old versions can read this file."""

import sys

OLDEST = (3, 10)


def complaint(error: Exception) -> str:
    """One line for an error of loading; any other error than a missing package is raised again."""
    version = ".".join(map(str, sys.version_info[:2]))
    remedy = "use .venv/bin/python, which tests/run and sitl/fly make"
    if sys.version_info[:2] < OLDEST:
        return "this is Python " + version + ", must be 3.10 to 3.13: " + remedy
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if package in ("", "sitl", "moar_companion"):
        raise error
    return "this Python has no " + package + ": " + remedy
