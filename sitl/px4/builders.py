"""What all of PX4's message builders share: where they look, and how a payload is packed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sitl.px4.commander import Commander
from sitl.px4.control import PositionControl
from sitl.px4.navigation import Navigation
from sitl.px4.parameters import Parameters
from sitl.px4.sticks import Sticks
from sitl.px4.voice import Voice
from sitl.wire import layout
from sitl.world import World

Builder = Callable[[], bytes | None]
"""Returns a payload, or None when PX4 has nothing to send."""


@dataclass(slots=True, kw_only=True)
class Sources:
    """Where the builders look."""

    world: World
    navigation: Navigation
    control: PositionControl
    commander: Commander
    parameters: Parameters
    sticks: Sticks
    voice: Voice
    boot_us: int


class Builders:
    """A group of builders."""

    def __init__(self, sources: Sources) -> None:
        """Take the sources."""
        self._s = sources
        self._noise = sources.world.random.gauss

    @property
    def _ms(self) -> int:
        return (self._s.world.now_us - self._s.boot_us) // 1000

    @property
    def _us(self) -> int:
        return self._s.world.now_us - self._s.boot_us

    @staticmethod
    def _pack(name: str, **values: Any) -> bytes:
        return layout(name).payload(**values)
