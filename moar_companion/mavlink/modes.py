"""Flight modes: an autopilot's custom_mode to its name, and the mode that follows setpoints.

Numbers measured on PX4 v1.17 and ArduCopter 4.6; others are from PX4's `px4_custom_mode.h` and
ArduCopter's `mode.h`.
"""

from __future__ import annotations

from ..types import AutopilotKind
from .dialect import mavlink

_PX4_MAIN = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
    11: "ALTITUDE_CRUISE",
}
_PX4_AUTO = {
    1: "READY",
    2: "TAKEOFF",
    3: "HOLD",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
_PX4_POSCTL = {1: "ORBIT", 2: "POSCTL_SLOW"}
_COPTER = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}

_QUADROTOR = int(mavlink.MAV_TYPE_QUADROTOR)
_MULTIROTORS = frozenset(
    {
        _QUADROTOR,
        int(mavlink.MAV_TYPE_COAXIAL),
        int(mavlink.MAV_TYPE_HELICOPTER),
        int(mavlink.MAV_TYPE_HEXAROTOR),
        int(mavlink.MAV_TYPE_OCTOROTOR),
        int(mavlink.MAV_TYPE_TRICOPTER),
        int(mavlink.MAV_TYPE_DODECAROTOR),
        int(mavlink.MAV_TYPE_DECAROTOR),
        int(mavlink.MAV_TYPE_GENERIC_MULTIROTOR),
    }
)
"""MAV_TYPEs that can hover."""
_MOTORS = {
    _QUADROTOR: 4,
    int(mavlink.MAV_TYPE_HEXAROTOR): 6,
    int(mavlink.MAV_TYPE_OCTOROTOR): 8,
    int(mavlink.MAV_TYPE_DECAROTOR): 10,
    int(mavlink.MAV_TYPE_DODECAROTOR): 12,
}


def _names(enum: str) -> dict[int, str]:
    """Names of one of pymavlink's enums of modes."""
    names = {
        number: item.name.removeprefix(f"{enum}_") for number, item in mavlink.enums[enum].items()
    }
    return {number: name for number, name in names.items() if name != "ENUM_END"}


_OTHER_VEHICLES = {
    int(mavlink.MAV_TYPE_FIXED_WING): _names("PLANE_MODE"),
    **dict.fromkeys(
        range(int(mavlink.MAV_TYPE_VTOL_DUOROTOR), int(mavlink.MAV_TYPE_VTOL_RESERVED5) + 1),
        _names("PLANE_MODE"),
    ),
    int(mavlink.MAV_TYPE_GROUND_ROVER): _names("ROVER_MODE"),
    int(mavlink.MAV_TYPE_SURFACE_BOAT): _names("ROVER_MODE"),
    int(mavlink.MAV_TYPE_SUBMARINE): _names("SUB_MODE"),
}
"""Modes of ArduPilot's vehicles other than copters, by MAV_TYPE."""

_HOMEWARD = frozenset(
    {
        "RTL",
        "LAND",
        "PRECLAND",
        "TERMINATION",
        "BRAKE",
        "SMART_RTL",
        "AUTO_RTL",
        "AVOID_ADSB",
    }
)

_PX4_OFFBOARD = (6, 0)
_PX4_LAND = (4, 6)
_COPTER_GUIDED = 4
_COPTER_LAND = 9
_CUSTOM_MODE = 1
_ARMED = 128


def mode_name(kind: AutopilotKind, custom_mode: int, vehicle_type: int = _QUADROTOR) -> str:
    """Name of the mode as its ground stations show it; an unknown mode as its number.

    vehicle_type: MAV_TYPE; ArduPilot numbers modes of planes, rovers and submarines differently.
    """
    name: str | None = None
    if kind is AutopilotKind.PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if main == 4:
            name = _PX4_AUTO.get(sub)
        elif main == 3 and sub:
            name = _PX4_POSCTL.get(sub)
        else:
            name = _PX4_MAIN.get(main)
    elif kind is AutopilotKind.ARDUPILOT and vehicle_type in _OTHER_VEHICLES:
        name = _OTHER_VEHICLES[vehicle_type].get(custom_mode)
    elif kind is AutopilotKind.ARDUPILOT:
        name = _COPTER.get(custom_mode)
    return name or f"MODE 0x{custom_mode:08X}"


def is_ours(kind: AutopilotKind, custom_mode: int, vehicle_type: int = _QUADROTOR) -> bool:
    """Returns True if the autopilot follows setpoints: PX4's OFFBOARD, ArduPilot's GUIDED.

    base_mode's guided bit is no criterion: ArduPilot sets it in many modes. False for planes,
    rovers and submarines in every mode: they would not hold a setpoint at rest.
    """
    if not is_multirotor(vehicle_type):
        return False
    if kind is AutopilotKind.PX4:
        return (custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF) == _PX4_OFFBOARD
    return kind is AutopilotKind.ARDUPILOT and custom_mode == _COPTER_GUIDED


def is_multirotor(vehicle_type: int) -> bool:
    """Returns True if a vehicle of this MAV_TYPE hovers, leaning against the wind."""
    return vehicle_type in _MULTIROTORS


def motor_count(vehicle_type: int) -> int | None:
    """Number of motors of a vehicle of this MAV_TYPE; None where the type does not define it."""
    return _MOTORS.get(vehicle_type)


def is_homeward(kind: AutopilotKind, custom_mode: int, vehicle_type: int = _QUADROTOR) -> bool:
    """Returns True if the autopilot itself returns, lands, or stops for a fence or an aircraft.

    Only the pilot may end these modes: ArduPilot lets a companion end any failsafe, and its fence
    acts without system_status 5.
    """
    return mode_name(kind, custom_mode, vehicle_type) in _HOMEWARD


def is_failsafe(system_status: int) -> bool:
    """Returns True if MAV_STATE reports an active failsafe: CRITICAL or worse.

    Measured: PX4's POSCTL with status 5 is offboard loss, with status 4 the pilot's choice.
    ArduPilot reports status 5 in any mode, even for a failsafe whose action is none.
    """
    return system_status >= int(mavlink.MAV_STATE_CRITICAL)


def own_mode_parameters(kind: AutopilotKind, *, armed: bool) -> tuple[int, int, int] | None:
    """First parameters of MAV_CMD_DO_SET_MODE for OFFBOARD or GUIDED; None: kind unknown."""
    if kind is AutopilotKind.PX4:
        return _px4_parameters(_PX4_OFFBOARD, armed=armed)
    if kind is AutopilotKind.ARDUPILOT:
        return _CUSTOM_MODE, _COPTER_GUIDED, 0
    return None


def land_parameters(kind: AutopilotKind, *, armed: bool) -> tuple[int, int, int] | None:
    """First parameters of MAV_CMD_DO_SET_MODE for LAND; None: kind unknown."""
    if kind is AutopilotKind.PX4:
        return _px4_parameters(_PX4_LAND, armed=armed)
    if kind is AutopilotKind.ARDUPILOT:
        return _CUSTOM_MODE, _COPTER_LAND, 0
    return None


def _px4_parameters(mode: tuple[int, int], *, armed: bool) -> tuple[int, int, int]:
    # PX4 takes base_mode with the armed bit as it is: 129 in flight, 1 on the ground.
    return _CUSTOM_MODE | (_ARMED if armed else 0), *mode
