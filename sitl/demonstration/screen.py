"""Display of a flight: the script's lines, on a terminal the live view above them."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live

from moar_companion.commands.live_view import LiveView
from moar_companion.commands.view import Statuses
from moar_companion.errors import LinkError
from moar_companion.texts.text_format import printable

_RETRY_S = 0.5
_NOTES = 3
"""Lines of the script that the view shows."""


def print_text(text: str) -> None:
    """A line of plain text."""
    sys.stdout.write(f"{printable(text)}\n")
    sys.stdout.flush()


class Screen:
    """Lines of plain text."""

    def print_text(self, text: str) -> None:
        """Print a line for the user."""
        print_text(text)

    def refresh(self) -> None:
        """Show new statuses; made to be called often."""


class LiveScreen(Screen):
    """The live view; the lines are below it, and are printed again when it ends."""

    def __init__(self, live: Live, socket: Path) -> None:
        self._live = live
        self._socket = socket
        self._lines: list[str] = []
        self._statuses: Statuses | None = None
        self._status: dict[str, Any] | None = None
        self._connect_s = 0.0

    def print_text(self, text: str) -> None:
        """Show a line below the view."""
        self._lines.append(text)
        self._draw()

    def refresh(self) -> None:
        """Draw the service's status, once it serves its view."""
        try:
            if self._statuses is None:
                self._connect()
            elif self._statuses.waiting():
                *_, self._status = [self._status, *self._statuses.read()]
                self._draw()
        except LinkError:
            self.close()

    def close(self) -> None:
        """Close the connection to the service."""
        if self._statuses is not None:
            self._statuses.close()
            self._statuses = None

    def report_again(self) -> None:
        """Print all lines permanently."""
        for text in self._lines:
            print_text(text)

    def _connect(self) -> None:
        if time.monotonic() - self._connect_s >= _RETRY_S:
            self._connect_s = time.monotonic()
            self._statuses = Statuses(str(self._socket))

    def _draw(self) -> None:
        notes = self._lines[-_NOTES:]
        page = "\n".join(notes) if self._status is None else LiveView(self._status, notes=notes)
        self._live.update(page, refresh=True)


@contextlib.contextmanager
def open_screen(socket: Path, *, live: bool) -> Iterator[Screen]:
    """The screen of a flight; its service serves the view on a socket."""
    console = Console()
    if not live or not console.is_terminal or console.is_dumb_terminal:
        yield Screen()
        return
    with contextlib.ExitStack() as stack:
        view = Live(console=console, screen=True, auto_refresh=False)
        screen = LiveScreen(view, socket)
        stack.callback(screen.report_again)
        stack.enter_context(view)
        stack.callback(screen.close)
        yield screen
