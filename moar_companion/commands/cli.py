"""The command line: arguments in, exit status out.

Only `main` turns errors into output for the user: one line on stderr, never a traceback. Exit
status: 0 done; 2 usage or bad input; 1 all other failures, and an interrupt (of a view: 0).
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import logging
import os
import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from ..errors import InputError, LinkError
from ..texts.text_format import printable

PROGRAM = "moar-companion"
_NO_MEMORY = (
    "not enough memory, or too many threads; limits: ulimit -v and -u, systemd's MemoryMax and "
    "TasksMax"
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Subcommand:
    """A command: its module in `commands`, and its description."""

    module: str
    summary: str
    description: str
    examples: tuple[str, ...]
    intermixed: bool = False
    """Options may stand before its last word, which it does not need."""


COMMANDS = {
    "plan": Subcommand(
        module="plan",
        summary="plan one path on a site",
        description="Plan one path on a site: to a target (inspection), or out of the site to a "
        "landing point (exit, evacuation). Prints a summary; writes the plan, the maps it was "
        "made on, and a picture of it.",
        examples=(
            f"{PROGRAM} plan site.yaml --mission inspection --plot plan.png",
            f"{PROGRAM} plan site.yaml --mission inspection --target splice-1 --json -",
            f"{PROGRAM} plan site.yaml --mission exit --start 27,2.5 --velocity -1,0",
            f"{PROGRAM} plan site.yaml --mission exit --target 0 --risk wind=0.8,battery=0.2",
            f"{PROGRAM} plan site.yaml --mission evacuation --weights 3,1,1 --maps maps.npz",
        ),
    ),
    "setup": Subcommand(
        module="setup",
        summary="find the autopilot, describe the vehicle, write the configuration",
        description="Find the autopilot on the serial ports at the usual rates, and on UDP; read "
        "its speeds, battery and limits; ask the rest; write companion.yaml and vehicle.yaml; "
        "run check; offer the parameters that should be set. It never arms, and sets "
        "parameters only after a yes, one by one, on a disarmed autopilot. Each question has an "
        "option. The old files stay until all is answered.",
        examples=(
            f"{PROGRAM} setup",
            f"{PROGRAM} setup --yes --connect serial:/dev/ttyTHS1:921600 --site site.yaml",
            f"{PROGRAM} setup --parameters autopilot.params",
            f"{PROGRAM} setup --yes --connect udp::14540 --out . --apply",
            f"{PROGRAM} setup --offline --connect udp::14540 --autopilot px4 --yes --out .",
        ),
    ),
    "check": Subcommand(
        module="check",
        summary="check files and aircraft before the flight: go or no-go",
        description="Check configuration, vehicle and site as the service loads them, and the "
        "aircraft on its links: parameters, GPS, battery, links. Flies nothing, sets no "
        "parameter. Reports each fault with its remedy. Exit status 0 is GO; 1 is NO-GO, also "
        "if no aircraft was checked. With --files the files alone: 0 is FILES OK.",
        examples=(
            f"{PROGRAM} check",
            f"{PROGRAM} check --site site.yaml --vehicle vehicle.yaml --connect udp::14540",
            f"{PROGRAM} check --files --config /etc/moar-companion/companion.yaml",
        ),
    ),
    "replay": Subcommand(
        module="replay",
        summary="risk indices and events over a recorded flight",
        description="Play a recorded flight through the code that flies: its risk indices and "
        "events as a summary, as JSON, as a picture. With a site, also where on it the aircraft "
        "was.",
        examples=(
            f"{PROGRAM} replay flight.tlog",
            f"{PROGRAM} replay flight.tlog.gz --vehicle vehicle.yaml --plot flight.png",
            f"{PROGRAM} replay flight.tlog --site site.yaml --json -",
        ),
    ),
    "report": Subcommand(
        module="flight_report",
        summary="what a flight inspected, as one page with its pictures",
        description="Write one self-contained HTML page of a flight: site and path, targets and "
        "what was captured, pictures beside their places, what was left out and why, battery and "
        "texts. With the camera's pictures, found by name, number or time, copies of them get "
        "their place, direction and time.",
        examples=(
            f"{PROGRAM} report flights/latest",
            f"{PROGRAM} report flights/latest --pictures /media/sdcard/DCIM --out report.html",
        ),
    ),
    "command": Subcommand(
        module="command",
        summary="order a mission of a companion in flight, or show its status",
        description="The operator's side: order a mission of the companion (inspection, exit, "
        "evacuation, hold, pause, continue, release) and show its answer; or show its status.",
        examples=(
            f"{PROGRAM} command inspection --connect udp::14550",
            f"{PROGRAM} command inspection --target splice-1 --site site.yaml --connect udp::14550",
            f"{PROGRAM} command exit --target 0 --connect tcp:10.0.0.2:5760",
            f"{PROGRAM} command status --connect serial:/dev/ttyUSB0:57600",
        ),
    ),
    "view": Subcommand(
        module="view",
        summary="watch a running service in the terminal",
        description="Watch a running service on this computer: state, risks, plan and link, until "
        "q or Ctrl-C. It sends no orders. Into a file or a pipe it writes a line each second.",
        examples=(
            f"{PROGRAM} view",
            f"{PROGRAM} view --once",
            f"{PROGRAM} view /tmp/view.sock --json",
        ),
    ),
    "evaluate": Subcommand(
        module="evaluate",
        summary="rerun the paper's experiments: figures, tables, a report",
        description="Rerun the experiments of the paper on three environments: maps, sensitivity "
        "to weights, adaptability to risks, the 36 tests, the flight. Writes figures (PNG, SVG), "
        "results (Parquet) and one report (HTML) into a folder. Needs the extra evaluation.",
        examples=(
            f"{PROGRAM} evaluate all",
            f"{PROGRAM} evaluate sensitivity --out results --workers 8",
            f"{PROGRAM} evaluate adaptability --scheduler tcp://10.0.0.5:8786",
        ),
    ),
    "site": Subcommand(
        module="site_files",
        intermixed=True,
        summary="a site file: from a point cloud, a map or a typical line; its map and orders",
        description="Make a site file from a point cloud of a power line (its conductors are found "
        "by RANSAC, the plane is laid across them at the target), from points drawn on a map, or "
        "of a typical line at a place that is given, or marked by the aircraft there. Or show a "
        "site and its paths on a map and as a mission of QGroundControl; move it in the world; or "
        "write its orders as buttons and scripts of ground stations.",
        examples=(
            f"{PROGRAM} site from-cloud scan.laz --at 53.187,6.567 --out site.yaml --plot site.png",
            f"{PROGRAM} site from-cloud scan.laz --at 228962,578460 --crs EPSG:28992 --out s.yaml",
            f"{PROGRAM} site from-map survey.kml --out site.yaml",
            f"{PROGRAM} site new --line 315kv-double --height 12 --at 45.3,-71.9,210 --out s.yaml",
            f"{PROGRAM} site new --mark 0,0 --connect udp::14540 --out site.yaml",
            f"{PROGRAM} site show site.yaml --kml site.kml --qgc-plan site.plan",
            f'{PROGRAM} site shift site.yaml --north 0.4 --reason "base moved" --out moved.yaml',
            f"{PROGRAM} site actions site.yaml --out ground",
        ),
    ),
    "watch": Subcommand(
        module="watch",
        summary="watch a fleet over MQTT in the terminal, a row per vehicle",
        description="Watch the companions that publish to an MQTT broker, a row per vehicle: "
        "state, risks, battery, age, until q or Ctrl-C. It sends no orders. Into a file or a pipe "
        "it writes a line per vehicle every 5 s.",
        examples=(
            f"{PROGRAM} watch --mqtt mqtt://192.168.1.10",
            f"{PROGRAM} watch --mqtt mqtts://10.0.0.2 --ca-file ca.pem --username ground",
            f"{PROGRAM} watch --mqtt mqtt://127.0.0.1 --once",
        ),
    ),
    "completion": Subcommand(
        module="completion",
        summary="write the script that completes commands in bash, zsh or fish",
        description="Write the script by which a shell completes commands, options, targets and "
        "files as they are typed. The script asks the installed program, so that it stays the "
        "same after an update.",
        examples=(
            f"{PROGRAM} completion bash | sudo tee /etc/bash_completion.d/{PROGRAM}",
            f"{PROGRAM} completion zsh > ~/.zfunc/_{PROGRAM}    # a folder of $fpath",
            f"{PROGRAM} completion fish > ~/.config/fish/completions/{PROGRAM}.fish",
        ),
    ),
    "page": Subcommand(
        module="page",
        summary="the page in a browser, without an aircraft: what-if, playback",
        description="Serve the page of the aircraft for browsers, without an aircraft: of a site, "
        "to change it and see the planner's path at once; or of a recorded flight, to play it "
        "back. Until Ctrl-C. The page of a flight is the service's: section page of its file.",
        examples=(
            f"{PROGRAM} page site.yaml",
            f"{PROGRAM} page flight.mcap --port 8080",
        ),
    ),
    "diagnose": Subcommand(
        module="diagnose",
        summary="one archive for a report of a fault",
        description="Collect what a report of a fault needs in one archive: versions, "
        "configuration, the check of its files, the last lines of the log, the present status, "
        "the decisions of the last flight. Passwords and keys are blanked.",
        examples=(
            f"sudo {PROGRAM} diagnose",
            f"sudo {PROGRAM} diagnose linedrone-07 --out fault.tar.gz",
        ),
    ),
    "docs": Subcommand(
        module="docs",
        summary="write the reference page and the schemas of a checkout",
        description="For developers: write configs/reference.md, and the JSON schemas of settings "
        "and MQTT payloads, as the code describes them.",
        examples=(f"{PROGRAM} docs", f"{PROGRAM} docs --check"),
    ),
}
"""Commands by their name on the command line."""

SERVICE = Subcommand(
    module="service",
    summary="run the companion service",
    description="Without a command: run the companion service, which listens to the autopilot, "
    "estimates risk, plans and guides. Without a site it is telemetry and risk only.",
    examples=(
        f"{PROGRAM} --config /etc/moar-companion/companion.yaml",
        f"{PROGRAM} --site site.yaml --connect udp:127.0.0.1:14540",
    ),
)


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status in all cases."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A site's name may contain characters that the terminal cannot show.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = _run(sys.argv[1:] if argv is None else argv)
        if sys.stdout is not None:
            sys.stdout.flush()
    except SystemExit as request:  # argparse, after --help and --version
        return request.code if isinstance(request.code, int) else 0
    except InputError as error:
        return _failed(str(error), 2)
    except LinkError as error:
        return _failed(str(error), 1)
    except KeyboardInterrupt:
        return 1
    except BrokenPipeError:
        _settle_stdout()
        return 1
    except (MemoryError, RuntimeError) as error:
        if not _lacks_memory(error):
            return _unexpected(error)
        return _failed(_NO_MEMORY, 1)
    except OSError as error:
        _settle_stdout()
        what = f"{error.filename}: " if error.filename else ""
        return _failed(f"{what}{error.strerror or error}", 1)
    except Exception as error:  # noqa: BLE001
        return _unexpected(error)
    return status


def _unexpected(error: Exception) -> int:
    if _is_interrupted(error):
        return 1
    _log.debug("unexpected error", exc_info=True)
    return _failed(f"unexpected error: {type(error).__name__}: {error}", 1)


def _lacks_memory(error: BaseException | None) -> bool:
    """Returns True if an error, or one of its causes, is a lack of memory or of threads."""
    if error is None:
        return False
    no_thread = isinstance(error, RuntimeError) and "start new thread" in str(error)
    behind = error.__cause__ or error.__context__
    return isinstance(error, MemoryError) or no_thread or _lacks_memory(behind)


def report(message: str) -> None:
    """Writes one line on stderr, for any content of the message."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            sys.stderr.write(f"{PROGRAM}: {printable(message)}\n")
            sys.stderr.flush()


