"""Settings of numba, which compiles the kernels.

A kernel gets its arrays as one vector of addresses: numba looks at every array it is given, which for two dozen of
them costs more than what the kernel does. Addresses are safe here because the memory of a plan never moves:
:class:`Memory` keeps the arrays it has taken the addresses of.

Machine code is kept on disk, beside the sources or where numba finds a folder that may be written. Numba looks at the
file of a kernel, not at the files of the kernels it has taken in: :func:`digest` is of all of them. What cannot be read
there is compiled, and what cannot be written is not kept.
"""

from __future__ import annotations

import ast
import ctypes
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, partial
from hashlib import sha256
from inspect import get_annotations
from math import prod
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Generic, TypeVar, cast, final, get_type_hints

import numba
import numpy as np
from llvmlite.binding import Linkage, add_symbol
from llvmlite.ir import FunctionType, IntType
from numba.core import caching, codegen, event
from numba.extending import intrinsic, models, register_model
from numba.np.arrayobj import np_cfarray
from numpy.typing import NDArray

__all__ = [
    "Layout", "Memory", "call_at", "callee", "carray", "copy", "digest", "entry", "floats", "integers", "kernel",
    "part", "place_of", "small_kernel",
]  # fmt: skip

# All that a compiler may do with sums but to suppose that numbers are finite: a certificate must see NaN.
_FAST = {"reassoc", "nsz", "arcp", "contract"}
#: Files of kernels, of the library or of a user, and how the names of their functions begin in machine code.
_OURS: dict[str, str] = {}
_numba: Any = numba
_types: Any = numba.types
_events: Any = event
_F = TypeVar("_F", bound=Callable[..., Any])


def _own_copies(library: Any) -> None:
    """Let what is linked into a library of machine code be its own, and make it ready.

    Numba links a kernel into those that call it under one name, and each copy is optimised with its caller. Of copies
    with one name that are loaded all but the first are left out: last digits would depend on what was loaded before,
    and be others where code is compiled than where it is read from disk.
    """
    module, ours = library._final_module, tuple(_OURS.values())
    if library._shared_module is None and any(function.name.startswith(ours) for function in module.functions):
        library._shared_module = shared = module.clone()  # what is linked into others
        for function in shared.functions:
            if not function.is_declaration and function.linkage is _LINKAGE.external:
                function.linkage = _LINKAGE.linkonce_odr
        for function in module.functions:
            if function.linkage is _LINKAGE.linkonce_odr and function.name.startswith(ours):
                function.linkage = _LINKAGE.internal
    _make_ready(library)


_LINKAGE: Any = Linkage
_LIBRARY: Any = codegen.JITCodeLibrary
_make_ready = _LIBRARY._finalize_final_module
_LIBRARY._finalize_final_module = _own_copies


def _kept(make: Callable[..., Any], function: Callable[..., Any], **more: Any) -> Any:
    if function.__module__:  # it stands in a file
        parts = (f"{len(part)}{part}" for part in function.__module__.split("."))
        _OURS[function.__code__.co_filename] = f"_ZN{''.join(parts)}"
    # Kernels make no arrays, so that there are no references to count: a tenth less to compile.
    how = {"fastmath": _FAST, "error_model": "numpy", "_nrt": False, **more}
    try:
        return make(cache=True, **how)(function)
    except RuntimeError:  # no folder to keep machine code in may be written
        return make(**how)(function)


def _made(function: _F, **more: bool) -> Any:
    made = _kept(_numba.njit, function, nogil=True, **more)
    if _numba.config.DISABLE_JIT:
        return made
    # Else a kernel that somebody gives the number 0, written as such, would be compiled once more for 0 alone.
    typed = made.get_call_template
    made.get_call_template = lambda given, named: typed([_types.unliteral(one) for one in given], named)
    return made


def kernel(function: _F) -> _F:
    """A function that other kernels call."""
    return cast(_F, _made(function))


def small_kernel(function: _F) -> _F:
    """A kernel of a few lines that is written into each of its callers."""
    # Without what Python would need to call it, which takes a third of the time to compile.
    return cast(_F, _made(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True))


