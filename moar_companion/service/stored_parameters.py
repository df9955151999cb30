"""Parameters that were set in flight, kept for the next process, for each vehicle by its name.

    DIRECTORY/parameters.json

They stand above the files of settings, but below a vehicle file that the command line names: then
those of the vehicle stay in the file, and do not count. A value that is no longer valid is reported
and dropped. A file that has no parameters is put aside.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter

from ..companion.flight_settings import settings_of
from ..companion.safety.file_faults import FileFault
from ..settings.config import CompanionConfig
from ..settings.flight_parameters import FlightParameters, flight_parameters
from ..settings.input_file import open_file
from ..settings.vehicle import Vehicle, VehicleFile
from ..texts import service_texts
from ..texts.text_format import plural
from .directories import state_folder
from .whole_file import WholeFile

FILE_NAME = "parameters.json"
_LONGEST_BYTES = 1_000_000
"""A longer file was not written by this program."""
_logger = logging.getLogger(__name__)


_Vehicles = dict[str, dict[str, float]]
"""Values by parameter, by the vehicle's name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _File:
    """Content of the file."""

    version: Literal[1] = 1
    vehicles: _Vehicles


_FILE = TypeAdapter(_File)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartSettings:
    """Settings that a process starts with.

    config, vehicle: as flown, with the stored values. parameters: the files' values, and those.
    unused: stored values below the command line, kept until these parameters are set again. others:
    values of other vehicles. problems: a text for the file where it cannot be used, and for each
    value that is no longer valid. faults: the same for pilots.
    """

    config: CompanionConfig
    vehicle: Vehicle
    parameters: FlightParameters
    unused: Mapping[str, float]
    others: _Vehicles
    problems: tuple[str, ...]
    faults: tuple[FileFault, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """What was set in flight, as texts."""
        above, below = self.parameters.changed, self.unused
        files = {name: self.parameters.in_file(name) for name in above}
        return (
            *(f"{name} {above[name]:g}, above the file's {files[name]:g}" for name in above),
            *(f"{name} {below[name]:g} does not count: --vehicle is given" for name in below),
        )

    def log(self) -> None:
        """Logs what was set in flight, and what is wrong with it."""
        for text in self.notes:
            _logger.info("set in flight: %s", text)
        for text in self.problems:
            _logger.warning("%s", text)


def start_settings(
    config: CompanionConfig, file: VehicleFile, *, vehicle_named: bool, put_aside: bool = True
) -> StartSettings:
    """The settings of a process: the files', and above them what was set in flight.

    vehicle_named: the command line names the vehicle file. put_aside: False leaves a broken file.
    """
    folder = state_folder(config)
    others: _Vehicles = {}
    problems: tuple[str, ...] = ()
    faults: tuple[FileFault, ...] = ()
    if folder is not None:
        others, problems, faults = _read(folder.path / FILE_NAME, put_aside=put_aside)
    known, rows = others.pop(file.name, {}), flight_parameters()
    unused = {
        name: value
        for name, value in known.items()
        if vehicle_named and name in rows and rows[name].file == "vehicle"
    }
    used = {name: value for name, value in known.items() if name not in unused}
    parameters, invalid = FlightParameters.of(file, config).with_stored(used)
    if invalid and folder is not None:
        reason = service_texts.STORED_INVALID(count=len(invalid), plural=plural(len(invalid)))
        faults = (*faults, FileFault(reason=reason, action="dropped"))
        path = folder.path / FILE_NAME
        problems = (*problems, *(f"{path}: {text}, dropped" for text in invalid))
    flown_config, vehicle = settings_of(parameters, config)
    return StartSettings(
        config=flown_config,
        vehicle=vehicle,
        parameters=parameters,
        unused=unused,
        others=others,
        problems=problems,
        faults=faults,
    )


def _read(
    path: Path, *, put_aside: bool
) -> tuple[_Vehicles, tuple[str, ...], tuple[FileFault, ...]]:
    """The values of the file, and its faults, as texts and for pilots; none without a file."""
    try:
        with open_file(path) as file:
            vehicles = _FILE.validate_json(file.read(_LONGEST_BYTES), strict=True).vehicles
            return vehicles, (), ()
    except FileNotFoundError:
        return {}, (), ()
    except OSError as error:
        text = f"{path}: not read: {error.strerror}"
        reason = service_texts.PARAMETERS_UNREADABLE()
    except ValueError:
        aside = path.with_suffix(".broken")
        text = f"{path}: no parameters of this version, put aside as {aside}"
        if put_aside:
            with contextlib.suppress(OSError):
                path.replace(aside)
        reason = service_texts.PARAMETERS_UNUSABLE()
    return {}, (text,), (FileFault(reason=reason, action="files count"),)


class ParameterFile:
    """The file of a vehicle's parameters, written by a thread of its own."""

    def __init__(self, folder: Path, settings: StartSettings) -> None:
        self._settings = settings
        self._file = WholeFile(folder / FILE_NAME, "parameters")

    @property
    def faults(self) -> tuple[FileFault, ...]:
        """Current faults of the file; those of the start stay in the list."""
        now = self._file.faults(service_texts.NO_PARAMETER_FILE, "not kept")
        return (*self._settings.faults, *now)

    def keep(self, parameters: FlightParameters) -> None:
        """Queues the values in force for writing."""
        unused, name = self._settings.unused, self._settings.vehicle.name
        kept = {key: value for key, value in unused.items() if key not in parameters.given}
        values = {**kept, **parameters.changed}
        file = _File(vehicles=self._settings.others | {name: values})
        self._file.put(_FILE.dump_json(file, indent=1))

    def close(self) -> None:
        """Waits a limited time for the pending write."""
        self._file.close()
