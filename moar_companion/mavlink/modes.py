"""Flight modes: an autopilot's custom_mode to its name, and the mode that follows setpoints.

The numbers and names are in the autopilot's profile (`autopilots`).
"""

from __future__ import annotations

from ..types import AutopilotKind
from .autopilots import profile
from .autopilots.profile import Profile
from .dialect import mavlink

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
_CUSTOM_MODE = 1
_ARMED = 128


def mode_name(kind: AutopilotKind, custom_mode: int, vehicle_type: int = _QUADROTOR) -> str:
    """Name of the mode as its ground stations show it; an unknown mode as its number.

    vehicle_type: MAV_TYPE; ArduPilot numbers modes of planes, rovers and submarines differently.
    """
    autopilot = profile(kind)
    enum = autopilot.mode_enums.get(vehicle_type)
    name = autopilot.mode_name(custom_mode) if enum is None else _enum_name(enum, custom_mode)
    return name or f"MODE 0x{custom_mode:08X}"


def _enum_name(enum: str, custom_mode: int) -> str | None:
    """Name in one of MAVLink's enums of modes; None if it has no such mode."""
    item = mavlink.enums[enum].get(custom_mode)
    name = None if item is None else item.name.removeprefix(f"{enum}_")
    return None if name == "ENUM_END" else name


def is_ours(kind: AutopilotKind, custom_mode: int, vehicle_type: int = _QUADROTOR) -> bool:
    """Returns True if the autopilot follows setpoints: PX4's OFFBOARD, ArduPilot's GUIDED.

    base_mode's guided bit is no criterion: ArduPilot sets it in many modes. False for planes,
    rovers and submarines in every mode: they would not hold a setpoint at rest.
    """
    return is_multirotor(vehicle_type) and profile(kind).is_own_mode(custom_mode)


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
    return mode_name(kind, custom_mode, vehicle_type) in profile(kind).homeward_modes


def is_failsafe(system_status: int) -> bool:
    """Returns True if MAV_STATE reports an active failsafe: CRITICAL or worse.

    Measured: PX4's POSCTL with status 5 is offboard loss, with status 4 the pilot's choice.
    ArduPilot reports status 5 in any mode, even for a failsafe whose action is none.
    """
    return system_status >= int(mavlink.MAV_STATE_CRITICAL)


def own_mode_parameters(kind: AutopilotKind, *, armed: bool) -> tuple[int, int, int] | None:
    """First parameters of MAV_CMD_DO_SET_MODE for OFFBOARD or GUIDED; None: kind unknown."""
    return _mode_request(profile(kind), profile(kind).own_mode_numbers, armed=armed)


def land_parameters(kind: AutopilotKind, *, armed: bool) -> tuple[int, int, int] | None:
    """First parameters of MAV_CMD_DO_SET_MODE for LAND; None: kind unknown."""
    return _mode_request(profile(kind), profile(kind).land_mode_numbers, armed=armed)


def _mode_request(
    autopilot: Profile, numbers: tuple[int, int] | None, *, armed: bool
) -> tuple[int, int, int] | None:
    if numbers is None:
        return None
    base_mode = _CUSTOM_MODE | (_ARMED if armed and autopilot.armed_in_mode_request else 0)
    return base_mode, *numbers
