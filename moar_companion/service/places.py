"""Where the service writes, and is looked at: as the configuration says, else as systemd does."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from pathlib import Path

from ..config import CompanionConfig
from ..errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A path, and who has named it: a key of a file, or (without a key) the environment."""

    path: Path
    source: str
    key: str = ""

    @property
    def name(self) -> str:
        """What is to be corrected."""
        return self.key or self.source

    def unwritable(self, error: OSError) -> InputError:
        """Why nothing can be written to this folder."""
        problem = f"is {str(self.path)!r}, must be a folder that can be written: {error.strerror}"
        return InputError(self.source, self.key, problem)

    def not_free(self, error: OSError) -> InputError:
        """Why no socket can be made there."""
        taken = error.errno == errno.EADDRINUSE
        reason = "something else is there" if taken else error.strerror or str(error)
        must = "must be a free name in a folder that can be written"
        return InputError(self.source, self.key, f"is {str(self.path)!r}, {must}: {reason}")


def recorder_folder(config: CompanionConfig) -> Place | None:
    """Where flights are recorded; None where they are not."""
    return _of_file(config, "recorder.directory", config.recorder.directory)


def state_folder(config: CompanionConfig) -> Place | None:
    """Where the mission is remembered; None where it is not."""
    if config.state.directory is not None:
        return _of_file(config, "state.directory", config.state.directory)
    return _of_systemd("STATE_DIRECTORY")


def view_socket(config: CompanionConfig) -> Place | None:
    """Where the view is served; None where it is not."""
    if config.view.socket is not None:
        return _of_file(config, "view.socket", config.view.socket)
    return _of_systemd("RUNTIME_DIRECTORY", "view.sock")


def _of_file(config: CompanionConfig, key: str, path: Path | None) -> Place | None:
    if path is None:
        return None
    if config.file is None:
        return Place(path=path, source=key)
    return Place(path=path, source=str(config.file), key=key)


def _of_systemd(variable: str, name: str = "") -> Place | None:
    """In the first of its folders."""
    folder, _, _ = os.environ.get(variable, "").partition(":")
    return Place(path=Path(folder, name), source=variable) if folder else None
