"""Parameters of an autopilot: their names and units in each release, and what counts unknown. Pure.

The table of each autopilot is in its file. The key of a row is the name in the newest release; the
value is kept in that release's unit. `mavlink/parameters` translates what arrives; all other code
uses keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

Release = tuple[int, int, int]
"""Major, minor and patch version of a firmware."""


class Name(NamedTuple):
    """Name of a parameter in the releases from `since` on; times `scale` its value is ours."""

    name: str
    since: Release = (0, 0, 0)
    scale: float = 1.0


class Parameter(NamedTuple):
    """Row of a table.

    default: the autopilot's. cautious: counts while the autopilot does not report the parameter;
    None: no value is the most cautious one, and no inspection begins. An escape, which has to be
    flown, then counts with the default. names: the newest first; empty: the key in all releases.
    forbids: the cautious value, too, permits no inspection; then the parameter is the reason.
    """

    key: str
    default: float
    cautious: float | None = None
    names: tuple[Name, ...] = ()
    absent: float | None = None
    """What holds in releases before the first name; None: it is in all of them."""
    forbids: bool = False

    @property
    def denies(self) -> bool:
        """True if no inspection begins while the parameter is not reported."""
        return self.cautious is None or self.forbids

    @property
    def all_names(self) -> tuple[Name, ...]:
        """Its names, the newest first."""
        return self.names or (Name(self.key),)


def keys(rows: Iterable[Parameter]) -> tuple[str, ...]:
    """Keys of rows."""
    return tuple(row.key for row in rows)


class Parameters(Mapping[str, float | None]):
    """Values by key, in our units. None: never reported; absent: still awaited.

    A view: it shows later changes of the mappings.
    """

    def __init__(
        self, values: Mapping[str, float | None], names: Mapping[str, Name] | None = None
    ) -> None:
        self._values = values
        self._names = {} if names is None else names

    def __getitem__(self, key: str) -> float | None:
        return self._values[key]

    def __contains__(self, key: object) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def as_of_now(self) -> Parameters:
        """A copy, which shows no later change."""
        return Parameters(dict(self._values), dict(self._names))

    def are(self, earlier: Parameters) -> bool:
        """True if values and names are those of an earlier copy."""
        return self._values == earlier._values and self._names == earlier._names

    def called(self, key: str) -> Name:
        """Name and unit in the connected firmware; those of the newest release without one."""
        return self._names.get(key, Name(key))

    def shown(self, keys: Iterable[str]) -> tuple[str, ...]:
        """Names in the connected firmware, for texts."""
        return tuple(self.called(key).name for key in keys)

    def with_silence(self, keys: Iterable[str]) -> Parameters:
        """These, with None (never reported) for the keys that are awaited."""
        return Parameters({**dict.fromkeys(keys), **self._values}, self._names)


class ParameterTable:
    """Parameters of an autopilot that the flight, or `check`, reads."""

    def __init__(self, rows: Iterable[Parameter] = ()) -> None:
        self._rows = {row.key: row for row in rows}
        self._by_name = {
            name.name: (row.key, name) for row in self._rows.values() for name in row.all_names
        }

    def row(self, key: str) -> Parameter:
        """Row of a key; KeyError without one."""
        return self._rows[key]

    def other_names(self, key: str, name: str) -> tuple[str, ...]:
        """Further names of a parameter, in other releases."""
        names = self._rows[key].all_names if key in self._rows else ()
        return tuple(other.name for other in names if other.name != name)

    @property
    def defaults(self) -> dict[str, float]:
        """The autopilot's default values by key."""
        return {key: row.default for key, row in self._rows.items()}

    def ours(self, name: str) -> tuple[str, Name]:
        """Key of a name that arrived, and the name's row; a name without a row is its own key."""
        return self._by_name.get(name, (name, Name(name)))

    def names(self, key: str, release: Release) -> tuple[Name, ...]:
        """Names of a parameter, that of the release first; the others follow, for builds between.

        A development build has the names of its day, whatever version it reports.
        """
        names = self._rows[key].all_names if key in self._rows else (Name(key),)
        return tuple(sorted(names, key=lambda name: release < name.since))

    def absent(self, key: str, release: Release) -> float | None:
        """Value of a parameter that a release does not have; None if it has it."""
        row = self._rows.get(key)
        if row is None or row.absent is None or release >= row.all_names[-1].since:
            return None
        return row.absent

    def values(
        self, wanted: Iterable[str], parameters: Mapping[str, float | None]
    ) -> dict[str, float]:
        """Values of parameters that are not awaited; for those never reported what counts then."""
        values: dict[str, float] = {}
        for key in wanted:
            value, row = parameters[key], self._rows[key]
            if value is None:
                value = row.default if row.cautious is None else row.cautious
            values[key] = value
        return values
