"""Optional parts of the service: each is imported and opened where it is asked for, at the start.

The configuration or systemd's directories ask for them (`directories`); the others cost neither
start time nor memory.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..companion.companion import Companion
from ..errors import InputError
from ..planner.site import Site
from ..settings.config import CompanionConfig
from .directories import recorder_folder, state_folder, view_socket

if TYPE_CHECKING:
    from ..mavlink.signing import Signing
    from ..settings.vehicle import Vehicle
    from .cycle_recorder import CycleRecorder
    from .mqtt_publisher import MqttPublisher
    from .page_process import PageProcess
    from .perception_process import PerceptionProcess
    from .signing_clock import SigningClock
    from .snapshot_file import SnapshotFile
    from .stored_parameters import ParameterFile, StartSettings

_logger = logging.getLogger(__name__)


def open_snapshot(config: CompanionConfig, stack: contextlib.ExitStack) -> SnapshotFile | None:
    """Opens the file of the mission snapshot until the stack ends; None without a directory.

    Raises InputError for a directory that cannot be written.
    """
    folder = state_folder(config)
    if folder is None:
        return None
    from .snapshot_file import SnapshotFile

    try:
        snapshot = SnapshotFile(folder.path)
    except OSError as error:
        raise folder.unwritable(error) from error
    stack.callback(snapshot.close)
    return snapshot


def open_parameters(
    config: CompanionConfig, settings: StartSettings, stack: contextlib.ExitStack
) -> ParameterFile | None:
    """Opens the file of the parameters until the stack ends; None without a directory."""
    folder = state_folder(config)
    if folder is None:
        return None
    from .stored_parameters import ParameterFile

    file = ParameterFile(folder.path, settings)
    stack.callback(file.close)
    return file


def open_signing(
    config: CompanionConfig, wall_s: float, stack: contextlib.ExitStack
) -> tuple[Signing | None, SigningClock | None]:
    """Returns the signing of the links, and the file of its time stamps, until the stack ends.

    None, None without a signed link; no file without a state directory. wall_s: the wall clock, in
    seconds since 1970. Raises InputError if there is no usable key.
    """
    if not config.has_signed_links:
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
    """Class of the machine: if flights are recorded (`open_recorder`), one that logs its calls."""
    if recorder_folder(config) is None:
        return Companion
    from .recording.calls import RecordedCompanion

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

    companion: of `companion_class`. status: the present status. clock_offset_s: wall clock less the
    companion's clock. Raises InputError for a folder that cannot be written.
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


async def open_view(
    config: CompanionConfig, status: Callable[[], dict[str, Any]], stack: contextlib.AsyncExitStack
) -> None:
    """Opens the socket of the view until the stack ends; nothing without a path.

    Raises InputError for a path where no socket can be made.
    """
    place = view_socket(config)
    if place is None:
        return
    from .status_socket import open_view_socket

    try:
        await stack.enter_async_context(open_view_socket(place.path, status))
    except OSError as error:
        raise place.not_free(error) from error


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


def open_page(
    config: CompanionConfig, vehicle: Vehicle, stack: contextlib.ExitStack
) -> PageProcess | None:
    """Starts the process of the page until the stack ends; None where it is not enabled.

    Raises the errors of PageProcess.
    """
    if not config.page.enabled:
        return None
    from .page_process import PageProcess

    page = PageProcess(config, vehicle)
    stack.callback(page.close)
    return page