@final
class _Symbol(_types.ExternalFunction):  # type: ignore[misc]
    """A function of machine code by its name, for other kernels; and for Python."""

    def __init__(self, made: Any, name: str, signature: Any) -> None:
        super().__init__(name, signature)
        self._made = made

    def __call__(self, *arguments: Any) -> Any:
        return self._made.ctypes(*arguments)

    @property
    def place(self) -> int:
        """Where its machine code begins."""
        return int(self._made.address)


register_model(_Symbol)(models.OpaqueModel)


def part(function: _F) -> _F:
    """A kernel of numbers, an address among them, that is compiled by itself and that others call by its name.

    What it calls stands before it. A kernel of another kind is linked into its callers, and compiled again with each of
    them: that is most of the time that compiling takes. Under ``NUMBA_BOUNDSCHECK=1`` this one is, too, since errors do
    not come out of a function that is called by its name.
    """
    if _numba.config.DISABLE_JIT:
        return function
    if _numba.config.BOUNDSCHECK:
        return kernel(function)
    kinds = {"int": _types.int64, "float": _types.float64, "bool": _types.int64, "None": _types.void}
    *given, answer = (kinds[kind] for kind in get_annotations(function).values())
    signature = answer(*given)
    made = _kept(partial(_numba.cfunc, signature), function)
    name = f"{function.__module__}.{function.__qualname__}"
    add_symbol(name, made.address)
    return cast(_F, _Symbol(made, name, signature))


def place_of(made: Callable[[int], int]) -> int:
    """Where the machine code of a part begins, for :func:`call_at`; 0 where it has none, for a debugger."""
    return made.place if isinstance(made, _Symbol) else 0


def entry(function: _F) -> _F:
    """A kernel of numbers that Python calls; compiled here and now, or read from disk, and not in a tick.

    Under ``NUMBA_DISABLE_JIT=1`` kernels stay Python, for a debugger.
    """
    made = _made(function)
    if _numba.config.DISABLE_JIT:
        return function
    made.compile((_types.int64,) * function.__code__.co_argcount)
    (compiled,) = made.overloads.values()
    return cast(_F, compiled.entry_point)  # no look at the types of its arguments, which numba takes at each call


#: For a debugger: callees by what stands for their address.
_CALLEES: dict[int, Callable[[int], int]] = {}


@final
class callee:  # a decorator
    """A kernel of one address that other kernels ``call_at`` where it stands; compiled when it is first asked for that.

    So that of many kernels a machine compiles those that it uses. It returns 1: 0 is what an error comes out as.
    """

    def __init__(self, function: Callable[[int], int]) -> None:
        self._function = function

    @cached_property
    def _made(self) -> Any:
        return _kept(partial(_numba.cfunc, "int64(int64)"), self._function)

    @cached_property
    def place(self) -> int:
        """Where the machine code stands."""
        if _numba.config.DISABLE_JIT:
            _CALLEES[id(self)] = self._function
            return id(self)
        return int(self._made.address)

    def __call__(self, at: int) -> int:
        return int(self._function(at) if _numba.config.DISABLE_JIT else self._made.ctypes(at))


@final
class _Teller(_events.Listener):  # type: ignore[misc]
    """Says once on a terminal that machine code is being made."""

    def __init__(self) -> None:
        self._has_told = sys.stderr is None or not sys.stderr.isatty()  # None: a service has closed it

    def on_start(self, event: Any) -> None:
        if not self._has_told:
            self._has_told = True
            print("compiling for this processor, once: about half a minute", file=sys.stderr)

    def on_end(self, event: Any) -> None:
        """Nothing is said then."""


_events.register("numba:compile", _Teller())


_PACKAGE = Path(__file__).parent
#: Kernels take in numbers of these, and are compiled by one of them.
_MADE_OF = "tolerances.py", "compiled.py", "stack/kernel_rows.py"
_TAKEN_IN = re.compile(rb"^from wbc\.([\w.]+\.compiled\.\w+) import", re.MULTILINE)


