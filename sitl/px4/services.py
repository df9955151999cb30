"""Constant answers: versions and the list of modes, as recorded from PX4 v1.17.0."""

from functools import cache
from typing import Final

from sitl.parameters import Firmware, version_number
from sitl.wire import layout

_GIT: Final = (0, 0, 0, 196, 209, 42, 241, 214)
_MODES: Final = (
    (0x10000, 0, 1, "Manual"), (0x20000, 4, 0, ""), (0x30000, 1, 0, ""),
    (0x4040000, 6, 1, ""), (0x3040000, 0, 1, "Hold"), (0x5040000, 5, 1, ""),
    (0x2030000, 0, 1, "Position Slow"), (0xB0000, 0, 0, "Altitude Cruise"),
    (0x50000, 0, 1, "Acro"), (0xA0000, 0, 3, "Termination"), (0x60000, 0, 1, "Offboard"),
    (0x70000, 0, 1, "Stabilized"), (0x2040000, 8, 1, ""), (0x6040000, 7, 1, ""),
    (0x8040000, 0, 1, "Follow Target"), (0x9040000, 0, 1, "Precision Landing"),
    (0x1030000, 2, 1, ""), (0xA040000, 0, 1, "VTOL Takeoff"),
    *((0x0B040000 + (i << 24), 0, 2, "(Mode not available)") for i in range(8)),
)  # fmt: skip
AVAILABLE_MODES: Final = tuple(
    layout("AVAILABLE_MODES").payload(
        custom_mode=custom,
        properties=properties,
        number_modes=len(_MODES),
        mode_index=index,
        standard_mode=standard,
        mode_name=name.encode(),
    )
    for index, (custom, standard, properties, name) in enumerate(_MODES, 1)
)


@cache
def autopilot_version(firmware: Firmware) -> bytes:
    """Return AUTOPILOT_VERSION's payload."""
    version = version_number(firmware)
    return layout("AUTOPILOT_VERSION").payload(
        capabilities=59647,
        flight_sw_version=version,
        middleware_sw_version=version,
        os_sw_version=101854463,
        board_version=1,
        flight_custom_version=_GIT,
        middleware_custom_version=_GIT,
        os_custom_version=(0,) * 8,
        vendor_id=0,
        product_id=0,
        uid=5283920058631409231,
        uid2=(0,) * 18,
    )


@cache
def protocol_version() -> bytes:
    """Return PROTOCOL_VERSION's payload: MAVLink 2, as far back as 1."""
    return layout("PROTOCOL_VERSION").payload(
        version=200,
        min_version=100,
        max_version=200,
        spec_version_hash=b"",
        library_version_hash=b"",
    )
