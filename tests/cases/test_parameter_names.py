"""Parameters by the names and units of each release: read, flown, judged by `check`."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.preflight.findings import Level
from moar_companion.mavlink.autopilots import PROFILES, profile
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.parameters import ParameterRequests
from moar_companion.types import ARDUPILOT, Mission

from ..companion.desk import EXIT, INSPECTION, TEMPORARILY_REJECTED, Desk
from ..flights.judging import true_places
from ..flights.lockstep import hovering
from ..flights.operator import ACCEPTED, DENIED, Manner
from ..mavlink.peer import Peer
from ..preflight.test_aircraft_check import VEHICLE, Look

OLD = {"WPNAV_ACCEL": 50.0, "RTL_ALT": 1500.0, "ANGLE_MAX": 3000.0, "PSC_JERK_XY": 5.0}
NEW = {"WP_ACC": 0.5, "RTL_ALT_M": 15.0, "ATC_ANGLE_MAX": 30.0}
OURS = {**NEW, "PSC_NE_JERK": 5.0}


class Reading:
    """Requests of an ArduPilot that has some parameters, in steps of 20 ms."""

    def __init__(self, has, release=None, wanted=tuple(OURS)):
        self.requests, self.has, self.asked = ParameterRequests(), has, []
        self.now_s = 10.0
        self.requests.want(wanted)
        self.requests.start(profile(ARDUPILOT), self.now_s)
        if release is not None:
            self.requests.learn_release(release)

    def run(self, seconds):
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            for name in list(self.requests.requests(self.now_s)):
                self.asked.append(name)
                if name in self.has:
                    self._answer(name)
        return self

    def _answer(self, name):
        data = Peer(1, 1).pack(
            mavlink.MAVLink_param_value_message(name.encode(), self.has[name], 9, 900, 7)
        )
        (message,) = Codec(system_id=1, component_id=195).receive(data)
        self.requests.handle(message, ARDUPILOT)


RELEASES = {
    "4.6.3": ((4, 6, 3), OLD),
    "4.7.0": ((4, 7, 0), {**NEW, "PSC_JERK_NE": 5.0}),
    "4.7.1": ((4, 7, 1), {**NEW, "PSC_NE_JERK": 5.0}),
}


@pytest.mark.parametrize("release", RELEASES)
def test_the_names_and_units_of_the_reported_release_are_asked_for_alone(release):
    version, has = RELEASES[release]
    reading = Reading(has, version).run(0.1)
    assert reading.requests.values == pytest.approx(OURS)
    assert set(reading.asked) == set(has)
    shown = reading.requests.values.shown(OURS)
    assert set(shown) == set(has)


@pytest.mark.parametrize("release", RELEASES)
def test_without_a_version_the_names_decide_that_are_answered(release):
    _, has = RELEASES[release]
    reading = Reading(has).run(3.0)
    assert reading.requests.values == pytest.approx(OURS)
    assert set(reading.requests.values.shown(OURS)) == set(has)


def test_a_development_build_has_the_names_of_its_day():
    reading = Reading(OLD, (4, 7, 0)).run(3.0)
    assert reading.requests.values == pytest.approx(OURS)
    assert set(reading.requests.values.shown(OURS)) == set(OLD)


@pytest.mark.parametrize(("release", "value"), [((4, 6, 3), 0.0), ((4, 7, 1), None)])
def test_a_parameter_that_a_release_does_not_have_is_not_missing(release, value):
    reading = Reading({}, release, wanted=("FENCE_MARGIN_XY",)).run(4.0)
    assert reading.requests.values == {"FENCE_MARGIN_XY": value}
    assert bool(reading.asked) is (value is None)


def test_a_name_of_one_release_is_no_name_of_another_parameter():
    for known in PROFILES.values():
        rows = [known.parameters.row(key) for key in known.parameters.defaults]
        names = [name.name for row in rows for name in row.all_names]
        assert len(names) == len(set(names))
        assert all(row.all_names[0].name == row.key for row in rows)
        assert all(len(name) <= 16 for name in names)


# In flight --------------------------------------------------------------------------------------


def test_an_unread_parameter_denies_an_inspection_by_the_firmwares_name_not_an_escape():
    desk = Desk(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    del desk.parameters["RTL_ALT"]
    desk.run(8.0).order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("unread: RTL_ALT, rejected")
    desk.order(EXIT).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED, ACCEPTED]
    desk.parameters["RTL_ALT"] = 1500.0
    desk.run(4.0).order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


def test_an_exit_with_an_unread_acceleration_counts_with_the_softest_one():
    desk = Desk(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    del desk.parameters["WPNAV_ACCEL"]
    desk.run(8.0).order(INSPECTION).run(0.5)
    assert desk.said("unread: WPNAV_ACCEL, rejected")
    desk.order(EXIT).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED, ACCEPTED]
    assert desk.said("ArduPilot brakes 0.5 < ")
    assert desk.said("1 parameter unread, taken as worst")


FLOWN = {
    "4.6.3": ((4, 6, 3), {"WPNAV_ACCEL": 50.0, "WPNAV_ACCEL_Z": 50.0}, "WPNAV_ACCEL"),
    "4.7.1": ((4, 7, 1), {"WP_ACC": 0.5, "WP_ACC_Z": 0.5}, "WP_ACC"),
}


@pytest.mark.slow
@pytest.mark.parametrize("release", FLOWN)
def test_half_a_metre_per_second_squared_is_flown_as_such_by_either_name(release):
    firmware, parameters, name = FLOWN[release]
    flight = hovering(
        manner=Manner.ARDUPILOT,
        options={"firmware": firmware, "parameters": {"GUID_TIMEOUT": 0.5, **parameters}},
    )
    flight.operator.mission(INSPECTION, 0)
    flight.run(3.0)
    assert flight.operator.answers() == [DENIED]
    assert "MOAR: ArduPilot brakes 0.5 < 1 m/s2, denied" in flight.operator.texts()
    reasons = [item.data.get("reason", "") for item in flight.decisions if item.kind == "answer"]
    assert f"set {name} and {name}_Z " in reasons[-1]
    flight.operator.mission(EXIT, 0)
    flight.run(3.0)
    flight.run_until(lambda: flight.state == "holding", 150.0)
    flight.run(1.0)
    assert "above the landing point" in " ".join(flight.operator.texts())
    (x_m, _), space = flight.site.landing_m[Mission.EXIT][0], flight.site.workspace
    for place in true_places(flight):
        assert space.lower_m[0] - 0.5 <= place[0] <= max(space.upper_m[0], x_m) + 0.5
        assert place[-1] <= space.upper_m[1] + 0.5


# Before the flight ------------------------------------------------------------------------------


def ardupilot_look(firmware, **parameters):
    vehicle = replace(VEHICLE, autopilot=None, risk=replace(VEHICLE.risk, cells=3))
    return Look(
        autopilot="ardupilot",
        age_s=60.0,
        vehicle=vehicle,
        ground_station=True,
        firmware=firmware,
        parameters={"GUID_TIMEOUT": 0.5, "FS_THR_ENABLE": 3, **parameters},
    )


def test_the_check_of_4_7_is_a_go_and_has_its_names():
    found = ardupilot_look((4, 7, 1)).findings()
    assert {name for name, item in found.items() if item.level is Level.NO_GO} == set()
    assert found["firmware"].text.startswith("ArduPilot 4.7.1; this program was tested with 4.6")
    assert found["firmware"].level is Level.NOTE
    assert found["WP_ACC"].text.startswith("2.5 m/s2, the vehicle file requires 0.8")
    assert found["RTL_ALT_M"].text.startswith("15 m: ")
    assert found["wind"].text.count("ATC_ANGLE_MAX") == 1
    assert not {"WPNAV_ACCEL", "RTL_ALT", "WPNAV_SPEED"} & set(found)


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("firmware", "name", "value"),
    [((4, 6, 3), "WPNAV_ACCEL", 50.0), ((4, 7, 1), "WP_ACC", 0.5)],
)
def test_a_soft_acceleration_is_a_no_go_with_the_firmwares_name_and_unit(firmware, name, value):
    finding = ardupilot_look(firmware, **{name: value}).findings()[name]
    assert finding.level is Level.NO_GO
    assert finding.text.startswith("0.5 m/s2, the vehicle file requires 0.8")
    asked = 0.8 if firmware[1] == 7 else 80
    assert finding.remedy.startswith(f"set {name} and {name}_Z {asked:g}, or")


def test_firmware_that_is_newer_than_all_known_names_is_not_blamed_on_the_link():
    look = ardupilot_look((4, 9, 0))
    look.lost = {"WP_ACC", "RTL_ALT_M"}
    found = look.findings()
    assert found["firmware"].level is Level.WARNING
    assert "and knows the parameters up to 4.7" in found["firmware"].text
    assert found["WP_ACC"].level is Level.NO_GO
    assert found["WP_ACC"].text.startswith("unknown, not reported, nor as WPNAV_ACCEL: ")
    assert "ArduPilot 4.9.0 may have another name for it" in found["WP_ACC"].remedy
    assert "link" not in found["WP_ACC"].remedy
    assert found["RTL_ALT_M"].level is Level.NO_GO


@pytest.mark.parametrize(
    ("firmware", "parameters", "name", "level"),
    [
        ((1, 17, 0), {"COM_RC_OVERRIDE": 1}, "COM_RC_OVERRIDE", Level.WARNING),
        ((1, 17, 0), {"COM_RC_OVERRIDE": 3}, "COM_RC_OVERRIDE", Level.OK),
        ((1, 18, 0), {}, "MAN_OVERRIDE_SPD", Level.OK),
        ((1, 18, 0), {"MAN_OVERRIDE_SPD": -1}, "MAN_OVERRIDE_SPD", Level.WARNING),
    ],
)
def test_the_take_over_by_the_sticks_is_judged_by_the_parameter_of_the_release(
    firmware, parameters, name, level
):
    found = Look(firmware=firmware, parameters=parameters).findings()
    assert found[name].level is level
    assert len({"COM_RC_OVERRIDE", "MAN_OVERRIDE_SPD"} & set(found)) == 1
    if level is Level.WARNING:
        assert found[name].remedy == ("set 3" if name == "COM_RC_OVERRIDE" else "set 1")
