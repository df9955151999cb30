"""Translation of MAVLink messages to `Telemetry`. Pure.

Each message has one function, in `translate_motion`, `translate_motors`, `translate_obstacles`,
`translate_radio`, `translate_status`, or the heartbeat's here. These alone turn MAVLink's many
values for "unknown" into `None`. The opposite direction is `translate_outgoing`. Sources: the
message definitions, and where they are ambiguous recordings of PX4 v1.17/v1.18 and ArduCopter
4.6.3.

HEARTBEAT reports only that a failsafe is active; a STATUSTEXT names it. One text reports its end,
and a link may lose that text: so each failsafe also ends some time after its last sign. The texts
are in the autopilot's profile.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..types import AutopilotKind
from . import (
    modes,
    translate_motion,
    translate_motors,
    translate_obstacles,
    translate_radio,
    translate_status,
)
from .autopilots import kind_of, profile_of
from .dialect import CURRENT_MODE_ID, Message, mavlink
from .packet_count import BOOT_TIME_AT
from .telemetry import AutopilotStatus, Failsafe, PeerHeartbeat, Telemetry

_FRESH_S = 2.5
"""Maximum age of HEARTBEAT, EKF_STATUS_REPORT (2 Hz) and GPS_RAW_INT: one may be lost."""
_FIX_3D = 3
"""Fix type required beside an absolute position, which dead reckoning by the wind reports, too."""


def failsafes_by_text(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with the failsafe that a text begins or ends."""
    text, reported = message.text, telemetry.failsafes_reported
    rows = profile_of(telemetry).failsafe_texts
    begun = {row.failsafe: now_s for row in rows if row.begins.match(text)}
    ended = {row.failsafe for row in rows if row.ends == text}
    left = {failsafe: sign_s for failsafe, sign_s in reported.items() if failsafe not in ended}
    after = {**left, **begun}
    return telemetry if after == reported else replace(telemetry, failsafes_reported=after)


def lasting_failsafes(telemetry: Telemetry, now_s: float) -> dict[Failsafe, float]:
    """Reported failsafes that are still active, with the times of their last signs.

    Called at each heartbeat. A doubtful position is a sign of an estimator failsafe.
    """
    autopilot, gnss = telemetry.autopilot, telemetry.gnss
    sure = (
        autopilot is not None
        and now_s - autopilot.received_s <= _FRESH_S
        and _position_sure(telemetry, now_s)
    )
    fixed = gnss is not None and now_s - gnss.received_s <= _FRESH_S and gnss.fix_type >= _FIX_3D
    signs = {Failsafe.ESTIMATOR: not sure, Failsafe.DEAD_RECKONING: not (sure and fixed)}
    lasts_s = {row.failsafe: row.lasts_s for row in profile_of(telemetry).failsafe_texts}
    return {
        failsafe: now_s if signs.get(failsafe) else sign_s
        for failsafe, sign_s in telemetry.failsafes_reported.items()
        if signs.get(failsafe) or now_s - sign_s <= lasts_s.get(failsafe, math.inf)
    }


def _position_sure(telemetry: Telemetry, now_s: float) -> bool:
    estimator = telemetry.estimator
    if estimator is None or now_s - estimator.received_s > _FRESH_S:
        return False
    innovations = (
        estimator.velocity_innovation,
        estimator.position_innovation,
        estimator.compass_innovation,
    )
    most = profile_of(telemetry).innovation_limit
    usual = all(value is None or value < most for value in innovations)
    return estimator.horizontal_position_ok and usual


_NO_AIRCRAFT = {
    int(mavlink.MAV_TYPE_ANTENNA_TRACKER),
    int(mavlink.MAV_TYPE_GCS),
    int(mavlink.MAV_TYPE_ONBOARD_CONTROLLER),
    int(mavlink.MAV_TYPE_GIMBAL),
    int(mavlink.MAV_TYPE_ADSB),
    int(mavlink.MAV_TYPE_CAMERA),
    int(mavlink.MAV_TYPE_CHARGING_STATION),
    int(mavlink.MAV_TYPE_FLARM),
    int(mavlink.MAV_TYPE_SERVO),
    int(mavlink.MAV_TYPE_ODID),
    int(mavlink.MAV_TYPE_BATTERY),
    int(mavlink.MAV_TYPE_LOG),
    int(mavlink.MAV_TYPE_OSD),
    int(mavlink.MAV_TYPE_IMU),
    int(mavlink.MAV_TYPE_GPS),
    int(mavlink.MAV_TYPE_WINCH),
}


_GROUND_GAP_S = 5.0
"""Gap after which a ground station counts as new: five heartbeats."""
_OPERATOR_S = 10.0
"""Least time for which a ground station was received before its order makes it the operator's."""


