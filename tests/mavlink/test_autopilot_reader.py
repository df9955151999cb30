"""The reader of `setup` beside the fake autopilots in lockstep: found, read, set while disarmed."""

from __future__ import annotations

import pytest

from moar_companion.companion.preflight.parameter_advice import (
    advices,
    mission_planner_text,
    qgroundcontrol_text,
)
from moar_companion.mavlink.autopilot_reader import AutopilotReader, Change, SetStatus
from moar_companion.mavlink.autopilots import PROFILES, profile
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.settings.config import LossCheck
from moar_companion.types import ARDUPILOT, PX4
from sitl.autopilot import FakeAutopilot, Options
from tests.copies import flown_once
from tests.vehicles import named_vehicle

LINK = "udp::14540"
STEP_S = 0.05


class Bench:
    """A reader beside a fake autopilot. lost: packets to the autopilot that are lost, by id."""

    def __init__(self, kind=PX4, **options):
        self.autopilot = FakeAutopilot(Options(autopilot=kind, **options))
        self.autopilot.step(5.0)
        self.autopilot.data_to_send()
        self.reader = AutopilotReader([LINK])
        self.now_s = 5.0
        self.deaf = False
        self.lost = set()
        self.sent = []
        self._codec = Codec(system_id=9, component_id=9)

    def run(self, condition, most_s=30.0):
        until_s = self.now_s + most_s
        while not condition() and self.now_s < until_s:
            self.now_s += STEP_S
            self.autopilot.step(self.now_s)
            for link, data in self.autopilot.data_to_send():
                if link == "companion" and not self.deaf:
                    self.reader.receive(LINK, data, self.now_s)
            self.reader.tick(self.now_s)
            for _, data in self.reader.data_to_send():
                messages = self._codec.receive(data)
                self.sent += messages
                if not any(message.get_type() in self.lost for message in messages):
                    self.autopilot.receive("companion", data)
        return condition()

    def set(self, *changes):
        self.reader.set(Change(name=name, value=value) for name, value in changes)
        assert self.run(lambda: not self.reader.setting)
        return [each.status for each in self.reader.results[-len(changes) :]]

    def sets(self):
        return [each for each in self.sent if each.get_type() == "PARAM_SET"]


@flown_once
def read(kind=PX4, **options):
    """A bench whose autopilot has been read."""
    bench = Bench(kind, **options)
    assert bench.run(lambda: bench.reader.done)
    return bench


def advice_of(bench, kind):
    return advices(
        profile(kind),
        bench.reader.parameters,
        named_vehicle("x500"),
        LossCheck.REFUSE,
        ground_station_received=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_what_is_advised_is_set_one_by_one_and_read_back(kind):
    bench = read(kind)
    found = advice_of(bench, kind)
    assert found
    results = bench.set(*((each.name, each.value) for each in found))
    assert results == [SetStatus.SET] * len(found)
    for each in found:
        assert bench.autopilot.parameter(each.name) == pytest.approx(each.value, rel=1e-6)
    again = read(kind, parameters={each.name: each.value for each in found})
    assert advice_of(again, kind) == []


def test_an_armed_autopilot_is_read_and_nothing_is_set():
    bench = read()
    assert bench.set(("COM_OF_LOSS_T", 0.5)) == [SetStatus.SET]
    arm(bench)
    before = len(bench.sets())
    assert bench.set(("COM_OBL_RC_ACT", 5.0), ("NAV_RCL_ACT", 1.0)) == [SetStatus.ARMED] * 2
    assert len(bench.sets()) == before
    assert bench.autopilot.parameter("COM_OBL_RC_ACT") == 0.0


@pytest.mark.slow
def test_nothing_is_set_while_no_heartbeat_tells_that_the_autopilot_is_disarmed():
    bench = read()
    bench.deaf = True
    bench.run(lambda: False, 3.0)
    assert bench.set(("COM_OF_LOSS_T", 0.5)) == [SetStatus.SILENT]
    assert bench.sets() == []


@pytest.mark.slow
def test_a_value_that_the_autopilot_does_not_take_is_reported():
    bench = read()
    assert bench.set(("COM_OBL_RC_ACT", 99.0)) == [SetStatus.REFUSED]
    assert bench.reader.results[-1].value == 0.0
    bench.lost = {"PARAM_SET"}
    assert bench.set(("COM_OF_LOSS_T", 0.5)) == [SetStatus.UNANSWERED]
    assert bench.autopilot.parameter("COM_OF_LOSS_T") == 1.0


def test_the_reader_sends_no_command_that_arms_or_moves():
    bench = read()
    bench.set(("COM_OF_LOSS_T", 0.5))
    commands = {each.command for each in bench.sent if each.get_type().startswith("COMMAND")}
    assert commands <= {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}
    types = {each.get_type() for each in bench.sent}
    assert not {each for each in types if "SETPOINT" in each or "TARGET" in each or "MODE" in each}


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_advised_values_are_in_the_remedy(kind):
    """A report and an offered file never contradict each other."""
    for rule in PROFILES[kind].rules:
        if rule.advised is None or callable(rule.advised) or callable(rule.remedy):
            continue
        assert f"{rule.advised:g}" in rule.remedy, rule.parameter


def test_without_a_report_there_is_no_advice():
    known = profile(PX4)
    silent = Parameters(dict.fromkeys(known.setup_parameters))
    vehicle = named_vehicle("x500")
    assert advices(known, silent, vehicle, LossCheck.REFUSE, ground_station_received=False) == []


def test_files_of_parameters_are_read_as_ground_stations_do():
    """QGroundControl: five columns; Mission Planner: two; a line that begins with # is skipped."""
    bench = read()
    found = advice_of(bench, PX4)
    text = qgroundcontrol_text(found, bench.reader.autopilot, bench.reader.types)
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    types = {"COM_OF_LOSS_T": "9", "COM_OBL_RC_ACT": "6", "COM_RC_OVERRIDE": "6"}
    assert [row[:2] for row in rows] == [["1", "1"]] * len(found)
    assert {row[2]: row[4] for row in rows}.items() >= types.items()
    assert [float(row[3]) for row in rows] == [each.value for each in found]
    text = mission_planner_text(found)
    rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert rows == [[each.name, f"{each.value:g}"] for each in found]
    assert text.count("# ") == len(found)
    assert "NOTE:" not in text


def arm(bench):
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    command = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for message in (beat, command):
        bench.autopilot.receive("gcs", message.pack(codec))
        codec.seq += 1
    status = bench.reader.telemetry.autopilot
    assert bench.run(lambda: bench.autopilot.truth.armed, 5.0), status
    assert bench.run(lambda: bench.reader.telemetry.autopilot.armed, 3.0)
