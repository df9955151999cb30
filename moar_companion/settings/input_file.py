"""Opening of input files. A pipe without a writer would block, a device may never end."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path

_KINDS = {
    stat.S_IFDIR: "a directory",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class NotAFileError(OSError):
    """The path leads to something else than a file; `strerror` completes `PATH: …`."""


def open_file(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Opens a file for reading. Raises OSError, NotAFileError included, and ValueError."""
    mode = Path(path).stat().st_mode
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "no file")
        raise NotAFileError(errno.EINVAL, f"is {kind}, must be a file")
    return Path(path).open("rb")


def unreadable(error: OSError | ValueError) -> str:
    """The problem of a file that could not be read, in words that complete `PATH: …`."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, NotAFileError):
        return str(error.strerror)
    # What os.stat says of a path with a null byte differs between versions of Python.
    reason = "not a valid path" if isinstance(error, ValueError) else error.strerror or error
    return f"cannot be read: {reason}"
