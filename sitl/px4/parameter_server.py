"""The parameter protocol: lists, reads and sets, paced like PX4's."""

from collections.abc import Callable
from typing import Any, Final

from sitl.px4.parameters import NAME_LENGTH, Parameters, decode
from sitl.wire import layout

_PER_TICK: Final = 2
"""Values of a list sent per tick of 10 ms, about PX4's pace on a fast link."""


class ParameterServer:
    """Answers parameter messages; lists drain through `due`."""

    def __init__(self, parameters: Parameters, apply: Callable[[str, float], None]) -> None:
        """`apply` sets a value and lets it act; KeyError or ValueError refuse it."""
        self._parameters = parameters
        self._apply = apply
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
        if kind == "PARAM_SET":
            kind_here = table[self._parameters.index[name]].type
            if message.param_type == kind_here:
                try:
                    self._apply(name, decode(message.param_value, message.param_type))
                except ValueError:
                    return [self._value(name)]
        return [self._value(name)]

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

    def _value(self, name: str) -> bytes:
        value, kind = self._parameters.encoded(name)
        return layout("PARAM_VALUE").payload(
            param_value=value,
            param_count=len(self._parameters.table),
            param_index=self._parameters.index[name],
            param_id=name.encode()[:NAME_LENGTH],
            param_type=kind,
        )
