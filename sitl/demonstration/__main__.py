"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`."""

import os
import signal
import sys

from sitl.python_version import complaint


def main() -> int:
    """Load the demonstration and fly it; an early end ends its processes, too."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    try:
        from .fly import main as fly  # noqa: PLC0415
    except (ImportError, SyntaxError) as error:
        sys.stderr.write("sitl/fly: " + complaint(error) + "\n")
        return 1
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
