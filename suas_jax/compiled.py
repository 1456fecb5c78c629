"""Compiled programs, and how much effort goes into compiling them."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

# XLA's newer way of generating code for the CPU takes twice as long to compile these
# programs of many small operations, which then run no faster.
OPTIONS: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}
# A program that runs once is done sooner without the compiler's own optimisation: half the
# compile time again, for twice the (much shorter) run time.
_OPTIONS_ONCE = {**OPTIONS, "xla_backend_optimization_level": 0}


class Compiled:
    """Programs by function, static settings and shapes, with the time they took to compile.

    Attributes:
        seconds: spent on tracing and compiling so far.
    """

    def __init__(self) -> None:
        self._programs: dict[Any, Callable[..., Any]] = {}
        self.seconds = 0.0

    def run(self, function: Callable[..., Any], *arguments: Any, once: bool = False) -> Any:
        """Call a function made by `equinox.filter_jit`, compiled apart, and wait for it.

        Args:
            function: the jitted function.
            arguments: its arguments; those that are no arrays are static.
            once: whether the program is not expected to run many times.
        """
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple(np.shape(x) if eqx.is_array_like(x) else x for x in leaves)
        key = (function, structure, shapes, once)
        if key not in self._programs:
            begin = time.perf_counter()
            lowered = function.lower(*arguments)  # type: ignore[attr-defined]
            options = _OPTIONS_ONCE if once else OPTIONS
            self._programs[key] = lowered.compile(compiler_options=options)
            self.seconds += time.perf_counter() - begin
        return jax.block_until_ready(self._programs[key](*arguments))


COMPILED = Compiled()
