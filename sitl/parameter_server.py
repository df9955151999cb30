"""The parameter protocol: lists, reads and sets, paced like an autopilot's."""

import contextlib
from collections.abc import Callable
from typing import Any, Final

from sitl.parameters import NAME_LENGTH, Parameters
from sitl.wire import layout

_PER_TICK: Final = 2
"""Values of a list sent per tick of 10 ms, about the pace of both autopilots on a fast link."""


class ParameterServer:
    """Answers parameter messages; lists drain through `due`."""

    def __init__(
        self,
        parameters: Parameters,
        apply: Callable[[str, float], None],
        *,
        any_type: bool = False,
        index_by_name: int | None = None,
    ) -> None:
        """`apply` sets a value and lets it act; KeyError or ValueError refuse it.

        `any_type`: a set need not name the parameter's type. `index_by_name`: the index in
        answers to requests by name; None: the parameter's own.
        """
        self._parameters = parameters
        self._apply = apply
        self._any_type = any_type
        self._index_by_name = index_by_name
        self._lists: dict[str, int] = {}

    def answer(self, link: str, message: Any) -> list[bytes]:
        """Return the PARAM_VALUE payloads that answer at once."""
        kind = message.get_type()
        table = self._parameters.table
        if kind == "PARAM_REQUEST_LIST":
            self._lists[link] = 0
            return []
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            if message.param_index >= len(table):
                return []
            return [self._value(table[message.param_index].name)]
        name = message.param_id
        if name not in self._parameters.index:
            return []
        if kind == "PARAM_SET" and (
            self._any_type or message.param_type == self._parameters.type(name)
        ):
            with contextlib.suppress(ValueError):
                self._apply(name, self._parameters.decoded(message.param_value, message.param_type))
        return [self._value(name, self._index_by_name)]

    def due(self, link: str) -> list[bytes]:
        """Return the next payloads of a list that is being sent."""
        position = self._lists.get(link)
        if position is None:
            return []
        table = self._parameters.table
        part = table[position : position + _PER_TICK]
        if position + _PER_TICK >= len(table):
            del self._lists[link]
        else:
            self._lists[link] = position + _PER_TICK
        return [self._value(parameter.name) for parameter in part]

    def _value(self, name: str, index: int | None = None) -> bytes:
        value, kind = self._parameters.encoded(name)
        return layout("PARAM_VALUE").payload(
            param_value=value,
            param_count=len(self._parameters.table),
            param_index=self._parameters.index[name] if index is None else index,
            param_id=name.encode()[:NAME_LENGTH],
            param_type=kind,
        )
