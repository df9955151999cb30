"""Profile of an autopilot: the differences between kinds of autopilots, as one immutable value.

One file for each autopilot fills it, and `unknown` for those that have none. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from ...types import AutopilotKind, GeodeticPoint, Vector
from ..telemetry import Failsafe, FenceItem, Firmware
from .failsafe_actions import FailsafeAction, Failsafes
from .fence import Area, Fence, areas_of
from .offboard_loss import OffboardLoss
from .parameter_names import Parameters, ParameterTable, Release
from .parameter_rules import Rule

Values = Mapping[str, float]
"""Values of parameters by key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unreported:
    """Parameters that the autopilot never reported, by their names in its firmware."""

    names: tuple[str, ...] = ()
    denying: tuple[str, ...] = ()
    """Those of them without which no inspection begins (`Parameter.denies`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeText:
    """Texts with which the autopilot reports that a failsafe begins and ends."""

    failsafe: Failsafe
    begins: re.Pattern[str]
    """Matched at the text's start."""
    ends: str | None = None
    lasts_s: float
    """Duration after the last sign: a link may lose the text of its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Values and functions of one kind of autopilot. Each row names what depends on it."""

    # Identity

    kind: AutopilotKind
    """Name in vehicle files, snapshots and recordings."""
    name: str
    """Name for texts."""
    mav_autopilot: int | None
    """MAV_AUTOPILOT of its heartbeat."""
    measured_releases: tuple[tuple[int, int], ...]
    """Major and minor versions whose behaviour this program was measured against."""
    newest_release: tuple[int, int]
    """Newest release whose parameters are in the table: a later one may have other names."""
    oldest_release: tuple[int, int]
    """Releases before it have other failsafes and other parameters for them."""

    # Modes, by HEARTBEAT.custom_mode

    mode_name: Callable[[int], str | None]
    """Name as its ground stations show it; None: unknown."""
    mode_enums: Mapping[int, str]
    """By MAV_TYPE, MAVLink's enum of the modes of vehicles that `mode_name` does not number."""
    is_own_mode: Callable[[int], bool]
    """True in the mode in which it follows the companion's setpoints."""
    own_mode: str
    """Name of that mode."""
    own_mode_numbers: tuple[int, int] | None
    """Parameters 2 and 3 of MAV_CMD_DO_SET_MODE for it; None: it is never requested."""
    land_mode: str
    """Name of the mode that lands here."""
    land_mode_numbers: tuple[int, int] | None
    armed_in_mode_request: bool
    """True if it takes base_mode of a mode request as it is, the armed bit included."""
    homeward_modes: frozenset[str]
    """Modes in which it returns, lands, or stops by itself: only the pilot may end them."""
    follow_up_modes: Mapping[str, str]
    """Mode that follows a mode by itself, by the name of the earlier one."""

    # Messages

    streams_by_itself: bool
    """True if it sends most messages unrequested."""
    line_share: float
    """Share of a serial line's rate for its messages; the rest is for answers, lists and packets of
    other senders. PX4 itself uses half of the rate, by default."""
    rates_hz: Mapping[str, float]
    """Wanted rates by message name, beside and before those of all autopilots (`message_rates`)."""
    integers_bytewise: bool
    """True if PARAM_VALUE carries the bytes of an integer parameter, not its number."""
    rssi_max: int
    """RSSI of full signal in RC_CHANNELS."""
    channels_without_receiver: bool
    """True if it sends RC_CHANNELS without any receiver of a remote control."""
    summary_is_battery_0: bool
    """True if SYS_STATUS describes battery 0; False: it may describe any, as the emptiest."""
    better_gnss_taken: bool
    """True if it always navigates by the better one of two receivers."""
    gnss_switch: str | None
    """Parameter by which it takes the better receiver."""
    gnss_switch_better: frozenset[float]
    """The values of `gnss_switch` with which it does."""
    gnss_primary: str | None
    """Parameter that is 1 if the second receiver is used first."""
    motor_range: tuple[str, str] | None
    """Parameters of the least and greatest output of the motors, in us."""
    unused_pulse_us: float
    """Pulse of an unused output, and of all outputs while disarmed; 0 always is such a pulse."""

    # Failsafes that are reported

    failsafe_flies: bool
    """True if it reports a failsafe only while that flies the aircraft, not in a pilot's mode."""
    failsafe_texts: tuple[FailsafeText, ...]
    innovation_limit: float
    """Innovation from which the estimator's failsafe may be active while its flags are good."""

    # Flight

    to_local_ned: Callable[[GeodeticPoint, GeodeticPoint], Vector]
    """Position of a geodetic point in its local NED frame about an origin, by its projection."""
    projection_known: bool
    """True if positions by `to_local_ned` agree with its global ones."""
    home_by_projection: bool
    """True if home's local position follows from the geodetic one and the origin at all times."""
    position_error_m: float
    """Greatest error of its position, measured with a common GNSS receiver and a barometer."""
    tracking_error_m: float
    """Distance from its setpoint that 95 % of every measured flight kept to."""
    stray_s2: float
    """Distance from the setpoint in metres for each m/s^2 of the setpoint (`vehicle.Guidance`)."""
    landing_mps: float
    """Speed of its landing."""
    landed_hover_s: float
    """Hover time with the energy of the motors on the ground until they stop."""
    speed_parameters: tuple[str, ...]
    """Parameters of its own cruising speeds level, upwards and downwards, in m/s."""
    cells_parameter: str | None
    """Parameter of the battery's number of cells in series."""
    capacity_parameter: str | None
    """Parameter of the battery's capacity, in mAh."""
    tilt_limits: tuple[str, ...]
    """Parameters that limit the lean in position control, in degrees; the first above 0 counts."""
    hover_thrust: str | None
    """Parameter of the hover thrust, as a fraction of the greatest thrust."""

    # Meaning of its parameters

    parameters: ParameterTable
    """Their names and units in each release, and what counts while one is not reported."""
    loss_parameters: tuple[str, ...]
    """Keys of the parameters that decide the flight after an offboard loss. They must be known
    before the companion takes control."""
    read_loss: Callable[[Values, Parameters], OffboardLoss] | None
    """Offboard loss by the values of all of `loss_parameters`; their names for texts."""
    failsafe_parameters: tuple[str, ...]
    """Keys of the parameters that decide its failsafe actions."""
    read_failsafes: Callable[[Values], Iterable[FailsafeAction]] | None
    """Failsafe actions in its own mode by the values of all of `failsafe_parameters`."""
    fence_parameters: tuple[str, ...]
    read_fence: Callable[[Values, tuple[Area, ...], bool], Fence] | None
    """Fence by the values of all of `fence_parameters`, the uploaded areas, and whether SYS_STATUS
    reports a fence."""
    rules: tuple[Rule, ...]
    """Rules by which `check` judges its parameters, in the order of the report."""

    def is_newer(self, firmware: Firmware) -> bool:
        """True for a release whose names of parameters are not known."""
        return firmware.version[:2] > self.newest_release

    @property
    def assumed_release(self) -> Release:
        """Release whose names are tried first, where the autopilot does not report its version."""
        return (*max(self.measured_releases, default=(0, 0)), 0)

    @property
    def holding_parameters(self) -> tuple[str, ...]:
        """Parameters of its lean limit and hover thrust."""
        return (*self.tilt_limits, *filter(None, (self.hover_thrust,)))

    @property
    def gnss_parameters(self) -> tuple[str, ...]:
        """Parameters that select one of two receivers for navigation."""
        return tuple(name for name in (self.gnss_switch, self.gnss_primary) if name is not None)

    @property
    def flight_parameters(self) -> tuple[str, ...]:
        """Keys of all parameters on which a flight depends, each once."""
        keys = (
            *self.loss_parameters,
            *self.fence_parameters,
            *self.failsafe_parameters,
            *self.holding_parameters,
        )
        return tuple(dict.fromkeys(keys))

    @property
    def checked_parameters(self) -> tuple[str, ...]:
        """Keys of the parameters that `check` reads, each once."""
        ruled = (rule.parameter for rule in self.rules)
        return tuple(dict.fromkeys((*ruled, *self.flight_parameters)))

    @property
    def setup_parameters(self) -> tuple[str, ...]:
        """Keys of the parameters that `setup` reads, each once: those of `check`, the vehicle's."""
        own = (*self.speed_parameters, self.cells_parameter, self.capacity_parameter)
        return tuple(dict.fromkeys((*filter(None, own), *self.checked_parameters)))

    def with_silence(self, parameters: Parameters) -> Parameters:
        """Parameters, with None (never reported) for those of a flight that are awaited."""
        return parameters.with_silence(self.flight_parameters)

    def unreported(self, parameters: Parameters) -> Unreported:
        """Parameters of a flight that were never reported."""
        silent = [key for key in self.flight_parameters if parameters.get(key, 0.0) is None]
        optional = self.fence_parameters if self._is_without_fence(parameters) else ()
        denying = [key for key in silent if self.parameters.row(key).denies and key not in optional]
        return Unreported(names=parameters.shown(silent), denying=parameters.shown(denying))

    def offboard_loss(self, parameters: Parameters) -> OffboardLoss | None:
        """Flight after an offboard loss; None while a parameter is awaited, or if unknown.

        A parameter that was never reported counts as `unreported` says.
        """
        values = self._values(self.loss_parameters, parameters)
        if values is None or self.read_loss is None:
            return None
        return self.read_loss(values, parameters)

    def failsafes(self, parameters: Parameters) -> Failsafes | None:
        """Failsafe actions; None while a parameter is awaited, or if unknown.

        A parameter that was never reported counts as `unreported` says.
        """
        values = self._values(self.failsafe_parameters, parameters)
        if values is None or self.read_failsafes is None:
            return None
        return Failsafes(actions=tuple(self.read_failsafes(values)))

    def fence(
        self, parameters: Parameters, items: Iterable[FenceItem], *, enabled: bool = False
    ) -> Fence | None:
        """Fence; None while a parameter is awaited, or if unknown.

        enabled: True if SYS_STATUS reports a fence. A parameter that was never reported counts as
        `unreported` says; a firmware with none of them has no limits but the uploaded areas.
        """
        values = self._values(self.fence_parameters, parameters)
        if values is None or self.read_fence is None:
            return None
        if self._is_without_fence(parameters):
            return Fence(areas=areas_of(items))
        return self.read_fence(values, areas_of(items), enabled)

    def _is_without_fence(self, parameters: Parameters) -> bool:
        """True for firmware that was built without a fence: it has none of its parameters.

        Those that came later are absent in old firmware by their value.
        """
        fence = self.fence_parameters
        later = {key for key in fence if self.parameters.row(key).absent is not None}
        answers = any(
            parameters.get(key) is not None for key in self.flight_parameters if key not in fence
        )
        return answers and all(key in later or parameters.get(key, 0.0) is None for key in fence)

    def _values(self, keys: tuple[str, ...], parameters: Parameters) -> Values | None:
        """Values; None while one is awaited."""
        if any(key not in parameters for key in keys):
            return None
        return self.parameters.values(keys, parameters)
