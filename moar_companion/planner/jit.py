"""The jit policy of the project, and the types of its kernels.

Each kernel has one signature. It is compiled or loaded at its first call, or before (`compiling`).
No kernel is compiled in flight, and code without kernels does not import the compiler. `nogil` (a
plan never delays the streaming loop), `cache` (compiled once per machine), no `fastmath` (costs are
compared with an oracle). The cache checks a kernel's own file alone. Constants, layouts of named
tuples and called kernels may come from other files: the name in the cache depends on them.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from types import CodeType
from typing import Any, TypeVar

_Function = TypeVar("_Function", bound=Callable[..., object])


@dataclass(frozen=True, slots=True, kw_only=True)
class Type:
    """A type of kernels. name: in digests, with all fields in it. make: numba's own."""

    name: str
    make: Callable[[], Any]


def _named(name: str) -> Type:
    return Type(name=name, make=lambda: getattr(_numba(), name))


BOOL, F8 = _named("boolean"), _named("float64")
I8, I4, U4, U1 = _named("int64"), _named("int32"), _named("uint32"), _named("uint8")
none = _named("none")


def read(scalar: Type, dimensions: int = 1) -> Type:
    """The type of an array that a kernel reads."""
    return Type(
        name=f"read {dimensions} {scalar.name}",
        make=lambda: _numba().types.Array(scalar.make(), dimensions, "C", readonly=True),
    )


def written(scalar: Type, dimensions: int = 1) -> Type:
    """The type of an array that a kernel writes, or makes."""
    return Type(
        name=f"written {dimensions} {scalar.name}",
        make=lambda: _numba().types.Array(scalar.make(), dimensions, "C"),
    )


def several(*types: Type) -> Type:
    """The type of several results."""
    return Type(
        name=str([each.name for each in types]),
        make=lambda: _numba().types.Tuple([each.make() for each in types]),
    )


def fields(named_tuple: Any, *types: Type) -> Type:
    """The type of a named tuple."""
    names = [each.name for each in types]
    return Type(
        name=f"{named_tuple.__name__} {list(zip(named_tuple._fields, names, strict=True))}",
        make=lambda: _numba().types.BaseTuple.from_types(
            [each.make() for each in types], named_tuple
        ),
    )


class Kernel:
    """A compiled function, which is made ready at its first call, or by `ready`.

    Two threads that do so at once do it twice, one after the other (the compiler has a lock).
    """

    def __init__(
        self, function: Any, answer: Type, arguments: tuple[Type, ...], *, helper: bool
    ) -> None:
        self.is_helper = helper or function.__name__.startswith("_")
        """True: only kernels call it, and their machine code contains it."""
        function.__qualname__ += f"_{_taken_in(function, answer, *arguments)}"
        self.py_func = function
        self._answer = answer
        self._arguments = arguments

    def __call__(self, *arguments: Any) -> Any:
        """The answer of the compiled function."""
        return self.ready(*arguments)

    @property
    def source(self) -> tuple[object, ...]:
        """Name, types and instructions of the kernel.

        The name has the digest of the constants and kernels that it uses.
        """
        types = [each.name for each in (self._answer, *self._arguments)]
        return self.py_func.__qualname__, types, _instructions(self.py_func.__code__)

    @cached_property
    def ready(self) -> Any:
        """Numba's dispatcher, with the machine code: from the cache, or compiled now."""
        dispatcher = self._dispatcher
        dispatcher.compile(self._signature)
        dispatcher.disable_compile()
        return dispatcher

    @cached_property
    def entry(self) -> Callable[..., Any]:
        """The machine code itself."""
        (compiled,) = self.ready.overloads.values()
        entry: Callable[..., Any] = compiled.entry_point
        return entry

    @property
    def has_cache(self) -> bool:
        """True if there is a folder in which machine code can be kept."""
        return self._cache_file is not None

    @property
    def is_cached(self) -> bool:
        """True if the cache has machine code of this source for this processor."""
        file = self._cache_file
        if file is None:
            return False
        # Keys are (signature, processor, hash of the source).
        processor = self._dispatcher.targetctx.codegen().magic_tuple()
        return any(key[1] == processor for key in file._load_index())  # noqa: SLF001

    @property
    def _cache_file(self) -> Any:
        """Numba's index of the cache; numba's public interface only loads from it."""
        return getattr(self._dispatcher._cache, "_cache_file", None)  # noqa: SLF001

    @cached_property
    def _dispatcher(self) -> Any:
        compiled = partial(
            _numba().njit,
            nogil=True,
            error_model="numpy",
            # The entry points for C and for Python would take a tenth of the compile time.
            no_cfunc_wrapper=True,
            no_cpython_wrapper=self.is_helper,
        )
        try:
            return compiled(cache=True)(self.py_func)
        except RuntimeError:  # there is no folder that may be written: it is compiled each time
            return compiled()(self.py_func)

    @property
    def _signature(self) -> Any:
        arguments = [each.make() for each in self._arguments]
        return _numba().core.typing.signature(self._answer.make(), *arguments)


