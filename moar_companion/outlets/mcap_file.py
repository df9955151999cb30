"""One .mcap: JSON messages on channels with schemas, whole at any moment up to its last flush.

A flush ends a chunk, which any reader of MCAP can read without the rest. A file that was not closed
has no index: readers scan it from its beginning.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

TimedMessage = tuple[str, int, bytes]
"""Channel, nanoseconds since 1970, JSON."""


class McapFile:
    """Writes one file. channels: by topic the name of its schema and the JSON schema."""

    def __init__(
        self, file: BinaryIO, channels: Mapping[str, tuple[str, bytes]], library: str
    ) -> None:
        self._file = file
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=library)
        schemas: dict[str, int] = {}
        self._ids: dict[str, int] = {}
        for topic, (name, schema) in channels.items():
            if name not in schemas:
                schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
            self._ids[topic] = self._writer.register_channel(topic, "json", schemas[name])

    def write(self, messages: Iterable[TimedMessage]) -> None:
        """Adds messages, and flushes them to the file."""
        for topic, time_ns, content in messages:
            self._writer.add_message(self._ids[topic], time_ns, content, time_ns)
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Writes the index and closes."""
        with self._file:
            self._writer.finish()  # type: ignore[no-untyped-call]
