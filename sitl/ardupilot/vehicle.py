"""The ArduPilot vehicle: its parts put together, messages in, telemetry out.

Inputs: decoded messages from links, the world's ticks. Outputs: the airframe's demand, packets on
the links. Behaviour as measured on ArduCopter 4.6.3.
"""

from typing import Any, Final

from sitl import sim_parameters
from sitl.ardupilot.battery import BatteryMonitor
from sitl.ardupilot.commander import Commander, Parts
from sitl.ardupilot.commands import Commands
from sitl.ardupilot.fence import Fence
from sitl.ardupilot.flight import Flight
from sitl.ardupilot.gains import gains
from sitl.ardupilot.inbox import Inbox, Receivers
from sitl.ardupilot.modes import Mode
from sitl.ardupilot.navigation import Navigation
from sitl.ardupilot.routing import route
from sitl.ardupilot.state import GuidedTarget
from sitl.ardupilot.streams import FIRST_PACKETS_US, IDS, Schedule
from sitl.ardupilot.telemetry import Telemetry
from sitl.ardupilot.texts import INFO, TextSender
from sitl.commands import ACCEPTED, DENIED, FAILED, Command, acknowledgement
from sitl.control import PositionControl
from sitl.fence_areas import FenceAreas
from sitl.links import Router
from sitl.parameter_server import ParameterServer
from sitl.parameters import Parameters
from sitl.radio import Radio
from sitl.sticks import Sticks
from sitl.wire import layout
from sitl.world import TICK_S, World

_RESTART_US: Final = 190_000
"""Time from the command to the new start."""
_ENDED: Final = "PROCESS ENDED"
_NO_INDEX: Final = 65535
_LAST_SWITCH_POSITION: Final = 6
_LEVEL_BIAS_RAD: Final = 0.01
_INTERVAL_UNKNOWN: Final = 0
_BOOTING: Final = 1
_ON_NEW_HOME: Final = ("GPS_GLOBAL_ORIGIN", "HOME_POSITION")


