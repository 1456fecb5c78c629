"""Compiled programs, in double precision, and how much effort goes into compiling them."""

import contextlib
import ctypes
import functools
import threading
import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from suas_jax.runtime.compiling import COMPILE_TIME, compiling
from suas_jax.runtime.program_store import Hole, KeptProgram, ProgramStore, filled_by


def give_back_freed_memory() -> None:
    """Let the C library give back what was freed, which it keeps until it is told.

    Loading or compiling a program takes for an instant what the program itself takes, hundreds
    of megabytes for a pad. Nothing happens where the C library is not GNU's.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)


# XLA's newer way of generating code for the CPU takes twice as long to compile these
# programs of many small operations, which then run no faster. From JAX 0.11.1 on there is no
# other, and an option that XLA doesn't know is an error.
OPTIONS: dict[str, bool | str] = (
    {"xla_cpu_use_fusion_emitters": False} if jax.__version_info__ < (0, 11, 1) else {}
)
# XLA hands products of matrices and sums to a library of kernels, which is set up for each of
# them. That pays for products: with sums, too, reading a deformed pad takes half as long again.
_PRODUCTS_ALONE: dict[str, bool | str] = {}
if jax.__version_info__ >= (0, 10, 2):
    _PRODUCTS_ALONE["xla_cpu_experimental_ynn_fusion_type"] = (
        "LIBRARY_FUSION_TYPE_INDIVIDUAL_DOT"
    )
# A program that runs once is done sooner without the compiler's own optimisation: half the
# compile time again, for twice the (much shorter) run time.
_OPTIONS_ONCE = {**OPTIONS, **_PRODUCTS_ALONE, "xla_backend_optimization_level": 0}
# A quarter more compile time than that, and loops that run as fast as they ever do: what is
# missing is vectorisation across lanes, which a single solve doesn't have.
_OPTIONS_ONCE_LONG = {**_OPTIONS_ONCE, "xla_backend_optimization_level": 1}


# Calls of LAPACK that JAX promises for no other version of itself; a kept program is only
# used with the version that made it.
_KEPT_CALLS = [
    jax.export.DisabledSafetyCheck.custom_call(name)
    for name in ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
]


class Compiled:
    """Programs by function, static settings and shapes, with the time they took to compile."""

    def __init__(self) -> None:
        self._programs: dict[Any, Callable[..., Any]] = {}
        self.store: ProgramStore | None = None  # keeps programs between runs
        self.loaded: set[Any] = set()  # keys of the programs that came from there
        self._compiling = threading.RLock()

    def run(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        once: bool = False,
        long: bool = False,
    ) -> Any:
        """Call a function made by `equinox.filter_jit`, compiled apart, and wait for it.

        Arguments that are not arrays are static. `once` says that the program is not expected
        to run many times, `long` that a single run is worth some optimisation.
        """
        leaves, structure = jax.tree.flatten(arguments)
        arrays = [x for x in leaves if eqx.is_array_like(x)]
        types = tuple(_type_of(x) if eqx.is_array_like(x) else x for x in leaves)
        key = (function, structure, types, once, long)
        if key not in self._programs:
            with self._compiling:  # two threads may ask for the same one
                if key not in self._programs:
                    return self._first(key, leaves)
        return jax.block_until_ready(self._programs[key](*arrays))

    def _first(self, key: Any, leaves: list[Any]) -> Any:
        """Compile a program, or load it, and call it."""
        *_, once, long = key
        arrays = [x for x in leaves if eqx.is_array_like(x)]
        options = (_OPTIONS_ONCE_LONG if long else _OPTIONS_ONCE) if once else OPTIONS
        begin = time.perf_counter()
        program = self._loaded_or_compiled(key, leaves, options)
        give_back_freed_memory()
        COMPILE_TIME.seconds += time.perf_counter() - begin
        found = jax.block_until_ready(program(*arrays))
        self._programs[key] = program
        if self.store is not None:
            self.store.settled()
        return found

    def run_or_trace(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a program made by `equinox.filter_jit`, or make it part of the one being traced.

        Numbers run it, tracers (of `jax.grad`, `jax.vmap`, a function that is compiled) don't.
        """
        if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arguments)):
            return function(*arguments)
        return self.run(function, *arguments)

    def forget(self) -> None:
        """Free the memory that programs take; those kept between runs stay on disk."""
        self._programs.clear()
        self.loaded.clear()

    def _loaded_or_compiled(
        self, key: Any, leaves: list[Any], options: dict[str, Any]
    ) -> Callable[..., Any]:
        """A program, to be called with the arrays alone."""
        function, structure, types, *_ = key
        arrays = [x for x in leaves if eqx.is_array_like(x)]
        name = kept = None
        if self.store is not None:
            described = jax.tree.unflatten(structure, types)
            name = self.store.name(function, described, options)
        if self.store is None or name is None:
            with compiling():
                return _anew(_Flat(function, leaves, structure), arrays, options)
        kept = self.store.load(name)
        if kept is not None:
            # A kept program that can't be compiled, whatever the reason, is traced after all.
            with contextlib.suppress(Exception):
                program = _compile(kept, arrays, options)
                self.loaded.add(key)
                return program
        flat = _Flat(function, leaves, structure)
        with compiling():
            try:
                jitted = jax.jit(flat)
                exported = jax.export.export(jitted, disabled_checks=_KEPT_CALLS)(*arrays)
            except (ValueError, NotImplementedError):  # has no portable form
                return _anew(flat, arrays, options)
            kept = KeptProgram(exported, flat.frame)
            self.store.save(name, kept)
            return _compile(kept, arrays, options)


