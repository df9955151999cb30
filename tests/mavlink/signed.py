"""A peer that signs by pymavlink's own code, and the companion's end of the link."""

from __future__ import annotations

import base64
import hashlib
import json

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.signing import LinkSigning, SigningKey

from .peer import Peer

SECRET = hashlib.sha256(b"a long phrase").digest()
OTHER_SECRET = hashlib.sha256(b"another phrase").digest()
MINUTE = 6_000_000
"""In units of time stamps."""


class SignedPeer(Peer):
    """A peer that signs, and refuses unsigned packets."""

    def __init__(
        self, system_id=1, component_id=1, *, secret=SECRET, link_id=3, timestamp=100 * MINUTE
    ):
        super().__init__(system_id, component_id)
        self._packer.robust_parsing = True
        self.signing = self._packer.signing
        self.signing.secret_key = secret
        self.signing.link_id = link_id
        self.signing.timestamp = timestamp
        self.signing.sign_outgoing = True

    def read(self, data):
        """The messages that are signed correctly."""
        messages = self._packer.parse_buffer(data) or []
        return [message for message in messages if message.get_type() != "BAD_DATA"]


def signing(*, secret=SECRET, link_id=0, timestamp=100 * MINUTE, **options):
    return LinkSigning(SigningKey(secret), link_id=link_id, timestamp=timestamp, **options)


def signed_codec(link=None, **options):
    return Codec(system_id=1, component_id=195, signing=link or signing(), **options)


def found_in(data, secret=SECRET):
    """Forms in which a text or a file contains the beginning of a key."""
    forms = {
        "bytes": secret,
        "hexadecimal": secret.hex().encode(),
        "upper case": secret.hex().upper().encode(),
        "base64": base64.b64encode(secret),
        "base64 of a URL": base64.urlsafe_b64encode(secret),
        "Python": repr(secret)[2:-1].encode(),
        "list": json.dumps(list(secret)).encode()[1:],
    }
    return [name for name, form in forms.items() if form[:12] in data]
