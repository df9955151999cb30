"""Thresholds of the risk indices: section `risk` of a vehicle file."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from .yaml_file import FileFinding
from .yaml_schema import file_key

_Positive = Field(gt=0.0, le=1e6)
_Fraction = Field(ge=0.0, le=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Values of a risk input at which its risk is 0 (`low`) and at which it is 1 (`high`).

    `low > high` is legal: the risk then grows as the input falls (satellites, battery).
    """

    low: float
    high: float

    def fraction(self, value: float) -> float:
        """The input's risk in [0, 1], linear between the two ends."""
        share = (value - self.low) / (self.high - self.low)
        return 0.0 if share <= 0.0 else min(1.0, share)

    def share(self, value: float) -> float:
        """Position of a value between the two ends: 0 at the first, 1 at the second."""
        return (value - self.low) / (self.high - self.low)

    @property
    def second_half(self) -> Range:
        """The range from its middle on."""
        return Range(low=0.5 * (self.low + self.high), high=self.high)


class RadioKind(str, enum.Enum):
    """Firmware of a telemetry radio, by its use of RADIO_STATUS."""

    SIK = "sik"
    """SiK and RFD900x: signal and noise at both ends, in units of about half a decibel."""
    MLRS = "mlrs"
    """Signals at both ends, -120 to -50 dBm as 0 to 254; noise: 10 minus the SNR in dB."""
    ELRS = "elrs"
    """ExpressLRS: rssi is 2.55 times the link quality in percent, remrssi the dBm without sign."""
    UNKNOWN = "unknown"


