"""Interface between an autopilot's manner and the machine around it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from sitl.battery import BatteryOptions
from sitl.links import Router
from sitl.parameters import Firmware, Parameters
from sitl.quadrotor import Airframe
from sitl.sticks import Sticks
from sitl.world import World


class Manner(Protocol):
    """The behaviour of one kind of autopilot: it answers messages, flies and emits telemetry."""

    parameters: Parameters
    sticks: Sticks

    @property
    def running(self) -> bool:
        """True when its links work; not while it boots."""

    @property
    def armed(self) -> bool:
        """True when the motors may turn."""

    @property
    def mode_name(self) -> str:
        """The autopilot's own name of its flight mode."""

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE as the autopilot estimates it."""

    def receive(self, link: str, message: Any) -> None:
        """Take one decoded message that arrived on a link: forward it, act on it, or neither."""

    def control(self) -> None:
        """Decide and write the demand of the airframe; before the physics of each tick."""

    def emit(self) -> None:
        """Send the telemetry that is due; after the physics of each tick."""

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and let it act; `KeyError`, `ValueError` when it is refused."""

    def reboot(self) -> None:
        """Restart: time_boot_ms restarts, disarmed; parameters and the world stay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One kind of autopilot, and the aircraft that its own simulation flies."""

    title: str
    airframe: Airframe
    battery: BatteryOptions
    estimate_noise: float
    """Errors of the position estimate, 1 those of PX4's simulation."""
    firmware: Firmware
    """The release whose behaviour it has."""
    parameters: Callable[[Mapping[str, float], Firmware], Parameters]
    """The parameters of a firmware, some of them replaced; `KeyError`, `ValueError` when that is
    refused."""
    start: Callable[[World, Router, Parameters], Manner]
    """Boots the autopilot."""
