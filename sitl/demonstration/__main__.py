"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`."""

from __future__ import annotations

import os
import signal
import sys


def main() -> int:
    """Load the demonstration and fly it; every way to end it early ends its processes, too."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    from .fly import main as fly  # noqa: PLC0415

    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler)
        status = fly()
    except KeyboardInterrupt:
        status = 1
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


if __name__ == "__main__":
    sys.exit(main())