KERNELS: list[Kernel] = []
"""All kernels of the imported modules, in order."""


def release_bitcode() -> None:
    """Frees the bitcode of kernels from the cache, once all are loaded.

    Only the compilation of a kernel that calls one of them needs it, and raises RuntimeError then.
    """
    kernels = [kernel for kernel in KERNELS if not kernel.is_helper]
    if all("ready" in vars(kernel) for kernel in kernels):
        for kernel in kernels:
            for compiled in kernel.ready.overloads.values():
                compiled.library._shared_module = None  # noqa: SLF001 - numba offers no other way


def jit(answer: Type, *arguments: Type, helper: bool = False) -> Callable[[_Function], _Function]:
    """Make a function a kernel for these types. helper: only kernels of other files call it."""

    def decorator(function: _Function) -> _Function:
        kernel: Any = Kernel(function, answer, arguments, helper=helper)
        KERNELS.append(kernel)
        made: _Function = kernel
        return made

    return decorator


@cache
def _numba() -> Any:
    """The compiler; its import takes longer than all other imports together."""
    import numba  # noqa: PLC0415

    _load_without_blas()

    @numba.extending.typeof_impl.register(Kernel)  # type: ignore[untyped-decorator]
    def type_of(kernel: Kernel, context: Any) -> Any:
        """Numba's type of a kernel that another one calls."""
        return numba.extending.typeof_impl(kernel.ready, context)

    return numba


def _load_without_blas() -> None:
    """Load numba's arrays without the search for a BLAS, which imports all of scipy.linalg.

    That import takes as long as numba itself. No kernel multiplies matrices; other code that does
    searches for a BLAS when it is compiled.
    """
    from numba.np import linalg  # noqa: PLC0415

    def ensure_blas() -> None:
        raise ImportError

    ensure_usual_blas, linalg.ensure_blas = linalg.ensure_blas, ensure_blas
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ensure_usual_blas


def _taken_in(function: Any, *types: Type) -> str:
    """Digest of the constants and kernels that a kernel and its callees use."""
    named: list[Any] = [function.__globals__.get(name) for name in function.__code__.co_names]
    taken = [
        [each.name for each in types],
        [each for each in named if isinstance(each, (int, float))],
        [each.source for each in named if isinstance(each, Kernel)],
    ]
    return hashlib.sha256(repr(taken).encode()).hexdigest()[:12]


def _instructions(code: CodeType) -> tuple[object, ...]:
    """Instructions and constants of a function, the same in each process."""
    constants = [
        _instructions(each) if isinstance(each, CodeType) else each for each in code.co_consts
    ]
    return code.co_code, code.co_names, constants


def direct(kernel: Any) -> Callable[..., Any]:
    """A kernel's compiled entry, for calls from Python without a lookup of types.

    The caller guarantees the types: arrays must be contiguous.
    """

    def call(*arguments: Any) -> Any:
        return kernel.entry(*arguments)

    return call
