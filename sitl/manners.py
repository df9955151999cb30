"""The autopilots that can be simulated, by name."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from sitl import ardupilot, px4
from sitl.manner import Kind

KINDS: Final[Mapping[str, Kind]] = MappingProxyType({"px4": px4.KIND, "ardupilot": ardupilot.KIND})