@cache
def digest(source: Path, package: Path = _PACKAGE) -> bytes:
    """Of the text that goes into the machine code of a file of kernels: its own and of all that it takes in.

    A file that is none of the library's may import as it likes: it counts as taking in every kernel of the library, and
    all files of its folder that it imports.
    """
    library = package, package.with_name("tasks")
    if any(folder in source.parents for folder in library):
        text = source.read_bytes()
        kernels = (package / f"{name.decode().replace('.', '/')}.py" for name in _TAKEN_IN.findall(text))
        parts = [text, *(digest(one, package) for one in kernels)]
    else:
        files = _beside(source, set()).union(*(folder.rglob("compiled/*.py") for folder in library))
        parts = [file.read_bytes() for file in sorted(files)]
    return sha256(b"".join([*parts, *((package / name).read_bytes() for name in _MADE_OF)])).digest()


def _beside(source: Path, found: set[Path]) -> set[Path]:
    """A file of Python, and those of its folder that it imports; added to those ``found``."""
    if source.suffix == ".py" and source.is_file() and source not in found:
        found.add(source)
        for node in ast.walk(ast.parse(source.read_bytes())):
            if isinstance(node, ast.Import | ast.ImportFrom):
                for name in (getattr(node, "module", None) or "", *(alias.name for alias in node.names)):
                    _beside(source.with_name(f"{name.rpartition('.')[2]}.py"), found)
    return found


def _compared(kind: Any) -> None:
    """Let what numba keeps of kernels be compared with all that they are made of, wherever it is kept."""
    of_file = kind.get_source_stamp

    def stamp(locator: Any) -> Any:
        file = locator._py_file
        return (of_file(locator), digest(Path(file))) if file in _OURS else of_file(locator)

    kind.get_source_stamp = stamp


_LOCATORS: Any = caching._CacheLocator
for _kind in _LOCATORS.__subclasses__():
    _compared(_kind)


_FILE: Any = caching.IndexDataCacheFile


class _Checked(_FILE):  # type: ignore[misc]
    """Machine code with what it is of. The index is written before it, and numbers files: where another process writes
    meanwhile, or the disk is full, it can speak of code of other types, or of a version before."""

    @property
    def _is_ours(self) -> bool:
        stamp = self._source_stamp
        return isinstance(stamp, tuple) and isinstance(stamp[-1], bytes)

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (self._source_stamp, key, data) if self._is_ours else data)

    def load(self, key: Any) -> Any:
        found = super().load(key)
        if found is None or not self._is_ours:
            return found
        *of, data = found
        return data if of == [self._source_stamp, key] else None


vars(caching)["IndexDataCacheFile"] = _Checked


def _ensure_folder(locator: Any) -> None:
    """Numba's own, but where nobody has a home: there it would make a folder called ~ in that of the process."""
    if locator._py_file in _OURS and locator.get_cache_path().startswith("~"):
        raise FileNotFoundError("there is no home")
    _make_folder(locator)


_make_folder = _LOCATORS.ensure_cache_path
_LOCATORS.ensure_cache_path = _ensure_folder


@contextmanager
def _or_none(cache: Any) -> Iterator[None]:
    """Around what numba reads and writes of one kernel: a full disk, or a file that is broken, leaves it compiled."""
    try:
        with _guard(cache):
            yield
    except (OSError, EOFError, UnpicklingError, AttributeError, ImportError, IndexError) as cause:
        if cache._py_func.__code__.co_filename not in _OURS:
            raise
        if not isinstance(cause, OSError):
            with suppress(OSError):
                cache.flush()  # else the broken file would stay


_CACHE: Any = caching.Cache
_guard = _CACHE._guard_against_spurious_io_errors
_CACHE._guard_against_spurious_io_errors = _or_none


