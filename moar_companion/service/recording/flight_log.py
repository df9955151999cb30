"""The flight log: cycles in, the timed messages of an .mcap out. The recorder's thread runs it."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import version

from .channels import Channels, Cycle, encoded_message, nanoseconds_of
from .schemas import CHANNELS, SHAPES, schema
from .secrets import Blanking


class FlightLog:
    """Blanks keys, makes the messages. clock_offset_s: wall clock minus the machine's clock."""

    def __init__(self, clock_offset_s: float) -> None:
        self._blanking = Blanking()
        self._channels = Channels(clock_offset_s)
        self._now_s = 0.0

    @property
    def channels(self) -> Mapping[str, tuple[str, bytes]]:
        """By topic the name of its schema and the JSON schema."""
        return {topic: (name, schema(name, SHAPES[name])) for topic, name in CHANNELS.items()}

    @property
    def library(self) -> str:
        """Program, processor and versions, on which the last digits of a number may depend."""
        return made_with()

    def latched(self) -> Iterator[tuple[str, int, bytes]]:
        """Messages at the start of each part."""
        for topic, wall_s, content in self._channels.latched(self._now_s):
            yield topic, nanoseconds_of(wall_s), encoded_message(content)

    def messages(self, items: list[Cycle], *, last: bool) -> Iterator[tuple[str, int, bytes]]:
        """Messages of these cycles, and of earlier cycles that waited. last: all."""
        for cycle in self._blanking.ready(items, last=last):
            self._now_s = cycle.now_s
            for topic, wall_s, content in self._channels.messages(cycle):
                yield topic, nanoseconds_of(wall_s), encoded_message(content)


def made_with() -> str:
    """Versions that a number depends on: `moar-companion 0.1.0, x86_64, Python 3.11, ...`."""
    python = ".".join(platform.python_version_tuple()[:2])
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    own = f"moar-companion {version('moar-companion')}"
    return f"{own}, {platform.machine()}, Python {python}, {packages}"
