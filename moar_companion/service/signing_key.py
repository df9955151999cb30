"""Secret keys: of the signed links, and of signed orders over MQTT.

A key is 32 bytes or 64 hexadecimal digits. Nothing here, and no error, reveals a byte of it.
"""

from __future__ import annotations

import re
from pathlib import Path

from ..mavlink.signing import KEY_BYTES, SigningKey
from ..settings.config import CompanionConfig
from .secret_file import LONGEST_BYTES, SecretPlace, UnusableSecretError, secret_place

_DIGITS = re.compile(rb"\s*([0-9A-Fa-f]{%d})\s*" % (2 * KEY_BYTES))
_FORMS = f"must be {KEY_BYTES} bytes or {2 * KEY_BYTES} hexadecimal digits"


def read_signing_key(config: CompanionConfig) -> SigningKey | None:
    """Returns the key of the configuration's links; None if none of them is signed.

    Raises InputError if there is no usable key, or if others can read it.
    """
    if not config.has_signed_links:
        return None
    signing = config.signing
    place = secret_place(
        str(config.file),
        "signing.",
        ("key_file", signing.key_file),
        ("credential", signing.credential),
    )
    return SigningKey(read_key(place))


def read_key(place: SecretPlace) -> bytes:
    """Returns the 32 bytes of a key. Raises InputError if there is none, or others can read it."""
    try:
        return _key_in(place.content())
    except (OSError, UnusableSecretError) as error:
        raise place.refused(error) from error


def signing_key_in(path: Path) -> SigningKey:
    """Returns the key in a file; raises InputError if it has none, or if others can read it."""
    return SigningKey(read_key(SecretPlace(path=path, source=str(path), key="")))


def _key_in(content: bytes) -> bytes:
    digits = _DIGITS.fullmatch(content)
    if digits is None and len(content) != KEY_BYTES:
        size = len(content) if len(content) <= LONGEST_BYTES else f"over {LONGEST_BYTES}"
        raise UnusableSecretError(f"holds no key ({size} bytes), {_FORMS}")
    secret = content if digits is None else bytes.fromhex(digits[1].decode())
    if not any(secret):
        raise UnusableSecretError("holds a key of zeros, must be random")
    return secret
