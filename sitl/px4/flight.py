"""Flight tasks: the motion that each of PX4's modes demands.

Inputs: mode, local position, sticks, setpoint. Outputs: the target of the position control.
"""

import math
from typing import Final

from sitl.control import PositionControl, Target
from sitl.parameters import Parameters
from sitl.px4.modes import AUTO_MODES, Mode
from sitl.px4.navigation import Navigation
from sitl.px4.offboard import OffboardStream, Setpoint
from sitl.quadrotor import Quadrotor
from sitl.sticks import Sticks

_BRAKE_TIME_S: Final = 0.5
_STICK_DEAD_ZONE: Final = 0.1
_NO_PILOT_SINK_MPS: Final = 0.75
"""Altitude mode without a pilot sinks slowly (measured on PX4 v1.17.0)."""
_ARRIVED_M: Final = 1.0


class FlightTasks:
    """The task of the current mode. `landing` and `takeoff_complete` report its progress."""

    def __init__(
        self,
        parameters: Parameters,
        control: PositionControl,
        quad: Quadrotor,
        level_bias_rad: tuple[float, float],
    ) -> None:
        """`level_bias_rad`: error of the level attitude without a position."""
        self._parameters = parameters
        self._control = control
        self._quad = quad
        self._bias = level_bias_rad
        self.mode = Mode.HOLD
        self.landing = False
        self.takeoff_complete = False
        self.return_altitude_m = 0.0
        self._takeoff_z: float | None = None
        self._hold_x = self._hold_y = self._hold_z = 0.0
        self._yaw = 0.0
        self._vx = self._vy = self._vz = 0.0
        self._locked = False
        self._phase = ""

    def enter(self, mode: Mode, nav: Navigation) -> None:
        """Begin a mode at the present place."""
        self.mode = mode
        self.landing = mode in (Mode.LAND, Mode.DESCEND)
        self.takeoff_complete = False
        self._locked = False
        self._phase = ""
        if mode is not Mode.TAKEOFF:
            self._takeoff_z = None
        estimator = nav.estimator
        self._vx, self._vy, self._vz = estimator.vn, estimator.ve, estimator.vd
        speed = math.hypot(estimator.vn, estimator.ve)
        reach_s = _BRAKE_TIME_S + speed / (2.0 * self._parameters.value("MPC_ACC_HOR"))
        self._hold_x = nav.x + estimator.vn * reach_s
        self._hold_y = nav.y + estimator.ve * reach_s
        self._hold_z = nav.z + estimator.vd * _BRAKE_TIME_S
        self._yaw = self._quad.yaw
        self._control.yaw_wish = self._yaw
        if mode is Mode.RTL:
            self._plan_return(nav)

    def reposition(self, x: float, y: float, z: float, yaw_rad: float) -> None:
        """Move the place to hold (NaN keeps a coordinate)."""
        self._hold_x = x if math.isfinite(x) else self._hold_x
        self._hold_y = y if math.isfinite(y) else self._hold_y
        self._hold_z = z if math.isfinite(z) else self._hold_z
        self._yaw = yaw_rad if math.isfinite(yaw_rad) else self._yaw

    def run(
        self, dt: float, nav: Navigation, sticks: Sticks | None, stream: OffboardStream
    ) -> None:
        """Write the control's target for this tick; `sticks` is None without a pilot."""
        target = self._control.target
        if self.mode is Mode.OFFBOARD:
            if stream.setpoint is not None:
                _take(stream.setpoint, target)
            return
        target.clear()
        target.yaw = self._yaw
        if self.mode in AUTO_MODES:
            self._auto(dt, nav, target)
        else:
            self._manual(dt, nav, sticks, target)

    def _auto(self, dt: float, nav: Navigation, target: Target) -> None:
        if self.mode in (Mode.LAND, Mode.DESCEND):
            self._land(dt, target, level=self.mode is Mode.DESCEND)
        elif self.mode is Mode.RTL:
            self._return(dt, nav, target)
        elif self.mode is Mode.TAKEOFF:
            goal = nav.home_z - self._parameters.value("MIS_TAKEOFF_ALT")
            if self._takeoff_z is not None:
                goal = min(goal, self._takeoff_z)
            target.x, target.y = self._hold_x, self._hold_y
            target.z = goal
            target.up_limit = self._parameters.value("MPC_TKO_SPEED")
            self.takeoff_complete = nav.z < goal + 0.3
        else:
            self._go(dt, nav, target, self._hold_x, self._hold_y)
            target.z = self._hold_z

    def climb_to(self, z: float) -> None:
        """Give the take-off, also when armed later, a height (local z) above MIS_TAKEOFF_ALT."""
        self._takeoff_z = z

    def _go(self, dt: float, nav: Navigation, target: Target, x: float, y: float) -> None:
        """Fly level to a point at cruise speed, then hold it."""
        dx, dy = x - nav.x, y - nav.y
        distance = math.hypot(dx, dy)
        if distance < 2.0 * _ARRIVED_M:
            target.x, target.y = x, y
            self._vx, self._vy = nav.estimator.vn, nav.estimator.ve
            return
        cruise = min(
            self._parameters.value("MPC_XY_CRUISE"),
            self._parameters.value("MPC_XY_TRAJ_P") * distance + 0.5,
        )
        step = self._parameters.value("MPC_ACC_HOR") * dt
        self._vx = _slew(self._vx, cruise * dx / distance, step)
        self._vy = _slew(self._vy, cruise * dy / distance, step)
        target.vx, target.vy = self._vx, self._vy

    def _land(self, dt: float, target: Target, *, level: bool) -> None:
        value = self._parameters.value
        height = self._quad.height_m
        high, low = value("MPC_LAND_ALT1"), value("MPC_LAND_ALT2")
        fast, slow = value("MPC_Z_V_AUTO_DN"), value("MPC_LAND_SPEED")
        if height > high:
            speed = fast
        elif height > low:
            speed = slow + (fast - slow) * (height - low) / (high - low)
        else:
            speed = slow if height > value("MPC_LAND_ALT3") else value("MPC_LAND_CRWL")
        self._vz = _slew(self._vz, speed, value("MPC_ACC_DOWN_MAX") * dt)
        target.vz = self._vz
        if level:
            target.roll, target.pitch = self._bias
        else:
            target.x, target.y = self._hold_x, self._hold_y

    def _plan_return(self, nav: Navigation) -> None:
        """Plan as RTL_TYPE 0: the cone over home counts within RTL_MIN_DIST alone."""
        value = self._parameters.value
        distance = nav.distance_to_home_m()
        height, climb = nav.home_z - nav.z, value("RTL_RETURN_ALT")
        cone_deg, arrived = value("RTL_CONE_ANG"), value("NAV_ACC_RAD")
        if cone_deg > 0.0:
            if distance <= arrived:
                climb = 2.0 * distance
            else:
                if distance <= value("RTL_MIN_DIST"):
                    cone = distance / math.tan(math.radians(min(89.0, max(1.0, cone_deg))))
                    climb = min(climb, cone)
                climb = max(climb, 2.0 * arrived)
        self.return_altitude_m = max(height, climb)
        self._phase = "climb"

    def _return(self, dt: float, nav: Navigation, target: Target) -> None:
        value = self._parameters.value
        top = nav.home_z - self.return_altitude_m
        if self._phase == "climb":
            target.x, target.y, target.z = self._hold_x, self._hold_y, top
            if nav.z < top + 0.8:
                self._phase = "cruise"
        elif self._phase == "cruise":
            self._go(dt, nav, target, nav.home_x, nav.home_y)
            target.z = top
            if nav.distance_to_home_m() < _ARRIVED_M:
                self._phase = "descend"
                self._vz = 0.0
        else:
            self._hold_x, self._hold_y = nav.home_x, nav.home_y
            if self._quad.height_m > value("RTL_DESCEND_ALT"):
                target.x, target.y = self._hold_x, self._hold_y
                self._vz = _slew(self._vz, value("MPC_Z_V_AUTO_DN"), value("MPC_ACC_DOWN_MAX") * dt)
                target.vz = self._vz
            else:
                self.landing = True
                self._land(dt, target, level=False)

    def _manual(self, dt: float, nav: Navigation, sticks: Sticks | None, target: Target) -> None:
        value = self._parameters.value
        if sticks is None:
            roll = pitch = yaw = throttle = 0.0
        else:
            roll, pitch = _expo(sticks.roll), _expo(sticks.pitch)
            yaw, throttle = _expo(sticks.yaw), _expo(sticks.throttle)
        if yaw:
            target.yaw = math.nan
            target.yaw_rate = yaw * math.radians(value("MPC_MAN_Y_MAX"))
            self._yaw = self._quad.yaw
        climb = throttle * (
            value("MPC_Z_VEL_MAX_UP") if throttle > 0.0 else value("MPC_Z_VEL_MAX_DN")
        )
        if self.mode is Mode.POSCTL:
            self._position_mode(dt, nav, target, (roll, pitch, climb))
            return
        tilt = math.radians(value("MPC_MAN_TILT_MAX"))
        target.roll, target.pitch = roll * tilt, -pitch * tilt
        if self.mode is Mode.MANUAL:
            target.thrust = max(0.0, min(1.0, 0.5 + 0.5 * (sticks.throttle if sticks else -1.0)))
        elif sticks is None:
            target.roll, target.pitch = self._bias
            target.vz = _NO_PILOT_SINK_MPS
        elif climb:
            target.vz = -climb
            self._hold_z = nav.z
        else:
            target.z = self._hold_z

    def _position_mode(
        self, dt: float, nav: Navigation, target: Target, wish: tuple[float, float, float]
    ) -> None:
        value = self._parameters.value
        roll, pitch, climb = wish
        if climb:
            target.vz = -climb
            self._hold_z = nav.z
        else:
            target.z = self._hold_z
        step = value("MPC_ACC_HOR") * dt
        speed = value("MPC_VEL_MANUAL")
        cos_y, sin_y = math.cos(self._quad.yaw), math.sin(self._quad.yaw)
        if roll or pitch:
            self._vx = _slew(self._vx, speed * (pitch * cos_y - roll * sin_y), step)
            self._vy = _slew(self._vy, speed * (pitch * sin_y + roll * cos_y), step)
            self._locked = False
        else:
            self._vx, self._vy = _slew(self._vx, 0.0, step), _slew(self._vy, 0.0, step)
            if not self._locked and math.hypot(self._vx, self._vy) < 0.2:
                self._hold_x, self._hold_y = nav.x, nav.y
                self._locked = True
        if self._locked:
            target.x, target.y = self._hold_x, self._hold_y
        else:
            target.vx, target.vy = self._vx, self._vy


def _take(setpoint: Setpoint, target: Target) -> None:
    target.clear()
    target.x, target.y, target.z = setpoint.position_ned_m
    target.vx, target.vy, target.vz = setpoint.velocity_ned_mps
    target.ax, target.ay, target.az = setpoint.acceleration_ned_mps2
    target.yaw, target.yaw_rate = setpoint.yaw_rad, setpoint.yaw_rate_radps


def _slew(value: float, goal: float, step: float) -> float:
    return value + max(-step, min(step, goal - value))


def _expo(stick: float) -> float:
    """PX4's stick curve: dead zone, then 0.4 x + 0.6 x cubed."""
    if abs(stick) < _STICK_DEAD_ZONE:
        return 0.0
    x = (abs(stick) - _STICK_DEAD_ZONE) / (1.0 - _STICK_DEAD_ZONE)
    return math.copysign(0.4 * x + 0.6 * x**3, stick)
