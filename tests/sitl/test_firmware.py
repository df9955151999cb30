"""The firmware that the fake reports, and the names and units of its parameters."""

import pytest

from sitl.autopilot import FakeAutopilot, Options
from sitl.manners import KINDS
from sitl.parameters import version_number
from sitl.shell import read_arguments

ARDUPILOT, PX4 = KINDS["ardupilot"], KINDS["px4"]


@pytest.mark.parametrize(
    ("firmware", "name", "value", "speed_mps"),
    [
        ((4, 6, 3), "WPNAV_SPEED", 300.0, 3.0),
        ((4, 7, 0), "WP_SPD", 3.0, 3.0),
        ((4, 7, 1), "WP_SPD", 4.5, 4.5),
    ],
)
def test_a_parameter_is_set_in_the_unit_of_the_firmware_and_flown(firmware, name, value, speed_mps):
    vehicle = FakeAutopilot(
        Options(autopilot="ardupilot", firmware=firmware, parameters={name: value})
    )
    assert vehicle.parameter(name) == value
    assert vehicle.manner.control_loop.gains.speed_mps == speed_mps


def test_4_7_has_other_names_and_one_more_parameter_and_4_7_1_changed_two_again():
    old, new, newest = (
        set(ARDUPILOT.parameters({}, release).values)
        for release in ((4, 6, 3), (4, 7, 0), (4, 7, 1))
    )
    assert len(new) == len(newest) == len(old) + 1
    assert {"WPNAV_ACCEL", "RTL_ALT", "ANGLE_MAX", "SYSID_MYGCS"} <= old - new
    assert {"WP_ACC", "RTL_ALT_M", "ATC_ANGLE_MAX", "MAV_GCS_SYSID"} <= new - old
    assert newest - new == {"PSC_NE_JERK", "PSC_D_JERK"}
    assert new - newest == {"PSC_JERK_NE", "PSC_JERK_D"}


def test_px4_1_18_has_one_parameter_for_the_take_over_by_the_sticks():
    names = set(PX4.parameters({}, (1, 18, 0)).values)
    assert "MAN_OVERRIDE_SPD" in names
    assert not {"COM_RC_OVERRIDE", "COM_RC_STICK_OV"} & names
    assert PX4.parameters({}, (1, 18, 0)).value("COM_RC_OVERRIDE") == 3.0
    off = PX4.parameters({"MAN_OVERRIDE_SPD": -1.0}, (1, 18, 0))
    assert off.value("COM_RC_OVERRIDE") == 0.0


def test_the_measured_firmware_is_the_default_and_its_number_as_recorded():
    assert version_number(PX4.firmware) == 17891583
    assert version_number(ARDUPILOT.firmware) == 67503103
    assert read_arguments([]).options.firmware is None
    assert read_arguments(["--firmware", "1.18.0"]).options.firmware == (1, 18, 0)
