"""Translation of a PX4 ULog: a row of a topic to `Telemetry`. Pure.

Each topic becomes the value that its message becomes in `mavlink.translate`, with the same values
for unknown. Names and fields are those of PX4 v1.8 to v1.17 (msg/*.msg); what a log lacks stays
unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ...mavlink.modes import is_homeward, is_multirotor, is_ours, mode_name, motor_count
from ...mavlink.statustext import ReceivedText
from ...mavlink.telemetry import (
    Attitude,
    AutopilotStatus,
    Battery,
    Estimator,
    GlobalPosition,
    Gnss,
    Home,
    Landed,
    LandedState,
    LocalOrigin,
    LocalPosition,
    MagneticField,
    PeerHeartbeat,
    RemoteControl,
    Telemetry,
)
from ...mavlink.translate_motion import with_wind
from ...mavlink.translate_motors import motor_outputs
from ...mavlink.translate_radio import with_radio
from ...mavlink.translate_status import ESTIMATOR_GPS_GLITCH, horizontal_position_ok, innovation
from ...types import PX4, GeodeticPoint

ESTIMATOR, ESTIMATOR_SELECTOR = "estimator_status", "estimator_selector_status"
"""Each estimator is an instance of the first topic; the second names the one in use."""
_MODES = {
    0: (1, 0),
    1: (2, 0),
    2: (3, 0),
    3: (4, 4),
    4: (4, 3),
    5: (4, 5),
    6: (3, 2),
    10: (5, 0),
    12: (4, 6),
    13: (10, 0),
    14: (6, 0),
    15: (7, 0),
    16: (8, 0),
    17: (4, 2),
    18: (4, 6),
    19: (4, 8),
    20: (4, 9),
    21: (3, 1),
    22: (4, 10),
}
"""vehicle_status.nav_state to main and sub mode of the heartbeat (px4_custom_mode.h)."""
_ARMED = 2
_GROUND_STATION = 6
"""MAV_TYPE_GCS."""
_MAX_RSSI = 100
_CHARGE_STATES = {0: 1, 1: 2, 2: 3, 3: 4, 4: 5, 6: 6, 7: 7}
"""battery_status.warning to MAV_BATTERY_CHARGE_STATE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UlogTopic:
    """One instance of a logged topic: columns of equal length, of which one is `timestamp` (us)."""

    name: str
    instance: int
    columns: Mapping[str, Sequence[float]]


@dataclass(frozen=True, slots=True)
class UlogSample:
    """Entry of one instant: a row of a topic, or a text with its level."""

    topic: UlogTopic | None
    row: int
    text: ReceivedText | None = None

    def value(self, *names: str) -> float | None:
        """First of these fields in the log; None if it has none of them, or no number."""
        assert self.topic is not None
        for name in names:
            column = self.topic.columns.get(name)
            if column is not None:
                value = column[self.row]
                return value if math.isfinite(value) else None
        return None

    def values(self, *names: str) -> tuple[float, ...] | None:
        """Values of these fields; None if one of them is missing or no number."""
        found = tuple(value for name in names if (value := self.value(name)) is not None)
        return found if len(found) == len(names) else None

    def whole(self, name: str) -> int:
        """Whole number or flag; 0 if the log does not have it."""
        return int(self.value(name) or 0)


