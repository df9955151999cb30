"""Inputs of the checks: a healthy flight, and changes of it."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.safety.check_inputs import CheckInputs, EscapeRoute, Host
from moar_companion.companion.safety.condition_types import Look
from moar_companion.companion.safety.conditions import causes
from moar_companion.mavlink.telemetry import (
    Attitude,
    Battery,
    Estimator,
    Gnss,
    Landed,
    LandedState,
    LocalPosition,
    Odometry,
    PeerHeartbeat,
    Telemetry,
)
from moar_companion.risk import IndexReport, InputReport, RiskEstimate, RiskReport
from moar_companion.risk.localization import LocalizationMemory
from moar_companion.risk.receivers import ReceiverMemory
from moar_companion.settings.config import Supervision
from moar_companion.types import Mission, RiskIndices

from .telemetry import px4_status

NOW_S = 100.0
OFF_PATH_M = 1.5
AUTOPILOT = px4_status(NOW_S)
BATTERY = Battery(
    received_s=NOW_S, remaining=0.9, voltage_v=16.0, current_a=None, charge_state=1, summary=False
)
GNSS = Gnss(
    received_s=NOW_S,
    receiver_s=40.0,
    fix_type=3,
    satellites=12,
    hdop=0.7,
    vdop=1.1,
    horizontal_accuracy_m=0.9,
    vertical_accuracy_m=1.8,
)
ESTIMATOR = Estimator(
    received_s=NOW_S, flags=0x37F, horizontal_position_ok=True, horizontal_accuracy_m=0.3
)
ODOMETRY = Odometry(received_s=NOW_S, reset_counter=3, horizontal_accuracy_m=0.3)
TELEMETRY = Telemetry(
    autopilot=AUTOPILOT,
    attitude=Attitude(received_s=NOW_S, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0),
    local_position=LocalPosition(
        received_s=NOW_S,
        boot_s=50.0,
        position_ned_m=(0.0, 0.0, -5.0),
        velocity_ned_mps=(0.0, 0.0, 0.0),
    ),
    landed=Landed(received_s=NOW_S, state=LandedState.IN_AIR),
    batteries={0: BATTERY},
    gnss=GNSS,
    estimator=ESTIMATOR,
    odometry=ODOMETRY,
    ground_station=PeerHeartbeat(received_s=NOW_S, system_id=255),
)
POSE = Pose(position_m=(5.0, 0.0, 5.0), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


def input_report(name, value, unit, risk=0.1):
    return InputReport(name=name, value=value, unit=unit, age_s=0.1, risk=risk)


def wind(value_mps, risk=0.1, source="reported"):
    return input_report(f"wind {source}", value_mps, "m/s", risk)


def accuracy(source, value_m):
    """Accuracy of a source; 0 means unknown."""
    return input_report(f"{source} accuracy", value_m, "m", 0.1 if value_m else None)


ACCURATE = (accuracy("estimator", 0.3), accuracy("odometry", 0.3), accuracy("receiver", 0.9))


def risk(
    *inputs,
    accuracies=ACCURATE,
    localization=0.1,
    receiver_s=40.0,
    since_s=NOW_S,
    last=(),
    charge=None,
    state=None,
):
    """Risk estimate. last: earlier reports that ended. charge, state: of battery 0, earlier."""
    known = [item for item in (*last, *inputs, *accuracies) if item.known]
    winds = {item.name: item for item in known if item.name.startswith("wind")}
    others = {item.name: item for item in known if item.name not in winds}
    charges = [
        input_report(f"battery 0 {what}", value, "")
        for what, value in (("remaining", charge), ("charge state", state))
        if value is not None
    ]
    receiver = ReceiverMemory(receiver_s=receiver_s, since_s=since_s)
    return RiskEstimate(
        indices=RiskIndices(localization=localization),
        report=RiskReport(
            wind=IndexReport(inputs=inputs), localization=IndexReport(inputs=accuracies)
        ),
        last_known={
            "wind": winds,
            "localization": others,
            "battery": {item.name: item for item in charges},
        },
        localization=LocalizationMemory(receivers=(receiver, ReceiverMemory())),
    )


RISK = risk(wind(4.0))
IN_FLIGHT = CheckInputs(
    telemetry=TELEMETRY,
    risk=RISK,
    pose=POSE,
    position_moved_s=NOW_S,
    room_m=2.0,
    in_control=True,
    error_m=0.2,
    escape_route=EscapeRoute(mission=Mission.EXIT, left_s=600.0, reserve_s=30.0, age_s=1.0),
    host=Host(disk_free=1e9, memory_available=1e9),
)
"""Healthy: no cause against the flight."""
HOVERING = replace(
    IN_FLIGHT,
    in_control=False,
    error_m=None,
    telemetry=replace(TELEMETRY, autopilot=replace(AUTOPILOT, mode="HOLD", ours=False)),
)
"""Healthy too, before control is given."""


def with_telemetry(seen=IN_FLIGHT, **changes):
    """Inputs with changed telemetry."""
    return replace(seen, telemetry=replace(seen.telemetry, **changes))


def flies(seen=IN_FLIGHT, failsafes=(), **changes):
    """Inputs with another autopilot status; failsafes: reported by texts."""
    autopilot = replace(seen.telemetry.autopilot, **changes)
    return with_telemetry(
        seen, autopilot=autopilot, failsafes_reported=dict.fromkeys(failsafes, 0.0)
    )


def drains(**changes):
    return with_telemetry(batteries={0: replace(BATTERY, **changes)})


def receives(**changes):
    return with_telemetry(gnss=replace(GNSS, **changes))


def uncertain(estimator_m, odometry_m, gnss_m, last=(), heights_m=(None, None, None)):
    accuracies = (
        accuracy("estimator", estimator_m),
        accuracy("odometry", odometry_m),
        accuracy("receiver", gnss_m),
        *(
            accuracy(f"{source} height", height_m)
            for source, height_m in zip(
                ("estimator", "odometry", "receiver"), heights_m, strict=True
            )
        ),
    )
    return replace(IN_FLIGHT, risk=risk(wind(4.0), accuracies=accuracies, last=last))


def leaves(mission, left_s, **changes):
    route = EscapeRoute(mission=mission, left_s=left_s, reserve_s=30.0, age_s=1.0)
    return replace(IN_FLIGHT, escape_route=replace(route, **changes))


def moves(seen=HOVERING, **changes):
    return replace(seen, pose=replace(POSE, **changes))


def found(seen):
    """Causes against the flight, by name."""
    return causes(Look(seen, Supervision(), OFF_PATH_M, NOW_S))
