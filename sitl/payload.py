"""A camera (component 100) and a gimbal (component 154) on a simulated aircraft, by MAVLink.

One machine without I/O, as the autopilot: bytes and true states in, bytes out.

    payload = Payload(PayloadOptions(scene=scene), system=1)
    payload.receive(packet)               # what the companion sends on the aircraft's link
    for data in payload.step(truth): ...  # bytes for that link
    payload.faults.card_full = True       # at any time
    payload.pictures                      # as they truly are

The camera follows the camera protocol v2 (a repeated sequence number takes no second picture), the
gimbal is its own manager by the gimbal protocol v2 (it obeys the holder alone). Its yaw is relative
to the aircraft's nose, roll and pitch are level.
"""

import math
import random
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from sitl.geodesy import Geodetic, TrueFrame
from sitl.lidar_carrier import Posed
from sitl.picture import CameraPose, FloatArray, Lens, PictureScene, Sighting, seen

CAMERA, GIMBAL = mavlink.MAV_COMP_ID_CAMERA, mavlink.MAV_COMP_ID_GIMBAL
_SHUTTER_S: Final = 0.15
"""From the accepted command to the exposure."""
_STORE_S: Final = 0.35
"""From the exposure to the confirmation; until then the camera is busy."""
_STATUS_S: Final = 0.5
_ATTITUDE_S: Final = 0.1
_RESIDUAL: Final = 0.02
"""Part of the aircraft's rotation that a gimbal leaves."""


class Moving(Posed, Protocol):
    """Fields of a true state that the payload needs."""

    @property
    def velocity_ned_mps(self) -> tuple[float, float, float]:
        """Velocity."""


@dataclass(slots=True, kw_only=True)
class PayloadFaults:
    """What goes wrong; each may change in flight."""

    camera_silent: bool = False
    busy: bool = False
    """Commands for pictures are rejected temporarily."""
    card_full: bool = False
    confirmations_lost: float = 0.0
    """Part of the confirmations that are lost."""
    answers_lost: float = 0.0
    """Part of the acknowledgements that are lost."""
    gimbal_silent: bool = False
    gimbal_rate_dps: float = 60.0
    gimbal_least_deg: float = -90.0
    """Least pitch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadOptions:
    """Camera and gimbal. gimbal: False for a camera that is fixed to the aircraft."""

    scene: PictureScene
    lens: Lens = field(default_factory=Lens)
    gimbal: bool = True
    holder: tuple[int, int] = (0, 0)
    """System and component that have the gimbal from the start."""
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture as it truly is. sightings: of the scene's points, by name; absent behind it."""

    number: int
    time_s: float
    pose: CameraPose
    sightings: dict[str, Sighting]


