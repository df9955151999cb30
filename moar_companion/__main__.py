"""Program entry; loads little, so that an interrupt during loading ends it without output."""

from __future__ import annotations

import os
import signal
import sys


def main() -> int:
    """Load the command line and run it; the exit status.

    An interrupt ends the program at once with status 1, unless a command has to clean up.
    """
    signal.signal(signal.SIGINT, _end)
    # No plugins are used; pydantic would search every installed package for them.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if "_ARGCOMPLETE" in os.environ:  # set by the script of `moar-companion completion`
        from .commands.completion import complete  # noqa: PLC0415

        complete()
    from .commands.cli import main as run  # noqa: PLC0415

    status = run()
    # The work is done: an interrupt while Python shuts down is ignored.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


def _end(*_: object) -> None:
    """Ends the process; an exception could be swallowed or printed by imports or the compiler."""
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
