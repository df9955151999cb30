"""The page of the demonstration: the service's settings for it, and a browser once it is served."""

from __future__ import annotations

import secrets
import webbrowser
from pathlib import Path
from typing import Any

from .broker import free_tcp_port

_SERVED = "page on http"
"""In the service's log."""


class Page:
    """folder: for the token, of this flight alone. opens: in the user's browser."""

    def __init__(self, folder: Path, *, opens: bool) -> None:
        self._port = free_tcp_port()
        self._file = folder / "page.token"
        self._file.touch(mode=0o600)
        token = secrets.token_urlsafe(18)
        self._file.write_text(token)
        # A browser keeps what follows # to itself.
        self.url = f"http://127.0.0.1:{self._port}/#token={token}"
        self._waits = opens

    def configuration(self) -> dict[str, Any]:
        """The section of the service's configuration."""
        return {"enabled": True, "port": self._port, "token_file": str(self._file)}

    def open_when_served(self, log: Path) -> None:
        """Opens the page once the service serves it; made to be called often."""
        if self._waits and log.exists() and _SERVED in log.read_text(encoding="utf-8"):
            self._waits = False
            webbrowser.open(self.url)