class ArduPilotManner:
    """ArduPilot's behaviour over a world and its links."""

    def __init__(self, world: World, router: Router, parameters: Parameters) -> None:
        """Boot now, with a remote control switched on, its throttle down."""
        self._world = world
        self._router = router
        self.parameters = parameters
        self.sticks = Sticks()
        self.areas = FenceAreas()
        self.sticks.hold(roll=0.0, pitch=0.0, throttle=-1.0, yaw=0.0)
        self.sticks.flip(_LAST_SWITCH_POSITION)
        self.sticks.step(world.now_us)
        gauss = world.random.gauss
        self._bias = (gauss(0.0, _LEVEL_BIAS_RAD), gauss(0.0, _LEVEL_BIAS_RAD))
        self._apply("SIM_RC_FAIL")
        self._boot(world.now_us)

    def _boot(self, boot_us: int) -> None:
        world, router, parameters = self._world, self._router, self.parameters
        self._boot_us = boot_us
        self.process_ended = False
        self.text_sender = TextSender(world, router, boot_us)
        self.navigation = Navigation(world, parameters, self.text_sender, boot_us)
        self.control_loop = PositionControl(gains(parameters), world.quad, 0.0)
        self.flight = Flight(parameters, self.control_loop, world.quad, self._bias)
        self.battery = BatteryMonitor(world.battery, parameters)
        self.fence = Fence(parameters, self.areas)
        self.commander = Commander(
            Parts(
                world=world,
                parameters=parameters,
                navigation=self.navigation,
                sticks=self.sticks,
                flight=self.flight,
                battery=self.battery,
                fence=self.fence,
                text_sender=self.text_sender,
            )
        )
        self.telemetry = Telemetry(world, self, parameters, boot_us)
        self._schedules = {name: Schedule(boot_us) for name in router.links}
        self._server = ParameterServer(
            parameters, self.set_parameter, any_type=True, index_by_name=_NO_INDEX
        )
        self._inbox = Inbox(
            Receivers(
                world=world,
                router=router,
                boot_us=boot_us,
                parameters=parameters,
                navigation=self.navigation,
                flight=self.flight,
                fence=self.fence,
                areas=self.areas,
                commander=self.commander,
                commands=Commands(self, self.commander, self.navigation, self.battery, self.fence),
                sticks=self.sticks,
                server=self._server,
                schedules=self._schedules,
            )
        )
        self._radio = Radio(world, router)

    # Interface for the machine

    @property
    def running(self) -> bool:
        """True while the process runs and its links work."""
        return not self.process_ended and self._world.now_us - self._boot_us >= FIRST_PACKETS_US

    @property
    def armed(self) -> bool:
        """True when the motors may turn."""
        return self.commander.armed and not self.process_ended

    @property
    def mode_name(self) -> str:
        """ArduPilot's name of the mode; PROCESS ENDED after a crash of it."""
        return _ENDED if self.process_ended else self.commander.mode.title

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        return self.commander.landed_state

    def reboot(self) -> None:
        """Restart: time_boot_ms restarts, disarmed; parameters and the world stay."""
        self._world.quad.demand.spinning = False
        self._boot(self._world.now_us)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and let it act; `KeyError`, `ValueError` when it is refused."""
        self.parameters.set(name, value)
        self.control_loop.gains = gains(self.parameters)
        sim_parameters.apply(name, self.parameters, self._world.conditions)
        self._apply(name)

    def _apply(self, name: str) -> None:
        if name != "SIM_RC_FAIL":
            return
        if self.parameters.value(name):
            self.sticks.release()
        else:
            self.sticks.remote_control = True

    # Inputs of the telemetry (`state.State`)

    @property
    def custom_mode(self) -> int:
        """ArduCopter's number of the mode."""
        return self.commander.mode.number

    @property
    def system_status(self) -> int:
        """MAV_STATE."""
        return self.commander.system_status

    @property
    def guided_target(self) -> GuidedTarget | None:
        """The target in use; None when the mode is not GUIDED."""
        if self.commander.mode is not Mode.GUIDED:
            return None
        return self.flight.guided.target(self.position_ned_m)

    @property
    def desired_attitude_rad(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw that the attitude control works towards."""
        demand = self._world.quad.demand
        return demand.roll_rad, demand.pitch_rad, demand.yaw_rad

    @property
    def ekf_flags(self) -> int:
        """EKF_STATUS_REPORT.flags."""
        return self.navigation.flags

    @property
    def position_known(self) -> bool:
        """True while the estimator has a position."""
        return self.navigation.position_known

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """The estimate, metres from the EKF origin."""
        nav = self.navigation
        return nav.x, nav.y, nav.z

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """The EKF origin."""
        return self.navigation.origin

    @property
    def home(self) -> tuple[float, float, float] | None:
        """Home; None until it is set."""
        return self.navigation.home

    @property
    def wind_from(self) -> tuple[float, float] | None:
        """The estimated wind; None unknown."""
        return self.navigation.wind_from

    @property
    def battery_charge_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE."""
        return int(self.battery.charge)

    @property
    def battery_consumed_mah(self) -> float:
        """Charge that the monitor has counted; the remaining charge is computed from it."""
        return self.battery.consumed_mah

    @property
    def battery_consumed_wh(self) -> float:
        """Energy that the monitor has counted."""
        return self.battery.consumed_wh

    @property
    def ready_to_arm(self) -> bool:
        """True when the pre-arm checks of the present mode pass."""
        return not self.commander.refusals

    @property
    def fence_enabled(self) -> bool:
        """True if there is a fence."""
        return self.fence.enabled

    @property
    def fence_breached(self) -> bool:
        """True if the vehicle is outside its fence."""
        return self.fence.breached

    @property
    def channels_us(self) -> tuple[int, ...]:
        """The eight channels of the remote control."""
        return tuple(self.sticks.channels())

    @property
    def remote_control_lost(self) -> bool:
        """True while the remote control is lost."""
        return self.commander.failsafes.radio

    @property
    def rssi(self) -> int:
        """RC_CHANNELS.rssi."""
        return self._inbox.rssi

    @property
    def return_place(self) -> tuple[float, float, float] | None:
        """Target of RTL; None in other modes and during the landing."""
        if not self.flight.returning or self.navigation.home is None:
            return None
        latitude_deg, longitude_deg, altitude_m = self.navigation.home
        return latitude_deg, longitude_deg, altitude_m + self.flight.return_height_m

    # Messages in

    def receive(self, link: str, message: Any) -> None:
        """Route a message, and take it if it is for the autopilot."""
        if self.process_ended or not route(self._router, self._router.links[link], message):
            return
        try:
            self._inbox.take(link, message)
        except FloatingPointError:
            self.process_ended = True
            self._world.quad.demand.spinning = False

    # Answers

    def acknowledge(self, command: Command, result: int) -> None:
        """Send a COMMAND_ACK to the sender."""
        self._send(command.link, "COMMAND_ACK", acknowledgement(command, result))

    def set_interval(self, link: str, msgid: int, interval_us: int) -> int:
        """Set a message interval on a link; returns the result, and reports a denial."""
        result = self._schedules[link].set(msgid, interval_us, self._world.now_us)
        if result == DENIED:
            self.text_sender.send(INFO, f"No ap_message for mavlink id ({msgid})")
        return result

    def send_interval(self, link: str, msgid: int) -> int:
        """Send MESSAGE_INTERVAL, 0 where the message is not known; returns the result."""
        interval_us = self._schedules[link].interval_us(msgid)
        payload = layout("MESSAGE_INTERVAL").payload(message_id=msgid, interval_us=interval_us)
        self._send(link, "MESSAGE_INTERVAL", payload)
        return FAILED if interval_us == _INTERVAL_UNKNOWN else ACCEPTED

    def send_message(self, link: str, msgid: int) -> int:
        """Send a message once, if there is such data; returns the result."""
        name = IDS.get(msgid)
        if name is None:
            return FAILED
        payload = self.telemetry.build(name)
        if payload is not None:
            self._send(link, name, payload)
        return ACCEPTED

    def restart(self) -> None:
        """Restart as commanded."""
        self._boot(self._world.now_us + _RESTART_US)

    def _send(self, link: str, name: str, payload: bytes) -> None:
        self._router.links[link].send(layout(name), payload)

    # Flight

    def control(self) -> None:
        """Decide and write the airframe's demand; before the physics of each tick."""
        if self.process_ended or self._world.now_us < self._boot_us:
            return
        self.navigation.update()
        commander = self.commander
        commander.step()
        if not commander.armed:
            self.control_loop.idle(spinning=False)
        elif commander.landed:
            self.flight.rest(self.navigation)
            self.control_loop.idle(spinning=True)
        else:
            self.flight.run(TICK_S, self._world.now_us, self.navigation, self.sticks)
            self.control_loop.run(TICK_S, self.navigation)

    # Telemetry out

    def emit(self) -> None:
        """Send what is due; after the physics of each tick."""
        if self.running:
            self._send_texts()
        self._radio.step()

    def _send_texts(self) -> None:
        now_us = self._world.now_us
        self.text_sender.step()
        made: dict[str, bytes | None] = {}
        booting = self.commander.system_status == _BOOTING
        for link, schedule in self._schedules.items():
            names = schedule.due(now_us)
            # During the boot every heartbeat is sent twice; a new mode is reported at once.
            if booting if "HEARTBEAT" in names else self.commander.mode_changed:
                names.append("HEARTBEAT")
            if self.navigation.home_changed:
                names += _ON_NEW_HOME
            for name in names:
                if name not in made:
                    made[name] = self.telemetry.build(name)
                payload = made[name]
                if payload is not None:
                    self._send(link, name, payload)
            for payload in self._server.due(link):
                self._send(link, "PARAM_VALUE", payload)
        self.commander.mode_changed = self.navigation.home_changed = False
        self.telemetry.step(TICK_S)
