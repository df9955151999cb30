"""Behaviour of PX4 v1.17, as measured on PX4 v1.17.0 with its built-in simulation."""

from typing import Final

from sitl.battery import BatteryOptions
from sitl.manner import Kind
from sitl.px4.parameters import FIRMWARE, parameters
from sitl.px4.vehicle import Px4Manner
from sitl.quadrotor import Airframe

KIND: Final = Kind(
    title="PX4",
    airframe=Airframe(),
    battery=BatteryOptions(),
    estimate_noise=1.0,
    firmware=FIRMWARE,
    parameters=parameters,
    start=Px4Manner,
)

__all__ = ["KIND"]
