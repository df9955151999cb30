"""The section `page` of the configuration: the page that the service serves to browsers."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from .yaml_file import FileFinding

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8195
PAGE_LINK = "page"
"""Name of the companion's link on which orders of the page come; no URL has this form."""
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")
_TILE_URL = re.compile(r"https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?/[^\s'\";,]*")


def _address(text: str) -> str:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        raise ValueError("must be an address of this computer, as 127.0.0.1, 0.0.0.0 or ::") from (
            None
        )
    return text


def _host_name(text: str) -> str:
    if not _HOST.fullmatch(text):
        raise ValueError("must be the name of a host, without scheme and port")
    return text.lower()


def _tile_url(text: str | None) -> str | None:
    if text is not None and not (
        _TILE_URL.fullmatch(text) and all(word in text for word in ("{z}", "{x}", "{y}"))
    ):
        raise ValueError("must be http:// or https://, with {z}, {x} and {y}")
    return text


@dataclass(frozen=True, slots=True, kw_only=True)
class PageConfig:
    """The page of the aircraft, for browsers."""

    enabled: bool = False
    """The service serves the page, in a process of its own."""
    host: Annotated[str, AfterValidator(_address)] = DEFAULT_HOST
    """Address of this computer on which the page is served; `0.0.0.0` and `::` are all. The page
    has no TLS: whoever can read the network's packets can read the token."""
    port: Annotated[int, Field(ge=1, le=65_535)] = DEFAULT_PORT
    """Its TCP port."""
    token_file: Path | None = None
    """A file with the token of orders, 16 to 256 printable characters, of root or of the service's
    user, that no other user can read; none: the page shows, and gives no orders."""
    token_credential: str | None = None
    """The same in a credential of systemd (`LoadCredential=`): where systemd passes some it is
    taken in place of the file."""
    allowed_hosts: tuple[Annotated[str, AfterValidator(_host_name)], ...] = ()
    """Names under which browsers open the page, beside `localhost` and addresses. Requests for
    other names are refused."""
    tile_url: Annotated[str | None, AfterValidator(_tile_url)] = None
    """Tiles of a map below the site, as `https://HOST/{z}/{x}/{y}.png`; none: no map, and the page
    needs no network."""

    @property
    def takes_orders(self) -> bool:
        """True if orders come from the page."""
        has_token = self.token_file is not None or self.token_credential is not None
        return self.enabled and has_token


def page_findings(section: PageConfig) -> Iterator[FileFinding]:
    """Errors across the keys of the section."""
    name = section.token_credential
    if name is not None and Path(name).name != name:
        problem = f"is {name!r}, must be the name of a credential, without a folder"
        yield FileFinding(("page", "token_credential"), problem)
