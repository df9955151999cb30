"""Time stamps of our signatures, kept for the next process.

    DIRECTORY/signing.json

The file is always ahead of the sent time stamps: peers refuse older ones, and a computer without a
clock cannot determine the file's age. A thread of its own writes it, as a rule every 3 s.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from ..mavlink.signing import LATEST_TIMESTAMP, UNITS_PER_S, Signing, timestamp_at
from ..settings.config import CompanionConfig
from ..settings.input_file import open_file
from .directories import state_folder
from .signing_key import read_signing_key
from .whole_file import WholeFile

_NAME = "signing.json"
_LONGEST_BYTES = 65536
"""A longer file was not written by this program."""
_AHEAD_UNITS = 5 * UNITS_PER_S
"""Lead of the file when it is written. A restart takes about as long, so that a service that
restarts again and again does not run ahead of the clocks of its peers."""
_LEAST_AHEAD_UNITS = 2 * UNITS_PER_S
"""With less lead than this the file is written again."""

_SET_SINCE_S = 1_767_225_600
"""2026-01-01 UTC, in seconds since 1970. An earlier time means that the clock was never set: this
software is younger."""
_PLAUSIBLE_AHEAD_S = 5 * 365 * 86400
"""Greatest possible lead of a stored time stamp. A clock that is not set may begin at the date of
the system's image, which is younger. A greater lead comes from a wrong clock."""
_DOUBTED_AHEAD_S = 60.0
"""Lag behind the stored time stamp from which new senders are refused."""

_Timestamp = Annotated[int, Field(ge=0, le=LATEST_TIMESTAMP)]

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class _File:
    """By the URL of each link: our time stamps, and the references for new senders."""

    version: Literal[1] = 1
    timestamps: dict[str, _Timestamp]
    references: dict[str, _Timestamp] = field(default_factory=dict)


_FILE = TypeAdapter(_File)


class SigningClock:
    """File in a folder, and the thread that writes it.

    Only the constructor raises OSError, if the folder cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._file = WholeFile(directory / _NAME, "signing")
        self._saved: dict[str, int] = {}

    def keep(self, timestamps: Mapping[str, int], references: Mapping[str, int]) -> None:
        """Queues the time stamps for writing when the file's lead over them is used up."""
        if all(
            timestamp + _LEAST_AHEAD_UNITS <= self._saved.get(link, 0)
            for link, timestamp in timestamps.items()
        ):
            return
        self._saved = {
            link: min(LATEST_TIMESTAMP, timestamp + _AHEAD_UNITS)
            for link, timestamp in timestamps.items()
        }
        file = _File(timestamps=self._saved, references=dict(references))
        self._file.put(_FILE.dump_json(file, indent=1))

    def close(self) -> None:
        """Waits a limited time for the pending write."""
        self._file.close()


def load_signing(config: CompanionConfig, wall_s: float) -> Signing | None:
    """Returns the signing of the configuration's links; None if none of them is signed.

    wall_s: the wall clock, in seconds since 1970. Raises InputError when there is no usable key.
    """
    key = read_signing_key(config)
    if key is None:
        return None
    folder = state_folder(config)
    file = None if folder is None else _kept(folder.path / _NAME)
    if folder is None or file is None:
        return Signing(key=key, wall_s=wall_s)
    references = _plausible(file.references, wall_s, folder.path / _NAME)
    return Signing(key=key, wall_s=wall_s, kept=file.timestamps, references=references)


def _plausible(references: Mapping[str, int], wall_s: float, path: Path) -> dict[str, int]:
    """Stored references that the wall clock does not prove wrong; logs those ahead of it."""
    now = timestamp_at(wall_s)
    ahead_s = (max(references.values(), default=0) - now) / UNITS_PER_S
    if wall_s < _SET_SINCE_S or ahead_s <= _DOUBTED_AHEAD_S:
        return dict(references)
    wrong = ahead_s > _PLAUSIBLE_AHEAD_S
    _logger.warning(
        "%s: time stamps are %.1f days ahead of this computer's clock, %s",
        path,
        ahead_s / 86400.0,
        "not used"
        if wrong
        else "senders that are behind them are refused: set the clock; where it is right delete "
        "the file, and restart",
    )
    latest = now + _PLAUSIBLE_AHEAD_S * UNITS_PER_S
    return {link: timestamp for link, timestamp in references.items() if timestamp <= latest}


def _kept(path: Path) -> _File | None:
    """Returns the content of a file; None if there is none. Logs an unusable file."""
    try:
        with open_file(path) as file:
            return _FILE.validate_json(file.read(_LONGEST_BYTES), strict=True)
    except FileNotFoundError:
        pass
    except OSError as error:
        _logger.warning("%s: not read: %s", path, error.strerror)
    except ValueError:
        _logger.warning("%s: no time stamps of this version, not used", path)
    return None
