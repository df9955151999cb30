"""ArduPilot's decisions: arming, modes, failsafes, land detection.

Inputs: requests, and the state of estimator, battery, remote control, ground station. Outputs: the
mode that is flown, the armed state, and texts.
"""

from dataclasses import dataclass
from typing import Final

from sitl.ardupilot import failsafe, texts
from sitl.ardupilot.battery import BatteryMonitor, Charge
from sitl.ardupilot.failsafe import Failsafes
from sitl.ardupilot.fence import Fence
from sitl.ardupilot.flight import Flight
from sitl.ardupilot.modes import Mode, requested
from sitl.ardupilot.navigation import Navigation
from sitl.parameters import Parameters
from sitl.sticks import Sticks
from sitl.world import TICK_S, World

ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
BOOT, STANDBY, ACTIVE, CRITICAL = 1, 3, 4, 5
_STANDBY_AFTER_S: Final = 2.4
_LIFT_AFTER_ARMING_S: Final = 3.35
"""Delay of arming, spool-up, and the slow start of the throttle."""
_LIFT_AFTER_REQUEST_S: Final = 1.0
_LANDED_AFTER_S: Final = 2.0
_LOW_THRUST: Final = 0.25
_RADIO_SILENT_S: Final = 0.2
_RADIO_LOST_S: Final = 1.0
_SWITCH_SETTLED_S: Final = 0.2
_ESTIMATOR_GOOD_S: Final = 1.0
_PREARM_PERIOD_S: Final = 30.0
_GOOD_HDOP: Final = 1.4
_LANDING_TOLD_US: Final = 80_000
"""EXTENDED_SYS_STATE still reports a landing that another mode has ended: 40 to 110 ms."""


@dataclass(slots=True, kw_only=True)
class Parts:
    """Inputs of the commander."""

    world: World
    parameters: Parameters
    navigation: Navigation
    sticks: Sticks
    flight: Flight
    battery: BatteryMonitor
    fence: Fence
    text_sender: texts.TextSender


