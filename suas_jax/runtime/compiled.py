"""Compiled programs, and how much effort goes into compiling them."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from suas_jax.runtime.program_store import (
    Hole,
    ProgramStore,
    filled_by,
    self_contained,
    uncached,
)

# XLA's newer way of generating code for the CPU takes twice as long to compile these
# programs of many small operations, which then run no faster.
OPTIONS: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}
# A program that runs once is done sooner without the compiler's own optimisation: half the
# compile time again, for twice the (much shorter) run time.
_OPTIONS_ONCE = {**OPTIONS, "xla_backend_optimization_level": 0}


class Compiled:
    """Programs by function, static settings and shapes, with the time they took to compile.

    Attributes:
        seconds: spent on tracing, compiling and loading so far.
        store: where programs are kept between runs; nowhere if None.
        loaded: keys of the programs that came from there.
    """

    def __init__(self) -> None:
        self._programs: dict[Any, Callable[..., Any]] = {}
        self.loaded: set[Any] = set()
        self.seconds = 0.0
        self.store: ProgramStore | None = None

    def run(self, function: Callable[..., Any], *arguments: Any, once: bool = False) -> Any:
        """Call a function made by `equinox.filter_jit`, compiled apart, and wait for it.

        Args:
            function: the jitted function.
            arguments: its arguments; those that are no arrays are static.
            once: whether the program is not expected to run many times.
        """
        leaves, structure = jax.tree.flatten(arguments)
        arrays = [x for x in leaves if eqx.is_array_like(x)]
        shapes = tuple(np.shape(x) if eqx.is_array_like(x) else x for x in leaves)
        key = (function, structure, shapes, once)
        options = _OPTIONS_ONCE if once else OPTIONS
        if key not in self._programs:
            self._make(key, function, leaves, structure, options)
        try:
            return jax.block_until_ready(self._programs[key](*arrays))
        except jax.errors.JaxRuntimeError:
            if key not in self.loaded:
                raise
        # A kept program that can't be run, whatever the reason, is compiled after all.
        self._make(key, function, leaves, structure, options, load=False)
        return jax.block_until_ready(self._programs[key](*arrays))

    def _make(
        self,
        key: Any,
        function: Callable[..., Any],
        leaves: list[Any],
        structure: Any,
        options: dict[str, Any],
        load: bool = True,
    ) -> None:
        """Load or compile a program, to be called with the arrays alone."""
        begin = time.perf_counter()
        file = program = None
        if self.store is not None:
            types = [_type_of(x) if eqx.is_array_like(x) else x for x in leaves]
            described = jax.tree.unflatten(structure, types)
            file = self.store.file(function, described, options)
            program = self.store.load(file) if file is not None and load else None
        if program is not None:
            self.loaded.add(key)
        else:
            self.loaded.discard(key)
            flat = _Flat(function, leaves, structure)
            arrays = [x for x in leaves if eqx.is_array_like(x)]
            lowered = jax.jit(flat).lower(*arrays)
            # Libraries that are called from outside are not there when a program is loaded.
            if self.store is not None and file is not None and self_contained(lowered):
                with uncached():
                    compiled = lowered.compile(compiler_options=options)
                self.store.save(file, compiled, len(arrays), flat.frame)
            else:
                compiled = lowered.compile(compiler_options=options)
            program = filled_by(compiled, flat.frame)
        self._programs[key] = program
        self.seconds += time.perf_counter() - begin


class _Flat:
    """A function of arrays alone that returns arrays alone.

    Attributes:
        frame: what the function returned when it was traced, a `Hole` for each array.
    """

    def __init__(self, function: Callable[..., Any], leaves: list[Any], structure: Any) -> None:
        self._function = function
        self._leaves = leaves
        self._structure = structure
        self.frame: Any = None

    def __call__(self, *arrays: Any) -> tuple[Any, ...]:
        given = iter(arrays)
        filled = [next(given) if eqx.is_array_like(x) else x for x in self._leaves]
        found = self._function(*jax.tree.unflatten(self._structure, filled))
        results, structure = jax.tree.flatten(found)
        holes = [Hole() if eqx.is_array(x) else x for x in results]
        self.frame = jax.tree.unflatten(structure, holes)
        return tuple(x for x in results if eqx.is_array(x))


def _type_of(x: Any) -> str:
    array = jax.api_util.shaped_abstractify(x)
    return f"{array.str_short()} {array.weak_type}"


COMPILED = Compiled()
