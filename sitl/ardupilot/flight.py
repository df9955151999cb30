"""ArduPilot's modes: the motion that each of them demands.

Inputs: mode, local position, sticks, GUIDED's request. Outputs: the target of the position
control, shaped to the vehicle's limits.
"""

import math
from typing import Final

from sitl.ardupilot.gains import horizontal_limits, vertical_limits
from sitl.ardupilot.guided import Guided, Request
from sitl.ardupilot.modes import Mode
from sitl.ardupilot.navigation import Navigation
from sitl.ardupilot.shaper import Shaper
from sitl.control import PositionControl, Target
from sitl.parameters import Parameters
from sitl.quadrotor import Quadrotor
from sitl.sticks import Sticks

_PAUSE_S: Final = 4.0
"""Pause of a failsafe's LAND before the descent."""
_ARRIVED_M: Final = 0.05
_RETURNED_M: Final = 0.3
_DEAD_ZONE: Final = 0.1
_NOSE_SHARE: Final = 0.05
"""Part of WPNAV_SPEED: above it the nose turns into the direction of travel."""
_RETURNING: Final = frozenset({Mode.RTL, Mode.SMART_RTL})
_PILOTED: Final = frozenset({Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.POSHOLD})


class Flight:
    """The task of the current mode."""

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
        self.guided = Guided()
        self.mode = Mode.STABILIZE
        self._across, self._down = Shaper(), Shaper()
        self._hold = 0j
        self._hold_z = 0.0
        self._yaw_rad = quad.yaw
        self._pause_s = 0.0
        self._phase = ""
        self._return_z = self._return_height_m = 0.0
        self._loiter_s = 0.0

    @property
    def taking_off(self) -> bool:
        """True during a take-off."""
        return self.mode is Mode.GUIDED and self.guided.takeoff_z_m is not None

    @property
    def landing(self) -> bool:
        """True during the descent of a landing."""
        return self.mode is Mode.LAND or (self.mode in _RETURNING and self._phase == "land")

    @property
    def returning(self) -> bool:
        """True during the flight home, before the landing."""
        return self.mode in _RETURNING and self._phase != "land"

    @property
    def return_height_m(self) -> float:
        """Height above home of the return."""
        return self._return_height_m

    def wants_up(self, sticks: Sticks) -> bool:
        """Return True if the vehicle, armed on the ground, would lift off now."""
        return self.taking_off or (self.mode in _PILOTED and sticks.throttle > _DEAD_ZONE)

    def enter(self, mode: Mode, nav: Navigation, *, pause: bool = False) -> None:
        """Begin a mode at the present place and speed; `pause`: LAND waits before it sinks."""
        self.mode = mode
        self.guided.stop()
        self._restart(nav)
        self._phase = ""
        self._pause_s = _PAUSE_S if pause else 0.0
        if mode in _RETURNING:
            self._plan_return(nav)

    def take_off(self, z_m: float, nav: Navigation) -> None:
        """Begin a take-off to a local z."""
        self._restart(nav)
        self.guided.stop()
        self.guided.takeoff_z_m = z_m

    def abandon_take_off(self) -> None:
        """Cancel a take-off under way."""
        if self.taking_off:
            self.guided.stop()

    def rest(self, nav: Navigation) -> None:
        """Hold the present place: on the ground."""
        self._restart(nav)

    def run(self, dt: float, now_us: int, nav: Navigation, sticks: Sticks) -> None:
        """Write the control's target for this tick."""
        target = self._control.target
        target.clear()
        if self.mode is Mode.GUIDED:
            self._guided(dt, now_us, nav, target)
        elif self.mode is Mode.LAND:
            self._land(dt, nav, target, sticks)
        elif self.mode in _RETURNING:
            self._return(dt, nav, target, sticks)
        elif self.mode is Mode.BRAKE:
            self._move(dt, nav, target, None, 0j)
            self._climb(dt, nav, target, None, 0.0)
        elif self.mode is Mode.GUIDED_NOGPS:
            target.roll, target.pitch = self._bias
            self._climb(dt, nav, target, None, 0.0)
        else:
            self._piloted(dt, nav, target, sticks)
        if not math.isfinite(target.yaw_rate):
            target.yaw = self._yaw_rad

    # The modes

    def _guided(self, dt: float, now_us: int, nav: Navigation, target: Target) -> None:
        guided = self.guided
        if guided.takeoff_z_m is not None:
            self._move(dt, nav, target, self._hold, 0j)
            self._climb(dt, nav, target, guided.takeoff_z_m, 0.0)
            if abs(nav.z - guided.takeoff_z_m) < _ARRIVED_M:
                top = (self._hold.real, self._hold.imag, guided.takeoff_z_m)
                guided.take(Request(position_ned_m=top), now_us)
            return
        guided.step(dt, now_us, self._parameters.value("GUID_TIMEOUT"))
        request = guided.request
        goal = goal_z = None
        if request.position_ned_m is not None:
            north, east, goal_z = request.position_ned_m
            goal = complex(north, east)
        vn, ve, vd = request.velocity_ned_mps or (0.0, 0.0, 0.0)
        self._move(dt, nav, target, goal, complex(vn, ve))
        self._climb(dt, nav, target, goal_z, vd)
        if request.yaw_rad is not None:
            self._yaw_rad = request.yaw_rad
        elif request.yaw_rate_radps is not None:
            target.yaw_rate = request.yaw_rate_radps
            self._yaw_rad = self._quad.yaw
        else:
            self._nose_forward()

    def _land(self, dt: float, nav: Navigation, target: Target, sticks: Sticks) -> None:
        value = self._parameters.value
        if nav.position_ok:
            self._move(dt, nav, target, self._hold, 0j)
        else:
            self._lean(target, sticks)
        if self._pause_s > 0.0:
            self._pause_s -= dt
            self._climb(dt, nav, target, None, 0.0)
            return
        speed = value("LAND_SPEED")
        if self._quad.height_m * 100.0 > value("LAND_ALT_LOW"):
            speed = value("LAND_SPEED_HIGH") or value("WPNAV_SPEED_DN")
        self._climb(dt, nav, target, None, speed / 100.0)

    def _plan_return(self, nav: Navigation) -> None:
        value = self._parameters.value
        home_x, home_y, home_z = nav.home_ned_m()
        distance = math.hypot(nav.x - home_x, nav.y - home_y)
        height = home_z - nav.z
        cone = distance * (value("RTL_CONE_SLOPE") or math.inf)
        self._return_height_m = max(height, min(value("RTL_ALT") / 100.0, cone))
        self._return_z = home_z - self._return_height_m
        self._phase = "climb"

    def _return(self, dt: float, nav: Navigation, target: Target, sticks: Sticks) -> None:
        home_x, home_y, _ = nav.home_ned_m()
        home = complex(home_x, home_y)
        if self._phase == "climb":
            self._move(dt, nav, target, self._hold, 0j)
            if nav.z < self._return_z + _ARRIVED_M:
                self._phase = "cruise"
        elif self._phase == "cruise":
            self._move(dt, nav, target, home, 0j)
            self._nose_forward()
            if abs(home - complex(nav.x, nav.y)) < _RETURNED_M:
                self._phase, self._loiter_s = "loiter", 0.0
        elif self._phase == "loiter":
            self._move(dt, nav, target, home, 0j)
            self._loiter_s += dt
            if self._loiter_s * 1000.0 >= self._parameters.value("RTL_LOIT_TIME"):
                self._phase, self._hold = "land", home
        if self._phase == "land":
            self._land(dt, nav, target, sticks)
        else:
            self._climb(dt, nav, target, self._return_z, 0.0)

    def _piloted(self, dt: float, nav: Navigation, target: Target, sticks: Sticks) -> None:
        value = self._parameters.value
        if yaw := _stick(sticks.yaw):
            target.yaw_rate = yaw * math.radians(value("PILOT_Y_RATE"))
            self._yaw_rad = self._quad.yaw
        if self.mode in (Mode.LOITER, Mode.POSHOLD):
            turn = complex(math.cos(self._quad.yaw), math.sin(self._quad.yaw))
            wish = complex(_stick(sticks.pitch), _stick(sticks.roll)) * turn
            self._move(dt, nav, target, None, wish * value("LOIT_SPEED") / 100.0)
        else:
            self._lean(target, sticks)
        if self.mode is Mode.STABILIZE:
            hover = self._quad.airframe.hover_thrust
            target.thrust = hover * (1.0 + sticks.throttle)
            return
        throttle = _stick(sticks.throttle)
        up = value("PILOT_SPEED_UP")
        speed = up if throttle > 0.0 else value("PILOT_SPEED_DN") or up
        self._climb(dt, nav, target, None, -throttle * speed / 100.0)

    # Helpers

    def _restart(self, nav: Navigation) -> None:
        estimator = nav.estimator
        self._hold = complex(nav.x, nav.y)
        self._across.restart(self._hold, complex(estimator.vn, estimator.ve))
        self._down.restart(nav.z, estimator.vd)
        self._yaw_rad = self._quad.yaw

    def _move(
        self, dt: float, nav: Navigation, target: Target, goal: complex | None, velocity: complex
    ) -> None:
        shaper = self._across
        limits = horizontal_limits(self._parameters)
        shaper.step(dt, limits, complex(nav.x, nav.y), goal, velocity)
        target.x, target.y = shaper.position.real, shaper.position.imag
        target.vx, target.vy = shaper.velocity.real, shaper.velocity.imag
        target.ax, target.ay = shaper.acceleration.real, shaper.acceleration.imag

    def _climb(
        self, dt: float, nav: Navigation, target: Target, goal: float | None, velocity: float
    ) -> None:
        shaper = self._down
        limits = vertical_limits(self._parameters)
        shaper.step(dt, limits, complex(nav.z), None if goal is None else complex(goal), velocity)
        target.z, target.vz = shaper.position.real, shaper.velocity.real
        target.az = shaper.acceleration.real

    def _lean(self, target: Target, sticks: Sticks) -> None:
        tilt_rad = math.radians(self._parameters.value("ANGLE_MAX") / 100.0)
        target.roll = _stick(sticks.roll) * tilt_rad + self._bias[0]
        target.pitch = -_stick(sticks.pitch) * tilt_rad + self._bias[1]

    def _nose_forward(self) -> None:
        velocity = self._across.velocity
        if abs(velocity) > _NOSE_SHARE * self._parameters.value("WPNAV_SPEED") / 100.0:
            self._yaw_rad = math.atan2(velocity.imag, velocity.real)


def _stick(*deflections: float) -> float:
    """Return a stick's deflection outside the dead zone; of several, the largest."""
    largest = max(deflections, key=abs)
    return largest if abs(largest) > _DEAD_ZONE else 0.0
