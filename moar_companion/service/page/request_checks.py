"""Which requests are answered: those for this computer, of its own page. No I/O.

A page of another site must neither read this one nor act through a browser that can reach it. Such
a page has another origin, or (DNS rebinding) a name that leads to this computer: the header Host
must be an address, `localhost`, or a name of the configuration.
"""

from __future__ import annotations

import hmac
import ipaddress
import re
from collections.abc import Collection, Mapping

_PORT = re.compile(r":[0-9]{1,5}$")
_BEARER = re.compile(r"Bearer ([!-~]+)")
_OWN = frozenset({"same-origin", "none"})
"""Values of Sec-Fetch-Site for requests of the page itself, and of the user's address line."""


def host_refusal(host: str | None, allowed: Collection[str]) -> str | None:
    """Reason why a request with this Host is refused; None if it is answered."""
    if not host:
        return "a request needs the header Host"
    name = _PORT.sub("", host).lower().rstrip(".")
    if name == "localhost" or name in allowed or _is_address(name):
        return None
    return f"{name[:80]!r} is not in page.allowed_hosts"


def origin_refusal(headers: Mapping[str, str], *, navigates: bool) -> str | None:
    """Reason why a request of another site is refused; None if it is answered.

    headers: with names in lower case. navigates: the address may be opened by a link elsewhere. A
    request without Origin comes from the page itself, or from no browser.
    """
    origin, host = headers.get("origin"), headers.get("host", "")
    if origin is not None and origin not in {f"http://{host}", f"https://{host}"}:
        return "requests of other sites are refused"
    site = headers.get("sec-fetch-site")
    if site is None or site in _OWN:
        return None
    if navigates and headers.get("sec-fetch-mode") == "navigate":
        return None
    return "requests of other sites are refused"


def has_token(authorization: str | None, token: str) -> bool:
    """True if a header `Authorization: Bearer TOKEN` has the token."""
    given = _BEARER.fullmatch(authorization or "")
    return given is not None and hmac.compare_digest(given[1], token)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True
