"""Inputs of PX4's message builders."""

from dataclasses import dataclass

from sitl import builders
from sitl.control import PositionControl
from sitl.parameters import Parameters
from sitl.px4.commander import Commander
from sitl.px4.navigation import Navigation
from sitl.px4.texts import TextSender
from sitl.sticks import Sticks
from sitl.world import World


@dataclass(slots=True, kw_only=True)
class Sources:
    """Inputs of the builders."""

    world: World
    navigation: Navigation
    control: PositionControl
    commander: Commander
    parameters: Parameters
    sticks: Sticks
    text_sender: TextSender
    boot_us: int


class Builders(builders.Builders):
    """A group of builders."""

    def __init__(self, sources: Sources) -> None:
        """Take the sources."""
        super().__init__(sources.world, sources.boot_us)
        self._s = sources
