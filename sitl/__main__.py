"""`python -m sitl`."""

import signal
import sys


def main() -> int:
    """Load the shell and run it; an interrupt while it loads ends it without a word."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from sitl.shell import main as run  # noqa: PLC0415

    signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


if __name__ == "__main__":
    sys.exit(main())
