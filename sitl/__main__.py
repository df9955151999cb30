"""`python -m sitl`."""

import os
import signal
import sys

from sitl.python_version import complaint


def main() -> int:
    """Load the shell and run it; an interrupt while it loads ends it with status 1."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(1))
    try:
        from sitl.shell import main as run  # noqa: PLC0415
    except (ImportError, SyntaxError) as error:
        sys.stderr.write("python -m sitl: " + complaint(error) + "\n")
        return 1
    status = run()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


if __name__ == "__main__":
    sys.exit(main())
