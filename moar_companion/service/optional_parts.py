"""Parts of the service that only some configurations have.

Each is imported where it is configured, so that no other service pays for it in start time and
memory.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..companion.companion import Companion
from ..config import CompanionConfig
from ..errors import InputError
from ..site import Site
from .directories import recorder_folder, state_folder

if TYPE_CHECKING:
    from ..mavlink.signing import Signing
    from .cycle_recorder import CycleRecorder
    from .mqtt_publisher import MqttPublisher
    from .perception_process import PerceptionProcess
    from .signing_clock import SigningClock
    from .snapshot_file import SnapshotFile

_logger = logging.getLogger(__name__)


def open_memory(config: CompanionConfig, stack: contextlib.ExitStack) -> SnapshotFile | None:
    """Opens the file of the mission snapshot until the stack ends; None without a directory.

    Raises InputError for a directory that cannot be written.
    """
    folder = state_folder(config)
    if folder is None:
        return None
    from .snapshot_file import SnapshotFile

    try:
        memory = SnapshotFile(folder.path)
    except OSError as error:
        raise folder.unwritable(error) from error
    stack.callback(memory.close)
    return memory


def open_signing(
    config: CompanionConfig, wall_s: float, stack: contextlib.ExitStack
) -> tuple[Signing | None, SigningClock | None]:
    """Returns the signing of the links, and the file that keeps its time stamps.

    None, None without a signed link. Raises InputError if there is no usable key.
    """
    if not any(link.signed for link in config.links):
        return None, None
    from .signing_clock import SigningClock, load_signing

    signing, folder = load_signing(config, wall_s), state_folder(config)
    if folder is None:
        _logger.warning("signed links without a state directory: time stamps are not kept")
        return signing, None
    clock = SigningClock(folder.path)
    stack.callback(clock.close)
    return signing, clock


def companion_class(config: CompanionConfig) -> type[Companion]:
    """Class of the machine: one that logs its calls if flights are recorded."""
    if recorder_folder(config) is None:
        return Companion
    from ..recording.calls import RecordedCompanion

    return RecordedCompanion


def open_recorder(
    config: CompanionConfig,
    companion: Companion,
    status: Callable[[], dict[str, Any]],
    *,
    clock_offset_s: float,
    now_s: float,
    stack: contextlib.AsyncExitStack,
) -> CycleRecorder | None:
    """Opens the recording until the stack ends; None if flights are not recorded.

    Arguments as of CycleRecorder. Raises InputError for a folder that cannot be written.
    """
    folder = recorder_folder(config)
    if folder is None:
        return None
    from .cycle_recorder import CycleRecorder

    try:
        recorder = CycleRecorder(
            folder.path,
            config.recorder,
            companion,
            status,
            clock_offset_s=clock_offset_s,
            now_s=now_s,
        )
    except OSError as error:
        raise folder.unwritable(error) from error
    stack.callback(recorder.close)
    return recorder


def open_perception(
    config: CompanionConfig, site: Site | None, speed: float
) -> PerceptionProcess | None:
    """Starts the perception process of the configured sensor; None without a sensor.

    Raises InputError without a site, and the errors of PerceptionProcess.
    """
    if config.perception.sensor is None:
        return None
    from .perception_process import PerceptionProcess

    source = str(config.file or "the configuration")
    if site is None:
        raise InputError(source, "perception.sensor", "needs a site file: `site`, or --site")
    return PerceptionProcess(config.perception, site, source=source, speed=speed)


def open_mqtt(config: CompanionConfig, stack: contextlib.AsyncExitStack) -> MqttPublisher | None:
    """Opens the connection to the MQTT broker until the stack ends; None without a broker."""
    if config.mqtt.url is None:
        return None
    from .mqtt_publisher import open_publisher

    publisher = open_publisher(config)
    if publisher is not None:
        stack.callback(publisher.close)
    return publisher
