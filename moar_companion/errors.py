"""The two errors that reach a user, as one line; all other failures are values with a name."""

from __future__ import annotations

import importlib.util
import sys


class InputError(Exception):
    """A file, a key or an option that cannot be used.

    The message is one line that names the source (file or option), the key, the value and what
    is allowed. The command line prints it and exits with status 2.
    """

    def __init__(
        self, source: str, key: str, problem: str, *, parts: tuple[InputError, ...] = ()
    ) -> None:
        self.parts = parts or (self,)
        """The single findings, where one line summarises several."""
        self.source = source
        self.key = key
        self.problem = problem
        where = f"{source}: {key}" if key else source
        super().__init__(f"{where}: {problem}".replace("\n", " "))


class LinkError(Exception):
    """A link that cannot be opened or gives no answer; the message is one line. Exit status 1."""


def without_extra(source: str, key: str, module: str, extra: str) -> InputError:
    """The error of an option or a setting that needs a module of an extra."""
    remedy = f'{sys.executable} -m pip install "moar-companion[{extra}]"'
    if importlib.util.find_spec("pip") is None:
        remedy = f"not in this package, install from a checkout with the extra {extra}"
    return InputError(source, key, f"needs {module}: {remedy}")
