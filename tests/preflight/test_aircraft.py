"""The aircraft judged by its telemetry: cases that the fake autopilot does not produce."""

from dataclasses import replace

import pytest

from moar_companion.companion.preflight.aircraft import Arrivals, ReceivedData, aircraft_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.companion.safety.check_inputs import CheckInputs
from moar_companion.companion.safety.condition_types import Look
from moar_companion.companion.safety.conditions import causes
from moar_companion.mavlink import autopilots
from moar_companion.mavlink.identity import Autopilot
from moar_companion.mavlink.telemetry import (
    AutopilotStatus,
    Firmware,
    PeerHeartbeat,
    Readiness,
    RemoteControl,
    Telemetry,
)
from moar_companion.risk import RiskEstimate, update
from moar_companion.settings.config import Supervision
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN
from tests.vehicles import named_vehicle

LINEDRONE = named_vehicle("linedrone_uniform")
OK, NOTE, WARNING, NO_GO = Level
STEADY = Arrivals(count=151, first_s=0.0, last_s=5.0, longest_gap_s=0.04)


def findings(
    *,
    kind=PX4,
    vehicle=LINEDRONE,
    armed=False,
    failsafe=False,
    multirotor=True,
    positions=STEADY,
    **telemetry,
):
    """Findings on an aircraft from which this was received, by subject."""
    status = AutopilotStatus(
        received_s=5.0,
        system_id=1,
        component_id=1,
        kind=kind,
        armed=armed,
        custom_mode=0,
        mode="HOLD",
        ours=False,
        homeward=False,
        multirotor=multirotor,
        failsafe=failsafe,
    )
    received = Telemetry(autopilot=status, **telemetry)
    unknown = RiskEstimate.unknown(vehicle.risk)
    risk = update(unknown, received, 6.0, model=vehicle.risk, cruise_mps=5.0)
    received = ReceivedData(
        autopilot=Autopilot(system_id=1, component_id=1, kind=kind, link="serial"),
        status=status,
        others=(),
        telemetry=received,
        risk=risk,
        positions=positions,
        attitudes=STEADY,
        pose=None,
        causes=causes(
            Look(
                CheckInputs(telemetry=received, risk=risk, pose=None, position_moved_s=0.0),
                Supervision(),
                1.0,
                6.0,
            )
        ),
    )
    return {
        item.subject: item for item in aircraft_findings(received, vehicle, None, Supervision())
    }


def test_an_aircraft_that_sends_only_heartbeats_never_passes():
    found = findings(positions=Arrivals())
    assert {name for name, item in found.items() if item.level is NO_GO} == {
        "LOCAL_POSITION_NED",
        "ready to arm",
        "battery",
        "localization risk",
        "battery risk",
        "take over",
    }
    assert {name for name, item in found.items() if item.level is WARNING} == {
        "firmware",
        "communication risk",
        "drag",
        "ground station",
        "remote control",
    }


def test_an_unknown_autopilot_is_reported():
    assert findings(kind=UNKNOWN)["autopilot"].level is NO_GO


def test_a_vehicle_that_is_no_multirotor_is_a_no_go():
    finding = findings(multirotor=False)["autopilot"]
    assert finding.level is NO_GO
    assert finding.text.endswith("the vehicle is no multirotor")


def test_a_failsafe_is_a_no_go():
    finding = findings(failsafe=True, armed=True)["state"]
    assert finding.level is NO_GO
    assert finding.text == "HOLD, armed, landed state unknown, in failsafe"


@pytest.mark.parametrize(
    ("kind", "version", "release", "level"),
    [
        (PX4, (1, 17, 0), "", OK),
        (PX4, (1, 18, 0), "beta", OK),
        (PX4, (1, 15, 4), "", NOTE),
        (PX4, (1, 13, 3), "", WARNING),
        (ARDUPILOT, (4, 6, 3), "", OK),
        (ARDUPILOT, (4, 7, 1), "", NOTE),
        (ARDUPILOT, (4, 8, 0), "dev", WARNING),
        (PX4, (1, 19, 0), "", WARNING),
        (ARDUPILOT, (4, 2, 3), "", WARNING),
    ],
)
def test_firmware_is_compared_with_the_measured_versions(kind, version, release, level):
    firmware = Firmware(received_s=5.0, version=version, release=release)
    finding = findings(kind=kind, firmware=firmware)["firmware"]
    assert finding.level is level
    assert finding.text.startswith(f"{autopilots.profile(kind).name} {firmware}")