def _failed(message: str, status: int) -> int:
    report(message)
    return status


def _is_interrupted(error: BaseException) -> bool:
    """Returns True if an interrupt caused an error: compiled code turns it into a SystemError."""
    cause = error.__cause__ or error.__context__
    return cause is not None and (isinstance(cause, KeyboardInterrupt) or _is_interrupted(cause))


def _settle_stdout() -> None:
    """Redirects a stdout that cannot be written to /dev/null, so that the exit does not fail."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _run(argv: Sequence[str]) -> int:
    first = argv[0] if argv else ""
    if first and not first.startswith("-") and first not in COMMANDS:
        raise InputError(
            first, "", f"is not a command, must be one of {', '.join(COMMANDS)} (see --help)"
        )
    if first in COMMANDS:
        parser, command, rest = _Parser(f"{PROGRAM} {first}", COMMANDS[first]), COMMANDS[first], 1
    else:
        parser, command, rest = _service_parser(), SERVICE, 0
    module = _module(command)
    module.add_arguments(parser)
    parse = parser.parse_intermixed_args if command.intermixed else parser.parse_args
    status: int = module.run(parse(_joined(argv[rest:])))
    return status


def _module(command: Subcommand) -> Any:
    return importlib.import_module(f".{command.module}", __package__)


_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)


def _joined(argv: Sequence[str]) -> list[str]:
    """`--start -1,2` as `--start=-1,2`: argparse takes only a lone negative number for a value."""
    joined: list[str] = []
    for index, word in enumerate(argv):
        if word == "--":
            return joined + list(argv[index:])
        last = joined[-1] if joined else ""
        if last.startswith("--") and "=" not in last and _NEGATIVE.match(word):
            joined[-1] = f"{last}={word}"
        else:
            joined.append(word)
    return joined


class _Once(argparse.Action):
    """Stores a value, as argparse does; refuses an option that is given twice."""

    given = False

    def __call__(
        self,
        _parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        _option: str | None = None,
    ) -> None:
        if self.given:
            raise argparse.ArgumentError(self, "is given twice, must be given once")
        self.given = True
        setattr(namespace, self.dest, values)


class _Parser(argparse.ArgumentParser):
    """argparse with error messages of one line, as all others."""

    def __init__(self, prog: str, command: Subcommand) -> None:
        examples = "\n".join(f"  {line}" for line in command.examples)
        super().__init__(
            prog=prog,
            description=textwrap.fill(command.description, 79),
            epilog=f"examples:\n{examples}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self.register("action", None, _Once)

    def error(self, message: str) -> NoReturn:
        name, separator, problem = message.removeprefix("argument ").partition(": ")
        if not (separator and message.startswith("argument ")):
            name, problem = self.prog.removeprefix(PROGRAM).strip() or "arguments", message
        raise InputError(name, "", f"{problem} (see {self.prog} --help)")


def _service_parser() -> _Parser:
    parser = _Parser(PROGRAM, SERVICE)
    width = max(map(len, COMMANDS))
    commands = "\n".join(f"  {name:{width}}  {item.summary}" for name, item in COMMANDS.items())
    parser.epilog = (
        f"commands ({PROGRAM} COMMAND --help):\n{commands}\n\n{parser.epilog}\n\n"
        "exit status: 0 done; 2 usage or bad input; 1 anything else"
    )
    parser.add_argument(
        "--version",
        action=_Version,
        nargs=0,
        help="show the versions of program and libraries, and exit",
    )
    return parser


def parser_for_completion(
    first: str, add_words: Callable[[argparse.ArgumentParser], None]
) -> argparse.ArgumentParser:
    """Parser of the whole command line for shell completion; first: its first word.

    Only the module of the command that is typed is loaded. add_words: is called with each parser
    that has arguments.
    """
    parser = argparse.ArgumentParser(PROGRAM, allow_abbrev=False)
    parser.add_argument("--version", action="store_true", help="show the version")
    commands = parser.add_subparsers()
    for name, command in COMMANDS.items():
        subparser = commands.add_parser(name, help=command.summary)
        if name == first:
            _module(command).add_arguments(subparser)
            add_words(subparser)
    if first not in COMMANDS:
        _module(SERVICE).add_arguments(parser)
        add_words(parser)
    return parser


class _Version(argparse.Action):
    """Prints the versions; reads them only then, since that takes longer than argparse."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from .versions import version_lines  # noqa: PLC0415

        sys.stdout.write("".join(f"{line}\n" for line in version_lines()))
        parser.exit()
