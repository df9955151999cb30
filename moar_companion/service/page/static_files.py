"""Files of the page, read at the start: a request names one of them and no path."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parent / "static"
_MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticFile:
    """Content, and a tag by which a browser knows that it has it."""

    content: bytes
    media_type: str
    tag: str


class StaticFiles:
    """The files by their names."""

    def __init__(self) -> None:
        self._files = {
            path.name: _read(path) for path in _FOLDER.iterdir() if path.suffix in _MEDIA_TYPES
        }

    def file(self, name: str) -> StaticFile | None:
        """The file of this name; None without one."""
        return self._files.get(name)


def _read(path: Path) -> StaticFile:
    content = path.read_bytes()
    tag = f'"{hashlib.sha256(content).hexdigest()[:16]}"'
    return StaticFile(content=content, media_type=_MEDIA_TYPES[path.suffix], tag=tag)
