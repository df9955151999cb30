"""Telemetry: last reports of the autopilot, radios and ground stations, by source.

All values are immutable. Missing is `None`; a sample carries the time it was received
(`received_s`, the machine's clock), which gives its age at any time.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from ..types import AutopilotKind, GeodeticPoint, Vector
from .radio import Radio, RadioChannels, RadioLink


class LandedState(enum.Enum):
    """MAV_LANDED_STATE of EXTENDED_SYS_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed:
    """EXTENDED_SYS_STATE."""

    received_s: float
    state: LandedState


class Failsafe(str, enum.Enum):
    """Cause of an autopilot's failsafe, as short text."""

    BATTERY = "battery"
    REMOTE_CONTROL = "RC"
    GROUND_STATION = "GCS"
    ESTIMATOR = "EKF"
    DEAD_RECKONING = "dead reckoning"
    FENCE = "fence"


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotStatus:
    """HEARTBEAT of the autopilot; its mode also by CURRENT_MODE.

    received_s: time of the last mode report, by either. armed_s: time of the last HEARTBEAT, which
    alone reports the armed state and more; None: as received_s.
    """

    received_s: float
    system_id: int
    component_id: int
    kind: AutopilotKind
    armed: bool
    custom_mode: int
    mode: str
    """The mode's name as its ground stations show it, e.g. `OFFBOARD`, `HOLD`, `GUIDED`."""
    ours: bool
    """True in the mode in which the autopilot follows the companion's setpoints."""
    homeward: bool
    """True in a mode that returns, lands or stops the aircraft by the autopilot's rules."""
    multirotor: bool
    """True for an aircraft that can hover."""
    failsafe: bool
    """True: system_status is CRITICAL or worse, or PX4 flies another mode than requested.
    On PX4 the failsafe chose the mode; on ArduPilot the mode may come from any source."""
    mode_since_s: float | None = None
    failsafe_since_s: float | None = None
    """First report of the mode, and of the active failsafe; None: before anything else."""
    vehicle_type: int = 2
    """MAV_TYPE; 2 is a quadrotor."""
    motors: int | None = None
    """Number of motors of the vehicle's type; None where the type does not define it."""
    armed_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude:
    """ATTITUDE: aerospace angles of the body in NED."""

    received_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    boot_s: float | None = None
    """The autopilot's own clock."""
    yaw_rate_radps: float | None = None
    """Rate about the body's axis; by the gyroscopes, independent of the estimator's heading."""
    turn_rate_radps: float | None = None
    """Magnitude of the rates about all axes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalPosition:
    """LOCAL_POSITION_NED: position about the estimator's origin."""

    received_s: float
    boot_s: float
    """The autopilot's own clock; a restart of the autopilot sets it back."""
    position_ned_m: Vector
    velocity_ned_mps: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """ODOMETRY: state of the estimator that reports the local position."""

    received_s: float
    reset_counter: int
    """Reset counter: a new number means a reset of position, velocity or heading; PX4 does not
    report which."""
    horizontal_accuracy_m: float | None
    vertical_accuracy_m: float | None = None
    """Standard deviations of the horizontal position and of the height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalOrigin:
    """GPS_GLOBAL_ORIGIN: geodetic position of the estimator's local origin."""

    received_s: float
    point: GeodeticPoint


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """HOME_POSITION."""

    received_s: float
    point: GeodeticPoint
    position_ned_m: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT. boot_s: the autopilot's own clock; None where a recording has none."""

    received_s: float
    point: GeodeticPoint
    boot_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """BATTERY_STATUS and SYS_STATUS of one battery."""

    received_s: float
    remaining: float | None
    """Fraction in [0, 1] that the autopilot reports."""
    voltage_v: float | None
    current_a: float | None
    charge_state: int | None
    """MAV_BATTERY_CHARGE_STATE: 1 ok, 2 low, 3 critical, 4 emergency."""
    cells: int | None = None
    """In series, where each one's voltage is reported."""
    summary: bool = False
    """From SYS_STATUS, which gives battery 0 while its BATTERY_STATUS is not received; on PX4 only
    where no other battery's is received."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gnss:
    """GPS_RAW_INT, or GPS2_RAW of a second receiver."""

    received_s: float
    receiver_s: float | None
    """The receiver's clock; frozen while the receiver has failed."""
    fix_type: int
    satellites: int | None
    hdop: float | None
    vdop: float | None
    horizontal_accuracy_m: float | None
    vertical_accuracy_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimator:
    """ESTIMATOR_STATUS (PX4) or EKF_STATUS_REPORT (ArduPilot).

    The innovations are deviations of measurements from expected values, as fractions of the limit
    that the estimator accepts; None where it reports none, as for sources that it does not use.
    """

    received_s: float
    flags: int
    horizontal_position_ok: bool
    horizontal_accuracy_m: float | None
    vertical_accuracy_m: float | None = None
    velocity_innovation: float | None = None
    position_innovation: float | None = None
    height_innovation: float | None = None
    compass_innovation: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MagneticField:
    """HIGHRES_IMU (PX4) or RAW_IMU (ArduPilot): the field's strength at the first magnetometer."""

    received_s: float
    strength_gauss: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """WIND_COV (PX4) or WIND (ArduPilot), as a vector towards which the air moves."""

    received_s: float
    velocity_ned_mps: Vector
    deviation_mps: float | None = None
    """Standard deviation of each level component; None where it is not reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteControl:
    """RC_CHANNELS: signal strength of the pilot's transmitter, fraction in [0, 1].

    ever_reported: True once this message or an earlier one has reported a signal strength.
    """

    received_s: float
    rssi: float | None
    ever_reported: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorOutputs:
    """SERVO_OUTPUT_RAW or ACTUATOR_OUTPUT_STATUS: pulse widths of the motors in use.

    least_us: least value ever reported. A value below any pulse width has another unit, as PX4's
    values of DShot (1 to 1999).
    """

    received_s: float
    pulse_us: tuple[float, ...]
    least_us: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorSpeeds:
    """ESC_STATUS: the speeds of the motors, four of a message, in either direction."""

    received_s: float
    rpm: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerHeartbeat:
    """Time of the last HEARTBEAT of a peer. since_s: since then without a gap; None: unknown."""

    received_s: float
    system_id: int
    since_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatistics:
    """Raw packets of the autopilot on the companion's link, by their headers' sequence numbers.

    off_stream: received packets of no stream that is read: parameters, logs, texts, and streams
    with a rate that may be reduced on request. packets_late: dropped packets, received after later
    ones of the same message. round_trip_s: time from a request of the companion to the autopilot's
    answer. shortest_round_trip_s: of all such answers.
    """

    received_s: float
    packets_received: int
    packets_lost: int
    off_stream: int = 0
    packets_late: int = 0
    round_trip_s: float | None = None
    shortest_round_trip_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkNode:
    """LINK_NODE_STATUS (PX4): packets that the autopilot receives on the companion's link."""

    received_s: float
    packets_received: int
    packets_lost: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """AUTOPILOT_VERSION: the autopilot's firmware."""

    received_s: float
    version: tuple[int, int, int]
    release: str
    """`dev`, `alpha`, `beta` or `rc`; empty for an official release."""

    def __str__(self) -> str:
        return "-".join(filter(None, (".".join(map(str, self.version)), self.release)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Readiness:
    """SYS_STATUS: readiness of the autopilot to arm, and its unhealthy parts."""

    received_s: float
    ready: bool
    unhealthy: tuple[str, ...]
    remote_control_ok: bool | None = None
    """True while the pilot's transmitter is received; None where it never was."""
    fence_enabled: bool = False
    """True: a fence is reported in force. ArduPilot omits a fence with the action to report
    only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity:
    """OBSTACLE_DISTANCE, or OBSTACLE_DISTANCE_3D of one instant: obstacles around the sensor.

    x_m, y_m, z_m: of its points, forward, left and up of the aircraft; empty: no obstacle within
    range. sender: its component; stamp_s: the sender's clock.
    """

    received_s: float
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    z_m: tuple[float, ...]
    sender: int
    stamp_s: float

    @property
    def points_m(self) -> tuple[Vector, ...]:
        """(x, y, z) of each point."""
        return tuple(zip(self.x_m, self.y_m, self.z_m, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class FenceItem:
    """An item of the fence that was uploaded to the autopilot.

    command: MAV_CMD_NAV_FENCE_*. parameter: its param1: the number of a polygon's vertices, or a
    circle's radius in metres.
    """

    command: int
    parameter: float
    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Telemetry:
    """The last value of every source; `None` where none was ever received."""

    autopilot: AutopilotStatus | None = None
    failsafes_reported: dict[Failsafe, float] = field(default_factory=dict)
    """Failsafes that the autopilot's texts have named and not cleared, with the time of the last
    sign of each."""
    attitude: Attitude | None = None
    local_position: LocalPosition | None = None
    odometry: Odometry | None = None
    local_origin: LocalOrigin | None = None
    global_position: GlobalPosition | None = None
    home: Home | None = None
    landed: Landed | None = None
    batteries: dict[int, Battery] = field(default_factory=dict)
    """By battery id; never changed in place."""
    gnss: Gnss | None = None
    second_gnss: Gnss | None = None
    second_gnss_first: bool = False
    """True: the second receiver is the autopilot's first choice."""
    better_gnss_taken: bool = False
    """True: the autopilot is known to navigate by the better receiver of two."""
    estimator: Estimator | None = None
    magnetic_field: MagneticField | None = None
    wind: Wind | None = None
    radio: Radio | None = None
    radio_link: RadioLink | None = None
    radio_channels: RadioChannels | None = None
    remote_control: RemoteControl | None = None
    motors: MotorOutputs | None = None
    motor_speeds: MotorSpeeds | None = None
    motor_min_us: float | None = None
    motor_max_us: float | None = None
    """The range of the motor outputs, where parameters report it."""
    ground_station: PeerHeartbeat | None = None
    """The operator's, once one is known, else the one received last."""
    ground_stations: dict[int, PeerHeartbeat] = field(default_factory=dict)
    """All, by system id; never changed in place."""
    operator_id: int | None = None
    """System id of the ground station from which the last order came."""
    link: LinkStatistics | None = None
    link_node: LinkNode | None = None
    firmware: Firmware | None = None
    readiness: Readiness | None = None
    proximity: Proximity | None = None
    """Report of the sensor that sent last."""
