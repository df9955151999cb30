"""PX4's commander: arming, modes, failsafes, landing detection.

Inputs: requests and the state of vehicle, stream, battery, position. Outputs: the mode that is
flown, the armed state, and texts. `intended` is the user's request, `mode` the flown mode. They
differ while a failsafe acts, and the intended mode resumes by itself when the cause ends (measured
on PX4 v1.17.0).
"""

from dataclasses import dataclass
from typing import Final

from sitl.parameters import Parameters
from sitl.px4 import texts
from sitl.px4.contact import Contact
from sitl.px4.failsafe import Action, Charge, Flags, charge_of, due
from sitl.px4.fence import Geofence
from sitl.px4.flight import FlightTasks
from sitl.px4.link_loss import LinkLosses
from sitl.px4.modes import AUTO_MODES, Mode
from sitl.px4.navigation import Navigation
from sitl.px4.offboard import OffboardStream
from sitl.px4.takeoff import TakeoffRamp
from sitl.sticks import Sticks
from sitl.world import World

ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
_CYCLE_US: Final = 100_000
_READY_S: Final = 4.0
_LOW_THRUST: Final = 0.25
_AIRBORNE_M: Final = 0.05
_NOT_ARMED_IN: Final = frozenset({Mode.TAKEOFF, Mode.LAND, Mode.RTL, Mode.DESCEND})
_OVERRIDE_BIT_AUTO, _OVERRIDE_BIT_OFFBOARD = 1, 2


@dataclass(slots=True, kw_only=True)
class Parts:
    """Inputs of the commander."""

    world: World
    parameters: Parameters
    navigation: Navigation
    stream: OffboardStream
    sticks: Sticks
    tasks: FlightTasks
    ramp: TakeoffRamp
    fence: Geofence
    text_sender: texts.TextSender


