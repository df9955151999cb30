"""Client of the perception process: starts it, sends it notes, and takes its reports.

The control loop never waits for the process: notes that the process does not take in time are
dropped. Without reports the supervisor holds the flight.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import socket
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError, LinkError, without_extra
from ..mavlink.link_basics import reason
from ..perception.perception_report import PerceptionReport
from ..perception.pose_notes import PoseNote
from ..planner.site import Polygon, Site
from ..settings.input_file import open_file, unreadable
from ..settings.perception_config import Perception, Sensor
from .child_process import ChildProcess
from .recording.value_codec import decoded, encoded

_DESCRIPTION = "perception.metadata must be the sensor's own description, a JSON file"
_DECODERS = {Sensor.VELODYNE: ("velodyne_decoder", "lidar"), Sensor.OUSTER: ("ouster", "ouster")}
"""Module of each sensor's decoder, and the extra that installs it."""
_WORKER = f"{__package__}.perception_worker"
"""Module of the process; the service does not need its imports."""
MESSAGE_BYTES = 180_000
"""Longest message: the kernel's send buffer has 208 kB."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Input of the process at its start. description: content of the metadata file."""

    settings: Perception
    site: Site
    description: str = ""
    speed: float = 1.0


class PerceptionProcess:
    """The perception process. source: of the settings, for errors.

    Raises InputError for settings that cannot be used, LinkError for a port that cannot be opened.
    """

    def __init__(
        self, settings: Perception, site: Site, *, source: str = "", speed: float = 1.0
    ) -> None:
        description = tried(settings, source)
        setup = Setup(settings=settings, site=site, description=description, speed=speed)
        # The socket end of the process stays open here, too: a restart loses no notes and no
        # reports.
        self._channel, self._other_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.setblocking(False)
        self._solids: tuple[Polygon, ...] = ()
        """Solids of the last report; a report with the same solids omits them."""
        self._process = ChildProcess(
            "perception",
            _WORKER,
            [self._other_end.fileno()],
            json.dumps(encoded(setup)).encode(),
        )

    @property
    def process_id(self) -> int | None:
        """Process id; None while no process runs."""
        return self._process.process_id

    def send(self, notes: list[PoseNote]) -> None:
        """Sends notes; drops them while the process is behind."""
        if not notes:
            return
        try:
            self._channel.send(
                json.dumps([[type(note).__name__, encoded(note)] for note in notes]).encode()
            )
        except OSError as error:
            _logger.debug("notes dropped: %s", error)

    def reports(self) -> Iterator[PerceptionReport]:
        """Yields the reports since the last call."""
        while True:
            try:
                message = self._channel.recv(MESSAGE_BYTES)
            except BlockingIOError:
                return
            data = json.loads(message)
            same = "solids" not in data
            report: PerceptionReport = decoded(PerceptionReport, data)
            if same:
                report = replace(report, solids=self._solids)
            self._solids = report.solids
            yield report

    def close(self) -> None:
        """Ends the process."""
        self._process.close(self._other_end, self._channel)


def tried(settings: Perception, source: str, *, port: bool = True) -> str:
    """Checks the settings; returns the content of the sensor's metadata file, empty without one.

    port: False leaves out the port, which a running service has open.

    Raises InputError for a file that cannot be used, or where the sensor's decoder is missing;
    LinkError for a port that cannot be opened.
    """
    description = "" if settings.metadata is None else _read_json(settings.metadata)
    if settings.sensor in _DECODERS:
        module, extra = _DECODERS[settings.sensor]
        if importlib.util.find_spec(module) is None:
            raise without_extra(source, "perception.sensor", module, extra)
    if port:
        _try_port(settings)
    return description


def _read_json(file: Path) -> str:
    try:
        with open_file(file) as stream:
            text = stream.read().decode()
        json.loads(text)
    except OSError as error:
        raise InputError(str(file), "", f"{unreadable(error)}; {_DESCRIPTION}") from error
    except ValueError as error:
        raise InputError(str(file), "", f"is no JSON; {_DESCRIPTION}") from error
    return text


def _try_port(settings: Perception) -> None:
    """Raises LinkError if the process cannot receive the sensor's packets."""
    if settings.data_port is None:
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        try:
            trial.bind((settings.address, settings.data_port))
        except OSError as error:
            place = f"{settings.address}:{settings.data_port}"
            raise LinkError(f"perception on udpin:{place}: {reason(error)}") from error
