"""The journal of systemd: log records as entries with fields, in its own protocol.

Fields beside MESSAGE and PRIORITY: LOGGER, the module; and those of a record's `fields`, each with
the prefix MOAR_: `journalctl -u moar-companion MOAR_KIND=text`.

Source: systemd.io/JOURNAL_NATIVE_PROTOCOL; JOURNAL_STREAM in systemd.exec(5).
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket

from ..texts.text_format import printable

_SOCKET = "/run/systemd/journal/socket"
_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
"""syslog(3)'s priorities, from each level on."""
_DEBUG = 7


def open_journal(stderr: int) -> socket.socket | None:
    """Socket of the journal, if systemd has connected this stderr to it; None otherwise."""
    status = os.fstat(stderr)
    if os.environ.get("JOURNAL_STREAM") != f"{status.st_dev}:{status.st_ino}":
        return None
    journal = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        journal.connect(_SOCKET)
    except OSError:
        journal.close()
        return None
    return journal


class JournalFormatter(logging.Formatter):
    """Records as entries: a line for each field, the last line without its end."""

    def format(self, record: logging.LogRecord) -> str:
        """Returns the entry of a record."""
        priority = next((each for level, each in _PRIORITIES if record.levelno >= level), _DEBUG)
        fields = {
            "MESSAGE": record.getMessage(),
            "PRIORITY": str(priority),
            "SYSLOG_IDENTIFIER": "moar-companion",
            "LOGGER": record.name,
        }
        for name, value in getattr(record, "fields", {}).items():
            fields[f"MOAR_{name.upper()}"] = value
        return "\n".join(f"{name}={printable(value)}" for name, value in fields.items())


def write_entries(journal: socket.socket, entries: list[bytes]) -> None:
    """Sends entries; those that the journal does not accept are lost."""
    for entry in entries:
        with contextlib.suppress(OSError):
            journal.send(entry)
