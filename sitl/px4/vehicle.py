"""The PX4 vehicle: its parts put together, messages in, telemetry out.

Inputs: decoded messages from links, the world's ticks. Outputs: the airframe's demand, packets on
the links. Behaviour as measured on PX4 v1.17.0.
"""

import math
from collections.abc import Callable
from typing import Any, Final

from sitl import sim_parameters
from sitl.commands import ACCEPTED, DENIED, FAILED, Command, acknowledgement
from sitl.control import PositionControl
from sitl.fence_areas import FenceAreas
from sitl.links import Link, Router
from sitl.parameter_server import ParameterServer
from sitl.parameters import Parameters
from sitl.px4 import texts
from sitl.px4.builders import Sources
from sitl.px4.commander import Commander, Parts
from sitl.px4.commands import Commands
from sitl.px4.fence import Geofence
from sitl.px4.flight import FlightTasks
from sitl.px4.forwarding import forward
from sitl.px4.gains import gains
from sitl.px4.inbox import Inbox, Receivers
from sitl.px4.modes import AUTO_MODES, Mode
from sitl.px4.navigation import Navigation
from sitl.px4.offboard import OffboardStream
from sitl.px4.services import AVAILABLE_MODES, autopilot_version, protocol_version
from sitl.px4.streams import FIRST_PACKETS_US, IDS, Schedule
from sitl.px4.takeoff import TakeoffRamp
from sitl.px4.telemetry import Telemetry
from sitl.radio import Radio
from sitl.sticks import Sticks
from sitl.wire import layout
from sitl.world import TICK_S, World

_GPS_GLOBAL_ORIGIN_ID: Final = 49
_AUTOPILOT_VERSION_ID: Final = 148
_PROTOCOL_VERSION_ID: Final = 300
_AVAILABLE_MODES_ID: Final = 435
_DRIFT_RADPS: Final = 0.02
_STATUS_US: Final = 500_000


