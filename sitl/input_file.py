"""Opening of the user's files. A pipe without a writer would block, a device may never end."""

import errno
import io
import stat
from pathlib import Path


class NotAFileError(OSError):
    """The path leads to something else than a file; `strerror` completes `PATH: `."""


def open_file(path: Path) -> io.BufferedReader:
    """Open a file for reading; `OSError`, also `NotAFileError`, when it cannot be."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kind = (
            "a pipe" if stat.S_ISFIFO(mode) else "a directory" if stat.S_ISDIR(mode) else "a device"
        )
        raise NotAFileError(errno.EINVAL, f"is {kind}, must be a file")
    return path.open("rb")
