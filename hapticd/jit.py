"""The one door to Numba: typed decorators, memory fences, libc calls and C function pointers.

Everything compiled in hapticd goes through here, for three reasons:

* strict type checking: Numba ships no type stubs, so the decorators are wrapped once;
* caching: Numba's own on-disk cache does not notice that a *called* function in another file has changed, so the cache
  folder is keyed by a digest of every compiled source file that can be called;
* the servo thread's contract (no Python, no exceptions, ``error_model='numpy'``, GIL released) is stated in one place.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.compiler import Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.targetconfig import ConfigStack
from numba.extending import intrinsic
from numba.np.unsafe.ndarray import to_fixed_tuple

F = TypeVar("F", bound=Callable[..., Any])

_DAEMON_FOLDERS = (
    "hapticd/effects",
    "hapticd/plant",
    "hapticd/record",
    "hapticd/servo",
    "hapticd/stability",
    "drivers",
)
# The simulated hardware compiles against the plant alone: an edit on one side leaves the other side's code as it is.
FOLDERS = {
    "sim_hw": ("hapticd/effects", "hapticd/plant", "sim_hw"),
    "hapticd.gap.kernel": ("hapticd/effects", "hapticd/plant", "hapticd/gap/kernel"),
}

_ON_DEMAND = ("hapticd.plant.", "hapticd.effects.", "hapticd.gap.kernel.")
"""Rooms whose functions are compiled, or loaded, when they are first called. Those of the servo loop, the drivers and the
simulated hardware are at import: nothing of theirs may take a second once it runs. They bring what they call."""
_waiting: list[Callable[[], Any]] = []


@functools.cache
def _source_digest(folders: tuple[str, ...]) -> str:
    root = Path(__file__).parent.parent
    digest = hashlib.sha256(f"{numba.__version__}".encode())
    digest.update(Path(__file__).read_bytes())
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder(room: str = "") -> Path:
    """Folder of a room's compiled code: in ``$NUMBA_CACHE_DIR``, systemd's ``$CACHE_DIRECTORY``, or the user's cache."""
    digest = _source_digest(FOLDERS.get(room, _DAEMON_FOLDERS))
    for variable in ("NUMBA_CACHE_DIR", "CACHE_DIRECTORY"):
        if value := os.environ.get(variable):
            return Path(value.split(":")[0]) / f"hapticd-{digest}"
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "hapticd" / digest


numba.config.CACHE_DIR = str(cache_folder())


@contextlib.contextmanager
def _cached(function: Callable[..., Any]) -> Iterator[None]:
    """Point Numba at the right cache folder while it decorates a function: it asks only then."""
    before = numba.config.CACHE_DIR
    room = next((room for room in FOLDERS if function.__module__.startswith(f"{room}.")), "")
    numba.config.CACHE_DIR = str(cache_folder(room))
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def njit(
    signature: Any = None, *, inline: bool = False, counted: bool = True, reorder: bool = False
) -> Callable[[F], F]:
    """Compile a function without the GIL, cached on disk, with IEEE division semantics (no ZeroDivisionError).

    Args:
        signature: optional Numba signature; with one, the function is compiled, or loaded, at import; in a room that can
            wait, when it is first called. Without one, when compiled code that calls it is compiled.
        inline: make LLVM inline the function; an array argument costs seven words a call otherwise.
        counted: keep reference counts of arrays. A function that makes no array can do without: each array argument
            otherwise costs two atomic operations a call, several times the work of a servo tick in all.
        reorder: let LLVM sum in another order and fuse products with sums, so that it computes several terms of a loop at
            once. Infinity and not-a-number stay what they are.
    """
    options: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy", "boundscheck": False}
    if inline:
        options["forceinline"] = True
    if not counted:
        options["_nrt"] = False
    if reorder:
        options["fastmath"] = {"reassoc", "contract"}

    def decorate(function: F) -> F:
        waits = signature is not None and function.__module__.startswith(_ON_DEMAND) and not numba.config.DISABLE_JIT
        with _cached(function):
            compiled = numba.njit(None if waits else signature, **options)(function)
        return cast(F, _on_demand(compiled, signature) if waits else compiled)

    return decorate


def _on_demand(compiled: Any, signature: Any) -> Any:
    """A function that is compiled, or loaded, for its signature when Python or compiled code first calls it."""
    compile_for = compiled.compile

    def compile_once(_: Any = None) -> Any:
        with global_compiler_lock:
            for found in compiled.overloads.values():
                return found.entry_point
            defaults = Flags()
            defaults.nrt = True
            with ConfigStack().enter(defaults):  # or it takes over the options of a caller that is being compiled
                entry_point = compile_for(signature)
            compiled.disable_compile()
            return entry_point

    def compile_for_python(*arguments: Any) -> Any:
        entry_point = compile_once()
        if not compiled._search_new_conversions(*arguments):  # Numba asks each later call by itself
            compiled._explain_matching_error(*arguments)
        return entry_point

    compiled.compile, compiled._compile_for_args = compile_once, compile_for_python
    _waiting.append(compile_once)
    return compiled


def compile_all() -> None:
    """Compile, or load, all that was imported and waits to be called."""
    for compile_once in _waiting:
        compile_once()


def effect_term(function: F) -> F:
    """Compile a term of the catalogue: floats in, a float out, or a bool if it is annotated so; inlined."""
    result = "boolean" if function.__annotations__["return"] in (bool, "bool") else "float64"
    arguments = ", ".join(["float64"] * function.__code__.co_argcount)
    return njit(f"{result}({arguments})", inline=True)(function)


