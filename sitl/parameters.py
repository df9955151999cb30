"""The parameters of an autopilot: a table of names, types and limits, and the values.

Autopilots differ in their tables and in how a value travels in PARAM_VALUE's float: PX4 puts an
integer's bytes there unchanged (`bytewise`), ArduPilot its number.
"""

import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

INT8: Final = 2
INT16: Final = 4
INT32: Final = 6
REAL32: Final = 9
NAME_LENGTH: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter; `type` is its MAV_PARAM_TYPE."""

    name: str
    default: float
    type: int = REAL32
    minimum: float = -2147483648.0
    maximum: float = 2147483647.0


Firmware = tuple[int, int, int]
"""Major, minor and patch version."""
Read = tuple[str, Callable[[float], float]]
"""The name that a parameter has in a later firmware, and its value from that one's."""


def version_number(firmware: Firmware) -> int:
    """AUTOPILOT_VERSION.flight_sw_version of an official release."""
    return int.from_bytes(bytes((*firmware, 255)), "big")


class Parameters:
    """All parameters of a firmware with their values, in alphabetical order."""

    def __init__(
        self,
        table: Iterable[Parameter],
        values: Mapping[str, float],
        *,
        bytewise: bool,
        firmware: Firmware,
        renamed: Mapping[str, Read] | None = None,
    ) -> None:
        """Start from the defaults, some replaced.

        renamed: by the name that the simulation reads; the table has the firmware's own names.
        """
        self.firmware = firmware
        self._renamed = renamed or {}
        self.table = tuple(sorted(table, key=lambda parameter: parameter.name))
        self.index = {parameter.name: i for i, parameter in enumerate(self.table)}
        self.values: dict[str, float] = {p.name: p.default for p in self.table}
        self._bytewise = bytewise
        for name, value in values.items():
            self.set(name, value)

    def value(self, name: str) -> float:
        """Return a value; `KeyError` when there is no such parameter."""
        if name in self._renamed:
            name, read = self._renamed[name]
            return read(self.values[name])
        return self.values[name]

    def type(self, name: str) -> int:
        """Return a parameter's MAV_PARAM_TYPE."""
        return self.table[self.index[name]].type

    def set(self, name: str, value: float) -> float:
        """Set a value, rounded for an integer; `KeyError` unknown, `ValueError` out of range."""
        parameter = self.table[self.index[name]]
        if not parameter.minimum <= value <= parameter.maximum:
            raise ValueError(
                f"{name}: {value:g} is not between {parameter.minimum:g} and {parameter.maximum:g}"
            )
        stored = float(value) if parameter.type == REAL32 else round(value)
        self.values[name] = stored
        return stored

    def encoded(self, name: str) -> tuple[float, int]:
        """Return (param_value, param_type) as they travel."""
        value, kind = self.values[name], self.type(name)
        if self._bytewise and kind == INT32:
            return struct.unpack("<f", struct.pack("<i", int(value)))[0], kind
        return float(value), kind

    def decoded(self, param_value: float, param_type: int) -> float:
        """Undo `encoded`; in bytewise encoding, types other than INT32 are taken as numbers."""
        if self._bytewise and param_type == INT32:
            return int(struct.unpack("<i", struct.pack("<f", param_value))[0])
        return param_value
