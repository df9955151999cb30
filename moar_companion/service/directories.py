"""Folders and socket of the service: from the configuration, else from systemd."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..settings.config import CompanionConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class Directory:
    """A path and its source: a key of a file, or (without a key) the environment."""

    path: Path
    source: str
    key: str = ""

    @property
    def name(self) -> str:
        """Name of the setting to correct."""
        return self.key or self.source

    def unwritable(self, error: OSError) -> InputError:
        """Returns the error for a folder that cannot be written."""
        problem = f"is {str(self.path)!r}, must be a folder that can be written: {error.strerror}"
        return InputError(self.source, self.key, problem)

    def not_free(self, error: OSError) -> InputError:
        """Returns the error for a path where no socket can be made."""
        taken = error.errno == errno.EADDRINUSE
        reason = "something else is there" if taken else error.strerror or str(error)
        must = "must be a free name in a folder that can be written"
        return InputError(self.source, self.key, f"is {str(self.path)!r}, {must}: {reason}")


def recorder_folder(config: CompanionConfig) -> Directory | None:
    """Folder of the flight records; None if flights are not recorded."""
    if not config.recorder.enabled:
        return None
    if config.recorder.directory is not None:
        return _of_file(config, "recorder.directory", config.recorder.directory)
    return _of_systemd("STATE_DIRECTORY", "flights")


def state_folder(config: CompanionConfig) -> Directory | None:
    """Folder of the mission snapshot; None if there is none."""
    if config.state.directory is not None:
        return _of_file(config, "state.directory", config.state.directory)
    return _of_systemd("STATE_DIRECTORY")


def view_socket(config: CompanionConfig) -> Directory | None:
    """Socket of the view; None if the view is not served."""
    if config.view.socket is not None:
        return _of_file(config, "view.socket", config.view.socket)
    return _of_systemd("RUNTIME_DIRECTORY", "view.sock")


def _of_file(config: CompanionConfig, key: str, path: Path | None) -> Directory | None:
    if path is None:
        return None
    if config.file is None:
        return Directory(path=path, source=key)
    return Directory(path=path, source=str(config.file), key=key)


def _of_systemd(variable: str, name: str = "") -> Directory | None:
    """Returns a place in the first folder of the variable."""
    folder, _, _ = os.environ.get(variable, "").partition(":")
    return Directory(path=Path(folder, name), source=variable) if folder else None
