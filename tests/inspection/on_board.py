"""Camera and gimbal clients beside the simulated payload, byte by byte, in lockstep time."""

from __future__ import annotations

from types import SimpleNamespace

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.camera import CameraClient
from moar_companion.mavlink.gimbal import GimbalClient
from sitl.geodesy import Geodetic
from sitl.payload import Payload, PayloadOptions
from sitl.picture import PictureScene

OURS, AUTOPILOT = (1, 195), ("udp:x", (1, 1))
SCENE = PictureScene(
    name="one wire",
    origin=Geodetic(latitude_deg=45.0, longitude_deg=-71.0, altitude_amsl_m=200.0),
    azimuth_deg=90.0,
    wires=((6.0, 0.0, 0.03),),
    points={"splice": (6.0, 0.0)},
)


class OnBoard:
    """Both clients and the payload; sent: what the clients sent. mute: messages that are lost."""

    def __init__(self, **options):
        self.camera, self.gimbal = CameraClient(), GimbalClient()
        self.payload = Payload(PayloadOptions(scene=SCENE, **options))
        self.now_s = 0.0
        self.sent = []
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
        self._parser = mavlink.MAVLink(None)
        self.autopilot_answers = {}
        """Result by command, or by command and first parameter, and messages that follow it."""
        self.images = []
        self.follows_s, self.follow = 0.0, []
        """Time in which the autopilot's messages follow its answer, and those still to come."""

    def want(self):
        self.camera.want(self.now_s)
        self.gimbal.want(self.now_s)

    def run(self, seconds):
        for _ in range(round(seconds / 0.02)):
            self.step()

    def step(self):
        self.now_s += 0.02
        truth = SimpleNamespace(
            time_s=self.now_s,
            latitude_deg=45.0,
            longitude_deg=-71.0,
            altitude_amsl_m=200.0,
            attitude_rad=(0.0, 0.0, 1.5),
            velocity_ned_mps=(0.0, 0.0, 0.0),
        )
        for data in self.payload.step(truth):
            for message in self._parser.parse_buffer(bytearray(data)) or []:
                self.hear(message)
        while self.follow and self.follow[0][0] <= self.now_s:
            self.from_autopilot(self.follow.pop(0)[1])
        due = (
            *self.camera.due(AUTOPILOT, self.now_s),
            *self.gimbal.due(AUTOPILOT, OURS, self.now_s),
        )
        for _, message in due:
            self.sent.append(message)
            packet = message.pack(self._codec)
            self.payload.receive(packet)
            if message.target_component == 1:
                self._answer(message)
        self.images += self.camera.take_images()

    def hear(self, message):
        self.camera.handle(message, "udp:x", OURS, self.now_s)
        self.gimbal.handle(message, "udp:x", OURS, self.now_s)

    def from_autopilot(self, message):
        message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
        self.hear(message)

    def _answer(self, command):
        asked = (command.command, command.param1)
        known = self.autopilot_answers.get(asked) or self.autopilot_answers.get(command.command)
        if known is None:
            return
        result, *messages = known
        if self.follows_s:
            self.follow += [(self.now_s + self.follows_s, message) for message in messages]
            messages = []
        ack = mavlink.MAVLink_command_ack_message(command.command, result, 0, 0, *OURS)
        for message in (ack, *messages):
            self.from_autopilot(message)

    def commands(self, number):
        return [message for message in self.sent if message.command == number]