def cfunc(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to a C callback; ``.address`` is what a driver hands to the servo loop."""

    def decorate(function: Callable[..., Any]) -> Any:
        with _cached(function):
            return numba.cfunc(signature, nopython=True, cache=True, error_model="numpy")(function)

    return decorate


def effect_term_callback(function: Callable[..., float], leading: int, parameters: int) -> Any:
    """Compile a term from outside to a C callback ``double law(double, double, double, double, double *parameters)``.

    It is compiled anew in every process, in a fraction of a second: where its source is, and what that calls, is not known.

    Args:
        function: plain Python on floats and `math`.
        leading: how many of the four numbers it takes, the first ones.
        parameters: how many numbers it takes after them, from the array.

    Raises:
        numba.core.errors.NumbaError: Numba cannot compile it.
    """
    compiled = numba.njit(error_model="numpy")(function)
    double = types.float64

    def callback(a: float, b: float, c: float, d: float, pointer: Any) -> Any:
        return compiled(*(a, b, c, d)[:leading], *to_fixed_tuple(numba.carray(pointer, (parameters,)), parameters))

    signature = double(double, double, double, double, types.CPointer(double))
    return numba.cfunc(signature, nopython=True, error_model="numpy")(callback)


def _typed_intrinsic(function: Callable[..., Any]) -> Callable[..., Any]:
    """Type an intrinsic as it is called: without the typing context that its definition takes."""
    return cast(Callable[..., Any], intrinsic(function))


carray: Callable[..., Any] = numba.carray
"""An array over memory that a C pointer names, inside compiled code."""


@_typed_intrinsic
def fence_acquire(typingctx: Any) -> Any:
    """Acquire fence: loads after it see what a releasing writer stored before its fence."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.fence("acquire")
        return context.get_dummy_value()

    return types.void(), codegen


@_typed_intrinsic
def fence_release(typingctx: Any) -> Any:
    """Release fence: stores before it are visible to a reader that acquires after seeing a later store."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.fence("release")
        return context.get_dummy_value()

    return types.void(), codegen


@_typed_intrinsic
def atomic_load(typingctx: Any, array: Any, index: Any) -> Any:
    """``array[index]`` of a 1-D int64 array as an atomic acquire load (never cached in a register, never torn)."""
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.dtype == types.int64):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array_type, index_type = signature.args
        view = context.make_array(array_type)(context, builder, args[0])
        position = context.cast(builder, args[1], index_type, types.intp)
        pointer = cgutils.get_item_pointer(context, builder, array_type, view, [position], wraparound=False)
        return builder.load_atomic(pointer, "acquire", 8, typ=ir.IntType(64))

    return types.int64(array, types.intp), codegen


@_typed_intrinsic
def atomic_store(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """``array[index] = value`` of a 1-D int64 array as an atomic release store."""
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.dtype == types.int64):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array_type, index_type, value_type = signature.args
        view = context.make_array(array_type)(context, builder, args[0])
        position = context.cast(builder, args[1], index_type, types.intp)
        pointer = cgutils.get_item_pointer(context, builder, array_type, view, [position], wraparound=False)
        builder.store_atomic(context.cast(builder, args[2], value_type, types.int64), pointer, "release", 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.int64), codegen


def _read_modify_write(operation: str) -> Callable[..., Any]:
    """An intrinsic ``array[index] = operation(array[index], value)`` in one atomic step; gives the value before it."""

    def typed(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
        if not (isinstance(array, types.Array) and array.ndim == 1 and array.dtype == types.int64):
            return None

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            array_type, index_type, value_type = signature.args
            view = context.make_array(array_type)(context, builder, args[0])
            position = context.cast(builder, args[1], index_type, types.intp)
            pointer = cgutils.get_item_pointer(context, builder, array_type, view, [position], wraparound=False)
            number = context.cast(builder, args[2], value_type, types.int64)
            return builder.atomic_rmw(operation, pointer, number, "acq_rel")

        return types.int64(array, types.intp, types.int64), codegen

    return _typed_intrinsic(typed)


atomic_add = _read_modify_write("add")
"""``array[index] += value`` of a 1-D int64 array in one atomic step; gives the value before it."""
atomic_max = _read_modify_write("max")
"""``array[index] = max(array[index], value)`` of a 1-D int64 array in one atomic step; gives the value before it."""


@_typed_intrinsic
def call_driver(typingctx: Any, function: Any, state: Any, exchange: Any) -> Any:
    """Call ``int32 function(void *state, hapticd_exchange *exchange)`` through integer addresses (about 3 ns)."""
    signature = types.int32(types.int64, types.int64, types.int64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        prototype = ir.FunctionType(ir.IntType(32), [pointer, pointer])
        callee = builder.inttoptr(args[0], prototype.as_pointer())
        return builder.call(callee, [builder.inttoptr(args[1], pointer), builder.inttoptr(args[2], pointer)])

    return signature, codegen


@_typed_intrinsic
def call_effect_term(typingctx: Any, address: Any, a: Any, b: Any, c: Any, d: Any, array: Any, index: Any) -> Any:
    """Call an `effect_term_callback` by its address, with its parameters at ``array[index]`` and after (about 3 ns)."""
    double = types.float64
    signature = double(types.int64, double, double, double, double, array, types.intp)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number = ir.DoubleType()
        prototype = ir.FunctionType(number, [number] * 4 + [number.as_pointer()])
        callee = builder.inttoptr(args[0], prototype.as_pointer())
        view = context.make_array(signature.args[5])(context, builder, args[5])
        pointer = cgutils.get_item_pointer(context, builder, signature.args[5], view, [args[6]], wraparound=False)
        return builder.call(callee, [*args[1:5], pointer])

    return signature, codegen
