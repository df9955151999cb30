"""The program's entry, light enough that an interrupt while it loads ends it without a word."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Load the command line and run it; the exit status."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as run  # noqa: PLC0415

    signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


if __name__ == "__main__":
    sys.exit(main())
