"""Common parts of message builders: the vehicle's clock, noise, and packing of payloads."""

from collections.abc import Callable
from typing import Any

from sitl.wire import layout
from sitl.world import World

Builder = Callable[[], bytes | None]
"""Returns a payload, or None when there is nothing to send."""


class Builders:
    """A group of builders of one autopilot, which started at `boot_us`."""

    def __init__(self, world: World, boot_us: int) -> None:
        """Take the world, the source of all messages."""
        self._world = world
        self._boot_us = boot_us
        self._noise = world.random.gauss

    @property
    def _ms(self) -> int:
        return self._us // 1000

    @property
    def _us(self) -> int:
        return self._world.now_us - self._boot_us

    @staticmethod
    def _pack(name: str, **values: Any) -> bytes:
        return layout(name).payload(**values)
