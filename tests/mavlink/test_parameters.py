"""Parameters read by name: requests, values and missing parameters."""

from __future__ import annotations

import struct
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.parameters import ParameterRequests
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

from .peer import Peer
from .story import of_type

UINT8, INT8, INT16, INT32, REAL32 = 1, 2, 4, 6, 9


def value_message(name, value, kind=REAL32, *, mavlink1=False):
    """PARAM_VALUE as the codec gives it; the value as a float on the wire."""
    data = Peer(1, 1).pack(
        mavlink.MAVLink_param_value_message(name.encode(), value, kind, 900, 7), mavlink1=mavlink1
    )
    (message,) = Codec(system_id=1, component_id=195).receive(data)
    return message


class Reading:
    """Requests against a clock in steps of 20 ms, and an autopilot that answers some of them."""

    def __init__(self, *names):
        self.requests = ParameterRequests()
        self.requests.start(profile(UNKNOWN), 99.0)
        self.requests.want(names)
        self.now_s = 100.0
        self.asked = []
        self.has = {}
        self.drop = 0
        """Requests still to be lost."""

    def run(self, seconds):
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            name = self.requests.next_request(self.now_s)
            if name is None:
                continue
            self.asked.append(name)
            if self.drop:
                self.drop -= 1
            elif name in self.has:
                self.requests.handle(value_message(name, self.has[name]), PX4)


def test_each_parameter_is_requested_once_where_the_autopilot_answers():
    reading = Reading("A", "B", "C")
    reading.has = {"A": 1.0, "B": 2.0, "C": 3.0}
    reading.run(5.0)
    assert reading.asked == ["A", "B", "C"]
    assert reading.requests.values == {"A": 1.0, "B": 2.0, "C": 3.0}


def test_a_parameter_whose_answer_is_lost_is_requested_again():
    reading = Reading("A")
    reading.has = {"A": 1.0}
    reading.drop = 2
    reading.run(0.4)
    assert reading.requests.values == {}  # without an answer, but not yet missing
    reading.run(2.0)
    assert reading.asked == ["A"] * 3
    assert reading.requests.values == {"A": 1.0}


def test_a_parameter_never_reported_is_missing_and_delays_no_other():
    reading = Reading("NONE1", "NONE2", "NONE3", "NONE4", "A")
    reading.has = {"A": 1.0}
    reading.run(0.7)
    assert reading.requests.values == {"A": 1.0}
    reading.run(5.0)
    assert reading.requests.values == {"A": 1.0} | dict.fromkeys(
        ("NONE1", "NONE2", "NONE3", "NONE4")
    )
    assert set(Counter(reading.asked).values()) == {1, 6}  # then one a second
    reading.run(4.0)
    asked = len(reading.asked)
    reading.run(8.0)
    assert len(reading.asked) - asked == 8


def test_at_most_four_requests_await_an_answer_at_once():
    reading = Reading(*"ABCDEFGH")
    reading.run(0.46)
    assert reading.asked == ["A", "B", "C", "D"]


def test_a_missing_parameter_counts_when_it_is_reported_later():
    reading = Reading("A")
    reading.run(5.0)
    assert reading.requests.values == {"A": None}
    reading.requests.handle(value_message("A", 4.0), PX4)
    assert reading.requests.values == {"A": 4.0}


def test_a_value_set_by_another_system_replaces_the_old_one():
    reading = Reading("A")
    reading.requests.handle(value_message("A", 1.0), PX4)
    reading.requests.handle(value_message("A", 1.0), PX4)
    reading.requests.handle(value_message("A", 2.0), PX4)
    assert reading.requests.values == {"A": 2.0}


def test_a_parameter_that_is_not_wanted_is_ignored():
    reading = Reading("A")
    reading.requests.handle(value_message("AB", 1.0), PX4)
    assert reading.requests.values == {}


def test_after_a_restart_all_parameters_are_requested_again():
    reading = Reading("A", "NONE")
    reading.has = {"A": 1.0}
    reading.run(5.0)
    reading.requests.start(profile(UNKNOWN), reading.now_s)
    assert reading.requests.values == {}
    reading.has = {"A": 2.0, "NONE": 3.0}
    reading.run(1.0)
    assert reading.requests.values == {"A": 2.0, "NONE": 3.0}


@given(value=st.integers(-(2**31), 2**31 - 1), mavlink1=st.booleans())
def test_every_integer_of_px4_survives_its_encoding(value, mavlink1):
    message = value_message("A", 0.0, INT32, mavlink1=mavlink1)
    start = 6 if mavlink1 else 10
    message.get_msgbuf()[start : start + 4] = struct.pack("<i", value)
    requests = ParameterRequests()
    requests.want(["A"])
    requests.handle(message, PX4)
    assert requests.values == {"A": float(value)}


@pytest.mark.parametrize(
    ("kind", "param_type", "on_wire", "value"),
    [
        (PX4, REAL32, 0.5, 0.5),
        (PX4, INT32, struct.unpack("<f", struct.pack("<i", 5))[0], 5.0),
        (ARDUPILOT, REAL32, 3.0, 3.0),
        (ARDUPILOT, INT8, 1.0, 1.0),
        (ARDUPILOT, INT16, -7.0, -7.0),
        (ARDUPILOT, INT32, 2752772.0, 2752772.0),
        (ARDUPILOT, REAL32, float("nan"), None),
    ],
)
def test_each_autopilot_has_its_own_encoding(kind, param_type, on_wire, value):
    requests = ParameterRequests()
    requests.want(["A"])
    requests.handle(value_message("A", on_wire, param_type), kind)
    assert requests.values == {"A": value}


