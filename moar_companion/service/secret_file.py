"""Secrets: from a file that only its owner can read, or from a credential of systemd.

Nothing here, and no error, reveals a byte of one.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError

_CREDENTIALS = "CREDENTIALS_DIRECTORY"
LONGEST_BYTES = 4096
"""A longer file is no key and no password."""


class UnusableSecretError(Exception):
    """Reason why a file has no usable secret."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SecretPlace:
    """A file with a secret, and the setting that names it. private: False for a credential."""

    path: Path
    source: str
    key: str
    private: bool = True

    def refused(self, error: Exception) -> InputError:
        """Returns the error for an OSError or UnusableSecretError."""
        reason = error.strerror if isinstance(error, OSError) else str(error)
        return InputError(self.source, self.key, f"is {str(self.path)!r}: {reason}")

    def content(self) -> bytes:
        """Returns the content, at most `LONGEST_BYTES` and one.

        Raises OSError, or UnusableSecretError for a file to which others than its owner (this user
        or root) have access.
        """
        # O_NONBLOCK: a pipe without a writer would block the start.
        descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise UnusableSecretError("is no file")
            # systemd gives its credentials to the service's user alone, by access list or
            # ownership: their mode does not show that.
            if self.private:
                _check_private(status)
            return file.read(LONGEST_BYTES + 1)


def secret_place(
    source: str, section: str, key_file: tuple[str, Path | None], credential: tuple[str, str | None]
) -> SecretPlace:
    """The place of a secret: a credential where systemd passes some, else the file.

    section: prefix of the keys. key_file, credential: key and value of each setting. Raises
    InputError if there is only a credential, and systemd passes none.
    """
    passed = os.environ.get(_CREDENTIALS)
    if credential[1] is not None and passed:
        key = f"{section}{credential[0]}"
        return SecretPlace(path=Path(passed, credential[1]), source=source, key=key, private=False)
    if key_file[1] is None:
        problem = f"is {credential[1]!r}, must be passed by systemd: {_CREDENTIALS} is not set"
        raise InputError(source, f"{section}{credential[0]}", problem)
    return SecretPlace(path=key_file[1], source=source, key=f"{section}{key_file[0]}")


def _check_private(status: os.stat_result) -> None:
    if status.st_uid not in {0, os.geteuid()}:
        raise UnusableSecretError(
            f"belongs to user {status.st_uid}, must belong to root or user {os.geteuid()}"
        )
    if status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        mode = stat.S_IMODE(status.st_mode)
        raise UnusableSecretError(f"is open to group or others (mode {mode:04o}), must be 0400")
