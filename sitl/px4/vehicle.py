"""The PX4 vehicle: its parts put together, messages in, telemetry out.

Inputs: decoded messages from links, the world's ticks. Outputs: the airframe's demand, packets on
the links. Behaviour as measured on PX4 v1.17.0.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from sitl.conditions import Conditions
from sitl.links import Link, Router
from sitl.px4 import voice as say
from sitl.px4.builders import Sources
from sitl.px4.commander import Commander, Parts
from sitl.px4.commands import Command, Commands
from sitl.px4.control import PositionControl
from sitl.px4.flight import FlightTasks
from sitl.px4.inbox import Inbox, Receivers
from sitl.px4.modes import AUTO_MODES, Mode
from sitl.px4.navigation import Navigation
from sitl.px4.offboard import OffboardStream
from sitl.px4.parameter_server import ParameterServer
from sitl.px4.parameters import Parameters
from sitl.px4.services import AVAILABLE_MODES, autopilot_version, protocol_version
from sitl.px4.sticks import Sticks
from sitl.px4.streams import FIRST_PACKETS_US, IDS, Schedule
from sitl.px4.takeoff import TakeoffRamp
from sitl.px4.telemetry import Telemetry
from sitl.wire import layout
from sitl.world import TICK_S, World

_GPS_GLOBAL_ORIGIN_ID: Final = 49
_AUTOPILOT_VERSION_ID: Final = 148
_PROTOCOL_VERSION_ID: Final = 300
_COMPONENT_METADATA_ID: Final = 397
_AVAILABLE_MODES_ID: Final = 435
_RADIO_PERIOD_US: Final = 1_000_000
_DRIFT_RADPS: Final = 0.02
_SIMULATION_FIELDS: Final = {
    "SIM_BATT_DRAIN": "drain_factor",
    "SIM_BATT_PCT": "battery_percent",
    "SIM_GPS_HDOP": "hdop",
    "SIM_GPS_MODE": "gps_mode",
    "SIM_GPS_NOISE": "gps_noise_factor",
    "SIM_GPS_SATS": "satellites",
    "SIM_LINK_LOSS": "link_loss_percent",
    "SIM_LINK_NOISE": "radio_noise",
    "SIM_LINK_RSSI": "radio_rssi",
    "SIM_WIND_DIR": "wind_from_deg",
    "SIM_WIND_GUST": "gust_mps",
    "SIM_WIND_SPD": "wind_mps",
}


class Px4Manner:
    """PX4's behaviour over a world and its links."""

    def __init__(self, world: World, router: Router, *, parameters: Mapping[str, float]) -> None:
        """Boot now. `parameters` replace defaults, SIM_ parameters included."""
        self._world = world
        self._router = router
        self.parameters = Parameters(parameters)
        for name in parameters:
            self._apply_simulation(name)
        self.sticks = Sticks()
        generator = world.random
        self._drift_radps = math.copysign(_DRIFT_RADPS, generator.uniform(-1.0, 1.0))
        self._bias = (generator.gauss(0.0, 0.015), generator.gauss(0.0, 0.015))
        self._boot()

    def _boot(self) -> None:
        world, router = self._world, self._router
        self._boot_us = world.now_us
        self.navigation = Navigation(world, self._boot_us)
        self.voice = say.Voice(world, router, self._boot_us)
        self.stream = OffboardStream()
        self.control_loop = PositionControl(self.parameters, world.quad, self._drift_radps)
        self.tasks = FlightTasks(self.parameters, self.control_loop, world.quad, self._bias)
        self.ramp = TakeoffRamp(self.parameters)
        self.commander = Commander(
            Parts(
                world=world,
                parameters=self.parameters,
                navigation=self.navigation,
                stream=self.stream,
                sticks=self.sticks,
                tasks=self.tasks,
                ramp=self.ramp,
                voice=self.voice,
            )
        )
        self.telemetry = Telemetry(
            Sources(
                world=world,
                navigation=self.navigation,
                control=self.control_loop,
                commander=self.commander,
                parameters=self.parameters,
                sticks=self.sticks,
                voice=self.voice,
                boot_us=self._boot_us,
            )
        )
        self.commands = Commands(
            self, self.commander, self.tasks, self.navigation, self.parameters, self.voice
        )
        self._server = ParameterServer(self.parameters, self.set_parameter)
        self._inbox = Inbox(
            Receivers(
                world=world,
                boot_us=self._boot_us,
                commands=self.commands,
                stream=self.stream,
                sticks=self.sticks,
                server=self._server,
                voice=self.voice,
                send=self._send,
            )
        )
        self._schedules = [
            (link, Schedule(link.profile, self._boot_us)) for link in router.links.values()
        ]
        self._later: list[Callable[[], None]] = []
        self._fixes_sent = world.estimator.fix_number
        self._next_radio_us = self._boot_us + _RADIO_PERIOD_US
        self._spoken = False
        self._counters: dict[str, tuple[int, int, int]] = {}

    # What the machine around sees

    @property
    def running(self) -> bool:
        """Whether the links work: from 0.3 s after the start."""
        return self._world.now_us - self._boot_us >= FIRST_PACKETS_US

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""
        return self.commander.armed

    @property
    def mode_name(self) -> str:
        """PX4's word for the mode."""
        return self.commander.mode.label

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        return self.commander.landed_state

    def reboot(self) -> None:
        """Restart: time_boot_ms goes back, HOLD, disarmed; parameters and the world stay."""
        self._world.quad.demand.spinning = False
        self._boot()

    def forwards(self, link: Link) -> bool:
        """Whether a link forwards: MAV_0_FORWARD for ground stations, MAV_1_FORWARD onboard."""
        name = "MAV_0_FORWARD" if link.profile == "normal" else "MAV_1_FORWARD"
        return self.parameters.value(name) == 1

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and let it act; `KeyError`, `ValueError` when it is refused."""
        self.parameters.set(name, value)
        self.control_loop.refresh(self.parameters)
        self._apply_simulation(name)

    def _apply_simulation(self, name: str) -> None:
        field = _SIMULATION_FIELDS.get(name)
        if field is None:
            return
        conditions: Conditions = self._world.conditions
        value: float | None = self.parameters.value(name)
        if name == "SIM_LINK_RSSI" and value is not None and value < 0.0:
            value = None
        setattr(conditions, field, value)

    # Messages in

    def receive(self, link: str, message: Any) -> None:
        """Take one message; what is not for the autopilot is ignored."""
        self._inbox.take(link, message)

    # Answers

    def acknowledge(self, command: Command, result: int, *, later: bool = False) -> None:
        """Send a COMMAND_ACK to the sender, now or in the next tick."""
        payload = layout("COMMAND_ACK").payload(
            command=command.number,
            result=result,
            progress=0,
            result_param2=0,
            target_system=command.system,
            target_component=command.component,
        )
        if later:
            self._later.append(lambda: self._send(command.link, "COMMAND_ACK", payload))
        else:
            self._send(command.link, "COMMAND_ACK", payload)

    def set_interval(self, link: str, msgid: int, interval_us: int) -> bool:
        """Set a message interval on a link; False where PX4 fails."""
        return self._schedule(link).set(msgid, interval_us, self._world.now_us)

    def send_interval(self, link: str, msgid: int) -> None:
        """Send MESSAGE_INTERVAL."""
        interval_us = self._schedule(link).interval_us(msgid)
        payload = layout("MESSAGE_INTERVAL").payload(message_id=msgid, interval_us=interval_us)
        self._send(link, "MESSAGE_INTERVAL", payload)

    def send_message(self, link: str, msgid: int) -> bool:
        """Send a message once; False when there is no such data."""
        if msgid == _AVAILABLE_MODES_ID:
            for payload in AVAILABLE_MODES:
                self._send(link, "AVAILABLE_MODES", payload)
            return True
        name = IDS.get(msgid, "GPS_GLOBAL_ORIGIN" if msgid == _GPS_GLOBAL_ORIGIN_ID else "")
        special = {
            _AUTOPILOT_VERSION_ID: ("AUTOPILOT_VERSION", autopilot_version),
            _PROTOCOL_VERSION_ID: ("PROTOCOL_VERSION", protocol_version),
        }.get(msgid)
        if special is not None:
            self._send(link, special[0], special[1]())
            return True
        builder = self.telemetry.builders.get(name)
        made = builder() if builder is not None else None
        if name == "LINK_NODE_STATUS":
            made = self._link_status(self._router.links[link])
        if made is None:
            return False
        self._send(link, name, made)
        return True

    def _schedule(self, name: str) -> Schedule:
        return next(schedule for link, schedule in self._schedules if link.name == name)

    def _send(self, link: str, name: str, payload: bytes) -> None:
        self._router.links[link].send(layout(name), payload)

    # Flight

    def control(self) -> None:
        """Decide and write the airframe's demand; before the physics of each tick."""
        later, self._later = self._later, []
        for send in later:
            send()
        self.navigation.update()
        commander = self.commander
        commander.step()
        if not commander.armed:
            self.ramp.reset()
            self.control_loop.idle(spinning=False)
            return
        sticks = self.sticks if commander.sticks_present else None
        self.tasks.run(TICK_S, self.navigation, sticks, self.stream)
        if self._on_ground():
            self.control_loop.idle(spinning=True)
            return
        self.control_loop.run(TICK_S, self.navigation)

    def _on_ground(self) -> bool:
        """Whether the motors stay at idle: spool-up, no wish to climb, landed."""
        commander, target = self.commander, self.control_loop.target
        now_us, value = self._world.now_us, self.parameters.value
        spooled_up = (
            commander.took_off or now_us - commander.armed_us >= value("COM_SPOOLUP_TIME") * 1e6
        )
        if self.ramp.idle(
            now_us, landed=commander.landed, spooled_up=spooled_up, wants_up=self._wants_up()
        ):
            return True
        if self.ramp.active():
            full_mps = min(value("MPC_Z_VEL_MAX_UP"), target.up_limit)
            target.up_limit = self.ramp.up_limit_mps(now_us, full_mps)
        return False

    def _wants_up(self) -> bool:
        target, mode = self.control_loop.target, self.commander.mode
        if mode in AUTO_MODES and mode is not Mode.TAKEOFF:
            return False
        if math.isfinite(target.thrust):
            return target.thrust > self._world.options.airframe.hover_thrust
        if math.isfinite(target.z):
            return target.z < self.navigation.z - 0.2
        return math.isfinite(target.vz) and target.vz < -0.05

    # Telemetry out

    def emit(self) -> None:
        """Send what is due; after the physics of each tick."""
        world = self._world
        now_us = world.now_us
        self.telemetry.step(TICK_S)
        if not self.running:
            return
        if not self._spoken:
            self._first_words()
        builders, layouts = self.telemetry.builders, self.telemetry.layouts
        new_fix = world.estimator.fix_number != self._fixes_sent
        self._fixes_sent = world.estimator.fix_number
        made: dict[str, bytes | None] = {}
        for link, schedule in self._schedules:
            names = schedule.due(now_us)
            if new_fix and schedule.unlimited("GPS_RAW_INT"):
                names.append("GPS_RAW_INT")
            for name in names:
                if name in made:
                    payload = made[name]
                elif name == "LINK_NODE_STATUS":
                    link.send(layout(name), self._link_status(link))
                    continue
                elif name == "AUTOPILOT_VERSION":
                    link.send(layout(name), autopilot_version())
                    continue
                else:
                    builder = builders.get(name)
                    payload = made[name] = builder() if builder is not None else None
                if payload is not None:
                    link.send(layouts[name], payload)
            for payload in self._server.due(link.name):
                link.send(layout("PARAM_VALUE"), payload)
        if now_us >= self._next_radio_us:
            self._next_radio_us += _RADIO_PERIOD_US
            self._radio()

    def _first_words(self) -> None:
        self._spoken = True
        self.voice.muted = False
        self.voice.event(say.LOG_FILE, 0x66, bytes.fromhex("ea070b1416112c"))
        for link in self._router.links.values():
            origin = self.telemetry.builders["GPS_GLOBAL_ORIGIN"]()
            if origin is not None:
                link.send(layout("GPS_GLOBAL_ORIGIN"), origin)

    def _radio(self) -> None:
        conditions = self._world.conditions
        if conditions.radio_rssi is None:
            return
        remote = conditions.radio_remote_rssi
        payload = layout("RADIO_STATUS").payload(
            rssi=round(conditions.radio_rssi),
            remrssi=round(conditions.radio_rssi if remote is None else remote),
            txbuf=95,
            noise=round(conditions.radio_noise),
            remnoise=round(conditions.radio_noise),
            rxerrors=0,
            fixed=0,
        )
        for link in self._router.links.values():
            link.send_as_radio(layout("RADIO_STATUS"), payload)

    def _link_status(self, link: Link) -> bytes:
        sent_bytes, received_bytes, at_us = self._counters.get(link.name, (0, 0, self._boot_us))
        now_us = self._world.now_us
        elapsed_s = max(1e-2, (now_us - at_us) / 1e6)
        self._counters[link.name] = (link.sent_bytes, link.received_bytes, now_us)
        return layout("LINK_NODE_STATUS").payload(
            timestamp=now_us - self._boot_us,
            tx_buf=0,
            rx_buf=0,
            tx_rate=round((link.sent_bytes - sent_bytes) / elapsed_s),
            rx_rate=round((link.received_bytes - received_bytes) / elapsed_s),
            rx_parse_err=0,
            tx_overflows=0,
            rx_overflows=0,
            messages_sent=link.sent,
            messages_received=link.received,
            messages_lost=0,
        )
