"""ArduPilot's onboard log as a recording: messages to telemetry, as the companion has it. Pure.

Names and fields are those of ArduCopter 3.1 to 4 (libraries/AP_Logger/LogStructure.h and its
parts, before 4 libraries/DataFlash). A second sensor or estimator core has a number in its
messages, before 4 messages of its own (GPS2, NKF6). Of several estimators the log names the one in
use. What a log lacks stays unknown: the companion's link, before 3.3 the estimated latitude and
longitude; the log of a default ArduPilot begins when it is armed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ...mavlink.autopilots import profile
from ...mavlink.dataflash import Row
from ...mavlink.identity import Autopilot, AutopilotFound
from ...mavlink.modes import is_homeward, is_multirotor, is_ours, mode_name, motor_count
from ...mavlink.packet_count import SourceStatistics
from ...mavlink.passive_listener import Input, ListenerEvent, TextReceived, type_in_words
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
    RemoteControl,
    Telemetry,
)
from ...mavlink.translate_motion import with_wind
from ...mavlink.translate_motors import motor_outputs
from ...mavlink.translate_radio import with_radio
from ...mavlink.translate_status import horizontal_position_ok, innovation
from ...texts.text_format import printable
from ...types import ARDUPILOT, AutopilotKind, GeodeticPoint, Vector

_ALIVE_S = 0.5
"""Age from which the mode counts as reported again: the log has its changes, and a log entry shows
that the autopilot runs."""
_GLITCH = 1 << 14
"""nav_filter_status: GPS glitching (AP_NavEKF/AP_Nav_Common.h); the first ten bits are those of
EKF_STATUS_REPORT."""
_WEEK_S = 604_800.0
_FIRMWARE = re.compile(r"(?:Ardu|APM:?)(plane|rover|sub)", re.IGNORECASE)
_FIRMWARES = {"plane": 1, "rover": 10, "sub": 12}
"""MAV_TYPE by the name of the firmware; a copter's is by its frame."""
_FRAME = "Frame: "
_FRAME_NAMES = {"HEXA": 13, "Y6": 13, "OCTA": 14, "OCTA_QUAD": 14, "TRI": 15, "HELI": 4}
"""Frame by the firmware's text to MAV_TYPE: before 3.5 the frame was no parameter."""
_FRAMES = {1: 2, 2: 13, 3: 14, 4: 14, 5: 13, 6: 4, 7: 15, 12: 29}
"""FRAME_CLASS (AP_Motors_Class.h) to MAV_TYPE."""
_QUADROTOR = 2
_NUMBER = "number"
_FAILSAFES = {5, 6, 8, 17}
"""Subsystems of ERR (LogErrorSubsystem): failsafe of radio, battery, ground station, estimator."""
_ESTIMATORS = {"EKF": 1, "NKF": 2, "XKF": 3}
"""AHRS_EKF_TYPE by the first letters of an estimator's messages."""
_NUMBERS = ("I", "C", "Inst", "Instance")
"""Fields with the number of a sensor or an estimator core."""
_CAPACITY = re.compile(r"BATT(\d*)_CAPACITY")
_EVENTS_ARMED = {10: True, 15: True, 11: False}
_EVENTS_LANDED = {18: LandedState.ON_GROUND, 28: LandedState.IN_AIR}
"""LogEvent: armed, auto-armed, disarmed; landed, not landed."""


