"""Links of the service, and the key of those that are signed: sections `links` and `signing`."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Strict

from .yaml_file import HEXADECIMAL_KEY, FileFinding, shown
from .yaml_schema import FileModel, FilePath, Name


class LinkRole(str, enum.Enum):
    """Peer at the other end of a link."""

    AUTOPILOT = "autopilot"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConfig:
    """One link: a URL (`mavlink/urls`) and the peer there."""

    url: str
    role: LinkRole = LinkRole.AUTOPILOT
    signed: bool = False
    """True: all packets are signed, and unsigned ones are refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySource:
    """Source of the key of the signed links, never the key itself."""

    key_file: Path | None = None
    credential: str | None = None
    """The name of a credential that systemd passes: where it passes some, in place of the file."""


class LinkFile(FileModel):
    """One entry of `links`."""

    url: Name
    role: Annotated[LinkRole, Strict(strict=False)] = LinkRole.AUTOPILOT
    signed: bool = False


class SigningFile(FileModel):
    """Section `signing`."""

    key_file: FilePath | None = None
    credential: Name | None = None


def link_findings(links: list[LinkFile], signing: SigningFile) -> Iterator[FileFinding]:
    """Yields the faults of links and key: a URL twice, a key in the file, no key."""
    seen: dict[str, int] = {}
    for index, link in enumerate(links):
        if link.url in seen:
            problem = f"is {link.url!r}, the same as links[{seen[link.url]}]: must be unique"
            yield FileFinding(("links", index, "url"), problem)
        seen.setdefault(link.url, index)
    yield from _signing_findings(links, signing)


def _signing_findings(links: list[LinkFile], signing: SigningFile) -> Iterator[FileFinding]:
    key_file, credential = signing.key_file, signing.credential
    for name, value in (("key_file", key_file), ("credential", credential)):
        if value is not None and HEXADECIMAL_KEY.fullmatch(Path(value).name):
            problem = f"is {shown(str(value))}, must be the name of what has the key"
            yield FileFinding(("signing", name), problem)
            return
    if credential is not None and Path(credential).name != credential:
        problem = f"is {credential!r}, must be the name of a credential, without a folder"
        yield FileFinding(("signing", "credential"), problem)
    if key_file is None and credential is None:
        problem = "is true, must have a key: signing.key_file or signing.credential"
        for index, link in enumerate(links):
            if link.signed:
                yield FileFinding(("links", index, "signed"), problem)
