"""The operator of a lockstep flight: a ground station (255/190) with raw MAVLink."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import FakeAutopilot
from sitl.wire import packet_header, packets

MAV_CMD_USER_1 = 31010
MAV_CMD_DO_PAUSE_CONTINUE = 193
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
INSPECTION, EXIT, EVACUATION, RELEASE, MISSION_HOLD = 1, 2, 3, 4, 0


READ = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
}
"""Messages that an operator reads; an autopilot sends a hundred times as many."""


class Manner(enum.Enum):
    """Kind of autopilot. modes: parameters of DO_SET_MODE after base_mode, name in the truth."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"

    @property
    def modes(self):
        return _MODES[self]


_MODES = {
    Manner.PX4: {
        "ours": ((6, 0), "OFFBOARD"),
        "hold": ((4, 3), "AUTO.LOITER"),
        "position": ((3, 0), "POSCTL"),
        "return": ((4, 5), "AUTO.RTL"),
        "land": ((4, 6), "AUTO.LAND"),
    },
    Manner.ARDUPILOT: {
        "ours": ((4,), "GUIDED"),
        "hold": ((5,), "LOITER"),
        "position": ((16,), "POSHOLD"),
        "return": ((6,), "RTL"),
        "land": ((9,), "LAND"),
    },
}


@dataclass
class Operator:
    """A ground station on the autopilot's other link: packets sent, received and read."""

    autopilot: FakeAutopilot
    manner: Manner
    received: list[mavlink.MAVLink_message] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._codec.robust_parsing = True
        self._heartbeat_due_s = 0.0
        self._fence: list[tuple[int, float, float, float]] = []
        self.silent = False
        """No heartbeats are sent."""

    def sign(self, secret: bytes) -> None:
        """Sign all packets from now on, and read signed packets only."""
        self._codec.signing.secret_key = secret
        self._codec.signing.link_id = 200
        self._codec.signing.sign_outgoing = True

    def tick(self, now_s: float) -> None:
        if now_s >= self._heartbeat_due_s and not self.silent:
            self._heartbeat_due_s = now_s + 1.0
            self.send(self._codec.heartbeat_encode(6, 8, 0, 0, 4))

    def receive(self, data: bytes) -> None:
        for packet in packets(data):
            if packet_header(packet)[0] in READ:
                received = self._codec.parse_buffer(packet) or []
                self.received += received
                for message in received:
                    if message.get_type() == "MISSION_REQUEST_INT":
                        self._send_item(message.seq)

    def send(self, message: mavlink.MAVLink_message) -> None:
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self.autopilot.receive("gcs", data)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter as a real number; PX4 reports the change only to the sender."""
        self.send(self._codec.param_set_encode(1, 1, name.encode(), value, 9))

    def upload_fence(self, items: list[tuple[int, float, float, float]]) -> None:
        """Items: command, param1, latitude and longitude in degrees."""
        self._fence = items
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 1))

    def _send_item(self, seq: int) -> None:
        command, value, latitude_deg, longitude_deg = self._fence[seq]
        place = round(latitude_deg * 1e7), round(longitude_deg * 1e7), 0.0
        self.send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, seq, 0, command, 0, 1, value, 0.0, 0.0, 0.0, *place, 1
            )
        )

    def command(self, command: int, *parameters: float, component: int = 1) -> None:
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        self.send(self._codec.command_long_encode(1, component, command, 0, *padded))

    def arm(self) -> None:
        self.command(400, 1)

    def take_off(self, height_m: float) -> None:
        """PX4 takes an altitude above the sea, ArduPilot a height above home."""
        if self.manner is Manner.PX4:
            altitude = self.autopilot.options.altitude_amsl_m + height_m
            self.command(22, 0, 0, 0, math.nan, math.nan, math.nan, altitude)
        else:
            self.command(22, 0, 0, 0, 0, 0, 0, height_m)

    def mode(self, word: str) -> None:
        self.command(176, 1, *self.manner.modes[word][0])

    def in_mode(self, word: str) -> bool:
        """True if the autopilot really is in a mode."""
        return self.autopilot.truth.mode == self.manner.modes[word][1]

    def mission(self, mission: int, index: float = -1) -> None:
        self.command(MAV_CMD_USER_1, mission, index, component=195)

    def pause(self) -> None:
        self.command(MAV_CMD_DO_PAUSE_CONTINUE, 0, component=195)

    def go_on(self) -> None:
        self.command(MAV_CMD_DO_PAUSE_CONTINUE, 1, component=195)

    def answers(self, command: int = MAV_CMD_USER_1) -> list[int]:
        return [
            message.result
            for message in self.received
            if message.get_type() == "COMMAND_ACK" and message.command == command
        ]

    def texts(self) -> list[str]:
        """Whole texts: chunks of 50 characters are put together."""
        texts: list[str] = []
        for message in self.received:
            if message.get_type() == "STATUSTEXT":
                if message.id and message.chunk_seq:
                    texts[-1] += message.text
                else:
                    texts.append(message.text)
        return texts

    def has_received(self, words: str) -> bool:
        return any(words in text for text in self.texts())