_USUAL_DRAG = (0.2, 0.005)
"""Linear drag per second, and quadratic drag per metre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskModel:
    """Thresholds of the risk indices, each with its reason (all optional in the file)."""

    unknown: Annotated[float, _Fraction] = 0.5
    """Value of an index without any known input so far; of the communication risk while neither a
    radio's signal, a transmitter nor a ground station is known."""
    drag_per_s: Annotated[float, _Positive] = _USUAL_DRAG[0]
    """Linear drag: deceleration per m/s of airspeed, by the propellers; the wind is computed from
    the lean by it. With the next about the mean of two recorded quadrotors: 0.227 and 0, 0.209 and
    0.008. `replay --fit-drag` fits it."""
    drag_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = _USUAL_DRAG[1]
    """Quadratic drag: deceleration per (m/s)^2 of airspeed, by the body."""
    wind_mps: Range = field(default_factory=lambda: Range(low=3.0, high=12.0))
    """Wind: from a light breeze to that in which small inspection multirotors are grounded."""
    gust_mps: Range = field(default_factory=lambda: Range(low=2.0, high=5.0))
    """Gusts, the standard deviation of the wind over half a minute. They are reported to pilots
    from 5 m/s above the mean, which is 2.5 times 2 m/s; with 5 m/s the gusts alone pass the
    greatest wind."""
    tilt_rad: Annotated[Range, Field(ge=0.0, le=90.0)] = field(
        default_factory=lambda: Range(low=0.17, high=0.52)
    )
    """Lean in hover against the wind: from about 10 deg to 30 deg, the limit of ArduPilot in
    position control, and of PX4 less a third for manoeuvres. Flights against the wind are forecast
    no faster than the second allows."""
    motor_fraction: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.75, high=0.95)
    )
    """Greatest motor output over its range: above 95 % no attitude authority is left."""
    motor_pulse_us: Range | None = None
    """Motor output of no and of full thrust in its reported unit: for PX4 with DShot [1, 1999].
    None: pulse widths by `PWM_MAIN_MIN1`, `PWM_MAIN_MAX1` (PX4) or `MOT_PWM_MIN`, `MOT_PWM_MAX`
    (ArduPilot), [1000, 2000] until they are reported."""
    motor_rpm: Range | None = None
    """Motor speed of no and of full thrust; none: ESC_STATUS is not used."""
    tracking_error_m: Range = field(default_factory=lambda: Range(low=1.0, high=2.0))
    """Distance from the setpoint: in calm air PX4 deviates by up to 0.98 m with the noise of its
    simulated receiver; at 2 m the path is left (`guidance.off_path_m`)."""
    radio: RadioKind | None = None
    """Kind of the telemetry radio, which says what its RADIO_STATUS means: `sik` is also RFD900x,
    `elrs` ExpressLRS; with `unknown` signal and noise are not used. None: recognised by its ids and
    fields, as far as these differ."""
    radio_margin: Range = field(default_factory=lambda: Range(low=60.0, high=10.0))
    """RSSI above noise in SiK units, about half a decibel (mLRS: above -105 dBm), here and at the
    radio's peer. In recorded flights almost no packet was broken above 60. Between 10 and 30 one
    broke every two seconds; below 10 no packet arrived."""
    radio_quality: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.9, high=0.5)
    )
    """Packets received, of those sent: ExpressLRS here, mLRS here and at its peer. One lost in ten
    is repeated in time; of commands sent 3 times with a loss of 0.5, one in 8 never arrives."""
    receive_errors_hz: Range = field(default_factory=lambda: Range(low=0.4, high=2.0))
    """Broken packets a second at the local radio, over 3 s: one is chance. In those flights 0.004
    above a margin of 60, and up to 5 at the edge of reception."""
    transmit_buffer_percent: Range = field(default_factory=lambda: Range(low=50.0, high=15.0))
    """Free space of the radio's transmit buffer: ArduPilot slows its streams below 50 % and at 15 %
    sends a seventh of them."""
    rc_rssi: Annotated[Range, _Fraction] = field(default_factory=lambda: Range(low=0.6, high=0.2))
    """Signal of the pilot's transmitter; 0 is unknown until there was another. Receivers report
    full signal over most of their range; a fifth of it is their edge."""
    remote_control_age_s: Range = field(default_factory=lambda: Range(low=2.5, high=6.0))
    """Time since the transmitter's channels were received, while the autopilot is received.
    RC_CHANNELS is requested twice a second, and PX4 ends it when the transmitter is lost."""
    ground_station_age_s: Range = field(default_factory=lambda: Range(low=2.5, high=10.0))
    """Time since the ground station was received. Ground stations send one heartbeat a second;
    autopilots report a link loss after 10 s."""
    autopilot_age_s: Range = field(default_factory=lambda: Range(low=1.5, high=3.0))
    """Time since the autopilot was received. Its slowest stream comes once a second; after 3 s the
    supervisor reports a link loss."""
    packet_loss: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.02, high=0.3)
    )
    """Packets lost on our own link, each way (PX4 reports its end). A wire loses none; of commands
    sent 3 times with a loss of 0.3, one in 37 never arrives."""
    data_rate: Annotated[Range, _Fraction] = field(default_factory=lambda: Range(low=0.5, high=0.1))
    """Rate of the streams that are read on our own link, as a fraction of the usual one;
    parameters, logs and texts do not count. ArduPilot sends 0.45 of it when a radio's buffer is
    short, 0.13 when it is nearly full; any single stream that is switched off is less than half of
    all."""
    satellites: Range = field(default_factory=lambda: Range(low=10.0, high=5.0))
    """Satellites: a fix needs 4; autopilots refuse to arm below 6."""
    hdop: Range = field(default_factory=lambda: Range(low=1.2, high=3.0))
    """Horizontal dilution of precision: autopilots refuse to arm above 2.5 (PX4) or 1.4
    (ArduPilot)."""
    vdop: Range = field(default_factory=lambda: Range(low=2.2, high=5.0))
    """Vertical dilution of precision: limits are higher than for hdop: satellites are only above,
    and errors of height are 1.5 to 2 times those of the place."""
    horizontal_accuracy_m: Range = field(default_factory=lambda: Range(low=1.0, high=5.0))
    """Horizontal accuracy that the receiver, the estimator and its odometry report. A common
    receiver reports 1 m under open sky; PX4 arms up to 3 m, and drops its position at 5
    (COM_POS_FS_EPH), as ArduPilot does."""
    vertical_accuracy_m: Range = field(default_factory=lambda: Range(low=3.0, high=7.5))
    """Vertical accuracy that they report. Autopilots accept receivers up to 5 m (PX4) or 7.5 m
    (ArduPilot)."""
    receiver_lost: Annotated[float, _Fraction] = 0.25
    """The risk when one of two receivers is useless; the better one counts where the autopilot uses
    it. The other is enough for flight, but the cause may affect it, too."""
    innovation: Range = field(default_factory=lambda: Range(low=0.5, high=1.0))
    """Deviation of velocity, position, height or compass from the estimator's expectation, over its
    limit. Above 0.5 PX4 does not arm, at 0.8 in two of them ArduPilot lands, and from 1 on the
    measurement is refused. In wind both simulators stay below 0.5, and two recorded quadrotors for
    99 % of their flights below 0.6."""
    position_resets: Range = field(default_factory=lambda: Range(low=1.0, high=4.0))
    """Resets of the estimator within 10 s, which PX4 reports; it aligns its heading once after
    take-off."""
    magnetic_change: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.25, high=0.5)
    )
    """Change of the magnetic field's strength, relative to its mean: motors and calibration make up
    to 0.15 in recorded flights, in an old one 0.34; PX4 rejects a compass from 0.2 gauss on
    (EKF2_MAG_CHK_STR), 0.4 of the earth's field."""
    battery_remaining: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.7, high=0.2)
    )
    """Charge left: at 20 % the autopilot's own warnings are near (PX4: 15 %)."""
    cell_voltage_v: Range = field(default_factory=lambda: Range(low=3.75, high=3.4))
    """Voltage of a cell, lithium-polymer under load: 3.4 V is close to the knee."""
    cells: Annotated[int | None, Field(ge=1, le=100)] = None
    """Cells in series; none: the voltage is not used. `check` compares it with the battery's
    report."""
    endurance_s: Annotated[float, _Positive] = 1200.0
    """Flight time of a full battery, until it is measured."""
    home_margin_s: Range = field(default_factory=lambda: Range(low=300.0, high=60.0))
    """Flight time left on arrival at home, and after the mission, an exit, an evacuation: a minute
    is the reserve for one landing; pilots return home with about five minutes of twenty."""

    @property
    def drag_is_usual(self) -> bool:
        """True for the default drag, which is not measured."""
        return (self.drag_per_s, self.drag_per_m) == _USUAL_DRAG


def risk_findings(risk: RiskModel) -> Iterator[FileFinding]:
    """Yields the faults of thresholds: two equal ones, or two the wrong way round."""
    usual = RiskModel()
    for member in dataclasses.fields(risk):
        limits, before = getattr(risk, member.name), getattr(usual, member.name)
        if not isinstance(limits, Range):
            continue
        key = ("risk", file_key(member.name))
        falls = before is not None and before.high < before.low
        if limits.low == limits.high:
            yield FileFinding(key, "has two equal values, must differ")
        elif (limits.high < limits.low) is not falls:
            first = "greater" if falls else "lesser"
            yield FileFinding(
                key, f"has its values the wrong way round, must have the {first} first"
            )
