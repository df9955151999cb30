"""The program's entry, light enough that an interrupt while it loads ends it without a word."""

from __future__ import annotations

import os
import signal
import sys


def main() -> int:
    """Load the command line and run it; the exit status.

    An interrupt ends it at once with status 1, unless a command has something to put in order.
    """
    signal.signal(signal.SIGINT, _end)
    # There are none, and pydantic would look for them in all that is installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from .cli import main as run  # noqa: PLC0415

    status = run()
    # What is done is done, whatever comes while Python puts itself away.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


def _end(*_: object) -> None:
    """Not by an exception, which those who load modules or compile may swallow or print."""
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
