"""Causes of the autopilot, its batteries and the computer, one by one: at each limit, just
beyond, and where a measurement is missing.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.companion.safety.autopilot_failsafe import reported
from moar_companion.companion.safety.check_inputs import Host, Unmeasured
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.mavlink.telemetry import (
    Failsafe,
    Landed,
    LandedState,
    LinkStatistics,
    Readiness,
)
from moar_companion.perception.lidar_scan import PacketFault
from moar_companion.perception.perception_report import SensorHealth
from moar_companion.settings.perception_config import Perception, Sensor
from moar_companion.types import ARDUPILOT

from .seen import (
    BATTERY,
    HOVERING,
    IN_FLIGHT,
    NOW_S,
    TELEMETRY,
    drains,
    flies,
    found,
    risk,
    wind,
    with_telemetry,
)
from .test_checks_of_place import STORIES as OF_PLACE


def lands_in_failsafe(**changes):
    """Inputs of an ArduPilot that lands in a failsafe."""
    landing = {"kind": ARDUPILOT, "mode": "LAND", "homeward": True}
    return flies(HOVERING, failsafe=True, **landing, **changes)


def lidar(**health):
    """A flight with a lidar whose newest scan and packet arrive now."""
    known = {"received_s": NOW_S, "scan_s": NOW_S, "returns": 0.5} | health
    settings = Perception(sensor=Sensor.VELODYNE)
    return replace(IN_FLIGHT, sensing=settings, sensor_health=SensorHealth(**known))


STORIES = [
    # title, inputs, expected causes
    ("all is well in flight", IN_FLIGHT, {}),
    ("all is well before control", HOVERING, {}),
    (
        "no autopilot",
        with_telemetry(autopilot=None),
        {
            "autopilot_identity": "no autopilot is received",
            "autopilot_link_lost": "no heartbeat is received",
        },
    ),
    (
        "two autopilots",
        replace(IN_FLIGHT, conflict="two autopilots are received"),
        {"autopilot_identity": "two autopilots are received"},
    ),
    ("a plane", flies(multirotor=False), {"autopilot_identity": "the vehicle is no multirotor"}),
    ("a heartbeat 3 s old", flies(received_s=97.0), {}),
    (
        "an older one",
        flies(received_s=96.94),
        {
            "autopilot_link_lost": "autopilot silent for 3.1 s",
            "mode_unconfirmed": "mode unknown for 3.1 s",
        },
    ),
    (
        "an older one, though other packets come",
        replace(
            flies(received_s=96.94),
            telemetry=replace(
                flies(received_s=96.94).telemetry,
                link=LinkStatistics(received_s=99.9, packets_received=9, packets_lost=0),
            ),
        ),
        {"mode_unconfirmed": "mode unknown for 3.1 s"},
    ),
    ("an armed state 15 s old", flies(armed_s=85.0), {}),
    (
        "an older one, though the mode is reported",
        flies(armed_s=84.9),
        {"mode_unconfirmed": "armed state unknown for 15.1 s"},
    ),
    (
        "no position",
        with_telemetry(local_position=None),
        {"position": "no local position is received"},
    ),
    ("a position 0.5 s old", replace(IN_FLIGHT, position_moved_s=99.5), {}),
    (
        "an older one, though it was just received",
        replace(IN_FLIGHT, position_moved_s=99.4),
        {"position": "position age 0.6 s > 0.5"},
    ),
    (
        "an older one, which has waited to be read",
        replace(IN_FLIGHT, position_moved_s=99.4, host=Host(read_late_s=0.3)),
        {"position": "position read late 0.6 s > 0.5"},
    ),
    ("no attitude", with_telemetry(attitude=None), {"attitude": "the attitude is unknown"}),
    (
        "an attitude 1 s old",
        with_telemetry(attitude=replace(TELEMETRY.attitude, received_s=99.0)),
        {},
    ),
    (
        "an older one",
        with_telemetry(attitude=replace(TELEMETRY.attitude, received_s=98.99)),
        {"attitude": "the attitude is unknown"},
    ),
    (
        "no origin",
        replace(IN_FLIGHT, pose=None),
        {"origin": "local origin unknown"},
    ),
    (
        "a failsafe of unknown cause while the mode is ours",
        flies(failsafe=True),
        {"failsafe_reported": "autopilot failsafe, cause unknown"},
    ),
    ("the same on the escape route", replace(flies(failsafe=True), escaping=True), {}),
    (
        "a failsafe by text",
        flies(failsafe=True, failsafes={Failsafe.GROUND_STATION, Failsafe.REMOTE_CONTROL}),
        {"failsafe_reported": "failsafe: GCS, RC"},
    ),
    (
        "the same on the escape route: it goes on",
        replace(flies(failsafe=True, failsafes={Failsafe.GROUND_STATION}), escaping=True),
        {},
    ),
    (
        "an estimator in doubt on the escape route",
        replace(flies(failsafe=True, failsafes={Failsafe.ESTIMATOR}), escaping=True),
        {"failsafe_reported": "failsafe: EKF"},
    ),
    (
        "a battery's failsafe on the escape route",
        replace(flies(failsafe=True, failsafes={Failsafe.BATTERY}), escaping=True),
        {"battery_failsafe": "autopilot battery failsafe"},
    ),
    (
        "a failsafe before control, in a mode of its own",
        flies(HOVERING, failsafe=True),
        {"failsafe_took_mode": "failsafe chose HOLD"},
    ),
    (
        "one that ArduPilot goes on to tell in the pilot's mode",
        flies(
            HOVERING,
            failsafe=True,
            kind=ARDUPILOT,
            mode="LOITER",
            failsafes={Failsafe.BATTERY},
        ),
        {"battery_failsafe": "autopilot battery failsafe"},
    ),
    (
        "one that has taken ArduPilot's mode",
        flies(HOVERING, failsafe=True, kind=ARDUPILOT, mode="LAND", homeward=True),
        {"failsafe_took_mode": "failsafe chose LAND"},
    ),
    (
        "one that began with ArduPilot's mode",
        lands_in_failsafe(mode_since_s=90.0, failsafe_since_s=88.0),
        {"failsafe_took_mode": "failsafe chose LAND"},
    ),
    (
        "a landing ordered while one stands",
        lands_in_failsafe(mode_since_s=90.0, failsafe_since_s=80.0),
        {"failsafe_took_mode": "autopilot in LAND"},
    ),
    (
        "a second failsafe with the landing",
        with_telemetry(
            lands_in_failsafe(mode_since_s=90.0, failsafe_since_s=80.0),
            failsafes_reported={Failsafe.BATTERY: 90.1},
        ),
        {"failsafe_took_mode": "failsafe chose LAND"},
    ),
    (
        "PX4's hold and then its landing",
        flies(HOVERING, failsafe=True, mode="LAND", mode_since_s=90.0, failsafe_since_s=80.0),
        {"failsafe_took_mode": "failsafe chose LAND"},
    ),
    ("disarmed", flies(armed=False), {"ground": "on the ground"}),
    (
        "disarmed before control",
        flies(HOVERING, armed=False),
        {"ground": "on the ground", "not_flying": "not in the air"},
    ),
    (
        "landed",
        with_telemetry(landed=Landed(received_s=NOW_S, state=LandedState.ON_GROUND)),
        {"ground": "on the ground"},
    ),
    ("a landed state that is unknown in flight", with_telemetry(landed=None), {}),
    (
        "a landed state that is unknown before",
        with_telemetry(HOVERING, landed=None),
        {"not_flying": "not in the air"},
    ),
    (
        "a landed state 5 s old",
        with_telemetry(HOVERING, landed=replace(TELEMETRY.landed, received_s=95.0)),
        {},
    ),
    (
        "an older one",
        with_telemetry(HOVERING, landed=replace(TELEMETRY.landed, received_s=94.9)),
        {"not_flying": "not in the air"},
    ),
    (
        "taking off",
        with_telemetry(HOVERING, landed=Landed(received_s=NOW_S, state=LandedState.TAKEOFF)),
        {"not_flying": "taking off"},
    ),
    (
        "landing",
        with_telemetry(
            flies(HOVERING, mode="LAND", homeward=True),
            landed=Landed(received_s=NOW_S, state=LandedState.LANDING),
        ),
        {"not_flying": "landing"},
    ),
    (
        "a mode of the pilot's",
        flies(mode="POSCTL", ours=False),
        {"pilot": "autopilot in POSCTL"},
    ),
    (
        "the landing that was asked for",
        replace(flies(mode="LAND", ours=False), landing=True),
        {"landing": "autopilot in LAND"},
    ),
    ("a battery that is low", drains(charge_state=2), {}),
    (
        "a battery that is critical",
        drains(charge_state=3),
        {"battery_critical": "battery 0 is critical"},
    ),
    (
        "a battery that has failed",
        drains(charge_state=5),
        {"battery_critical": "battery 0 is critical"},
    ),
    ("a battery whose monitor is unhealthy", drains(charge_state=6), {}),
    (
        "the second battery",
        with_telemetry(batteries={0: BATTERY, 1: replace(BATTERY, charge_state=4)}),
        {"battery_critical": "battery 1 is critical"},
    ),
    ("a battery above its reserve", drains(remaining=0.21), {}),
    (
        "a battery at its reserve",
        drains(remaining=0.2),
        {"battery_reserve": "battery 0 at 20% <= 20%"},
    ),
    (
        "an autopilot on USB power",
        drains(remaining=0.0, voltage_v=4.1, charge_state=3),
        {"unmonitored": "unknown: battery"},
    ),
    (
        "two cells under load, with a voltage that USB may have",
        drains(remaining=0.1, voltage_v=5.4),
        {"battery_reserve": "battery 0 at 10% <= 20%"},
    ),
    (
        "a battery of which nothing is reported but its voltage",
        drains(remaining=None, charge_state=None),
        {"unmonitored": "unknown: battery"},
    ),
    ("a battery that tells no more than its state", drains(remaining=None), {}),
    (
        "one of which only a summary tells, its voltage and no state of now",
        drains(remaining=None, charge_state=3, summary=True),
        {
            "battery_critical": "battery 0 is critical",
            "unmonitored": "unknown: battery",
        },
    ),
    ("no battery", with_telemetry(batteries={}), {"unmonitored": "unknown: battery"}),
    (
        "a parameter is not reported",
        replace(IN_FLIGHT, parameters_unknown=("RTL_ALT_M",)),
        {"parameter_unknown": "unread: RTL_ALT_M"},
    ),
    (
        "many parameters are not reported",
        replace(IN_FLIGHT, parameters_unknown=("COM_OBL_RC_ACT", "NAV_RCL_ACT", "RTL_TYPE")),
        {"parameter_unknown": "unread: COM_OBL_RC_ACT and 2 more (NAV_RCL_ACT, RTL_TYPE)"},
    ),
    ("a battery 15 s silent", drains(received_s=85.0), {}),
    (
        "silent for longer",
        drains(received_s=84.0),
        {
            "battery_silent": "battery 0 is silent for 16 s",
            "unmonitored": "unknown: battery",
        },
    ),
    (
        "one of two silent",
        with_telemetry(batteries={0: BATTERY, 1: replace(BATTERY, received_s=80.0)}),
        {
            "battery_silent": "battery 1 is silent for 20 s",
            "unmonitored": "unknown: battery",
        },
    ),
    (
        "a battery that reports its voltage where it reported its charge",
        replace(drains(remaining=None), risk=risk(wind(4.0), charge=0.22)),
        {
            "battery_silent": "battery 0 reports no charge (was 22%)",
            "unmonitored": "unknown: battery",
        },
    ),
    (
        "one that tells no more that it was at its reserve, and critical",
        replace(
            drains(remaining=None, charge_state=None), risk=risk(wind(4.0), charge=0.2, state=3)
        ),
        {
            "battery_critical": "battery 0 is critical",
            "battery_reserve": "battery 0 at 20% <= 20%",
            "battery_silent": "battery 0 reports no charge (was 20%)",
            "unmonitored": "unknown: battery",
        },
    ),
    (
        "one that was at its reserve, and seems to be on USB power",
        replace(drains(remaining=1.0, voltage_v=4.1), risk=risk(wind(4.0), charge=0.2)),
        {
            "battery_reserve": "battery 0 at 20% <= 20%",
            "battery_silent": "battery 0 reports no charge (was 20%)",
            "unmonitored": "unknown: battery",
        },
    ),
    (
        "one that was charged since",
        replace(drains(), risk=risk(wind(4.0), charge=0.2, state=3)),
        {},
    ),
    (
        "a failsafe before control",
        replace(IN_FLIGHT, in_control=False, exposure="RC loss hits wire: 121 s (120)"),
        {},
    ),
    (
        "a failsafe that would hit something",
        replace(IN_FLIGHT, exposure="RC loss hits wire: 121 s (120)"),
        {"failsafe_exposure": "RC loss hits wire: 121 s (120)"},
    ),
    ("memory at its limit", replace(IN_FLIGHT, host=Host(memory_available=100e6)), {}),
    (
        "memory below it",
        replace(IN_FLIGHT, host=Host(memory_available=99e6)),
        {"memory": "memory 99 MB < 100"},
    ),
    ("a disk at its limit", replace(IN_FLIGHT, host=Host(disk_free=200e6)), {}),
    (
        "a disk below it",
        replace(IN_FLIGHT, host=Host(disk_free=199e6)),
        {"disk": "disk 199 MB < 200"},
    ),
    ("a lidar that sees", lidar(), {}),
    ("no lidar", replace(IN_FLIGHT, sensor_health=SensorHealth()), {}),
    (
        "a lidar that was never received",
        lidar(received_s=None, scan_s=None),
        {"perception": "no data of the lidar is received"},
    ),
    (
        "one without a whole scan",
        lidar(scan_s=None),
        {"perception": "no data of the lidar is received"},
    ),
    (
        "one whose packets are all refused",
        lidar(received_s=None, scan_s=None, refusal=PacketFault.CHECKSUM),
        {"perception": "lidar data with a wrong checksum"},
    ),
    ("one at its limits", lidar(received_s=99.0, scan_s=99.5, returns=0.05), {}),
    (
        "one that is lost",
        lidar(received_s=98.9, scan_s=98.9),
        {"perception": "lidar silent for 1.1 s > 1"},
    ),
    ("one that is late", lidar(scan_s=99.4), {"perception": "lidar scan age 0.6 s > 0.5"}),
    (
        "one that is covered",
        lidar(returns=0.02),
        {"perception": "lidar blinded, 2% returns < 5%"},
    ),
    ("what is seen is soon on the maps", replace(lidar(), unmapped_s=1.0), {}),
    (
        "what is seen is not on the maps",
        replace(lidar(), unmapped_s=1.1),
        {"perception": "obstacle unmapped for 1.1 s > 1"},
    ),
    *[
        (
            f"the fault {name}",
            replace(IN_FLIGHT, faults=Unmeasured(**{name: "words"})),
            {name: "words"},
        )
        for name in (
            "loop_stall",
            "autopilot_reboot",
            "setpoint_rejected",
            "setpoint_held",
            "settings_refused",
            "no_clearance",
            "path_barred",
            "offboard_loss_unknown",
            "offboard_loss_collision",
        )
    ],
]


@pytest.mark.parametrize(("case", "seen", "expected"), STORIES, ids=[row[0] for row in STORIES])
def test_exactly_the_expected_causes_are_found(case, seen, expected):
    assert found(seen) == expected, case


def test_every_cause_has_its_story():
    names = {name for _, _, expected in STORIES + OF_PLACE for name in expected}
    assert names == {row.name for row in CONDITIONS}


def test_a_failsafe_of_the_autopilot_is_identified_by_what_is_lost():
    flying = replace(TELEMETRY, autopilot=replace(TELEMETRY.autopilot, failsafe=True))
    assert reported(flying) == frozenset()
    silent = Readiness(received_s=NOW_S, ready=True, unhealthy=(), remote_control_ok=False)
    assert reported(replace(flying, readiness=silent)) == {Failsafe.REMOTE_CONTROL}
    empty = replace(silent, unhealthy=("battery",), remote_control_ok=True)
    assert reported(replace(flying, readiness=empty)) == {Failsafe.BATTERY}
    lost = replace(TELEMETRY.estimator, horizontal_position_ok=False)
    assert reported(replace(flying, estimator=lost)) == {Failsafe.ESTIMATOR}


def test_without_a_failsafe_flag_a_lost_position_is_no_failsafe_of_the_autopilot():
    lost = replace(TELEMETRY.estimator, horizontal_position_ok=False)
    assert reported(replace(TELEMETRY, estimator=lost)) is None