class Commander:
    """Arming, mode and failsafes of the vehicle."""

    def __init__(self, parts: Parts) -> None:
        """Boot in the switch's mode, disarmed."""
        self._p = parts
        self.armed = False
        self.landed = True
        self.failsafes = Failsafes()
        self.mode_changed = False
        self._lift_us = 0
        self._contact_s = 0.0
        self._idle_s = 0.0
        self._switch = parts.sticks.switch_position
        self._switch_s = 0.0
        self._radio_silent_s = 0.0
        self._ground_station_us: int | None = None
        self._estimator_good_s = 0.0
        self._lane = 0
        self._was_known = False
        self._next_prearm_s = _PREARM_PERIOD_S
        self._landing_reported_until_us = 0
        self.mode = self._mode_of_switch() or Mode.STABILIZE
        parts.flight.enter(self.mode, parts.navigation)

    # Queries

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status; a vehicle on the ground is in standby, armed or not."""
        if self._p.navigation.since_boot_s < _STANDBY_AFTER_S:
            return BOOT
        if self.failsafes.any() or self._p.battery.charge > Charge.OK:
            return CRITICAL
        return STANDBY if self.landed else ACTIVE

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.landed:
            return ON_GROUND
        if self._p.flight.taking_off:
            return TAKING_OFF
        reported = self._p.world.now_us < self._landing_reported_until_us
        return LANDING if self._p.flight.landing or reported else IN_AIR

    @property
    def refusals(self) -> list[str]:
        """Names of checks before arming that fail in this mode; empty when all pass."""
        parts = self._p
        nav = parts.navigation
        if not nav.settled:
            return ["Accels inconsistent"]
        if found := parts.battery.refusals():
            return found
        if self.failsafes.radio:
            return ["Radio failsafe on"]
        if self.mode.value.needs_position:
            if not nav.position_ok:
                return ["Need Position Estimate"]
            if parts.world.conditions.hdop > _GOOD_HDOP:
                return ["High GPS HDOP"]
        return []

    def may_lift(self) -> bool:
        """Return True when the motors, armed on the ground, are ready to lift."""
        return self._p.world.now_us >= self._lift_us

    # Requests

    def request_mode(self, number: int) -> bool:
        """Request a mode by its number; False when it is refused."""
        mode = requested(number)
        if mode is None:
            self._p.text_sender.send(texts.WARNING, f"No such mode {number}")
            return False
        why = None
        if mode is Mode.AUTO:
            why = "init failed"
        elif self.armed and mode.value.needs_position and not self._p.navigation.position_ok:
            why = "requires position"
        if why is not None:
            self._p.text_sender.send(texts.WARNING, f"Mode change to {mode.title} failed: {why}")
            return False
        self._enter(mode)
        return True

    def arm(self, *, force: bool = False) -> bool:
        """Arm; False when a check forbids it."""
        if self.armed:
            return True
        whys = self.refusals or ([] if self.mode.value.armable else ["Mode not armable"])
        if whys and not force:
            for why in whys:
                self._p.text_sender.send(texts.CRITICAL, f"Arm: {why}")
            return False
        self.armed = True
        self.landed = True
        self._idle_s = 0.0
        self._lift_us = self._p.world.now_us + round(_LIFT_AFTER_ARMING_S * 1e6)
        if self._p.navigation.position_ok:
            self._p.navigation.set_home()
        self._p.text_sender.send(texts.INFO, "Arming motors")
        return True

    def disarm(self, *, force: bool = False) -> bool:
        """Disarm; False in the air unless forced."""
        if not self.armed:
            return True
        if not self.landed and not force:
            return False
        self.armed = False
        self.landed = True
        self._p.flight.abandon_take_off()
        self._p.text_sender.send(texts.INFO, "Disarming motors")
        if self._lane:
            self._use_lane(0)
        return True

    def take_off(self, height_m: float) -> bool:
        """Take off to a height above home; False unless armed in GUIDED on the ground."""
        if not (self.armed and self.landed and self.mode is Mode.GUIDED and height_m > 0.0):
            return False
        parts = self._p
        request_us = parts.world.now_us + round(_LIFT_AFTER_REQUEST_S * 1e6)
        self._lift_us = max(self._lift_us, request_us)
        parts.flight.take_off(parts.navigation.home_ned_m()[2] - height_m, parts.navigation)
        return True

    def handle_ground_station(self) -> None:
        """Note a heartbeat of the ground station."""
        self._ground_station_us = self._p.world.now_us
        if self.failsafes.ground_station:
            self.failsafes.ground_station = False
            self._p.text_sender.send(texts.WARNING, "GCS Failsafe Cleared")

    # Cycle

    def step(self) -> None:
        """Run all checks; once per tick."""
        parts = self._p
        parts.sticks.step(parts.world.now_us)
        self._detect_ground()
        self._judge_radio()
        self._judge_ground_station()
        self._judge_battery()
        self._judge_dead_reckoning()
        self._judge_estimator()
        self._judge_fence()
        self._turn_switch()
        self._disarm_by_itself()
        self._complain()

    def _enter(self, mode: Mode, *, pause: bool = False) -> None:
        if mode is self.mode:
            return
        if self._p.flight.landing:
            self._landing_reported_until_us = self._p.world.now_us + _LANDING_TOLD_US
        self.mode = mode
        self.mode_changed = True
        self._p.flight.enter(mode, self._p.navigation, pause=pause)

    def _act(self, mode: failsafe.Reaction, *, pause: bool = True) -> None:
        """Act as a failsafe demands; on the ground it disarms. `pause`: LAND waits a moment."""
        if mode is None or not self.armed:
            return
        if self.landed or mode == failsafe.TERMINATE:
            self.disarm(force=True)
        elif mode.value.needs_position and not self._p.navigation.position_ok:
            self._enter(Mode.LAND, pause=pause)
        else:
            self._enter(mode, pause=pause and mode is Mode.LAND)

    def _judge_radio(self) -> None:
        parts = self._p
        value = parts.parameters.value
        received = parts.sticks.present(parts.world.now_us, _RADIO_SILENT_S)
        self._radio_silent_s = 0.0 if received else self._radio_silent_s + TICK_S
        lost = self._radio_silent_s >= _RADIO_LOST_S
        if lost == self.failsafes.radio or (lost and not value("FS_THR_ENABLE")):
            return
        self.failsafes.radio = lost
        if not lost:
            parts.text_sender.send(texts.WARNING, "Radio Failsafe Cleared")
            return
        parts.text_sender.send(texts.WARNING, "Radio Failsafe")
        self._act(
            failsafe.on_radio(int(value("FS_THR_ENABLE")), int(value("FS_OPTIONS")), self.mode)
        )

    def _judge_ground_station(self) -> None:
        parts = self._p
        value = parts.parameters.value
        action = int(value("FS_GCS_ENABLE"))
        if not action or self._ground_station_us is None or self.failsafes.ground_station:
            return
        if parts.world.now_us - self._ground_station_us <= value("FS_GCS_TIMEOUT") * 1e6:
            return
        self.failsafes.ground_station = True
        parts.text_sender.send(texts.WARNING, "GCS Failsafe")
        self._act(failsafe.on_ground_station(action, int(value("FS_OPTIONS")), self.mode))

    def _judge_battery(self) -> None:
        parts = self._p
        value = parts.parameters.value
        level = parts.battery.step(TICK_S)
        if level is None:
            return
        word, name = {
            Charge.LOW: ("low", "BATT_FS_LOW_ACT"),
            Charge.CRITICAL: ("critical", "BATT_FS_CRT_ACT"),
        }[level]
        parts.text_sender.send(
            texts.WARNING,
            f"Battery 1 is {word} {parts.world.battery.voltage_v:.2f}V"
            f" used {parts.battery.consumed_mah:.0f} mAh",
        )
        parts.text_sender.send(texts.WARNING, "Battery Failsafe")
        self._act(failsafe.on_battery(int(value(name)), int(value("FS_OPTIONS")), self.mode))

    def _judge_estimator(self) -> None:
        parts = self._p
        nav = parts.navigation
        self._was_known = self._was_known or nav.position_ok
        self._estimator_good_s = self._estimator_good_s + TICK_S if nav.position_ok else 0.0
        if self.failsafes.estimator:
            if self._estimator_good_s >= _ESTIMATOR_GOOD_S:
                self.failsafes.estimator = False
                parts.text_sender.send(texts.CRITICAL, "EKF Failsafe Cleared")
            return
        action = int(parts.parameters.value("FS_EKF_ACTION"))
        if nav.position_ok or not (self._was_known and self.armed):
            return
        self.failsafes.estimator = True
        parts.text_sender.send(texts.CRITICAL, f"EKF3 lane switch {1 - self._lane}")
        self._use_lane(1 - self._lane)
        parts.text_sender.send(texts.CRITICAL, "EKF variance")
        mode = failsafe.on_estimator(action, self.mode)
        if mode is not None:
            parts.text_sender.send(texts.CRITICAL, f"EKF Failsafe: changed to {mode.title} Mode")
            self._act(mode)

    def _judge_dead_reckoning(self) -> None:
        parts = self._p
        lost = parts.navigation.dead_reckoning
        if lost == self.failsafes.dead_reckoning:
            return
        action = int(parts.parameters.value("FS_DR_ENABLE"))
        self.failsafes.dead_reckoning = lost and action > 0
        if self.failsafes.dead_reckoning:
            parts.text_sender.send(texts.CRITICAL, "Dead Reckoning started")
            self._act(failsafe.on_dead_reckoning(action, self.mode))
        elif action > 0:
            parts.text_sender.send(texts.CRITICAL, "Dead Reckoning stopped")

    def _use_lane(self, lane: int) -> None:
        self._lane = lane
        self._p.text_sender.send(texts.WARNING, f"EKF primary changed:{lane}")

    def _judge_fence(self) -> None:
        parts = self._p
        nav = parts.navigation
        place = (nav.x, nav.y, nav.z)
        landing = parts.flight.landing or self.landed or not self.armed
        change = parts.fence.step(
            TICK_S, *nav.from_home_m(place), nav.on_map(place), landing=landing
        )
        if change is None or not self.armed:
            return
        if not self.landed:
            parts.text_sender.send(texts.NOTICE, change.text)
        self._act(change.mode, pause=False)

    def _mode_of_switch(self) -> Mode | None:
        return requested(int(self._p.parameters.value(f"FLTMODE{self._switch}")))

    def _turn_switch(self) -> None:
        """Follow the remote control's mode switch, once it has settled for a moment."""
        position = self._p.sticks.switch_position
        if position == self._switch or self.failsafes.radio:
            self._switch_s = 0.0
            return
        self._switch_s += TICK_S
        if self._switch_s >= _SWITCH_SETTLED_S:
            self._switch = position
            self.request_mode(int(self._p.parameters.value(f"FLTMODE{position}")))

    def _detect_ground(self) -> None:
        parts = self._p
        quad = parts.world.quad
        if not self.armed or self.landed:
            self._contact_s = 0.0
            if self.armed and self.may_lift() and parts.flight.wants_up(parts.sticks):
                self.landed = False
            return
        if quad.on_ground and quad.demand.thrust < _LOW_THRUST:
            self._contact_s += TICK_S
            self.landed = self._contact_s >= _LANDED_AFTER_S
            self._idle_s = 0.0
        else:
            self._contact_s = 0.0

    def _disarm_by_itself(self) -> None:
        if not (self.armed and self.landed):
            return
        self._idle_s += TICK_S
        delay_s = self._p.parameters.value("DISARM_DELAY")
        if self._p.flight.landing or 0.0 < delay_s <= self._idle_s:
            self.disarm()

    def _complain(self) -> None:
        """Send every 30 s the reasons that forbid arming."""
        nav = self._p.navigation
        if self.armed or nav.since_boot_s < self._next_prearm_s:
            return
        self._next_prearm_s = nav.since_boot_s + _PREARM_PERIOD_S
        for why in self.refusals:
            self._p.text_sender.send(texts.CRITICAL, f"PreArm: {why}")