def test_a_disarmed_autopilot_that_would_not_arm_is_reported_with_its_unhealthy_sensors():
    readiness = Readiness(received_s=5.0, ready=False, unhealthy=("gps", "ahrs"))
    finding = findings(readiness=readiness)["ready to arm"]
    assert (finding.level, finding.text) == (NO_GO, "no, unhealthy: gps, ahrs")


@pytest.mark.parametrize(
    ("ready", "unhealthy", "level", "text"),
    [
        (True, (), OK, "armed"),
        (True, ("rc receiver",), NOTE, "armed, unhealthy: rc receiver"),
        (False, (), WARNING, "armed, would not arm now"),
        (False, ("gps", "ahrs"), WARNING, "armed, would not arm now, unhealthy: gps, ahrs"),
    ],
)
def test_an_armed_aircraft_is_not_called_ready_and_its_unhealthy_sensors_are_named(
    ready, unhealthy, level, text
):
    readiness = Readiness(received_s=5.0, ready=ready, unhealthy=unhealthy)
    finding = findings(readiness=readiness, armed=True)["ready to arm"]
    assert (finding.level, finding.text) == (level, text)
    assert bool(finding.remedy) is (level is WARNING)


def test_a_slow_stream_is_a_warning_and_a_long_pause_a_no_go():
    slow = Arrivals(count=51, first_s=0.0, last_s=5.0, longest_gap_s=0.12)
    assert findings(positions=slow)["LOCAL_POSITION_NED"].level is WARNING
    paused = Arrivals(count=151, first_s=0.0, last_s=5.0, longest_gap_s=0.6)
    finding = findings(positions=paused)["LOCAL_POSITION_NED"]
    assert finding.level is NO_GO
    assert "a pause of 0.5 s ends the flight" in finding.remedy


def test_arrivals_are_counted():
    arrivals = Arrivals()
    assert arrivals.rate_hz is None
    for now_s in (1.0, 1.1, 1.4, 1.5):
        arrivals = arrivals.another(now_s)
    assert arrivals.rate_hz == pytest.approx(6.0)
    assert arrivals.longest_gap_s == pytest.approx(0.3)


def test_a_remote_control_whose_signal_is_unknown_is_there():
    remote = RemoteControl(received_s=5.0, rssi=None)
    assert findings(remote_control=remote)["remote control"].text == "received, unknown signal"


GROUND = PeerHeartbeat(received_s=5.0, system_id=255)
REMOTE = RemoteControl(received_s=5.0, rssi=0.9)


def readiness(remote_control_ok):
    return Readiness(received_s=5.0, ready=True, unhealthy=(), remote_control_ok=remote_control_ok)


@pytest.mark.parametrize(
    ("telemetry", "words"),
    [
        ({"remote_control": REMOTE, "readiness": readiness(True)}, "received, signal 90%"),
        ({"remote_control": REMOTE}, "received, signal 90%"),
        ({"ground_station": GROUND}, "not received"),
    ],
    ids=["remote control", "no word of the autopilot on it", "ground station"],
)
def test_one_operator_who_can_take_over_is_enough(telemetry, words):
    found = findings(**telemetry)
    assert "take over" not in found
    assert found["remote control"].text == words


@pytest.mark.parametrize(
    ("telemetry", "subject", "words"),
    [
        ({"remote_control": replace(REMOTE, rssi=0.0)}, "remote control", "remote control 0% of"),
        ({"remote_control": replace(REMOTE, rssi=0.3)}, "remote control", "remote control 30% of"),
        (
            {"remote_control": REMOTE, "readiness": readiness(False)},
            "remote control",
            "remote control lost: yes",
        ),
        (
            {"remote_control": REMOTE, "readiness": readiness(None)},
            "remote control",
            "not received",
        ),
        (
            {"ground_station": replace(GROUND, received_s=-4.0)},
            "ground station",
            "ground station silence 10.0 s",
        ),
    ],
    ids=["lost", "far", "the autopilot's word", "channels without a receiver", "silent"],
)
def test_an_operator_whose_link_is_lost_cannot_take_over(telemetry, subject, words):
    found = findings(**telemetry)
    assert found["take over"].level is NO_GO
    assert (found[subject].level, words in found[subject].text) == (WARNING, True), found[subject]


def test_a_drag_that_was_not_measured_is_reported_with_how_to_measure_it():
    usual = findings()["drag"]
    assert usual.level is WARNING
    assert "--fit-drag" in usual.remedy
    risk = replace(LINEDRONE.risk, drag_per_s=0.22, drag_per_m=0.0)
    measured = findings(vehicle=replace(LINEDRONE, risk=risk))["drag"]
    assert (measured.level, measured.text) == (OK, "0.22 /s and 0 /m")