def _anew(flat: "_Flat", arrays: list[Any], options: dict[str, Any]) -> Callable[..., Any]:
    compiled = jax.jit(flat).lower(*arrays).compile(compiler_options=options)
    return filled_by(compiled, flat.frame)


def _compile(
    kept: KeptProgram, arrays: list[Any], options: dict[str, Any]
) -> Callable[..., Any]:
    lowered = jax.jit(kept.exported.call).lower(*arrays)
    return filled_by(lowered.compile(compiler_options=options), kept.frame)


class _Flat:
    """A function of arrays alone that returns arrays alone."""

    def __init__(self, function: Callable[..., Any], leaves: list[Any], structure: Any) -> None:
        self._function = function
        self._leaves = leaves
        self._structure = structure
        self.frame: Any = None  # what it returned when it was traced, a `Hole` for each array

    def __call__(self, *arrays: Any) -> tuple[Any, ...]:
        given = iter(arrays)
        filled = [next(given) if eqx.is_array_like(x) else x for x in self._leaves]
        found = self._function(*jax.tree.unflatten(self._structure, filled))
        results, structure = jax.tree.flatten(found)
        holes = [Hole() if eqx.is_array(x) else x for x in results]
        self.frame = jax.tree.unflatten(structure, holes)
        return tuple(x for x in results if eqx.is_array(x))


def _type_of(x: Any) -> str:
    if isinstance(x, np.ndarray | jax.Array):  # what follows takes ten times as long
        return f"{x.dtype.name}{x.shape} {getattr(x, 'weak_type', False)}"
    array = jax.api_util.shaped_abstractify(x)
    return f"{array.dtype.name}{array.shape} {array.weak_type}"


COMPILED = Compiled()


class Float64Error(RuntimeError):
    """JAX computes in single precision, which is not enough to find an equilibrium."""


def require_float64() -> None:
    """Refuse to compute in single precision, JAX's own default.

    Raises Float64Error: float64 is off.
    """
    if jnp.result_type(float) != jnp.float64:
        raise Float64Error(
            "suas_jax computes in float64, which is off: call suas_jax.configure() first"
        )


P = ParamSpec("P")
R = TypeVar("R")


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of the model, such as `forward`, in half of JAX's usual time.

    As `equinox.filter_jit`: arrays are traced, everything else is static, and one program
    serves all arguments of the same shapes. Apply it last, so to the gradient itself
    (``jit(jax.grad(loss))``): inside another transformation the options that save the time
    have no effect. The function must be pure.

    Raises:
        Float64Error: when called, if float64 is off.
    """
    outermost = eqx.filter_jit(function, compiler_options=OPTIONS)  # type: ignore[call-overload]
    # JAX takes compiler options for the outermost program alone.
    inner = eqx.filter_jit(function)

    @functools.wraps(function)
    def compiled(*args: P.args, **kwargs: P.kwargs) -> R:
        require_float64()
        leaves = jax.tree.leaves((args, kwargs))
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
        found: R = (inner if traced else outermost)(*args, **kwargs)
        return found

    return compiled
