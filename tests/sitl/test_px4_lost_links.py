"""A lost ground station and lost sticks, after the source of PX4 v1.17.0 and real flights."""

import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

OFFBOARD = 6 << 16
LINK_ACTIONS = [(1, 0.0, "AUTO.LOITER"), (2, 5.0, "AUTO.RTL"), (3, 5.0, "AUTO.LAND")]
"""NAV_DLL_ACT or NAV_RCL_ACT, for how long it holds first, the mode in the end."""


def lose_ground_station(airborne):
    airborne.ground_station_alive = False


def lose_sticks(airborne):
    """The last message of a joystick."""
    airborne.gcs.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))


def assert_it_was_lost(airborne, after_s, hold_s, mode):
    """In OFFBOARD until `after_s`, then in the failsafe."""
    airborne.run(after_s - 1.5)
    assert airborne.truth.mode == "OFFBOARD"
    airborne.run(2.7)
    assert airborne.truth.mode == ("AUTO.LOITER" if hold_s else mode)
    assert airborne.heartbeat().system_status == 5
    airborne.run(hold_s)
    assert airborne.truth.mode == mode


@pytest.mark.parametrize(("action", "hold_s", "mode"), LINK_ACTIONS)
def test_a_lost_ground_station_ends_offboard_by_nav_dll_act(airborne, action, hold_s, mode):
    airborne.vehicle.set_parameter("NAV_DLL_ACT", action)
    lose_ground_station(airborne)
    assert_it_was_lost(airborne, 10.0, hold_s, mode)


@pytest.mark.parametrize(("action", "hold_s", "mode"), LINK_ACTIONS)
def test_lost_sticks_end_offboard_by_nav_rcl_act(airborne, action, hold_s, mode):
    airborne.vehicle.set_parameter("NAV_RCL_ACT", action)
    airborne.vehicle.set_parameter("COM_RC_LOSS_T", 3.0)
    lose_sticks(airborne)
    assert_it_was_lost(airborne, 3.0, hold_s, mode)


@pytest.mark.parametrize(
    ("values", "lose"),
    [
        ({"NAV_DLL_ACT": 0}, lose_ground_station),
        ({"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 4}, lose_ground_station),
        ({"NAV_RCL_ACT": 2, "COM_RCL_EXCEPT": 4}, lose_sticks),
        ({"NAV_RCL_ACT": 2, "COM_RC_IN_MODE": 4}, lose_sticks),
    ],
)
def test_offboard_goes_on_without_a_link_that_is_excepted(airborne, values, lose):
    for name, value in values.items():
        airborne.vehicle.set_parameter(name, value)
    lose(airborne)
    airborne.run(13.0)
    assert airborne.truth.mode == "OFFBOARD"
    assert airborne.heartbeat().system_status == 4


def test_after_link_recovery_the_hold_stays_until_a_mode_is_chosen(airborne):
    airborne.vehicle.set_parameter("NAV_DLL_ACT", 1)
    lose_ground_station(airborne)
    airborne.run(12.0)
    airborne.ground_station_alive = True
    airborne.run(3.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.heartbeat().system_status == 5
    assert airborne.mode(airborne.companion, (6, 0))[-1] == 0
    airborne.run(1.0)
    assert airborne.truth.mode == "OFFBOARD"
    lose_ground_station(airborne)  # a second time
    airborne.run(12.0)
    assert airborne.truth.mode == "AUTO.LOITER"


def test_a_mode_that_is_chosen_while_a_link_is_lost_is_flown(airborne):
    airborne.vehicle.set_parameter("NAV_RCL_ACT", 1)
    lose_sticks(airborne)
    airborne.run(2.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.mode(airborne.companion, (6, 0))[-1] == 0
    airborne.run(3.0)
    assert airborne.truth.mode == "OFFBOARD"
    assert airborne.heartbeat().system_status == 4


def test_a_landing_goes_on_without_a_ground_station(airborne):
    airborne.vehicle.set_parameter("NAV_DLL_ACT", 1)
    assert airborne.mode(airborne.gcs, (4, 6))[-1] == 0
    lose_ground_station(airborne)
    airborne.run(12.0)
    assert airborne.truth.mode == "AUTO.LAND"


def test_the_event_of_a_lost_link_names_the_lost_link(airborne):
    airborne.vehicle.set_parameter("NAV_DLL_ACT", 1)
    lose_ground_station(airborne)
    airborne.run(12.0)
    hold, ground_station = 5, 2
    packed = struct.pack("<IBB", OFFBOARD, hold, ground_station)
    received = airborne.companion.of("UNKNOWN_410") or airborne.companion.of("EVENT")
    events = [event.get_msgbuf() for event in received]
    assert sum(packed in event for event in events) == 1


def test_with_an_action_on_ground_station_loss_arming_needs_a_ground_station(flight):
    flight.vehicle.set_parameter("NAV_DLL_ACT", 1)
    flight.ground_station_alive = False
    flight.run(6.0)
    assert flight.ask(flight.companion, 400, 1) == [1]
    flight.ground_station_alive = True
    flight.run(1.5)
    assert flight.ask(flight.companion, 400, 1) == [0]
