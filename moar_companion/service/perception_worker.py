"""Process that turns packets of the sensor into reports, outside the control loop.

`python -m moar_companion.service.perception_worker DESCRIPTOR`: its setup comes as JSON on standard
input. Notes of poses arrive on the socket, and reports leave on it. The process ends when the
service closes its end.
"""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import sys
from typing import Any

from ..errors import LinkError
from ..mavlink.link import open_link
from ..mavlink.link_basics import clock_s
from ..mavlink.peers import Address
from ..mavlink.urls import parse_url
from ..perception.live_perception import LivePerception
from ..perception.perception_report import PerceptionReport
from ..perception.pose_notes import AttitudeNote, PointsNote, PoseNote, PositionNote
from .perception_process import MESSAGE_BYTES, Setup
from .recording.value_codec import decoded, encoded

_STEP_S = 0.01
_KINDS = {kind.__name__: kind for kind in (PositionNote, AttitudeNote, PointsNote)}

_logger = logging.getLogger(__name__)


def apply(perception: LivePerception, note: PoseNote) -> None:
    """Applies a note to the perception."""
    match note:
        case PositionNote():
            perception.note_position(note.time_s, note.position_m, note.jumped_m, note.offset_m)
        case AttitudeNote():
            perception.note_attitude(note.time_s, note.roll_rad, note.pitch_rad, note.yaw_rad)
        case PointsNote(time_s=time_s, points_m=points_m):
            perception.note_points(points_m, time_s)


class _Worker:
    def __init__(self, setup: Setup, channel: socket.socket) -> None:
        self._perception = LivePerception(setup.settings, setup.site, setup.description)
        self._setup = setup
        self._channel = channel
        self._solids: list[Any] | None = None
        """Solids of the last report, as sent; they seldom change."""
        self._has_dropped = False
        self._ended = asyncio.Event()

    async def run(self) -> None:
        settings, loop = self._setup.settings, asyncio.get_running_loop()
        loop.add_reader(self._channel, self._readable)
        if settings.data_port is None:
            await self._step_loop()
            return
        address = parse_url(f"udpin:{settings.address}:{settings.data_port}")
        async with open_link(address, self._received):
            await self._step_loop()

    async def _step_loop(self) -> None:
        while not self._ended.is_set():
            report = self._perception.step(self._now_s())
            if report is not None:
                self._send(report)
            await asyncio.sleep(_STEP_S)

    def _now_s(self) -> float:
        return clock_s() * self._setup.speed

    def _received(self, data: bytes, arrived_s: float, _address: Address | None) -> None:
        self._perception.receive(data, arrived_s * self._setup.speed)

    def _readable(self) -> None:
        message = self._channel.recv(MESSAGE_BYTES)
        if not message:
            self._ended.set()
            return
        for name, data in json.loads(message):
            apply(self._perception, decoded(_KINDS[name], data))

    def _send(self, report: PerceptionReport) -> None:
        data = encoded(report)
        solids = data.pop("solids")
        if solids != self._solids:
            data["solids"] = solids
        message = json.dumps(data).encode()
        if len(message) > MESSAGE_BYTES:
            _logger.error("a report of %d bytes is too long to be sent", len(message))
            return
        try:
            self._channel.send(message)
            self._solids = solids
        except BlockingIOError:
            pass  # the service is behind: the next report has everything, too
        except BrokenPipeError:
            self._ended.set()
        except OSError as error:  # the kernel has no room for this one
            level = logging.DEBUG if self._has_dropped else logging.ERROR
            self._has_dropped = True
            _logger.log(level, "report of %d bytes dropped: %s", len(message), error.strerror)


def main(arguments: list[str]) -> int:
    """Runs until the service ends; returns the exit status."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    setup: Setup = decoded(Setup, json.load(sys.stdin))
    channel = socket.socket(fileno=int(arguments[0]))
    channel.setblocking(False)
    try:
        asyncio.run(_Worker(setup, channel).run())
    except LinkError as error:
        _logger.error("%s", error)  # noqa: TRY400 - one line, no traceback
        return 1
    except Exception as error:  # noqa: BLE001 - the service starts it again
        _logger.error("%s: %s", type(error).__name__, error)  # noqa: TRY400
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