def _pointer(kind: Any, c_kind: Any) -> Any:
    if _numba.config.DISABLE_JIT:  # for a debugger
        return lambda address: ctypes.cast(int(address), ctypes.POINTER(c_kind))

    def to(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        signature: Any = _types.CPointer(kind)
        return signature(address), generate

    return intrinsic(to)


def _call_at() -> Any:
    if _numba.config.DISABLE_JIT:  # no part has a place then
        return lambda place, number: _CALLEES[int(place)](number) if place else 0

    def to(_context: Any, place: Any, number: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            number = IntType(64)
            return builder.call(
                builder.inttoptr(arguments[0], FunctionType(number, [number]).as_pointer()), arguments[1:]
            )

        return _types.int64(place, number), generate

    return intrinsic(to)


def _carray() -> Any:
    if _numba.config.DISABLE_JIT:
        return _numba.carray

    def array(_context: Any, pointer: Any, shape: Any) -> Any:
        dimensions = shape.count if isinstance(shape, _types.BaseTuple) else 1
        return _types.Array(pointer.dtype, dimensions, "C")(pointer, shape), np_cfarray

    return intrinsic(array)


#: In a kernel: ``call_at(place, number)`` is the answer to the number of the part (:func:`place_of`) or
#: :class:`callee` at that place.
call_at: Any = _call_at()
#: In a kernel: ``carray(floats(address), shape)`` is the array there, as ``carray(integers(address), shape)`` is.
carray: Any = _carray()
floats: Any = _pointer(_types.float64, ctypes.c_double)
integers: Any = _pointer(_types.int64, ctypes.c_int64)


@final
class Memory:
    """Addresses of float64 and int64 arrays, in the order given, for a kernel; the arrays are kept.

    Raises:
        ValueError: an array of another type.
    """

    def __init__(self, *arrays: NDArray[np.float64] | NDArray[np.int64]) -> None:
        for i, array in enumerate(arrays):
            if array.dtype not in (np.float64, np.int64):
                raise ValueError(f"array {i} is of {array.dtype}, neither float64 nor int64")
        self._arrays = arrays
        #: Of each array, and of this vector.
        self.addresses = np.array([array.__array_interface__["data"][0] for array in arrays], dtype=np.int64)
        self.address = int(self.addresses.__array_interface__["data"][0])


@small_kernel
def copy(numbers: NDArray[Any], out: NDArray[Any]) -> None:
    """In a kernel: as many numbers as ``out`` has. An assignment to a slice would need memory of its own."""
    for i in range(len(out)):
        out[i] = numbers[i]


_T = TypeVar("_T", bound=tuple[NDArray[Any], ...])


@final
class Layout(Generic[_T]):
    """The arrays that the fields of a NamedTuple name, with their shapes, for Python and for kernels.

    Args:
        kind: its fields are annotated ``Annotated[Mat, "rows, n + 1"]``, integers as Index. One is called ``sizes``.
        rules: names in the shapes, in an order in which each can be computed, of ``sizes`` and of those before.
    """

    def __init__(self, kind: type[_T], **rules: str) -> None:
        self._kind, self._rules = kind, rules
        hints: dict[str, Any] = get_type_hints(kind, include_extras=True)
        self._shapes = {name: f"({hint.__metadata__[0]},)" for name, hint in hints.items()}
        self._integers = {name for name, hint in hints.items() if hint.__origin__ == NDArray[np.int64]}
        names = list(self._shapes)
        views = [
            f"carray({'integers' if name in self._integers else 'floats'}(a[{i}]), {shape})"
            for i, (name, shape) in enumerate(self._shapes.items())
        ]
        known = "\n    ".join(f"{name} = {rule}" for name, rule in rules.items())
        scope: dict[str, Any] = {"carray": carray, "integers": integers, "floats": floats, "kind": kind}
        exec(f"def shapes(sizes):\n    {known}\n    return {', '.join(self._shapes.values())},", scope)
        exec(
            f"def views(at):\n    a = carray(integers(at), {len(names)})\n    sizes = {views[names.index('sizes')]}\n"
            f"    {known}\n    return kind({', '.join(views)})",
            scope,
        )
        self._shapes_for: Callable[[list[int]], tuple[tuple[int, ...], ...]] = scope["shapes"]
        #: In a kernel: the arrays at an address.
        self.views: Callable[[int], _T] = small_kernel(scope["views"])

    def arrays(self, sizes: NDArray[np.int64], **given: NDArray[Any]) -> _T:
        """The arrays given, which stand row by row in one piece, and zeros for all others."""
        made = {"sizes": sizes, **given}
        for name, size in zip(self._shapes, self._shapes_for(sizes.tolist()), strict=True):
            if name not in made:
                made[name] = np.zeros(size, np.int64 if name in self._integers else np.float64)
            assert made[name].size == prod(size), f"{name} has shape {made[name].shape}, not {size}"
            assert made[name].flags.c_contiguous, f"{name} does not stand row by row in one piece; a kernel reads it so"
        return self._kind(**made)