class Commander:
    """Arming, mode and failsafes of the vehicle."""

    def __init__(self, parts: Parts) -> None:
        """Boot in HOLD, disarmed."""
        self._parts = parts
        self.armed = False
        self.intended = Mode.HOLD
        self.mode = Mode.HOLD
        self.failsafe: Action | None = None
        self.charge = Charge.OK
        self.landed = True
        self.took_off = False
        self.armed_us = 0
        self._mode_after_disarming = Mode.HOLD
        self.companion = Contact(
            parts.world,
            parts.text_sender,
            parts.parameters,
            "COM_OBC_LOSS_T",
            lost=(texts.CRITICAL, "Connection to mission computer lost"),
            regained="Onboard controller regained",
        )
        self.ground_station = Contact(
            parts.world,
            parts.text_sender,
            parts.parameters,
            "COM_DL_LOSS_T",
            lost=(texts.INFO, "Connection to ground station lost"),
            regained="GCS connection regained",
        )
        self._overridden = Charge.OK
        self._links = LinkLosses(parts.parameters)
        self._hold_until_us: int | None = None
        self._announced: Mode | None = None
        self._contact_us: int | None = None
        self._landed_us = 0
        self._mode_chosen = False
        self._health: tuple[bool, bool] | None = None
        self._next_cycle_us = parts.world.now_us

    # Queries

    @property
    def stream_alive(self) -> bool:
        """True while offboard setpoints come within the time-out."""
        parts = self._parts
        return parts.stream.alive(parts.world.now_us, parts.parameters.value("COM_OF_LOSS_T"))

    @property
    def sticks_present(self) -> bool:
        """True while a pilot's input arrives."""
        parts = self._parts
        return parts.sticks.present(parts.world.now_us, parts.parameters.value("COM_RC_LOSS_T"))

    def can_run(self, mode: Mode) -> bool:
        """Return True if the requirements of a mode are met."""
        if mode is Mode.MISSION:
            return False
        if mode.value.needs_sticks and not self.sticks_present:
            return False
        if mode.value.needs_position and not self._parts.navigation.position_valid:
            return False
        return mode is not Mode.OFFBOARD or self.stream_alive

    @property
    def can_arm(self) -> bool:
        """True if arming in the present mode would be accepted (SYS_STATUS pre-arm bit)."""
        return (
            self._parts.navigation.since_boot_s >= _READY_S
            and self.can_run(self.mode)
            and self.charge < Charge.CRITICAL
            and (self.ground_station.there or not self._parts.parameters.value("NAV_DLL_ACT"))
        )

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status: 0 not ready, 3 standby, 4 active, 5 failsafe."""
        if self.armed:
            return 5 if self.failsafe is not None else 4
        if self._parts.navigation.since_boot_s < _READY_S or not self.can_run(self.intended):
            return 0
        return 3

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode as measured per mode."""
        base = self.mode.value.base_mode
        if self.mode is Mode.OFFBOARD and not self.stream_alive:
            base = 1
        return base | (128 if self.armed else 0)

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.landed:
            return ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return TAKING_OFF
        return LANDING if self._parts.tasks.landing else IN_AIR

    # Requests

    def request_mode(self, mode: Mode) -> bool:
        """Request a mode; False when it is not available now (only while armed)."""
        if self.armed and not self.can_run(mode):
            self._parts.text_sender.unavailable(mode)
            return False
        self._mode_chosen = True
        self._intend(mode)
        if self.armed:
            self._overrule()
        self._hold_until_us = None
        self.failsafe = None
        self._parts.fence.note_mode(self._parts.world.now_us)
        self._enter(mode)
        return True

    def arm(self, by: str) -> bool:
        """Arm; False when health forbids it."""
        parts = self._parts
        if self.armed:
            return True
        if not self.can_arm:
            parts.text_sender.send(
                texts.CRITICAL, "Arming denied: Resolve system health failures first"
            )
            return False
        self.armed = True
        self.armed_us = parts.world.now_us
        self.took_off = False
        self.landed = True
        self._landed_us = parts.world.now_us
        self._overridden = Charge.OK
        self._links.arm()
        parts.navigation.set_home()
        self._enter(self.intended)
        parts.text_sender.send(texts.INFO, f"Armed by {by}")
        parts.text_sender.event(texts.ARMED, 0x66, b"\x04")
        return True

    def disarm(self, by: str, *, force: bool = False) -> bool:
        """Disarm; False in the air unless forced."""
        parts = self._parts
        if not self.armed:
            return True
        if not self.landed and not force:
            parts.text_sender.send(texts.CRITICAL, "Disarming denied: not landed")
            return False
        self.armed = False
        self.landed = True
        self.failsafe = None
        self._announced = None
        self._hold_until_us = None
        parts.fence.note_mode(parts.world.now_us)
        self.intended = self._mode_after_disarming
        self._enter(self.intended)
        if parts.world.options.battery.refills_when_disarmed:
            parts.world.battery.refill()
        parts.text_sender.send(texts.INFO, f"Disarmed by {by}")
        parts.text_sender.event(texts.DISARMED, 0x66, b"\x04")
        return True

    # Cycle

    def step(self) -> None:
        """Run all checks; once per tick, most of them ten times a second."""
        parts = self._parts
        now_us = parts.world.now_us
        parts.sticks.step(now_us)
        self._detect_ground(now_us)
        if now_us >= self._next_cycle_us:
            self._next_cycle_us += _CYCLE_US
            self._judge_battery()
            self._judge_health()
            self.companion.judge()
            self.ground_station.judge()
            self._pilot()
            self._disarm_by_itself(now_us)
            if self.armed:
                for text in parts.fence.step(now_us):
                    parts.text_sender.send(texts.CRITICAL, text)
                self._failsafe(now_us)
        elif self.failsafe is not None and self._recovered():
            self._failsafe(now_us)
        if self.mode is Mode.TAKEOFF and parts.tasks.takeoff_complete:
            self.intended = self.mode = Mode.HOLD
            parts.tasks.enter(Mode.HOLD, parts.navigation)

    def _intend(self, mode: Mode) -> None:
        """Take the user's mode; it is back after disarming, if it can be armed in."""
        self.intended = mode
        if mode not in _NOT_ARMED_IN:
            self._mode_after_disarming = mode

    def _enter(self, mode: Mode) -> None:
        if mode is self.mode and self.armed and not self.landed:
            return
        self.mode = mode
        parts = self._parts
        parts.tasks.enter(mode, parts.navigation)
        if mode is Mode.RTL and self.armed:
            above = parts.tasks.return_altitude_m
            parts.text_sender.return_start(parts.navigation.home_altitude_m + above, above)
            if parts.navigation.distance_to_home_m() < parts.parameters.value("NAV_ACC_RAD"):
                parts.text_sender.send(texts.INFO, "RTL: land at destination")
                parts.text_sender.event(texts.RETURN_LAND, 0x66)

    def _judge_battery(self) -> None:
        parts = self._parts
        charge = charge_of(parts.world.battery.fraction, parts.parameters)
        if charge is self.charge:
            return
        worse = charge > self.charge
        self.charge = charge
        if worse:
            severity, text, number, levels = texts.BATTERY[charge]
            parts.text_sender.send(severity, text)
            parts.text_sender.event(number, levels, bytes.fromhex("ffffffff0b"))
        else:
            self._overridden = min(self._overridden, charge)

    def _judge_health(self) -> None:
        nav = self._parts.navigation
        if nav.since_boot_s < 2.0:
            return
        health = (nav.position_valid, self.stream_alive)
        if health != self._health:
            self._health = health
            self._parts.text_sender.health(position=health[0], offboard=health[1])

    def _pilot(self) -> None:
        parts = self._parts
        if not self.sticks_present:
            return
        if not self._mode_chosen and not self.armed and self.intended is Mode.HOLD:
            self._mode_chosen = True
            self._intend(Mode.POSCTL)
            self._enter(Mode.POSCTL)
        bits = int(parts.parameters.value("COM_RC_OVERRIDE"))
        moved = parts.sticks.deflection() * 100.0 > parts.parameters.value("COM_RC_STICK_OV")
        may = (self.mode in AUTO_MODES and bits & _OVERRIDE_BIT_AUTO) or (
            self.mode is Mode.OFFBOARD and bits & _OVERRIDE_BIT_OFFBOARD
        )
        if self.armed and not self.landed and moved and may:
            mode = Mode.POSCTL if parts.navigation.position_valid else Mode.ALTCTL
            self._intend(mode)
            self.failsafe = None
            self._hold_until_us = None
            self._overrule()
            self._enter(mode)
            parts.text_sender.send(texts.INFO, "Pilot took over using sticks")
            parts.text_sender.event(texts.PILOT_TOOK_OVER, 0x66)

    def _overrule(self) -> None:
        """Fly a selected mode, in spite of the present demands of battery and links."""
        self._overridden = max(self._overridden, self.charge)
        self._links.overrule()

    def _recovered(self) -> bool:
        return self.intended is Mode.OFFBOARD and self.can_run(Mode.OFFBOARD)

    def _failsafe(self, now_us: int) -> None:
        parts = self._parts
        value = parts.parameters.value
        sticks, links = self.sticks_present, self._links
        links.step(self.intended, sticks=sticks, ground_station=self.ground_station.there)
        action = due(
            Flags(
                mode=self.intended,
                stream_alive=self.stream_alive,
                position_valid=parts.navigation.position_valid,
                sticks=sticks,
                charge=self.charge,
                overridden_charge=self._overridden,
                offboard_action=int(value("COM_OBL_RC_ACT")),
                battery_action=int(value("COM_LOW_BAT_ACT")),
                sticks_action=int(value("NAV_RCL_ACT")),
                sticks_lost=links.sticks.due,
                ground_station_lost=links.ground_station.due,
                ground_station_action=int(value("NAV_DLL_ACT")),
                fence_action=parts.fence.action,
            )
        )
        if action is None:
            if self.failsafe is not None:
                self.failsafe = None
                self._announced = None
                self._hold_until_us = None
                self._enter(self.intended)
            return
        mode = action.mode
        if action.delayed and self.failsafe is None:
            self._hold_until_us = now_us + int(value("COM_FAIL_ACT_T") * 1e6)
        if not action.delayed:
            self._hold_until_us = None
        self.failsafe = action
        if self._hold_until_us is not None:
            if now_us < self._hold_until_us:
                if parts.navigation.position_valid:
                    mode = Mode.HOLD
            else:
                self._hold_until_us = None
        if mode is not self.mode or mode is not self._announced:
            self._parts.text_sender.failsafe(
                mode=mode,
                intended=self.intended,
                final=action.mode,
                cause=action.cause,
                hold_s=round(value("COM_FAIL_ACT_T")) if self._hold_until_us is not None else None,
            )
            self._announced = mode
            self._enter(mode)

    def _detect_ground(self, now_us: int) -> None:
        parts = self._parts
        quad = parts.world.quad
        if not self.armed:
            self.landed = True
            self._contact_us = None
            return
        if self.landed:
            if quad.height_m > _AIRBORNE_M or parts.ramp.detected(now_us):
                self.landed = False
                self.took_off = True
                self._contact_us = None
                parts.text_sender.send(texts.INFO, "Takeoff detected")
                parts.text_sender.event(texts.TAKEOFF_DETECTED, 0x66)
            return
        if quad.on_ground and quad.demand.thrust < _LOW_THRUST and not parts.ramp.active():
            if self._contact_us is None:
                self._contact_us = now_us
            elif now_us - self._contact_us >= parts.parameters.value("LNDMC_TRIG_TIME") * 1e6:
                self.landed = True
                self._landed_us = now_us
                parts.text_sender.send(texts.INFO, "Landing detected")
                parts.text_sender.event(texts.LANDING_DETECTED, 0x66)
        else:
            self._contact_us = None

    def _disarm_by_itself(self, now_us: int) -> None:
        if not self.armed or not self.landed:
            return
        value = self._parts.parameters.value
        if self.took_off:
            wait_s, by = value("COM_DISARM_LAND"), "landing"
        else:
            wait_s = value("COM_DISARM_PRFLT") + value("COM_SPOOLUP_TIME")
            by = "auto preflight disarming"
        if wait_s > 0.0 and now_us - self._landed_us >= wait_s * 1e6:
            self.disarm(by)