def _status(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    main, sub = _MODES.get(sample.whole("nav_state"), (0, 0))
    custom_mode, vehicle_type = main << 16 | sub << 24, sample.whole("system_type")
    kind = PX4
    status = AutopilotStatus(
        received_s=now_s,
        system_id=sample.whole("system_id"),
        component_id=sample.whole("component_id"),
        kind=kind,
        armed=sample.whole("arming_state") == _ARMED,
        custom_mode=custom_mode,
        mode=mode_name(kind, custom_mode, vehicle_type),
        ours=is_ours(kind, custom_mode, vehicle_type),
        homeward=is_homeward(kind, custom_mode, vehicle_type),
        multirotor=is_multirotor(vehicle_type),
        failsafe=bool(sample.whole("failsafe")),
        motors=motor_count(vehicle_type),
    )
    return replace(telemetry, autopilot=status)


def _attitude(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    quaternion = sample.values("q[0]", "q[1]", "q[2]", "q[3]")
    if quaternion is None:
        return telemetry
    w, x, y, z = quaternion
    attitude = Attitude(
        received_s=now_s,
        roll_rad=math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        pitch_rad=math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
        yaw_rad=math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
    return replace(telemetry, attitude=attitude)


def _local_position(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    if not all(map(sample.whole, ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"))):
        return telemetry
    position, velocity = sample.values("x", "y", "z"), sample.values("vx", "vy", "vz")
    if position is None or velocity is None:
        return telemetry
    (north, east, down), (v_north, v_east, v_down) = position, velocity
    local = LocalPosition(
        received_s=now_s,
        boot_s=sample.whole("timestamp") * 1e-6,
        position_ned_m=(north, east, down),
        velocity_ned_mps=(v_north, v_east, v_down),
    )
    telemetry = replace(telemetry, local_position=local)
    point = _point(sample, "ref_lat", "ref_lon", "ref_alt")
    if point is None or not (sample.whole("xy_global") and sample.whole("z_global")):
        return telemetry
    return replace(telemetry, local_origin=LocalOrigin(received_s=now_s, point=point))


def _global_position(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    point = _point(sample, "lat", "lon", "alt")
    if point is None:
        return telemetry
    return replace(telemetry, global_position=GlobalPosition(received_s=now_s, point=point))


def _home(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    point, position = _point(sample, "lat", "lon", "alt"), sample.values("x", "y", "z")
    if point is None or position is None:
        return telemetry
    north, east, down = position
    home = Home(received_s=now_s, point=point, position_ned_m=(north, east, down))
    return replace(telemetry, home=home)


def _point(
    sample: UlogSample, latitude: str, longitude: str, altitude: str
) -> GeodeticPoint | None:
    place = sample.values(latitude, longitude, altitude)
    if place is None or place[:2] == (0.0, 0.0):
        return None
    return GeodeticPoint(latitude_deg=place[0], longitude_deg=place[1], altitude_amsl_m=place[2])


def _landed(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    state = LandedState.ON_GROUND if sample.whole("landed") else LandedState.IN_AIR
    return replace(telemetry, landed=Landed(received_s=now_s, state=state))


def _battery(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    assert sample.topic is not None
    if not sample.whole("connected"):
        return telemetry
    remaining, current_a = sample.value("remaining"), sample.value("current_a")
    warning = sample.value("warning")
    battery = Battery(
        received_s=now_s,
        remaining=remaining if remaining is not None and 0.0 <= remaining <= 1.0 else None,
        voltage_v=sample.value("voltage_v") or None,
        current_a=current_a if current_a is not None and current_a >= 0.0 else None,
        charge_state=None if warning is None else _CHARGE_STATES.get(int(warning)),
    )
    return replace(telemetry, batteries={**telemetry.batteries, sample.topic.instance: battery})


def _gnss(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    assert sample.topic is not None
    gnss = Gnss(
        received_s=now_s,
        receiver_s=sample.whole("timestamp") * 1e-6,
        fix_type=sample.whole("fix_type"),
        satellites=sample.whole("satellites_used"),
        hdop=sample.value("hdop") or None,
        vdop=sample.value("vdop") or None,
        horizontal_accuracy_m=sample.value("eph") or None,
        vertical_accuracy_m=sample.value("epv") or None,
    )
    if sample.topic.instance == 0:
        return replace(telemetry, gnss=gnss)
    # PX4 weighs its receivers by their accuracy (SENS_GPS_MASK).
    return replace(telemetry, second_gnss=gnss, better_gnss_taken=True)


def _estimator(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    flags = sample.whole("solution_status_flags")
    estimator = Estimator(
        received_s=now_s,
        flags=flags,
        horizontal_position_ok=horizontal_position_ok(flags, ESTIMATOR_GPS_GLITCH),
        horizontal_accuracy_m=sample.value("pos_horiz_accuracy") or None,
        vertical_accuracy_m=sample.value("pos_vert_accuracy") or None,
        velocity_innovation=innovation(sample.value("vel_test_ratio") or 0.0),
        position_innovation=innovation(sample.value("pos_test_ratio") or 0.0),
        height_innovation=innovation(sample.value("hgt_test_ratio") or 0.0),
        compass_innovation=innovation(sample.value("mag_test_ratio") or 0.0),
    )
    return replace(telemetry, estimator=estimator)


def _magnetic_field(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    field = sample.values("magnetometer_ga[0]", "magnetometer_ga[1]", "magnetometer_ga[2]")
    strength = 0.0 if field is None else math.hypot(*field)
    if not strength:
        return telemetry
    return replace(
        telemetry, magnetic_field=MagneticField(received_s=now_s, strength_gauss=strength)
    )


def _wind(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    wind = sample.values("windspeed_north", "windspeed_east")
    north = sample.value("variance_north", "covariance_north")
    east = sample.value("variance_east", "covariance_east")
    if wind is None:
        return replace(telemetry, wind=None)
    variance_m2ps2 = 0.0 if north is None else north + (north if east is None else east)
    return with_wind(telemetry, now_s, (wind[0], wind[1], 0.0), variance_m2ps2)


def _remote_control(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    remote, rssi = telemetry.remote_control, sample.value("rssi")
    known = remote is not None and remote.rssi is not None
    if rssi is not None and not (0.0 <= rssi <= _MAX_RSSI and (rssi or known)):
        rssi = None
    fraction = None if rssi is None else rssi / _MAX_RSSI
    return replace(telemetry, remote_control=RemoteControl(received_s=now_s, rssi=fraction))


def _radio(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    return with_radio(
        telemetry,
        now_s,
        here=(sample.whole("rssi"), sample.whole("noise")),
        there=(sample.whole("remote_rssi"), sample.whole("remote_noise")),
        receive_errors=sample.whole("rxerrors"),
        corrected=sample.whole("fix"),
        free_percent=sample.whole("txbuf"),
    )


def _ground_station(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    """Reads a flag, and before v1.12 the last heartbeats with their times."""
    stamp_us = sample.whole("timestamp")
    ages_s = [
        (stamp_us - sample.whole(f"heartbeats[{slot}].timestamp")) * 1e-6
        for slot in range(4)
        if sample.whole(f"heartbeats[{slot}].type") == _GROUND_STATION
    ]
    if sample.whole("heartbeat_type_gcs"):
        ages_s.append(0.0)
    if not ages_s:
        return telemetry
    received_s, last = now_s - max(0.0, min(ages_s)), telemetry.ground_station
    if last is not None and last.received_s >= received_s:
        return telemetry
    return replace(telemetry, ground_station=PeerHeartbeat(received_s=received_s, system_id=255))


def _motors(telemetry: Telemetry, sample: UlogSample, now_s: float) -> Telemetry:
    assert sample.topic is not None
    if sample.topic.instance != 0:
        return telemetry
    outputs = (sample.whole(f"output[{number}]") for number in range(sample.whole("noutputs")))
    return motor_outputs(telemetry, outputs, now_s)


_Translator = Callable[[Telemetry, UlogSample, float], Telemetry]
_TRANSLATORS: dict[str, tuple[str, _Translator]] = {
    "vehicle_status": ("autopilot", _status),
    "vehicle_attitude": ("attitude", _attitude),
    "vehicle_local_position": ("local_position", _local_position),
    "vehicle_global_position": ("global_position", _global_position),
    "home_position": ("home", _home),
    "vehicle_land_detected": ("landed", _landed),
    "battery_status": ("battery", _battery),
    "vehicle_gps_position": ("gps", _gnss),
    ESTIMATOR: ("estimator", _estimator),
    ESTIMATOR_SELECTOR: ("estimator", lambda telemetry, _sample, _now_s: telemetry),
    "vehicle_magnetometer": ("magnetometer", _magnetic_field),
    "wind": ("wind", _wind),
    "wind_estimate": ("wind", _wind),
    "input_rc": ("remote_control", _remote_control),
    "radio_status": ("radio", _radio),
    "telemetry_status": ("ground_station", _ground_station),
    "actuator_outputs": ("motors", _motors),
}
TOPICS: dict[str, _Translator] = {name: entry[1] for name, entry in _TRANSLATORS.items()}
"""Topics that are read."""
INPUT_OF = {name: entry[0] for name, entry in _TRANSLATORS.items()}
"""Input of each topic."""
