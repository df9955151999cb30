"""Questions of a command: each has an option, and a default where there is a plausible one.

An option that is given answers its question. With `--yes` the default does; else a person at the
terminal. Where neither can, an InputError names the option.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TypeVar

from ..errors import InputError
from .outputs import print_text

Answer = TypeVar("Answer")


class Questions:
    """Answers by options, defaults, or a person at the terminal. yes: takes all defaults."""

    def __init__(self, *, yes: bool) -> None:
        self._yes = yes

    @property
    def has_person(self) -> bool:
        """True if a person answers at the terminal."""
        return not self._yes and sys.stdin is not None and sys.stdin.isatty()

    def ask(
        self,
        option: str,
        question: str,
        given: Answer | None,
        parse: Callable[[str], Answer],
        default: Answer | None = None,
        shown: str | None = None,
    ) -> Answer:
        """The answer to one question. parse: text to answer, InputError for a wrong one.

        given: the option's value. default: None where there is no plausible one. shown: text of
        the default.
        """
        if given is not None:
            return given
        if not self.has_person:
            if default is not None:
                return default
            raise InputError(option, "", f"is missing: {question}")
        suffix = "" if default is None else f" [{default if shown is None else shown}]"
        while True:
            text = self._typed(f"{question} ({option}){suffix}: ")
            if not text and default is not None:
                return default
            try:
                return parse(text)
            except InputError as error:
                print_text(f"{error}\n")

    def confirmed(self, question: str, *, given: bool) -> bool:
        """True for a yes: by the option, or by a person; never by a default."""
        if given or not self.has_person:
            return given
        return self._typed(f"{question} [y/N]: ").lower() in {"y", "yes"}

    def _typed(self, prompt: str) -> str:
        try:
            return input(prompt).strip()
        except EOFError:
            raise KeyboardInterrupt from None