# In a session


def test_a_session_requests_parameters_of_the_autopilot_alone_once_received(story, autopilot):
    story.session.requests.want_parameters(["COM_OF_LOSS_T"])
    assert of_type(story.run(2.0), "PARAM_REQUEST_READ") == []
    story.meet(autopilot)
    sent = [item for item in story.run(0.1) if item[2].get_type() == "PARAM_REQUEST_READ"]
    assert [link for _, link, _ in sent] == ["serial"]
    request = sent[0][2]
    assert (request.target_system, request.target_component) == (1, 1)
    assert (request.param_id, request.param_index) == ("COM_OF_LOSS_T", -1)


def test_parameters_are_taken_from_the_autopilot_on_its_own_link_alone(story, autopilot, peer):
    story.session.requests.want_parameters(["A"])
    story.meet(autopilot)
    value = {"param_id": b"A", "param_type": REAL32, "param_count": 1, "param_index": 0}
    story.handle(peer(1, 195).send("PARAM_VALUE", param_value=1.0, **value))
    story.handle(peer(2, 1).send("PARAM_VALUE", param_value=1.0, **value))
    story.handle(autopilot.send("PARAM_VALUE", param_value=1.0, **value), link="network")
    assert story.session.requests.parameters == {}
    story.handle(autopilot.send("PARAM_VALUE", param_value=2.0, **value))
    assert story.session.requests.parameters == {"A": 2.0}


def test_only_a_reported_version_lacks_parameters_and_a_name_that_is_answered_shows_no_version():
    """ArduCopter has FENCE_AUTOENABLE from 4.6 on, and WPNAV_ACCEL until 4.7."""
    requests = ParameterRequests()
    requests.start(profile(ARDUPILOT), 0.0)
    requests.want(["WP_ACC", "FENCE_AUTOENABLE"])
    requests.handle(value_message("WPNAV_ACCEL", 250.0), ARDUPILOT)
    assert requests.values == {"WP_ACC": 2.5}
    assert "FENCE_AUTOENABLE" in set(requests.requests(1.0))
    requests.learn_release((4, 5, 7))
    assert requests.values == {"WP_ACC": 2.5, "FENCE_AUTOENABLE": 0.0}


def test_the_version_is_requested_until_it_arrives(story, autopilot):
    def asked(seconds):
        return sum(
            (message.command, message.param1) == (512, 148)
            for message in of_type(story.run(seconds), "COMMAND_LONG")
        )

    story.meet(autopilot)
    assert asked(0.5) == 1
    assert asked(1.0) == 1
    version = mavlink.MAVLink_autopilot_version_message(
        0, 0x040701FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
    )
    story.handle(autopilot.pack(version))
    assert asked(3.0) == 0


@pytest.mark.uncounted
@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "values"),
    [
        (
            "px4/g1_routing.gcs.tlog",
            {
                "COM_OF_LOSS_T": 1.0,
                "COM_OBL_RC_ACT": 0.0,
                "COM_FLTMODE1": -1.0,
                "CAL_ACC0_ID": 1310988.0,
                "BAT_CRIT_THR": pytest.approx(0.07),
            },
        ),
        (
            "ardupilot/g1_routing.gcs.tlog",
            {
                "GUID_TIMEOUT": 3.0,
                "FS_OPTIONS": 16.0,
                "SYSID_MYGCS": 255.0,
                "RTL_ALT_M": 15.0,
                "FS_EKF_THRESH": pytest.approx(0.8),
            },
        ),
    ],
)
def test_parameter_lists_of_recorded_autopilots_are_read(story, recording, name, values):
    story.session.requests.want_parameters(values)
    for time_s, packet in recording(name):
        story.now_s = time_s
        story.handle(packet)
    assert story.session.requests.parameters == values


@pytest.mark.parametrize(
    ("autopilot_id", "names"),
    [
        pytest.param(mavlink.MAV_AUTOPILOT_PX4, {"PWM_MAIN_MIN1", "PWM_MAIN_MAX1"}, id="PX4"),
        pytest.param(
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, {"MOT_PWM_MIN", "MOT_PWM_MAX"}, id="ArduPilot"
        ),
    ],
)
def test_the_range_of_motor_outputs_is_requested_once_outputs_are_received(
    story, autopilot, autopilot_id, names
):
    story.handle(autopilot.heartbeat(autopilot=autopilot_id))
    assert not of_type(story.run(0.2), "PARAM_REQUEST_READ")
    zeros = {f"servo{number}_raw": 0 for number in range(5, 9)}
    outputs = {f"servo{number}_raw": 1500 for number in range(1, 5)}
    story.handle(autopilot.send("SERVO_OUTPUT_RAW", time_usec=0, port=0, **outputs, **zeros))
    asked = of_type(story.run(0.2), "PARAM_REQUEST_READ")
    assert {message.param_id for message in asked} == names
