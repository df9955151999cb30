"""The fake autopilot: one machine without I/O. Bytes and time in, bytes out.

    vehicle = FakeAutopilot(Options(latitude_deg=45.3781, longitude_deg=-71.9295))
    vehicle.receive("companion", packet)      # bytes that arrived on a link
    vehicle.step(now_s)                       # advance to now_s (seconds since the start, at 0)
    for link, data in vehicle.data_to_send():
        ...                                   # bytes to carry away

    vehicle.truth            # frozen: the true position, wind, battery, mode
    vehicle.conditions       # change the world in flight: vehicle.conditions.wind_mps = 8.0
    vehicle.move_sticks(roll=0.5)             # a pilot's remote control; no_sticks() turns it off
    vehicle.flip_switch(5)                    # its flight mode switch, positions 1 to 6 (ArduPilot)
    vehicle.parameter("COM_OF_LOSS_T"), vehicle.set_parameter("COM_OF_LOSS_T", 0.5)
    vehicle.jump(0.0, 1.2)   # the position estimate is reset, 1.2 m to the east
    vehicle.reboot()         # as if power-cycled: time_boot_ms goes back, disarmed

`Options.autopilot` chooses PX4 or ArduPilot. Links are named in `Options.links`; PX4 sends its
onboard set of messages to links of profile `onboard` and its normal set to those of profile
`normal` (a ground station); ArduPilot sends the messages requested on each.
Everything is deterministic: the same options, bytes and times give the same bytes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from sitl import sim_parameters
from sitl.battery import BatteryOptions
from sitl.conditions import Conditions
from sitl.links import DelayedPackets, Link, LinkOptions, Router
from sitl.manner import Manner
from sitl.manners import KINDS
from sitl.parameters import Firmware
from sitl.quadrotor import Airframe
from sitl.scenario import Scenario, ScenarioPlayer
from sitl.world import TICK_US, World, WorldOptions

DEFAULT_LINKS = (
    LinkOptions(name="companion", profile="onboard"),
    LinkOptions(name="gcs", profile="normal"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Start of a simulation. Home is the aircraft's place; the ground is flat there.

    autopilot: a name in `sitl.manners.KINDS`. firmware: the version that it reports, with that
    release's names and units of parameters; None means the one that was measured. airframe,
    battery: None means those of the autopilot's own simulation.
    """

    autopilot: str = "px4"
    firmware: Firmware | None = None
    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_amsl_m: float = 489.4
    yaw_deg: float = 0.0
    airframe: Airframe | None = None
    battery: BatteryOptions | None = None
    scenario: Scenario = field(default_factory=Scenario)
    seed: int = 1
    links: tuple[LinkOptions, ...] = DEFAULT_LINKS
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The true state.

    position_ned_m      (3,)  metres north, east, down of home, WGS84
    velocity_ned_mps    (3,)
    attitude_rad        (3,)  roll, pitch, yaw
    wind_ned_mps        (3,)  velocity of the air
    """

    time_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]
    attitude_rad: tuple[float, float, float]
    wind_ned_mps: tuple[float, float, float]
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    battery_fraction: float
    thrust: float
    armed: bool
    mode: str
    landed_state: int
    on_ground: bool


class FakeAutopilot:
    """A vehicle: physics, battery, sensors, manner and links in one step machine."""

    def __init__(self, options: Options | None = None) -> None:
        """Power on at time 0, disarmed on the ground at home."""
        options = options or Options()
        self.options = options
        kind = KINDS[options.autopilot]
        self._world = World(
            WorldOptions(
                latitude_deg=options.latitude_deg,
                longitude_deg=options.longitude_deg,
                altitude_amsl_m=options.altitude_amsl_m,
                yaw_deg=options.yaw_deg,
                airframe=options.airframe or kind.airframe,
                battery=options.battery or kind.battery,
                estimate_noise=kind.estimate_noise,
                seed=options.seed,
            )
        )
        self._player = ScenarioPlayer(options.scenario)
        self._links = {link.name: Link(link, link_id) for link_id, link in enumerate(options.links)}
        firmware = kind.firmware if options.firmware is None else options.firmware
        parameters = kind.parameters(options.parameters, firmware)
        for name in options.parameters:
            sim_parameters.apply(name, parameters, self._world.conditions)
        self._manner = kind.start(self._world, Router(list(self._links.values())), parameters)
        self._to_autopilot = DelayedPackets[tuple[str, bytes]]()

    @property
    def manner(self) -> Manner:
        """The autopilot's behaviour."""
        return self._manner

    @property
    def conditions(self) -> Conditions:
        """The world's conditions: read them or write them at any time."""
        return self._world.conditions

    @property
    def time_s(self) -> float:
        """Simulated time reached so far."""
        return self._world.now_s

    @property
    def truth(self) -> Truth:
        """A snapshot of the true state."""
        world, quad = self._world, self._world.quad
        place = world.frame.geodetic(quad.n, quad.e, quad.d)
        return Truth(
            time_s=world.now_s,
            position_ned_m=(quad.n, quad.e, quad.d),
            velocity_ned_mps=(quad.vn, quad.ve, quad.vd),
            attitude_rad=(quad.roll, quad.pitch, quad.true_yaw),
            wind_ned_mps=world.wind.ned_mps,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_amsl_m=place.altitude_amsl_m,
            battery_fraction=world.battery.fraction,
            thrust=quad.thrust,
            armed=self._manner.armed,
            mode=self._manner.mode_name,
            landed_state=self._manner.landed_state,
            on_ground=quad.on_ground,
        )

    def receive(self, link: str, data: bytes) -> None:
        """Take bytes that arrived on a link.

        They are handled in the next tick (10 ms), those of all links in the order of their arrival,
        and lost while the autopilot boots.
        """
        if link not in self._links:
            raise KeyError(link)
        if not data:
            return
        onboard = self._links[link].profile == "onboard"
        due_us = self._arrival_us() if onboard else self._world.now_us
        self._to_autopilot.send((link, data), due_us)

    def step(self, now_s: float) -> None:
        """Advance to `now_s` in ticks of 10 ms; earlier times do nothing."""
        end_us = math.floor(now_s * 1e6 + 0.5)
        world, manner = self._world, self._manner
        while world.now_us + TICK_US <= end_us:
            self._take_inbox()
            self._player.step(world)
            manner.control()
            world.tick(armed=manner.armed)
            manner.emit()

    def data_to_send(self) -> list[tuple[str, bytes]]:
        """Return and remove the bytes that wait, at most one entry per link."""
        loss = self._world.conditions.link_loss_percent / 100.0
        out = []
        for link in self._links.values():
            onboard = link.profile == "onboard"
            if link.out:
                link.loss_fraction = loss if onboard else 0.0
                packets = link.drain(self._world.random)
                if onboard:
                    for packet in packets:
                        link.from_autopilot.send(packet, self._arrival_us())
                else:
                    out.append((link.name, b"".join(packets)))
            if onboard and (packets := link.from_autopilot.arrived(self._world.now_us)):
                out.append((link.name, b"".join(packets)))
        return out

    def _arrival_us(self) -> float:
        """Arrival time of a packet that is sent now on an onboard link."""
        conditions = self._world.conditions
        delay_ms = conditions.link_delay_ms
        if conditions.link_jitter_ms > 0.0:
            delay_ms += self._world.random.uniform(0.0, conditions.link_jitter_ms)
        return self._world.now_us + 1e3 * delay_ms

    def move_sticks(
        self, *, roll: float = 0.0, pitch: float = 0.0, throttle: float = 0.0, yaw: float = 0.0
    ) -> None:
        """Switch on a remote control and hold its sticks there, each -1 to 1, 0 in the middle."""
        self._manner.sticks.hold(roll=roll, pitch=pitch, throttle=throttle, yaw=yaw)

    def flip_switch(self, position: int) -> None:
        """Turn the remote control's flight mode switch to a position, 1 to 6."""
        self._manner.sticks.flip(position)

    def no_sticks(self) -> None:
        """Switch the remote control off."""
        self._manner.sticks.release()

    def parameter(self, name: str) -> float:
        """Return a parameter's value; `KeyError` when there is none."""
        return self._manner.parameters.value(name)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter as PARAM_SET does; `KeyError`, `ValueError` when it is refused."""
        self._manner.set_parameter(name, value)

    def jump(self, north_m: float, east_m: float) -> None:
        """Reset the position estimate to another place; PX4's ODOMETRY counts it."""
        self._world.estimator.jump(north_m, east_m)

    def reboot(self) -> None:
        """Restart the autopilot's software; the aircraft stays where it is, motors off."""
        self._manner.reboot()

    def _take_inbox(self) -> None:
        arrived = self._to_autopilot.arrived(self._world.now_us)
        if not self._manner.running:
            return
        for name, data in arrived:
            link = self._links[name]
            if link.loss_fraction and self._world.random.random() < link.loss_fraction:
                continue
            for message in link.parse(data):
                self._manner.receive(name, message)
