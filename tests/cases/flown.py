"""Small flights as packets, made by pymavlink, and what a replay makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as m

from moar_companion.analysis.replay.player import Player
from moar_companion.analysis.replay.replay_report import Replay
from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle

VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
PX4, ARDUPILOT = m.MAV_AUTOPILOT_PX4, m.MAV_AUTOPILOT_ARDUPILOTMEGA
AUTOPILOT = (1, 1)
GROUND_STATION = (255, 190)
BOOT_MS = 10_000
"""The autopilot's clock at the start."""
_PLACE = (453781000, -719295000, 220000)
_MODES = {PX4: (3 << 24) | (4 << 16), ARDUPILOT: 5}
"""HOLD, LOITER."""

Message = Any


class Packets:
    """Packets of several senders, each numbered in order, with their times."""

    def __init__(self, *, mavlink1: bool = False) -> None:
        self.packets: list[tuple[float, bytes]] = []
        self._mavlink1 = mavlink1
        self._senders: dict[tuple[int, int], Any] = {}

    def put(
        self, time_s: float, *messages: Message, by: tuple[int, int] = AUTOPILOT, copies: int = 1
    ) -> None:
        """Adds messages of one sender; 0 copies: the packets are sent, and lost."""
        sender = self._senders.setdefault(by, m.MAVLink(None, *by))
        for message in messages:
            packet = bytes(message.pack(sender, force_mavlink1=self._mavlink1))
            sender.seq = (sender.seq + 1) % 256
            self.packets += [(time_s, packet)] * copies

    def played(self, vehicle: Vehicle = VEHICLE) -> tuple[Replay, PassiveListener]:
        """The replay of these packets, and the listener after it."""
        listener = PassiveListener()
        player = Player(vehicle, listener)
        for time_s, packet in self.packets:
            player.feed(time_s, packet)
        return player.finish("packets"), listener


def boot_ms(time_s: float) -> int:
    return BOOT_MS + round(time_s * 1000)


def heartbeat(autopilot: int = PX4, kind: int = m.MAV_TYPE_QUADROTOR) -> Message:
    return m.MAVLink_heartbeat_message(kind, autopilot, 0x81, _MODES.get(autopilot, 0), 4, 3)


def gps(time_s: float, fix_type: int = 3) -> Message:
    usec = boot_ms(time_s) * 1000
    return m.MAVLink_gps_raw_int_message(
        usec, fix_type, *_PLACE, 80, 120, 0, 0, 14, 0, 800, 1200, 0, 0, 0
    )


def sys_status(remaining_percent: int = 80) -> Message:
    everything = 0x3FFFFFF
    return m.MAVLink_sys_status_message(
        everything, everything, everything, 100, 15600, 1200, remaining_percent, *(0,) * 6
    )


def motion(time_s: float) -> list[Message]:
    """Attitude and position of an aircraft that hovers."""
    ms = boot_ms(time_s)
    return [
        m.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0),
        m.MAVLink_local_position_ned_message(ms, 0, 0, -20, 0, 0, 0),
        m.MAVLink_global_position_int_message(ms, *_PLACE, 20000, 0, 0, 0, 0),
    ]


def hover(
    *,
    duration_s: float,
    autopilot: int = PX4,
    rate_hz: int = 10,
    unread: int = 0,
    copies: Callable[[float], int] = lambda _: 1,
    first: Callable[[float], Iterable[Message]] = lambda t: (gps(t), sys_status()),
    also: Callable[[Packets, float], None] = lambda _packets, _t: None,
    mavlink1: bool = False,
) -> Packets:
    """A hover: motion at a rate, and once a second the heartbeat and `first`.

    unread: messages beside each motion that the companion does not read. copies: of each packet,
    by the time. also: adds more once a second.
    """
    packets = Packets(mavlink1=mavlink1)
    for step in range(round(duration_s * rate_hz)):
        time_s = step / rate_hz
        here = copies(time_s)
        if step % rate_hz == 0:
            landed = m.MAVLink_extended_sys_state_message(0, 2)
            packets.put(time_s, heartbeat(autopilot), landed, *first(time_s), copies=here)
            also(packets, time_s)
        vibration = m.MAVLink_vibration_message(boot_ms(time_s) * 1000, *(0,) * 6)
        packets.put(time_s, *motion(time_s), *[vibration] * unread, copies=here)
    return packets