class Px4Manner:
    """PX4's behaviour over a world and its links."""

    def __init__(self, world: World, router: Router, parameters: Parameters) -> None:
        """Boot now."""
        self._world = world
        self._router = router
        self.parameters = parameters
        self.sticks = Sticks()
        self.areas = FenceAreas()
        generator = world.random
        self._drift_radps = math.copysign(_DRIFT_RADPS, generator.uniform(-1.0, 1.0))
        self._bias = (generator.gauss(0.0, 0.015), generator.gauss(0.0, 0.015))
        self._boot()

    def _boot(self) -> None:
        world, router = self._world, self._router
        self._boot_us = world.now_us
        self.navigation = Navigation(world, self._boot_us)
        self.text_sender = texts.TextSender(world, router, self._boot_us)
        self.stream = OffboardStream()
        self.control_loop = PositionControl(gains(self.parameters), world.quad, self._drift_radps)
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
                fence=Geofence(self.parameters, self.navigation, self.areas),
                text_sender=self.text_sender,
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
                text_sender=self.text_sender,
                boot_us=self._boot_us,
            )
        )
        self.commands = Commands(
            self, self.commander, self.tasks, self.navigation, self.text_sender
        )
        self._server = ParameterServer(self.parameters, self.set_parameter)
        self._inbox = Inbox(
            Receivers(
                world=world,
                boot_us=self._boot_us,
                commander=self.commander,
                commands=self.commands,
                stream=self.stream,
                sticks=self.sticks,
                server=self._server,
                areas=self.areas,
                text_sender=self.text_sender,
                send=self._send,
            )
        )
        self._schedules = [
            (link, Schedule(link.profile, self._boot_us)) for link in router.links.values()
        ]
        self._later: list[Callable[[], None]] = []
        self._fixes_sent = world.estimator.fix_number
        self._status: tuple[Mode, Mode, bool] | None = None
        self._status_us = 0
        self._status_sent_us: dict[str, int] = {}
        self._radio = Radio(world, router)
        self._announced = False
        self._counters: dict[str, tuple[int, int, int]] = {}

    # Interface for the machine

    @property
    def running(self) -> bool:
        """True when the links work: from 0.3 s after the start."""
        return self._world.now_us - self._boot_us >= FIRST_PACKETS_US

    @property
    def armed(self) -> bool:
        """True when the motors may turn."""
        return self.commander.armed

    @property
    def mode_name(self) -> str:
        """PX4's name of the mode."""
        return self.commander.mode.label

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        return self.commander.landed_state

    def reboot(self) -> None:
        """Restart: time_boot_ms restarts, HOLD, disarmed; parameters and the world stay."""
        self._world.quad.demand.spinning = False
        self._boot()

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and let it act; `KeyError`, `ValueError` when it is refused."""
        self.parameters.set(name, value)
        self.control_loop.gains = gains(self.parameters)
        sim_parameters.apply(name, self.parameters, self._world.conditions)

    # Messages in

    def receive(self, link: str, message: Any) -> None:
        """Forward a message, and take it if it is for the autopilot."""
        forward(self._router, self._router.links[link], message, self._forwards)
        self._inbox.take(link, message)

    def _forwards(self, link: Link) -> bool:
        """Return MAV_0_FORWARD for ground stations, MAV_1_FORWARD onboard."""
        name = "MAV_0_FORWARD" if link.profile == "normal" else "MAV_1_FORWARD"
        return self.parameters.value(name) == 1

    # Answers

    def acknowledge(self, command: Command, result: int) -> None:
        """Send a COMMAND_ACK to the sender."""
        self._send(command.link, "COMMAND_ACK", acknowledgement(command, result))

    def acknowledge_later(self, command: Command, result: int) -> None:
        """Send a COMMAND_ACK to the sender in the next tick."""
        self._later.append(lambda: self.acknowledge(command, result))

    def set_interval(self, link: str, msgid: int, interval_us: int) -> int:
        """Set a message interval on a link; returns the result."""
        done = self._schedule(link).set(msgid, interval_us, self._world.now_us)
        return ACCEPTED if done else FAILED

    def send_interval(self, link: str, msgid: int) -> int:
        """Send MESSAGE_INTERVAL; returns the result."""
        interval_us = self._schedule(link).interval_us(msgid)
        payload = layout("MESSAGE_INTERVAL").payload(message_id=msgid, interval_us=interval_us)
        self._send(link, "MESSAGE_INTERVAL", payload)
        return ACCEPTED

    def send_message(self, link: str, msgid: int) -> int:
        """Send a message once; returns the result, DENIED when there is no such data."""
        if msgid == _AVAILABLE_MODES_ID:
            for payload in AVAILABLE_MODES:
                self._send(link, "AVAILABLE_MODES", payload)
            return ACCEPTED
        name = IDS.get(msgid, "GPS_GLOBAL_ORIGIN" if msgid == _GPS_GLOBAL_ORIGIN_ID else "")
        special = {
            _AUTOPILOT_VERSION_ID: ("AUTOPILOT_VERSION", self._version()),
            _PROTOCOL_VERSION_ID: ("PROTOCOL_VERSION", protocol_version()),
        }.get(msgid)
        if special is not None:
            self._send(link, *special)
            return ACCEPTED
        builder = self.telemetry.builders.get(name)
        made = builder() if builder is not None else None
        if name == "LINK_NODE_STATUS":
            made = self._link_status(self._router.links[link])
        if made is None:
            return DENIED
        self._send(link, name, made)
        return ACCEPTED

    def restart(self) -> None:
        """Restart as commanded."""
        self.reboot()

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
        """Return True if the motors stay at idle: spool-up, no demand to climb, landed."""
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
        if not self._announced:
            self._first_words()
        builders, layouts = self.telemetry.builders, self.telemetry.layouts
        new_fix = world.estimator.fix_number != self._fixes_sent
        self._fixes_sent = world.estimator.fix_number
        self._publish_status(now_us)
        made: dict[str, bytes | None] = {}
        for link, schedule in self._schedules:
            rate = world.conditions.link_rate_bytes_per_s if link.profile == "onboard" else None
            names = schedule.due(now_us, rate)
            if new_fix and schedule.unlimited("GPS_RAW_INT"):
                names.append("GPS_RAW_INT")
            for name in names:
                if name == "CURRENT_MODE" and not self._has_new_status(link.name):
                    continue
                if name in made:
                    payload = made[name]
                elif name == "LINK_NODE_STATUS":
                    link.send(layout(name), self._link_status(link))
                    continue
                elif name == "AUTOPILOT_VERSION":
                    link.send(layout(name), self._version())
                    continue
                else:
                    builder = builders.get(name)
                    payload = made[name] = builder() if builder is not None else None
                if payload is not None:
                    link.send(layouts[name], payload)
                    schedule.sent(layouts[name])
            for payload in self._server.due(link.name):
                link.send(layout("PARAM_VALUE"), payload)
        self._radio.step()

    def _publish_status(self, now_us: int) -> None:
        """Publish `vehicle_status` twice a second, and when it changes."""
        commander = self.commander
        status = (commander.mode, commander.intended, commander.armed)
        if status != self._status or now_us >= self._status_us + _STATUS_US:
            self._status, self._status_us = status, now_us

    def _has_new_status(self, link: str) -> bool:
        """Return True once for each link and published status."""
        before, self._status_sent_us[link] = self._status_sent_us.get(link), self._status_us
        return before != self._status_us

    def _version(self) -> bytes:
        return autopilot_version(self.parameters.firmware)

    def _first_words(self) -> None:
        self._announced = True
        self.text_sender.muted = False
        self.text_sender.event(texts.LOG_FILE, 0x66, bytes.fromhex("ea070b1416112c"))
        for link in self._router.links.values():
            origin = self.telemetry.builders["GPS_GLOBAL_ORIGIN"]()
            if origin is not None:
                link.send(layout("GPS_GLOBAL_ORIGIN"), origin)

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
