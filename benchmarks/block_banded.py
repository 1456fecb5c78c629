"""The block-banded elimination against LAPACK's banded Cholesky factorisation.

    python benchmarks/block_banded.py             # two pads, a larger one
    python benchmarks/block_banded.py 69 27       # unknowns a station, stations

Both solve the same positive definite system on one core in turn, so that a busy machine
slows both: the ratios of CPU times, medians over the rounds, are to be trusted rather than
the times. Rounding errors are of the solution, relative to the largest unknown.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["XLA_FLAGS"] = (
    os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false"
)

import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from suas_jax.numerics.block_banded import BlockBanded, factorise, solve_with
from suas_jax.runtime.compiled import OPTIONS

ROUNDS = 30
PADS = [(69, 27), (72, 23), (110, 40)]
RIGHT = [1, 2, 5, 30, 100]


def random_bands(stations: int, dof: int, lanes: int = 1) -> np.ndarray:
    """Lower blocks of definite systems [lane, station, 4, dof, dof]."""
    bands = np.random.default_rng(0).normal(size=(lanes, stations, 4, dof, dof)) / 10
    bands[:, :, 0] += bands[:, :, 0].swapaxes(-1, -2) + (dof / 2 + 10) * np.eye(dof)
    for o in range(1, 4):
        bands[:, stations - o :, o] = 0
    return bands


def lapack_bands(bands: np.ndarray) -> np.ndarray:
    """The same system as `scipy.linalg.cholesky_banded` takes it (lower form)."""
    stations, _, dof, _ = bands.shape
    columns = bands.reshape(stations, 4 * dof, dof)
    banded = np.zeros((4 * dof, stations * dof))
    for k in range(dof):
        banded[: 4 * dof - k, k::dof] = columns[:, k:, k].T
    return banded


def compiled(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """A program to be called without arguments, and the CPU time it took to compile."""
    begin = time.process_time()
    program = jax.jit(function).lower(*arguments).compile(compiler_options=OPTIONS)
    seconds = time.process_time() - begin
    return lambda: jax.block_until_ready(program(*arguments)), seconds


def race(name: str, ours: Callable[[], Any], lapack: Callable[[], Any], note: str = "") -> None:
    """Run both in turn and print a line of the table."""
    times: list[list[float]] = [[], []]
    for run in (ours, lapack):
        run()
    for _ in range(ROUNDS):
        for run, into in zip((ours, lapack), times, strict=True):
            begin = time.process_time()
            run()
            into.append(1e3 * (time.process_time() - begin))
    a, b = (np.median(x) for x in times)
    ratio = np.median(np.divide(*times))
    best = [min(x) for x in times]
    print(
        f"{name:34s}{a:9.3f}{b:9.3f}{best[0]:9.3f}{best[1]:9.3f}{ratio:8.2f}  {note}",
        flush=True,
    )


def compare(dof: int, stations: int) -> None:
    print(f"\n{stations} stations of {dof} unknowns; CPU ms: medians, best, ratio of medians")
    print(f"{'':34s}{'scan':>9s}{'LAPACK':>9s}{'scan':>9s}{'LAPACK':>9s}{'ratio':>8s}")
    bands = random_bands(stations, dof)
    banded = lapack_bands(bands[0])
    tangent = BlockBanded(jnp.asarray(bands))
    rng = np.random.default_rng(1)
    right = rng.normal(size=(stations * dof, max(RIGHT)))

    def ours(count: int) -> jax.Array:
        rows = right[:, :count].reshape(stations, dof, count)
        return jnp.asarray(rows.transpose(1, 2, 0)[..., None])

    run, seconds = compiled(factorise, tangent)
    race(
        "factorise",
        run,
        lambda: scipy.linalg.cholesky_banded(banded, lower=True, check_finite=False),
        f"compiled in {seconds:.1f} s",
    )
    factors = run()
    run, seconds = compiled(lambda t, r: t.solve(r), tangent, ours(2))
    race(
        "factorise, 2 right-hand sides",
        run,
        lambda: scipy.linalg.solveh_banded(
            banded, right[:, :2], lower=True, check_finite=False
        ),
        f"compiled in {seconds:.1f} s",
    )
    kept = scipy.linalg.cholesky_banded(banded, lower=True)
    for count in RIGHT:
        run, _ = compiled(solve_with, factors, ours(count))
        want = scipy.linalg.cho_solve_banded((kept, True), right[:, :count])
        got = np.asarray(run())[..., 0].transpose(2, 0, 1).reshape(want.shape)
        error = np.max(abs(got - want)) / np.max(abs(want))
        race(
            f"{count} right-hand sides, factors kept",
            run,
            lambda count=count: scipy.linalg.cho_solve_banded(
                (kept, True), right[:, :count], check_finite=False
            ),
            f"difference {error:.0e}",
        )
    lanes = jnp.asarray(np.repeat(bands, 8, 0))
    run, _ = compiled(factorise, BlockBanded(lanes))
    vmapped, _ = compiled(jax.vmap(lambda b: factorise(BlockBanded(b[None]))), lanes)
    race("factorise 8 lanes; by vmap", run, vmapped, "(vmap in LAPACK's place)")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    chosen = [(int(sys.argv[1]), int(sys.argv[2]))] if len(sys.argv) > 2 else PADS
    for dof, stations in chosen:
        compare(dof, stations)