def update(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry updated by this message; unchanged by messages without a translator.

    Ids are not checked: the caller passes messages of the autopilot, heartbeats of ground stations,
    radios, and the obstacles of sensors on board. Never raises on a decoded message.
    """
    translator = _TRANSLATORS.get(message.get_msgId())
    return telemetry if translator is None else translator(telemetry, message, now_s)


def autopilot_kind(message: Message) -> AutopilotKind | None:
    """Kind of the autopilot that sent a HEARTBEAT; None if not from an aircraft's autopilot."""
    if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type in _NO_AIRCRAFT:
        return None
    return kind_of(message.autopilot)


def is_ground_station(message: Message) -> bool:
    """Returns True for a HEARTBEAT of a ground station (MAV_TYPE_GCS)."""
    return bool(message.type == mavlink.MAV_TYPE_GCS)


def boot_time_s(message: Message) -> float | None:
    """Autopilot's clock in a message that carries it, otherwise None.

    Both autopilots' TIMESYNC requests carry the time since boot, too; without requested streams
    ArduPilot sends no other message with it.
    """
    message_id = message.get_msgId()
    if message_id in BOOT_TIME_AT:
        return float(message.time_boot_ms) * 1e-3
    if message_id == mavlink.MAVLINK_MSG_ID_TIMESYNC and message.tc1 == 0:
        return float(message.ts1) * 1e-9
    return None


def _heartbeat(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if is_ground_station(message):
        return _ground_heartbeat(telemetry, message.get_srcSystem(), now_s)
    kind = autopilot_kind(message)
    if kind is None:
        return telemetry
    mode = (kind, message.custom_mode, message.type)
    before, failsafe = telemetry.autopilot, modes.is_failsafe(message.system_status)
    cleared = before is not None and before.failsafe and not failsafe
    mode_since_s = failsafe_since_s = None
    if before is not None:
        same = message.custom_mode == before.custom_mode
        mode_since_s = before.mode_since_s if same else now_s
        failsafe_since_s = before.failsafe_since_s if before.failsafe else now_s
    return replace(
        telemetry,
        failsafes_reported={} if cleared else lasting_failsafes(telemetry, now_s),
        autopilot=AutopilotStatus(
            received_s=now_s,
            system_id=message.get_srcSystem(),
            component_id=message.get_srcComponent(),
            kind=kind,
            armed_s=now_s,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            custom_mode=message.custom_mode,
            mode=modes.mode_name(*mode),
            ours=modes.is_ours(*mode),
            homeward=modes.is_homeward(*mode),
            multirotor=modes.is_multirotor(message.type),
            failsafe=failsafe,
            mode_since_s=mode_since_s,
            failsafe_since_s=failsafe_since_s if failsafe else None,
            vehicle_type=message.type,
            motors=modes.motor_count(message.type),
        ),
    )


def _ground_heartbeat(telemetry: Telemetry, system_id: int, now_s: float) -> Telemetry:
    before = telemetry.ground_stations.get(system_id)
    since_s = now_s
    if before is not None and now_s - before.received_s <= _GROUND_GAP_S:
        since_s = before.since_s or 0.0
    received = PeerHeartbeat(received_s=now_s, system_id=system_id, since_s=since_s)
    counts = telemetry.operator_id in {None, system_id}
    return replace(
        telemetry,
        ground_station=received if counts else telemetry.ground_station,
        ground_stations={**telemetry.ground_stations, system_id: received},
    )


def with_operator(telemetry: Telemetry, system_id: int) -> Telemetry:
    """Telemetry after an order of this system: its ground station is the operator's from now on.

    Only one that has been received for some time: a command line sends its order and leaves.
    """
    station = telemetry.ground_stations.get(system_id)
    if station is None or station.received_s - (station.since_s or 0.0) < _OPERATOR_S:
        return telemetry
    return replace(telemetry, operator_id=system_id, ground_station=station)


def _current_mode(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with the mode of CURRENT_MODE; only HEARTBEAT reports arming and vehicle type.

    Measured on PX4 v1.17: while a failsafe flies, the intended mode is the requested one.
    """
    before = telemetry.autopilot
    if before is None:
        return telemetry
    mode = (before.kind, message.custom_mode, before.vehicle_type)
    asked_for = message.intended_custom_mode in {0, message.custom_mode}
    same = message.custom_mode == before.custom_mode
    failsafe = (before.failsafe if same else False) or not asked_for
    failsafe_since_s = before.failsafe_since_s if before.failsafe else now_s
    after = replace(
        before,
        received_s=now_s,
        custom_mode=message.custom_mode,
        mode=modes.mode_name(*mode),
        ours=modes.is_ours(*mode),
        homeward=modes.is_homeward(*mode),
        failsafe=failsafe,
        mode_since_s=before.mode_since_s if same else now_s,
        failsafe_since_s=failsafe_since_s if failsafe else None,
    )
    return replace(telemetry, autopilot=after)


_TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    CURRENT_MODE_ID: _current_mode,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: failsafes_by_text,
    **translate_motion.TRANSLATORS,
    **translate_motors.TRANSLATORS,
    **translate_obstacles.TRANSLATORS,
    **translate_radio.TRANSLATORS,
    **translate_status.TRANSLATORS,
}

MESSAGE_IDS: frozenset[int] = frozenset(_TRANSLATORS)
"""Messages that change telemetry."""
