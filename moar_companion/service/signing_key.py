"""Key of the signed links: from a file that only its owner can read, or from systemd.

Nothing here, and no error, reveals a byte of it.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from ..config import CompanionConfig
from ..errors import InputError
from ..mavlink.signing import KEY_BYTES, SigningKey

_CREDENTIALS = "CREDENTIALS_DIRECTORY"
_CREDENTIAL, _KEY_FILE = "signing.credential", "signing.key_file"
_LONGEST_BYTES = 4096
"""A longer file is no key."""
_DIGITS = re.compile(rb"\s*([0-9A-Fa-f]{%d})\s*" % (2 * KEY_BYTES))
_FORMS = f"must be {KEY_BYTES} bytes or {2 * KEY_BYTES} hexadecimal digits"


class _UnusableError(Exception):
    """Reason why a file is no key."""


def read_signing_key(config: CompanionConfig) -> SigningKey | None:
    """Returns the key of the configuration's links; None if none of them is signed.

    Raises InputError if there is no usable key, or if others can read it.
    """
    if not any(link.signed for link in config.links):
        return None
    path, key = _place(config)
    try:
        # systemd gives its credentials to the service's user alone, by access list or ownership:
        # their mode does not show that.
        return _key_in(_content(path, private=key == _KEY_FILE))
    except OSError as error:
        reason = error.strerror
    except _UnusableError as error:
        reason = str(error)
    raise InputError(str(config.file), key, f"is {str(path)!r}: {reason}")


def _place(config: CompanionConfig) -> tuple[Path, str]:
    """Returns the file, and the key of the configuration that names it."""
    key_file, credential = config.signing.key_file, config.signing.credential
    passed = os.environ.get(_CREDENTIALS)
    if credential is not None and passed:
        return Path(passed, credential), _CREDENTIAL
    if key_file is None:
        problem = f"is {credential!r}, must be passed by systemd: {_CREDENTIALS} is not set"
        raise InputError(str(config.file), _CREDENTIAL, problem)
    return key_file, _KEY_FILE


def _content(path: Path, *, private: bool) -> bytes:
    """Returns a file's content. private: only its owner (this user or root) may have access."""
    # O_NONBLOCK: a pipe without a writer would block the start.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise _UnusableError("is no file")
        if private and status.st_uid not in {0, os.geteuid()}:
            raise _UnusableError(
                f"belongs to user {status.st_uid}, must belong to root or user {os.geteuid()}"
            )
        if private and status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            mode = stat.S_IMODE(status.st_mode)
            raise _UnusableError(f"is open to group or others (mode {mode:04o}), must be 0400")
        return file.read(_LONGEST_BYTES + 1)


def _key_in(content: bytes) -> SigningKey:
    digits = _DIGITS.fullmatch(content)
    if digits is None and len(content) != KEY_BYTES:
        size = len(content) if len(content) <= _LONGEST_BYTES else f"over {_LONGEST_BYTES}"
        raise _UnusableError(f"holds no key ({size} bytes), {_FORMS}")
    secret = content if digits is None else bytes.fromhex(digits[1].decode())
    if not any(secret):
        raise _UnusableError("holds a key of zeros, must be random")
    return SigningKey(secret)
