from __future__ import annotations

import pytest

from moar_companion.mavlink import modes
from moar_companion.mavlink.dialect import mavlink
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN


@pytest.mark.parametrize(
    ("kind", "custom_mode", "name", "ours"),
    [
        (PX4, 0x00010000, "MANUAL", False),
        (PX4, 0x00020000, "ALTCTL", False),
        (PX4, 0x00030000, "POSCTL", False),
        (PX4, 0x01030000, "ORBIT", False),
        (PX4, 0x00060000, "OFFBOARD", True),
        (PX4, 0x02040000, "TAKEOFF", False),
        (PX4, 0x03040000, "HOLD", False),
        (PX4, 0x04040000, "MISSION", False),
        (PX4, 0x05040000, "RTL", False),
        (PX4, 0x06040000, "LAND", False),
        (PX4, 0x00FF0000, "MODE 0x00FF0000", False),
        (PX4, 4, "MODE 0x00000004", False),
        (ARDUPILOT, 0, "STABILIZE", False),
        (ARDUPILOT, 4, "GUIDED", True),
        (ARDUPILOT, 5, "LOITER", False),
        (ARDUPILOT, 20, "GUIDED_NOGPS", False),
        (ARDUPILOT, 99, "MODE 0x00000063", False),
        (UNKNOWN, 4, "MODE 0x00000004", False),
    ],
)
def test_a_mode_has_its_name_and_only_offboard_and_guided_take_setpoints(
    kind, custom_mode, name, ours
):
    assert modes.mode_name(kind, custom_mode) == name
    assert modes.is_ours(kind, custom_mode) is ours


def test_returns_landings_and_fence_stops_are_homeward_modes():
    homeward = [0x05040000, 0x06040000, 0x09040000, 0x000A0000]
    assert all(modes.is_homeward(PX4, mode) for mode in homeward)
    assert not any(modes.is_homeward(PX4, mode) for mode in (0x03040000, 0x00030000, 0x00060000))
    assert all(modes.is_homeward(ARDUPILOT, mode) for mode in (6, 9, 17, 21, 27))
    assert not any(modes.is_homeward(ARDUPILOT, mode) for mode in (0, 2, 4, 5, 16))


@pytest.mark.parametrize(
    ("vehicle", "custom_mode", "name"),
    [
        (mavlink.MAV_TYPE_FIXED_WING, 11, "RTL"),
        (mavlink.MAV_TYPE_VTOL_QUADROTOR, 4, "ACRO"),
        (mavlink.MAV_TYPE_GROUND_ROVER, 4, "HOLD"),
        (mavlink.MAV_TYPE_SUBMARINE, 19, "MANUAL"),
        (mavlink.MAV_TYPE_SUBMARINE, 22, "MODE 0x00000016"),
        (mavlink.MAV_TYPE_HEXAROTOR, 4, "GUIDED"),
    ],
)
def test_other_vehicles_of_ardupilot_have_other_mode_numbers(vehicle, custom_mode, name):
    assert modes.mode_name(ARDUPILOT, custom_mode, vehicle) == name
    assert modes.is_ours(ARDUPILOT, custom_mode, vehicle) is (name == "GUIDED")
    assert modes.is_homeward(ARDUPILOT, custom_mode, vehicle) is (name == "RTL")


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_only_a_hovering_vehicle_takes_setpoints(kind):
    ours = 0x00060000 if kind is PX4 else 4
    quadrotor, plane, hexarotor, vtol, submarine = 2, 1, 13, 20, 12
    assert modes.is_ours(kind, ours, quadrotor)
    assert modes.is_ours(kind, ours, hexarotor)
    assert not any(modes.is_ours(kind, ours, other) for other in (plane, vtol, submarine))


def test_a_system_status_of_critical_or_worse_is_a_failsafe():
    assert [modes.is_failsafe(status) for status in range(9)] == [False] * 5 + [True] * 4


def test_mode_requests_have_the_parameters_measured_on_real_autopilots():
    assert modes.own_mode_parameters(PX4, armed=False) == (1, 6, 0)
    assert modes.own_mode_parameters(PX4, armed=True) == (129, 6, 0)
    assert modes.land_parameters(PX4, armed=True) == (129, 4, 6)
    assert modes.own_mode_parameters(ARDUPILOT, armed=True) == (1, 4, 0)
    assert modes.land_parameters(ARDUPILOT, armed=True) == (1, 9, 0)
    assert modes.own_mode_parameters(UNKNOWN, armed=True) is None
    assert modes.land_parameters(UNKNOWN, armed=True) is None
