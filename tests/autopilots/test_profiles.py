"""Autopilot profiles: a third autopilot needs a profile alone; an unknown one has the worst."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

import moar_companion
from moar_companion.companion.preflight.aircraft_check import parameter_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.errors import InputError
from moar_companion.mavlink import modes, translate
from moar_companion.mavlink.autopilots import PROFILES, kind_of, profile
from moar_companion.mavlink.autopilots.failsafe_actions import AutopilotAction
from moar_companion.mavlink.autopilots.fence import Fence
from moar_companion.mavlink.autopilots.offboard_loss import OffboardLoss
from moar_companion.mavlink.autopilots.parameter_names import Parameter, Parameters, ParameterTable
from moar_companion.mavlink.autopilots.parameter_rules import Rule, switch
from moar_companion.mavlink.message_rates import wanted_rates_hz
from moar_companion.mavlink.telemetry import Telemetry
from moar_companion.settings import vehicle as vehicle_file
from moar_companion.settings.config import Authority, LossCheck, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import AUTOPILOTS, UNKNOWN, AutopilotKind

from ..companion.desk import INSPECTION, Desk

MADE_UP, FOLLOW, WAIT, LAND = AutopilotKind("made_up"), 7, 8, 9
NUMBER = int(mavlink.MAV_AUTOPILOT_REFLEX)
X500 = shipped_configs() / "vehicles" / "x500.yaml"


def read_loss(value, _parameters):
    return OffboardLoss(
        kind=MADE_UP,
        name="Made-up",
        action=AutopilotAction.HOLD if value["MU_STAYS"] else AutopilotAction.FALL,
        remedy="set MU_STAYS 1",
        timeout_s=None,
        stopping_s=0.5,
        stopping_s2pm=0.2,
    )


@pytest.fixture
def made_up(monkeypatch):
    """A third autopilot, added to the table of profiles."""
    third = replace(
        profile(UNKNOWN),
        kind=MADE_UP,
        name="Made-up",
        mav_autopilot=NUMBER,
        mode_name={FOLLOW: "FOLLOW", WAIT: "WAIT", LAND: "DOWN"}.get,
        is_own_mode=lambda custom_mode: custom_mode == FOLLOW,
        own_mode="FOLLOW",
        own_mode_numbers=(FOLLOW, 0),
        land_mode="DOWN",
        land_mode_numbers=(LAND, 0),
        homeward_modes=frozenset({"DOWN"}),
        rates_hz={"WIND_COV": 3.0},
        projection_known=True,
        parameters=ParameterTable(
            (
                Parameter("MU_STAYS", 1.0, 0.0),
                Parameter("MU_FAILSAFE", 0.0, 0.0),
                Parameter("MU_FENCE", 0.0, 0.0),
            )
        ),
        loss_parameters=("MU_STAYS",),
        read_loss=read_loss,
        failsafe_parameters=("MU_FAILSAFE",),
        read_failsafes=lambda _: (),
        fence_parameters=("MU_FENCE",),
        read_fence=lambda _values, areas, _enabled: Fence(areas=areas),
        rules=(
            Rule(
                parameter="MU_STAYS",
                judge=switch(off=Level.NO_GO),
                meaning="whether it stays",
                unknown=Level.NO_GO,
            ),
        ),
    )
    monkeypatch.setitem(PROFILES, MADE_UP, third)
    monkeypatch.setattr(vehicle_file, "AUTOPILOTS", (*AUTOPILOTS, MADE_UP))
    return third


def desk_of(**parameters):
    desk = Desk(autopilot=NUMBER, authority=Authority.ENGAGE)
    desk.set(ours=FOLLOW, mode=WAIT)
    desk.parameters.update(MU_STAYS=1.0, MU_FENCE=0.0, MU_FAILSAFE=0.0, **parameters)
    return desk


def test_a_third_autopilot_is_flown_by_its_profile_alone(made_up):
    desk = desk_of().run(1.2)
    assert desk.companion.telemetry.autopilot.mode == "WAIT"
    names = {message.param_id for message in desk.messages("PARAM_REQUEST_READ")}
    assert names == {"MU_STAYS", "MU_FAILSAFE", "MU_FENCE"}
    desk.order(INSPECTION).run_until("ready").run(2.0)
    (asked,) = desk.mode_requests()
    assert (asked.param1, asked.param2) == (1, FOLLOW)
    desk.send_heartbeat(FOLLOW).run_until("flying", 0.1).run(2.0)
    assert len(desk.setpoints()) > 50
    desk.send_heartbeat(WAIT).run(0.1)
    assert desk.state == "overridden"


def test_an_autopilot_that_would_fall_on_offboard_loss_is_not_flown(made_up):
    desk = desk_of()
    desk.parameters["MU_STAYS"] = 0.0
    desk.run(1.2).order(INSPECTION).run(0.5)
    assert desk.state == "idle"
    assert desk.said("Made-up would stop its motors")
    assert not desk.setpoints()


def test_the_check_and_the_vehicle_file_support_a_third_autopilot(made_up, tmp_path):
    file = tmp_path / "vehicle.yaml"
    file.write_text(X500.read_text().replace("autopilot: px4", "autopilot: made_up"))
    vehicle = Vehicle.load(file)
    assert vehicle.autopilot == MADE_UP
    finding, *_ = parameter_findings(
        made_up,
        Parameters({"MU_STAYS": 0.0}),
        vehicle,
        LossCheck.REFUSE,
        ground_station_received=True,
    )
    assert (finding.level, finding.text) == (Level.NO_GO, "0: whether it stays")
    assert wanted_rates_hz(MADE_UP)[mavlink.MAVLINK_MSG_ID_WIND_COV] == 3.0


def test_a_vehicle_file_names_a_known_autopilot_or_none(tmp_path):
    file = tmp_path / "vehicle.yaml"
    file.write_text(X500.read_text().replace("autopilot: px4", "autopilot: made_up"))
    with pytest.raises(InputError, match="is 'made_up', must be 'px4' or 'ardupilot'"):
        Vehicle.load(file)


def test_each_autopilot_that_a_vehicle_file_names_has_a_profile():
    assert tuple(PROFILES) == AUTOPILOTS


@pytest.mark.parametrize("kind", list(PROFILES))
def test_every_profile_has_its_own_number_and_consistent_modes(kind):
    known = profile(kind)
    assert kind_of(known.mav_autopilot) == known.kind == kind
    numbers = modes.own_mode_parameters(kind, armed=True), modes.land_parameters(kind, armed=True)
    assert None not in numbers
    assert known.land_mode in known.homeward_modes
    assert known.own_mode not in known.homeward_modes
    read = (known.read_loss, known.read_failsafes, known.read_fence)
    assert None not in read


@pytest.mark.parametrize("kind", list(PROFILES))
def test_no_assumption_about_an_unknown_autopilot_lowers_a_risk(kind):
    unknown, known = profile(UNKNOWN), profile(kind)
    assert unknown.landing_mps <= known.landing_mps
    assert unknown.landed_hover_s >= known.landed_hover_s
    assert unknown.position_error_m >= known.position_error_m
    assert unknown.tracking_error_m >= known.tracking_error_m
    assert unknown.stray_s2 >= known.stray_s2
    assert unknown.innovation_limit <= known.innovation_limit
    assert not unknown.better_gnss_taken
    assert not unknown.summary_is_battery_0
    assert not unknown.channels_without_receiver
    assert not unknown.projection_known
    values = unknown.with_silence(known.with_silence(Parameters({})))
    assert unknown.offboard_loss(values) is None
    assert unknown.failsafes(values) is None
    assert unknown.fence(values, (), enabled=True) is None


@pytest.mark.parametrize("kind", [None, AutopilotKind("made_up")])
def test_an_autopilot_without_a_profile_is_unknown(kind):
    assert profile(kind) is profile(UNKNOWN)
    assert kind_of(NUMBER) == UNKNOWN


@pytest.mark.parametrize("custom_mode", [4, 6 << 16])
def test_an_unknown_autopilot_has_no_mode_for_setpoints(custom_mode):
    heartbeat = mavlink.MAVLink_heartbeat_message(2, NUMBER, 209, custom_mode, 5, 3)
    status = translate.update(Telemetry(), heartbeat, 1.0).autopilot
    assert not status.ours
    assert not status.homeward
    assert status.mode.startswith("MODE 0x")
    assert modes.own_mode_parameters(status.kind, armed=True) is None
    assert modes.land_parameters(status.kind, armed=True) is None


def test_only_log_readers_name_an_autopilot_outside_its_package():
    package = Path(moar_companion.__file__).parent
    named = re.compile(
        r"^from \.+(\w+\.)*autopilots\.(px4|ardupilot) |"
        r"^from \.+types import .*\b(PX4|ARDUPILOT)\b",
        re.MULTILINE,
    )
    naming = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if path.parent.name != "autopilots" and named.search(path.read_text())
    }
    assert naming == {"analysis/replay/ulog_topics.py", "analysis/replay/dataflash_listener.py"}
