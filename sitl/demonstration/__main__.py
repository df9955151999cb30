"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Load the script and run it; every way to end it early ends its processes, too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .script import main as fly  # noqa: PLC0415

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    return fly()


if __name__ == "__main__":
    sys.exit(main())