class DataflashListener:
    """Reads a log as the companion reads its autopilot; a `Witness` of another format."""

    def __init__(self) -> None:
        self.telemetry = Telemetry()
        self.autopilot: AutopilotKind | None = None
        self.vehicle_type: str | None = None
        self.leans = True
        self.inputs = {name: Input() for name in dict.fromkeys(INPUT_OF.values()) if name}
        self.sources: dict[tuple[int, int], SourceStatistics] = {}
        self._type = _QUADROTOR
        self._mode = 0
        self._armed = False
        self._failing: set[int] = set()
        self._estimator: int | None = None
        self._core = 0
        self._capacities_mah: dict[int, float] = {}
        self._accuracies: dict[int, dict[str, Any]] = {}

    def tick(self, now_s: float) -> None:
        """Does nothing: a log has no packets to count."""

    def handle(self, row: Row, now_s: float) -> list[ListenerEvent]:
        """Takes a message; returns the events in it."""
        name, fields = row
        if name[:3] in _ESTIMATORS and self._estimator not in {None, _ESTIMATORS[name[:3]]}:
            return []
        number = next((fields[key] for key in _NUMBERS if key in fields), _TABLE[name][2])
        before = self.telemetry
        try:
            events = _TABLE[name][1](self, {**_known(fields), _NUMBER: number}, now_s) or []
        except (KeyError, TypeError):  # fields of another version, or without a value
            return []
        status = self.telemetry.autopilot
        if status is not None and now_s - status.received_s > _ALIVE_S:
            self._note_status(now_s)
        source = INPUT_OF[name]
        if source and self.telemetry is not before:
            self.inputs[source] = Input(messages=self.inputs[source].messages + 1, last_s=now_s)
        return events

    # Status

    def _note_status(self, now_s: float) -> list[ListenerEvent]:
        """Sets mode and armed state, as a heartbeat would."""
        mode, kind = self._mode, self._type
        status = AutopilotStatus(
            received_s=now_s,
            system_id=1,
            component_id=1,
            kind=ARDUPILOT,
            armed=self._armed,
            custom_mode=mode,
            mode=mode_name(ARDUPILOT, mode, kind),
            ours=is_ours(ARDUPILOT, mode, kind),
            homeward=is_homeward(ARDUPILOT, mode, kind),
            multirotor=is_multirotor(kind),
            failsafe=bool(self._failing),
            vehicle_type=kind,
            motors=motor_count(kind),
        )
        self.telemetry = replace(self.telemetry, autopilot=status)
        self.vehicle_type, self.leans = type_in_words(kind), is_multirotor(kind)
        if self.autopilot is not None:
            return []
        self.autopilot = ARDUPILOT
        found = Autopilot(system_id=1, component_id=1, kind=ARDUPILOT, link="log")
        return [AutopilotFound(autopilot=found)]

    def read_mode(self, fields: dict[str, Any], now_s: float) -> list[ListenerEvent]:
        """Takes MODE."""
        self._mode = int(fields["ModeNum" if "ModeNum" in fields else "Mode"])
        return self._note_status(now_s)

    def read_armed(self, fields: dict[str, Any], now_s: float) -> list[ListenerEvent]:
        """Takes ARM."""
        self._armed = bool(fields["ArmState"])
        return self._note_status(now_s)

    def read_event(self, fields: dict[str, Any], now_s: float) -> list[ListenerEvent]:
        """Takes EV."""
        event = int(fields["Id"])
        landed = _EVENTS_LANDED.get(event)
        if landed is not None:
            reported = Landed(received_s=now_s, state=landed)
            self.telemetry = replace(self.telemetry, landed=reported)
        if event not in _EVENTS_ARMED:
            return []
        self._armed = _EVENTS_ARMED[event]
        return self._note_status(now_s)

    def read_error(self, fields: dict[str, Any], now_s: float) -> list[ListenerEvent]:
        """Takes ERR."""
        subsystem, code = int(fields["Subsys"]), int(fields["ECode"])
        if subsystem in _FAILSAFES:
            (self._failing.add if code else self._failing.discard)(subsystem)
        text = ReceivedText(severity="error", text=f"ERR subsystem {subsystem}, code {code}")
        return [*self._note_status(now_s), TextReceived(ours=False, text=text)]

    def read_text(self, fields: dict[str, Any], _now_s: float) -> list[ListenerEvent]:
        """Takes MSG."""
        text = printable(str(fields["Message"]))
        firmware = _FIRMWARE.match(text)
        if firmware is not None:
            self._type = _FIRMWARES[firmware[1].lower()]
        elif text.startswith(_FRAME):
            self._type = _FRAME_NAMES.get(text.removeprefix(_FRAME).split("/")[0], self._type)
        return [TextReceived(ours=False, text=ReceivedText(severity="info", text=text))]

    def read_parameter(self, fields: dict[str, Any], _now_s: float) -> None:
        """Takes PARM."""
        name, value = fields["Name"], float(fields["Value"])
        if name == "FRAME_CLASS" and self._type == _QUADROTOR:
            self._type = _FRAMES.get(int(value), _QUADROTOR)
        elif name == "AHRS_EKF_TYPE":
            self._estimator = int(value) if value in _ESTIMATORS.values() else None
        elif (battery := _CAPACITY.fullmatch(name)) is not None:
            self._capacities_mah[int(battery[1] or 1) - 1] = value
        elif name == "MOT_PWM_MIN" and value > 0.0:
            self.telemetry = replace(self.telemetry, motor_min_us=value)
        elif name == "MOT_PWM_MAX" and value > 0.0:
            self.telemetry = replace(self.telemetry, motor_max_us=value)

    # Position

    def read_attitude(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes ATT, degrees."""
        attitude = Attitude(
            received_s=now_s,
            roll_rad=math.radians(fields["Roll"]),
            pitch_rad=math.radians(fields["Pitch"]),
            yaw_rad=math.radians(math.remainder(fields["Yaw"], 360.0)),
        )
        self.telemetry = replace(self.telemetry, attitude=attitude)

    def read_estimate(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes XKF1: position and velocity about the origin."""
        if fields[_NUMBER] != self._core:
            return
        local = LocalPosition(
            received_s=now_s,
            boot_s=fields["TimeUS"] * 1e-6 if "TimeUS" in fields else fields["TimeMS"] * 1e-3,
            position_ned_m=_vector(fields, "PN", "PE", "PD"),
            velocity_ned_mps=_vector(fields, "VN", "VE", "VD"),
        )
        self.telemetry = replace(self.telemetry, local_position=local)

    def read_position(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes POS."""
        position = GlobalPosition(received_s=now_s, point=_point(fields))
        self.telemetry = replace(self.telemetry, global_position=position)

    def read_origin(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes ORGN: the estimator's origin, or home."""
        point = _point(fields)
        if fields["Type"] == 0:
            origin = LocalOrigin(received_s=now_s, point=point)
            self.telemetry = replace(self.telemetry, local_origin=origin)
        elif self.telemetry.local_origin is not None:
            origin_point = self.telemetry.local_origin.point
            place = profile(ARDUPILOT).to_local_ned(point, origin_point)
            home = Home(received_s=now_s, point=point, position_ned_m=place)
            self.telemetry = replace(self.telemetry, home=home)

    def read_wind(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes XKF2: the estimated wind; zero is no estimate."""
        if fields[_NUMBER] == self._core:
            known = None not in {fields["VWN"], fields["VWE"]}
            wind = (fields["VWN"], fields["VWE"], 0.0) if known else (0.0, 0.0, 0.0)
            self.telemetry = with_wind(self.telemetry, now_s, wind, 0.0)

    # Health

    def read_health(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes XKF4: innovations as fractions of the accepted ones, and status."""
        self._core = max(0, int(fields.get("PI", 0)))
        if fields[_NUMBER] != self._core:
            return
        compass = (
            fields["SM"] if "SM" in fields else math.hypot(*(fields[f"SM{axis}"] for axis in "XYZ"))
        )
        flags = int(fields["SS"])
        estimator = Estimator(
            received_s=now_s,
            flags=flags,
            horizontal_position_ok=horizontal_position_ok(flags, _GLITCH),
            horizontal_accuracy_m=None,
            velocity_innovation=innovation(fields["SV"] or 0.0),
            position_innovation=innovation(fields["SP"] or 0.0),
            height_innovation=innovation(fields["SH"] or 0.0),
            compass_innovation=innovation(compass or 0.0),
        )
        self.telemetry = replace(self.telemetry, estimator=estimator)

    def read_accuracy(self, fields: dict[str, Any], _now_s: float) -> None:
        """Takes GPA, which comes before its GPS."""
        self._accuracies[fields[_NUMBER]] = fields

    def read_gnss(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes GPS."""
        accuracy = self._accuracies.get(fields[_NUMBER], {})
        week, week_ms = ("GWk", "GMS") if "GMS" in fields else ("Week", "TimeMS")
        gnss = Gnss(
            received_s=now_s,
            receiver_s=_WEEK_S * fields[week] + fields[week_ms] * 1e-3,
            fix_type=int(fields["Status"]),
            satellites=int(fields["NSats"]),
            hdop=fields["HDop"] or None,
            vdop=accuracy.get("VDop") or None,
            horizontal_accuracy_m=accuracy.get("HAcc") or None,
            vertical_accuracy_m=accuracy.get("VAcc") or None,
        )
        if fields[_NUMBER] == 0:
            self.telemetry = replace(self.telemetry, gnss=gnss)
        elif fields[_NUMBER] == 1:
            self.telemetry = replace(self.telemetry, second_gnss=gnss)

    def read_battery(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes BAT, before 3.7 named CURR."""
        number, current_a = int(fields[_NUMBER]), _units(fields["Curr"])
        battery = Battery(
            received_s=now_s,
            remaining=self._remaining(number, fields),
            voltage_v=_units(fields["Volt"]) or None,
            current_a=current_a if current_a is not None and current_a >= 0.0 else None,
            charge_state=None,
        )
        batteries = {**self.telemetry.batteries, number: battery}
        self.telemetry = replace(self.telemetry, batteries=batteries)

    def _remaining(self, number: int, fields: dict[str, Any]) -> float | None:
        """Fraction left: as logged, before 4.1 of the capacity, as ArduPilot reports it."""
        if "RemPct" in fields:
            percent = fields["RemPct"]
            return percent / 100.0 if percent is not None and 0 <= percent <= 100 else None
        used_mah, capacity_mah = fields["CurrTot"] or 0.0, self._capacities_mah.get(number, 0.0)
        if used_mah <= 0.0 or capacity_mah <= 0.0:  # 0: the current is not measured
            return None
        return max(0.0, 1.0 - used_mah / capacity_mah)

    def read_magnetometer(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes MAG, milligauss."""
        gauss = 1e-3 * math.hypot(fields["MagX"], fields["MagY"], fields["MagZ"])
        if fields[_NUMBER] == 0 and gauss:
            field = MagneticField(received_s=now_s, strength_gauss=gauss)
            self.telemetry = replace(self.telemetry, magnetic_field=field)

    def read_motors(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes RCOU, of 3.1 MOT."""
        prefix = next(prefix for prefix in ("C", "Ch", "Chan", "Mot") if f"{prefix}1" in fields)
        names = (f"{prefix}{number}" for number in range(1, 15))
        pulses = (fields[name] for name in names if name in fields)
        self.telemetry = motor_outputs(self.telemetry, pulses, now_s)

    def read_remote_control(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes RSSI."""
        remote = RemoteControl(received_s=now_s, rssi=fields["RXRSSI"])
        self.telemetry = replace(self.telemetry, remote_control=remote)

    def read_radio(self, fields: dict[str, Any], now_s: float) -> None:
        """Takes RAD."""
        self.telemetry = with_radio(
            self.telemetry,
            now_s,
            here=(fields["RSSI"], fields["Noise"]),
            there=(fields["RemRSSI"], fields["RemNoise"]),
            receive_errors=fields["RxErrors"],
            corrected=fields["Fixed"],
            free_percent=fields["TxBuf"],
        )


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    """Fields with None for NaN and infinite numbers: no measurement."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in fields.items()
    }


def _vector(fields: dict[str, Any], *names: str) -> Vector:
    """Three numbers; TypeError where one is unknown."""
    first, second, third = (float(fields[name]) for name in names)
    return first, second, third


def _point(fields: dict[str, Any]) -> GeodeticPoint:
    latitude_deg, longitude_deg, altitude_m = _vector(fields, "Lat", "Lng", "Alt")
    return GeodeticPoint(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_m
    )


def _units(value: float | None) -> float | None:
    """Volts or amperes: whole numbers are hundredths, as logged before 3.4."""
    return value / 100.0 if isinstance(value, int) else value


_Reader = Callable[[DataflashListener, dict[str, Any], float], list[ListenerEvent] | None]
_READERS: tuple[tuple[str, _Reader, tuple[str, ...]], ...] = (
    ("autopilot", DataflashListener.read_mode, ("MODE",)),
    ("autopilot", DataflashListener.read_armed, ("ARM",)),
    ("landed", DataflashListener.read_event, ("EV",)),
    ("autopilot", DataflashListener.read_error, ("ERR",)),
    ("", DataflashListener.read_text, ("MSG",)),
    ("", DataflashListener.read_parameter, ("PARM",)),
    ("attitude", DataflashListener.read_attitude, ("ATT",)),
    ("local_position", DataflashListener.read_estimate, ("EKF1 NKF1 XKF1", "NKF6 XKF6")),
    ("global_position", DataflashListener.read_position, ("POS",)),
    ("home", DataflashListener.read_origin, ("ORGN",)),
    ("wind", DataflashListener.read_wind, ("EKF2 NKF2 XKF2", "NKF7 XKF7")),
    ("estimator", DataflashListener.read_health, ("EKF4 NKF4 XKF4", "NKF9 XKF9")),
    ("gps", DataflashListener.read_accuracy, ("GPA", "GPA2")),
    ("gps", DataflashListener.read_gnss, ("GPS", "GPS2")),
    ("battery", DataflashListener.read_battery, ("BAT CURR", "BAT2 CUR2", "BAT3", "BAT4")),
    ("magnetometer", DataflashListener.read_magnetometer, ("MAG",)),
    ("motors", DataflashListener.read_motors, ("RCOU MOT",)),
    ("remote_control", DataflashListener.read_remote_control, ("RSSI",)),
    ("radio", DataflashListener.read_radio, ("RAD",)),
)
"""Input, reader, and names of the messages; those of a second sensor or core after a comma."""
_TABLE: dict[str, tuple[str, _Reader, int]] = {
    name: (source, reader, number)
    for source, reader, numbered in _READERS
    for number, names in enumerate(numbered)
    for name in names.split()
}
"""Input, reader, and the number of a message that has none, by name."""
MESSAGES = frozenset(_TABLE)
"""Messages that the listener reads."""
INPUT_OF = {name: entry[0] for name, entry in _TABLE.items()}
"""Input of each message; empty for those of none."""
