"""`moar-companion diagnose`: one archive for a report of a fault, in which secrets are blanked.

Each part is read for itself: a part that cannot be read has the reason in its place.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import platform
import re
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, LinkError
from ..service.recorded_files import is_flight
from ..settings.config import CompanionConfig
from ..settings.input_file import unreadable
from .options import add_file, refused
from .outputs import check_outputs, print_text, write_output
from .service import INSTALLED_CONFIG
from .versions import version_lines
from .view import DEFAULT_SOCKET, Statuses

_STATE = Path("/var/lib/moar-companion")
"""The unit's StateDirectory=, with the recordings in `flights`."""
_LOG_LINES = 5000
_MOST_BYTES = 4_000_000
"""Of one part: its end, which shows the fault, is kept."""
_COMMAND_S = 300.0
"""The check compiles the planner where this user has not done so."""
_INSTANCE = re.compile(r"[A-Za-z0-9_.-]+")
_SECRET = r"[\w-]*(?:password|passwd|secret|token|phrase|key)"  # noqa: S105 - names of keys in YAML
_BLANKED = "(blanked)"
_BLANKS = (
    # The lines below a key, and all of a key's own line.
    (
        re.compile(rf"(?im)^([ -]*)({_SECRET}) *:[ \t]*(?:[|>].*)?\n(?:\1[ \t]+.*\n?)+"),
        rf"\1\2: {_BLANKED}\n",
    ),
    (re.compile(rf"""(?im)^([ -]*["']?{_SECRET}["']? *:)[ \t]+\S.*$"""), rf"\1 {_BLANKED}"),
    # A value in braces, where a comma ends it unless it is quoted, or a list.
    (
        re.compile(
            rf"""(?i)([{{,]\s*["']?{_SECRET}["']?\s*:\s*)"""
            r"""("(?:\\.|[^"\\\n])*"|'[^'\n]*'|\[[^\]]*\]|[^,}\n]+)"""
        ),
        rf"\1{_BLANKED}",
    ),
    # A credential or variable in a unit, with its further lines.
    (
        re.compile(r"(?im)^(\s*SetCredential\w*=[^:\n]*:)(?:[^\n]*\\\n)*[^\n]*"),
        rf"\1{_BLANKED}",
    ),
    (re.compile(rf"(?im)^(\s*Environment=.*?{_SECRET}=).*$"), rf"\1{_BLANKED}"),
    # A password in a URL, and a key in its query; a key in hexadecimal digits.
    (re.compile(r"""://[^\s"']*@"""), f"://{_BLANKED}@"),
    (re.compile(rf"""(?i)([?&]{_SECRET}=)[^\s&"',}}]+"""), rf"\1{_BLANKED}"),
    (re.compile(r"\b[0-9a-fA-F]{64}\b"), _BLANKED),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """A file of the archive, and the function that reads its content."""

    name: str
    content: Callable[[], str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the instance, the configuration and the archive."""
    parser.add_argument(
        "vehicle",
        nargs="?",
        metavar="NAME",
        help="the vehicle of moar-companion@NAME (default: of moar-companion.service)",
    )
    add_file(parser, "--config", f"the configuration (default: {INSTALLED_CONFIG}, or NAME's)")
    add_file(parser, "--out", "the archive (default: moar-diagnose-TIME.tar.gz)")


def run(arguments: argparse.Namespace) -> int:
    """Writes the archive and lists its parts; 0 also where parts could not be read."""
    name = arguments.vehicle
    if name is not None and not _INSTANCE.fullmatch(name):
        raise refused("NAME", name, "must be letters, digits, and . _ -")
    config = Path(arguments.config or INSTALLED_CONFIG.parent / (name or "") / "companion.yaml")
    now_s = time.time()
    named = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now_s))
    out = arguments.out or f"moar-diagnose-{named}.tar.gz"
    check_outputs({"--out": out}, {"--config": str(config)})
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for part in _parts(name, config):
            content, fault = _read(part)
            entry = tarfile.TarInfo(f"{Path(out).name.removesuffix('.tar.gz')}/{part.name}")
            entry.size, entry.mtime, entry.mode = len(content), int(now_s), 0o600
            archive.addfile(entry, io.BytesIO(content))
            print_text(f"{part.name:<28} {fault or f'{len(content)} bytes'}\n")
    problem = write_output("--out", out, lambda file: file.write(stream.getvalue()))
    if problem is not None:
        raise OSError(problem)
    Path(out).chmod(0o600)
    print_text(
        f"{out}: passwords and keys are blanked, places are not; read it before you send it\n"
    )
    return 0


def blanked(text: str) -> str:
    """The text without the values of passwords and keys; names of files of keys stay."""
    for pattern, replacement in _BLANKS:
        text = pattern.sub(replacement, text)
    return text


def _read(part: _Part) -> tuple[bytes, str]:
    """The end of a part's content, or the reason why there is none; and that reason alone."""
    try:
        text, fault = part.content(), ""
    except (OSError, ValueError) as error:
        text = fault = unreadable(error)
    except (InputError, LinkError, subprocess.TimeoutExpired) as error:
        text = fault = str(error)
    content = blanked(text).encode(errors="backslashreplace")
    return content[-_MOST_BYTES:], fault


def _parts(name: str | None, config: Path) -> Iterator[_Part]:
    """The parts of the archive, in order."""
    unit = f"moar-companion@{name}" if name else "moar-companion"
    state = _STATE / (name or "")
    socket = Path(DEFAULT_SOCKET).parent / (name or "") / Path(DEFAULT_SOCKET).name
    isolated = ["-I"] if sys.flags.isolated else []
    check = [sys.executable, *isolated, "-m", "moar_companion", "check", "--files"]
    journal = ["journalctl", "--no-pager", "--output=short-precise", f"--lines={_LOG_LINES}"]
    yield _Part(name="versions.txt", content=lambda: "\n".join(_system_lines()))
    yield _Part(name="check.txt", content=lambda: _output(*check, "--config", str(config)))
    yield _Part(name="unit.txt", content=lambda: _output("systemctl", "--no-pager", "cat", unit))
    yield _Part(name="log.txt", content=lambda: _output(*journal, f"--unit={unit}"))
    yield _Part(name="status.json", content=lambda: _status(socket))
    yield _Part(name="serial.txt", content=lambda: "\n".join(_serial_lines()))
    yield from _files("configuration", _configuration(config))
    yield from _files("state", [state / "mission.json", state / "parameters.json"])
    yield from _files("flight", _decisions(_recordings(config, state)))


def _files(folder: str, paths: list[Path]) -> Iterator[_Part]:
    """Parts with the content of files."""
    for path in paths:
        yield _Part(name=f"{folder}/{path.name}", content=path.read_text)


def _system_lines() -> Iterator[str]:
    """Versions, and the computer."""
    yield from version_lines()
    yield f"system {platform.freedesktop_os_release().get('PRETTY_NAME', 'unknown')}"
    model = Path("/proc/device-tree/model")  # of a Jetson, a Raspberry Pi
    if model.exists():
        yield f"model {model.read_text().rstrip(chr(0))}"
    yield f"processors {len(os.sched_getaffinity(0))} of {os.cpu_count()}"
    yield Path("/proc/meminfo").read_text().partition("\n")[0]


def _serial_lines() -> list[str]:
    """Names of serial devices, and the device of each link."""
    names = ("serial/by-id/*", "moar-*", "ttyACM*", "ttyUSB*", "ttyTHS*", "ttyAMA*")
    paths = [path for name in names for path in sorted(Path("/dev").glob(name))]
    return [f"{path} -> {path.resolve()}" for path in paths]


def _status(socket: Path) -> str:
    """The present status of a running service."""
    with closing(Statuses(str(socket))) as statuses:
        return json.dumps(statuses.first(), indent=1)


def _output(*command: str) -> str:
    """What a command writes on stdout and stderr."""
    done = subprocess.run(  # noqa: S603 - ours and systemd's, without a shell
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=_COMMAND_S,
        check=False,
    )
    return done.stdout.decode(errors="backslashreplace")


def _loaded(config: Path) -> CompanionConfig | None:
    """The configuration, if it can be used; `check` tells why not."""
    try:
        return CompanionConfig.load(config)
    except InputError:
        return None


def _configuration(config: Path) -> list[Path]:
    """The configuration, and the files that it names."""
    loaded = _loaded(config)
    named = [] if loaded is None else [loaded.vehicle, loaded.site]
    return [config, *(Path(path) for path in named if path is not None)]


def _recordings(config: Path, state: Path) -> Path:
    """Folder of the recordings."""
    loaded = _loaded(config)
    named = None if loaded is None else loaded.recorder.directory
    return Path(named) if named is not None else state / "flights"


def _decisions(recordings: Path) -> list[Path]:
    """The decisions of the last flight, part by part."""
    try:
        flights = sorted(path for path in recordings.iterdir() if is_flight(path))
    except OSError:
        return []
    return sorted(flights[-1].glob("decisions*.jsonl")) if flights else []