class Payload:
    """The machine."""

    def __init__(self, options: PayloadOptions, system: int = 1) -> None:
        """Power on: no picture so far, the gimbal level and forward."""
        self.options = options
        self.faults = PayloadFaults()
        self.pictures: list[Picture] = []
        self.videos_s: list[tuple[float, float]] = []
        """Start and end of each video."""
        self.holder = options.holder
        self.zoom_percent: float | None = None
        self._system = system
        self._camera = _codec(system, CAMERA)
        self._gimbal = _codec(system, GIMBAL)
        self._parser = _codec(system, 0)
        self._random = random.Random(options.seed)
        self._frame = TrueFrame(options.scene.origin)
        azimuth = math.radians(options.scene.azimuth_deg)
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        self._from_ned = np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]])
        self._out: list[bytes] = []
        self._now_s = 0.0
        self._truth: Moving | None = None
        self._axes: FloatArray | None = None
        self._rates: FloatArray = np.zeros(3)
        self._pitch_deg = self._yaw_deg = 0.0
        self._wanted_deg = (0.0, 0.0)
        self._sequence: float | None = None
        self._exposes_s = self._stored_s = math.inf
        self._video_s: float | None = None
        self._due = dict.fromkeys(("heartbeat", "status", "attitude"), 0.0)

    # In

    def receive(self, data: bytes) -> None:
        """Take bytes from the aircraft's link."""
        for message in self._parser.parse_buffer(bytearray(data)) or []:
            if message.get_type() != "COMMAND_LONG" or message.target_system != self._system:
                continue
            if message.target_component == CAMERA and not self.faults.camera_silent:
                self._answer(self._camera, message, self._camera_command(message))
            elif message.target_component == GIMBAL and self._gimbal_answers:
                self._answer(self._gimbal, message, self._gimbal_command(message))

    def step(self, truth: Moving) -> list[bytes]:
        """Advance to a true state; return the bytes to send."""
        step_s = max(1e-3, truth.time_s - self._now_s)
        self._now_s, self._truth = truth.time_s, truth
        self._turn(truth, step_s)
        if truth.time_s >= self._exposes_s:
            self._exposes_s = math.inf
            self._stored_s = truth.time_s + _STORE_S
            self.pictures.append(self._picture())
        if truth.time_s >= self._stored_s:
            self._stored_s = math.inf
            if self._random.random() >= self.faults.confirmations_lost:
                self._confirm(len(self.pictures) - 1)
        self._stream()
        out, self._out = self._out, []
        return out

    # Camera

    def _camera_command(self, command: Any) -> int | None:
        match command.command:
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                return self._camera_message(int(command.param1), int(command.param2))
            case mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                return self._start_capture(command.param4)
            case mavlink.MAV_CMD_VIDEO_START_CAPTURE:
                if self.faults.card_full:
                    return int(mavlink.MAV_RESULT_FAILED)
                self._video_s = self._now_s if self._video_s is None else self._video_s
            case mavlink.MAV_CMD_VIDEO_STOP_CAPTURE:
                if self._video_s is not None:
                    self.videos_s.append((self._video_s, self._now_s))
                self._video_s = None
            case mavlink.MAV_CMD_SET_CAMERA_ZOOM:
                self.zoom_percent = command.param2
            case _:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _start_capture(self, sequence: float) -> int:
        if sequence == self._sequence:
            return int(mavlink.MAV_RESULT_ACCEPTED)  # the answer was lost
        if self.faults.card_full:
            return int(mavlink.MAV_RESULT_FAILED)
        if self.faults.busy or self._exposes_s < math.inf or self._stored_s < math.inf:
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        self._sequence = sequence
        self._exposes_s = self._now_s + _SHUTTER_S
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _camera_message(self, message_id: int, number: int) -> int | None:
        stored = len(self.pictures) - (1 if self._stored_s < math.inf else 0)
        match message_id:
            case mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION:
                self._inform()
            case mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS:
                room_mib = 0.0 if self.faults.card_full else 30_000.0
                self._send(
                    self._camera,
                    self._camera.camera_capture_status_encode(
                        self._boot_ms, 0, 0, 0.0, 0, room_mib, stored
                    ),
                )
            case mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED if 0 <= number < stored:
                self._confirm(number)
            case mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
                return int(mavlink.MAV_RESULT_DENIED)
            case _:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _inform(self) -> None:
        lens, wide_mm = self.options.lens, 36.0
        focal_mm = lens.focal_px * wide_mm / lens.width_px
        self._send(
            self._camera,
            self._camera.camera_information_encode(
                self._boot_ms,
                _characters("MOAR"),
                _characters("simulated camera"),
                1,
                focal_mm,
                wide_mm,
                wide_mm * lens.height_px / lens.width_px,
                lens.width_px,
                lens.height_px,
                0,
                mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE | mavlink.CAMERA_CAP_FLAGS_CAPTURE_VIDEO,
                0,
                b"",
            ),
        )

    def _confirm(self, number: int) -> None:
        picture, truth = self.pictures[number], self._truth
        assert truth is not None
        self._send(
            self._camera,
            self._camera.camera_image_captured_encode(
                self._boot_ms,
                0,
                1,
                round(truth.latitude_deg * 1e7),
                round(truth.longitude_deg * 1e7),
                round(truth.altitude_amsl_m * 1e3),
                0,
                [1.0, 0.0, 0.0, 0.0],
                picture.number,
                1,
                f"IMG_{picture.number:04d}.JPG".encode(),
            ),
        )

    def _picture(self) -> Picture:
        pose = self._pose()
        sightings = {
            name: sighting
            for name, (x_m, z_m) in self.options.scene.points.items()
            if (sighting := seen((x_m, 0.0, z_m), pose, self.options.lens)) is not None
        }
        return Picture(
            number=len(self.pictures), time_s=self._now_s, pose=pose, sightings=sightings
        )

    def _pose(self) -> CameraPose:
        truth, axes = self._truth, self._axes
        assert truth is not None
        assert axes is not None
        place = Geodetic(
            latitude_deg=truth.latitude_deg,
            longitude_deg=truth.longitude_deg,
            altitude_amsl_m=truth.altitude_amsl_m,
        )
        return CameraPose(
            position_m=self._from_ned @ np.array(self._frame.ned(place)),
            axes=axes @ self._from_ned.T,
            turn_rate_radps=self._rates,
            velocity_mps=self._from_ned @ np.array(truth.velocity_ned_mps),
        )

    # Gimbal

    @property
    def _gimbal_answers(self) -> bool:
        return self.options.gimbal and not self.faults.gimbal_silent

    def _gimbal_command(self, command: Any) -> int:
        source = (command.get_srcSystem(), command.get_srcComponent())
        match command.command:
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                if command.param1 == mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION:
                    self._send(
                        self._gimbal,
                        self._gimbal.gimbal_manager_information_encode(
                            self._boot_ms,
                            mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
                            | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS,
                            GIMBAL,
                            0.0,
                            0.0,
                            math.radians(self.faults.gimbal_least_deg),
                            math.radians(30.0),
                            -math.pi,
                            math.pi,
                        ),
                    )
                elif command.param1 == mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS:
                    self._send_status()
                else:
                    return int(mavlink.MAV_RESULT_UNSUPPORTED)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                pass
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
                self._configure(command.param1, command.param2, source)
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                if source != self.holder:
                    return int(mavlink.MAV_RESULT_DENIED)
                self._wanted_deg = (command.param1, command.param2)
            case _:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _configure(self, system: float, component: float, source: tuple[int, int]) -> None:
        if system == -3.0:
            if source == self.holder:
                self.holder = (0, 0)
        elif system >= 0.0 and component >= 0.0:
            self.holder = (int(system), int(component))
        self._send_status()

    def _turn(self, truth: Moving, step_s: float) -> None:
        """Move the gimbal; keep the camera's axes and turn rates."""
        roll, pitch, yaw = truth.attitude_rad
        if self.options.gimbal:
            most_deg = self.faults.gimbal_rate_dps * step_s
            wanted_pitch = max(self.faults.gimbal_least_deg, self._wanted_deg[0])
            self._pitch_deg += _limited(wanted_pitch - self._pitch_deg, most_deg)
            turn = math.remainder(self._wanted_deg[1] - self._yaw_deg, 360.0)
            self._yaw_deg = math.remainder(self._yaw_deg + _limited(turn, most_deg), 360.0)
            angles = (
                _RESIDUAL * roll,
                math.radians(self._pitch_deg) + _RESIDUAL * pitch,
                yaw + math.radians(self._yaw_deg),
            )
        else:
            angles = (roll, pitch, yaw)
        axes = _axes(*angles)
        if self._axes is not None:
            turned = axes @ self._axes.T
            skew = (turned - turned.T) / (2.0 * step_s)
            self._rates = np.array([skew[1, 2], skew[2, 0], skew[0, 1]])
        self._axes = axes

    def _send_status(self) -> None:
        self._send(
            self._gimbal,
            self._gimbal.gimbal_manager_status_encode(self._boot_ms, 0, GIMBAL, *self.holder, 0, 0),
        )

    def _send_attitude(self) -> None:
        half_pitch, half_yaw = (
            math.radians(self._pitch_deg) / 2.0,
            math.radians(self._yaw_deg) / 2.0,
        )
        cp, sp, cy, sy = (
            math.cos(half_pitch), math.sin(half_pitch), math.cos(half_yaw), math.sin(half_yaw),
        )  # fmt: skip
        self._send(
            self._gimbal,
            self._gimbal.gimbal_device_attitude_status_encode(
                0,
                0,
                self._boot_ms,
                mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
                | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
                | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
                [cp * cy, -sp * sy, sp * cy, cp * sy],
                math.nan,
                math.nan,
                math.nan,
                0,
            ),
        )

    # Out

    def _stream(self) -> None:
        if self._is_due("heartbeat", 1.0):
            for codec, kind, here in (
                (self._camera, mavlink.MAV_TYPE_CAMERA, not self.faults.camera_silent),
                (self._gimbal, mavlink.MAV_TYPE_GIMBAL, self._gimbal_answers),
            ):
                if here:
                    invalid = mavlink.MAV_AUTOPILOT_INVALID
                    active = mavlink.MAV_STATE_ACTIVE
                    self._send(codec, codec.heartbeat_encode(kind, invalid, 0, 0, active))
        if self._gimbal_answers and self._is_due("status", _STATUS_S):
            self._send_status()
        if self._gimbal_answers and self._is_due("attitude", _ATTITUDE_S):
            self._send_attitude()

    def _is_due(self, name: str, period_s: float) -> bool:
        if self._now_s < self._due[name]:
            return False
        self._due[name] = self._now_s + period_s
        return True

    def _answer(self, codec: Any, command: Any, result: int | None) -> None:
        if result is None or self._random.random() < self.faults.answers_lost:
            return
        source = (command.get_srcSystem(), command.get_srcComponent())
        self._send(codec, codec.command_ack_encode(command.command, result, 0, 0, *source))

    def _send(self, codec: Any, message: Any) -> None:
        self._out.append(bytes(message.pack(codec)))
        codec.seq = (codec.seq + 1) % 256

    @property
    def _boot_ms(self) -> int:
        return round(self._now_s * 1e3)


def _codec(system: int, component: int) -> Any:
    codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    codec.robust_parsing = True
    return codec


def _characters(text: str) -> list[int]:
    return list(text.encode().ljust(32, b"\0"))


def _limited(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _axes(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Forward, right and down axes, rows (3, 3), in north, east, down."""
    (sr, sp, sy), (cr, cp, cy) = np.sin((roll, pitch, yaw)), np.cos((roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, sy * cp, -sp],
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
        ]
    )
