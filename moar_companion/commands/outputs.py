"""Output files: checked before any computation, and written as a whole or not at all."""

from __future__ import annotations

import io
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from pathlib import Path
from typing import IO, Any

from ..texts.text_format import printable
from .options import refused

STDOUT = "-"
"""File name that means stdout."""


def check_outputs(outputs: Mapping[str, str | None], inputs: Mapping[str, str]) -> None:
    """Raises InputError for an output, by option, that cannot or should not be written.

    It must not be an input, nor another output, and its directory must be there and writable.
    """
    taken = {_real(path): name for name, path in inputs.items()}
    for option, path in outputs.items():
        if path is None:
            continue
        real = _real(path)
        if real.is_dir() or path.endswith(os.sep):
            raise refused(option, path, "a directory, must be a file")
        if _is_special(real):
            continue
        if real in taken:
            raise refused(option, path, f"the file of {taken[real]} too, must be another")
        if not real.parent.is_dir():
            raise refused(option, path, f"but there is no directory {real.parent}")
        if not os.access(real.parent, os.W_OK | os.X_OK):
            raise refused(option, path, f"but nothing may be written in {real.parent}")
        taken[real] = option


def output_folder(option: str, name: str) -> Path:
    """A folder for output files, made where it is missing; InputError where it cannot be used."""
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(option, name, f"but the folder cannot be made: {error.strerror}") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise refused(option, name, "but nothing may be written there")
    return folder


@contextmanager
def replacing(path: str) -> Iterator[IO[bytes]]:
    """A file that takes its name when it is complete; until then the old file stays.

    A device or pipe gets the content in one piece: archives seek, which those cannot.
    """
    real = _real(path)
    if _is_special(real):
        content = io.BytesIO()
        yield content
        with real.open("wb") as device:
            device.write(content.getbuffer())
        return
    part = real.with_name(f".moar-companion-{os.urandom(8).hex()}.part")
    with _removed_when_ended(part):
        try:
            with part.open("xb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
                os.fchmod(stream.fileno(), _mode(real))
            part.replace(real)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise


def replace_together(contents: Mapping[Path, str]) -> None:
    """Writes files that belong together: all take their names when all are complete.

    Until then the old files stay, after an interrupt or the end of the terminal, too.
    """
    parts: dict[Path, Path] = {}
    with _signals_later():
        try:
            for path, text in contents.items():
                real = _real(str(path))
                part = real.with_name(f".moar-companion-{os.urandom(8).hex()}.part")
                parts[part] = real
                with part.open("x", encoding="utf-8") as stream:
                    stream.write(text)
                    stream.flush()
                    os.fsync(stream.fileno())
                    os.fchmod(stream.fileno(), _mode(real))
                    with suppress(OSError):  # the service's group may read a file that root wrote
                        old = real.stat()
                        os.fchown(stream.fileno(), old.st_uid, old.st_gid)
            for part, real in parts.items():
                part.replace(real)
        finally:
            for part in parts:
                part.unlink(missing_ok=True)


@contextmanager
def _signals_later() -> Iterator[None]:
    """Context after which an interrupt, SIGTERM or the terminal's end acts that came in it.

    By handlers: a mask of this thread alone would leave the signals to the other threads.
    """
    arrived: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda it, _: arrived.append(it)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for late in dict.fromkeys(arrived):
            signal.raise_signal(late)


@contextmanager
def _removed_when_ended(path: Path) -> Iterator[None]:
    """Context in which an interrupt or SIGTERM removes the file and ends the process."""

    def end(*_: object) -> None:
        with suppress(OSError):
            path.unlink()
        os._exit(1)

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def write_output(
    option: str, path: str | None, content: Callable[[IO[bytes]], object]
) -> str | None:
    """Writes one file, unless it is None or stdout; returns the error text, None if written.

    Raises nothing, so that the other files are still written.
    """
    if path is None or path == STDOUT:
        return None
    try:
        with replacing(path) as stream:
            content(stream)
    except OSError as error:
        return f"{option}: {path}: {error.strerror or error}"
    return None


@contextmanager
def json_output(path: str | None) -> Iterator[dict[str, Any]]:
    """A document that is filled within, and written as JSON at the end, after an error, too.

    path: None: it is not written; STDOUT: to stdout, and all that is printed within to stderr.
    """
    document: dict[str, Any] = {}
    check_outputs({"--json": None if path == STDOUT else path}, {})

    def text() -> str:
        return json.dumps(document, indent=2, ensure_ascii=False) + "\n"

    try:
        with redirect_stdout(sys.stderr) if path == STDOUT else nullcontext():
            yield document
    finally:
        if document and path == STDOUT:
            print_text(text())
        elif document:
            failure = write_output("--json", path, lambda stream: stream.write(text().encode()))
            if failure:
                raise OSError(failure)


def report_compiling() -> None:
    """Compiles the missing kernels by all processors, with a bar; once on each computer.

    Only where a person watches the terminal's stderr: elsewhere each is compiled at its first use.
    """
    if sys.stderr is None or not sys.stderr.isatty():
        return
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn  # noqa: PLC0415

    from ..service.compiling import fill_cache  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("compiling the planner, once on this computer", visible=False)
        fill_cache(
            lambda done, total: bar.update(task, completed=done, total=total, visible=True),
            threading.Event(),
        )


def print_text(text: str) -> None:
    """Writes lines to stdout at once, without control characters in them.

    An OSError names stdout, except BrokenPipeError.
    """
    if sys.stdout is None:
        raise OSError("stdout is closed")
    try:
        sys.stdout.write("\n".join(map(printable, text.split("\n"))))
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, "stdout") from error


def _real(path: str) -> Path:
    """The path with all links resolved: this file is replaced."""
    return Path(os.path.realpath(path))


def _is_special(real: Path) -> bool:
    """Returns True for an existing path that is no regular file: /dev/null is never replaced."""
    return real.exists() and not real.is_file()


def _mode(real: Path) -> int:
    """The permissions of the file that is replaced, or those of a new one."""
    with suppress(OSError):
        return real.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
