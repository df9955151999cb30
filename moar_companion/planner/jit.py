"""The jit policy of the project, and the types of its kernels.

Eager signatures (no compilation in flight), `nogil` (a plan never holds up the streaming loop),
`cache` (compiled once per machine), no `fastmath` (costs are compared with an oracle). A kernel
and what it calls stand in one file, for the cache knows a kernel by its own file alone; constants
and layouts of named tuples may be another's, as they are in the name that it is kept under.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, TypeVar

import numba as nb

_Function = TypeVar("_Function", bound=Callable[..., object])

BOOL, F8 = nb.boolean, nb.float64
I8, I4, U4, U1 = nb.int64, nb.int32, nb.uint32, nb.uint8
none = nb.none


def read(scalar: object, dimensions: int = 1) -> object:
    """The type of an array that a kernel reads."""
    return nb.types.Array(scalar, dimensions, "C", readonly=True)


def written(scalar: object, dimensions: int = 1) -> object:
    """The type of an array that a kernel writes, or makes."""
    return nb.types.Array(scalar, dimensions, "C")


def several(*types: object) -> object:
    """The type of several answers."""
    return nb.types.Tuple(types)


def fields(named_tuple: type, *types: object) -> object:
    """The type of a named tuple."""
    return nb.types.BaseTuple.from_types(types, named_tuple)


def jit(answer: object, *arguments: object) -> Callable[[_Function], _Function]:
    """Compile a kernel for these types."""
    compiled: Callable[[_Function], _Function] = nb.njit(
        nb.core.typing.signature(answer, *arguments), nogil=True, cache=True, error_model="numpy"
    )

    def decorator(kernel: _Function) -> _Function:
        kernel.__qualname__ += f"_{_taken_in(kernel, arguments)}"
        return compiled(kernel)

    return decorator


def _taken_in(kernel: Callable[..., object], types: tuple[object, ...]) -> str:
    """A digest of what a kernel takes from other files, and of what those it calls take."""
    named: list[Any] = [kernel.__globals__.get(name) for name in kernel.__code__.co_names]
    taken = [
        [getattr(each, "fields", None) for each in types],
        [each for each in named if isinstance(each, (int, float))],
        [each.py_func.__qualname__ for each in named if hasattr(each, "py_func")],
    ]
    return hashlib.sha256(repr(taken).encode()).hexdigest()[:12]


def direct(kernel: Any) -> Callable[..., Any]:
    """A kernel's compiled entry, for calls from Python that have no time to look up types.

    The caller answers for them: arrays are taken to be contiguous.
    """
    (compiled,) = kernel.overloads.values()
    entry: Callable[..., Any] = compiled.entry_point
    return entry
