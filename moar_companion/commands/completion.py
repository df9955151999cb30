"""`moar-companion completion`: the script by which a shell completes the command line.

The shell runs the program at each completion, with the line in its environment: `complete` answers.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from typing import Any

from .options import refused

_SHELLS = ("bash", "zsh", "fish")
_WORDS = re.compile(r"[a-z_-]+(\|[a-z_-]+)+")
"""A metavar that lists all allowed words."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the shell."""
    parser.add_argument("shell", metavar="|".join(_SHELLS), type=_shell, help="the shell")


def run(arguments: argparse.Namespace) -> int:
    """Prints the script."""
    import argcomplete  # noqa: PLC0415

    from .cli import PROGRAM  # noqa: PLC0415

    sys.stdout.write(argcomplete.shellcode([PROGRAM], shell=arguments.shell) + "\n")
    return 0


def complete() -> None:
    """Answers the shell that asks for completions, and ends the process."""
    import argcomplete  # noqa: PLC0415

    from .cli import parser_for_completion  # noqa: PLC0415

    words = os.environ.get("COMP_LINE", "").split()
    first = words[1] if len(words) > 1 else ""
    argcomplete.autocomplete(parser_for_completion(first, add_words), always_complete_options=False)


def add_words(parser: argparse.ArgumentParser) -> None:
    """Adds the allowed words to the arguments of a parser that are no files."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list of them
        completed: Any = action
        if isinstance(action.metavar, str) and _WORDS.fullmatch(action.metavar):
            completed.completer = _Words(action.metavar.split("|"))
        elif action.dest == "target":
            completed.completer = _targets
        elif action.metavar is not None and action.metavar not in _FILES:
            completed.completer = _Words([])


_FILES = {"FILE", "SITE", "RECORDING", "DIR", "SOCKET"}


class _Words:
    """Completion by fixed words."""

    def __init__(self, words: list[str]) -> None:
        self._words = words

    def __call__(self, **_: object) -> list[str]:
        return self._words


def _targets(*, parsed_args: argparse.Namespace, **_: object) -> list[str]:
    """Names of the targets of the site that is named before; none without one."""
    from ..errors import InputError  # noqa: PLC0415
    from ..planner.site import Site  # noqa: PLC0415

    file = getattr(parsed_args, "site", None)
    try:
        return [] if file is None else [target.name for target in Site.load(file).targets]
    except InputError:
        return []


def _shell(text: str) -> str:
    if text not in _SHELLS:
        raise refused("SHELL", text, f"must be one of {', '.join(_SHELLS)}")
    return text
