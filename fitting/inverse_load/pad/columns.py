"""Solved states of a pad under one contact: columns of all forces at one place."""

import os
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.model.evaluation import NoRestError
from fitting.inverse_load.pad.rest import film_readings
from fitting.inverse_load.pad.table import LEVELS, grid
from fitting.workers import in_float64
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.pad_levels import Ahead, extrapolation, nothing_ahead, readings_along
from suas_jax.scene.skin import Skin

ACROSS = (0, 1, 2, 3, 5, 7)
"""Which of them, rest left out, know derivatives by tangential forces, which change little."""
_GAP_LEFT = 0.05  # smallest gap in the table in terms of the film's
_MOST_FORCE = 3.0  # largest force in terms of the smallest of the largest forces
_PASSES = 6  # attempts to find the largest force
_SMALL_FORCE = 0.05  # where paths of prestressed pads begin, in terms of modulus and thickness
_GROWTH = (2.5, 10.0)  # of a force that does not reach the wall, at least and at most
_NARROWED = 1.2  # ratio of a force at which paths end to one that is reached, near enough
_FEW = 20  # columns that aren't worth the compiler's own optimisation
_AT_ONCE = 4  # columns that a worker is sent
_READ_ALONG = eqx.filter_jit(readings_along)


class Column(NamedTuple):
    """Readings of one place, or of many with a leading axis; see `PadReadings`.

    Derivatives by tangential forces are known at `ACROSS` of the levels, where asked for.
    """

    so: Floats
    pressure: Floats
    min_gap: Floats
    found: Flags
    across: Floats = np.zeros(0)


class Columns:
    """Solves columns of the table: one place, all forces."""

    def __init__(
        self,
        skin: Skin,
        diameter: float,  # of the contacts [m]
        # called with the number of columns solved and their total
        progress: Callable[[int, int], None],
        total: int,  # columns that will be solved
        workers: Executor | None = None,  # that solve them; None: this process, on all cores
    ) -> None:
        self.skin, self._diameter, self._workers = skin, diameter, workers
        self._progress, self._total, self._done = progress, total, 0

    def solve(
        self,
        places: Floats,  # angle [rad] and axial position [m]
        force: Floats,  # of the places [N]
        levels: Floats,  # shares of the force, for all places [level] or each [place, level]
        elements: tuple[int, int] | None = None,  # of the mesh; those of the pad if None
        across: Flags | None = None,
        line: int = 1,
    ) -> Column:
        """Readings [place, level, ...] of places [place, 2] under shares of forces.

        Derivatives by tangential forces are wanted at the places `across`; nowhere if None. So
        many places one after the other lie on a line, as far from one another.
        """
        skin = self.skin if elements is None else replace(self.skin, elements=elements)
        once = self._total < _FEW
        diameter = np.full(len(places), self._diameter)
        wanted = np.zeros(len(places)) if across is None else across
        numbers = np.column_stack([places, force, diameter, wanted])
        levels = np.broadcast_to(levels, (len(places), levels.shape[-1]))
        if self._workers is not None:
            sent = _parts(len(numbers), max(line, _AT_ONCE // line * line))
            how = skin, numbers, levels, line, once
            return _joined(self._on_workers(self._workers, sent, *how))

        def solved(part: slice) -> list[Column]:
            return solve_line(skin, numbers[part], levels[part], once, self._count)

        first, *others = _parts(len(numbers), line)
        rows = [solved(first)]  # compiles
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            rows += pool.map(solved, others)
        return _joined([column for row in rows for column in row])

    def rest(self) -> tuple[Floats, float]:
        """Readings of the pad without contacts [taxel], and the oil's pressure [Pa].

        By the program that solves columns.

        Raises NoRestError: there is no state without contacts.
        """
        if not self.skin.prestressed:
            return film_readings(self.skin), 0.0
        nothing = np.array([0.0, 0.0, 0.0, self._diameter, 0.0])
        once = self._total < _FEW
        levels = LEVELS[None, LEVELS != 0]
        found = solve_line(self.skin, nothing[None], levels, once)[0]
        if not found.found[0]:
            raise NoRestError
        return np.asarray(found.so[0]), float(found.pressure[0])

    def _on_workers(
        self,
        workers: Executor,
        parts: list[slice],
        skin: Skin,
        numbers: Floats,
        levels: Floats,
        line: int,
        once: bool,
    ) -> list[Column]:
        """Columns in the order of their places."""
        solve = in_float64(_solve_columns, skin)
        futures = [
            workers.submit(solve, numbers[part], levels[part], line, once) for part in parts
        ]
        for future in as_completed(futures):
            self._count(len(future.result()))  # raises what the worker raised
        return [row for future in futures for row in future.result()]

    def _count(self, columns: int) -> None:
        self._done += columns
        self._progress(min(self._done, self._total), self._total)


def solve_line(
    skin: Skin,
    numbers: Floats,
    levels: Floats,
    once: bool,
    count: Callable[[int], None] = lambda columns: None,
) -> list[Column]:
    """Readings under shares of contacts' forces, of places on a line, one column after another.

    States follow one another by extrapolation, and go as far beyond it as those of the columns
    before would have gone here; those that Newton's method doesn't find that way are solved
    from rest, each for itself.

    The numbers are angle [rad], axial position [m], force [N], diameter [m], and whether
    derivatives by tangential forces are wanted [column, number]. Levels are shares of the
    force [column, level]. `once` says whether few columns will be solved; `count` is called
    with one after each.
    """
    columns: list[Column] = []
    before: list[BorderedVector] = []
    for (angle, axial, force, diameter, wanted), shares in zip(numbers, levels, strict=True):
        loads = Loads.patch(angle, axial, force, diameter)
        meshed, weights = skin.around(loads), extrapolation(shares)
        across = np.isin(np.arange(len(shares)), ACROSS) & bool(wanted)
        ahead = nothing_ahead(meshed, len(shares))
        if before:
            beyond = before[-1]
            if len(before) > 1:
                beyond = jax.tree.map(lambda a, b: 2 * a - b, before[-1], before[-2])
            ahead = Ahead(beyond, np.array(True))  # type: ignore[arg-type]
        found, missed = COMPILED.run(
            _READ_ALONG, meshed, loads, shares, weights, across, ahead, once=once
        )
        column = Column(*(np.array(x) for x in found))
        before.append(jax.tree.map(np.asarray, missed))
        if not column.found.all():
            before.clear()
        for k in np.flatnonzero(~column.found):
            alone = forward(meshed, Loads.patch(angle, axial, force * shares[k], diameter))
            column.so[k] = alone.so[:, 0]
            column.pressure[k], column.min_gap[k] = alone.oil_pressure[0], alone.min_gap[0]
            column.found[k] = alone.solved[0]
        columns.append(column)
        count(1)
    return columns


def _solve_columns(
    skin: Skin, numbers: Floats, levels: Floats, line: int, once: bool
) -> list[Column]:
    """A few lines of columns [column, number] in a worker's process."""
    parts = _parts(len(numbers), line)
    rows = [solve_line(skin, numbers[part], levels[part], once) for part in parts]
    return [column for row in rows for column in row]


def _parts(count: int, size: int) -> list[slice]:
    """So many rows, some at a time."""
    return [slice(k, k + size) for k in range(0, count, size)]


def _joined(rows: list[Column]) -> Column:
    return Column(*(np.stack(x) for x in zip(*rows, strict=True)))


def largest_forces(columns: Columns, probes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """Forces that leave little of the gap, and those that leave none [angle, axial] [N].

    From the linear response at the crown a path of forces is guessed that reaches the wall,
    and raised until it does; where it ends before, forces in between are tried. The smallest
    gap of a prestressed pad at rest is anywhere, so that its path begins with a small force.
    """
    skin = columns.skin
    places, levels = grid(*probes), LEVELS[LEVELS != 0]
    g = skin.geometry
    gap = float(g.oil_gap[0])
    unit = float(skin.law.shear_modulus[0]) * float(g.thickness[0]) ** 2
    linear = _SMALL_FORCE * unit
    if not skin.prestressed:
        light = columns.solve(places[:1], np.array([1e-7 * unit]), levels)
        linear = 1e-7 * unit * gap / max(gap - float(light.min_gap[0, -1]), 1e-12 * gap)
    top = np.full(len(places), 1.2 * linear)
    cap, touch, ended = (np.full(len(places), x) for x in (np.nan, np.inf, np.inf))
    growth = np.full(len(places), _GROWTH[0])
    open_ = np.arange(len(places))
    for _ in range(_PASSES):
        found = columns.solve(places[open_], top[open_], levels)
        for row, k in enumerate(open_):
            share, closes = _reach(found, row, levels, _GAP_LEFT * gap)
            # Where a path ends, what one to a smaller force has reached still holds.
            cap[k] = share * top[k] if np.isfinite(closes) else np.fmax(cap[k], share * top[k])
            touch[k] = closes * top[k]
            if np.isinf(closes) and share < levels[-1]:
                ended[k] = min(ended[k], top[k])
            before, last = found.min_gap[row, -2:]
            falls = max((before - last) / (levels[-1] - levels[-2]), 1e-12 * gap)
            growth[k] = np.clip(1 + last / falls, *_GROWTH)
        most = _MOST_FORCE * np.nanmin(cap)
        longer = np.isinf(ended) & (top < most)
        shorter = np.isfinite(ended) & (_NARROWED * cap < np.minimum(ended, most))
        top = np.where(longer, growth * top, np.sqrt(cap * ended))
        open_ = np.flatnonzero(np.isinf(touch) & (longer | shorter))
        if not open_.size:
            break
    cap = np.minimum(cap, _MOST_FORCE * cap.min())
    shape = tuple(len(x) for x in probes)
    return cap.reshape(shape), touch.reshape(shape)


def _reach(found: Column, row: int, levels: Floats, left: float) -> tuple[float, float]:
    """Shares of the force at which little of the gap is left, and none."""
    good = found.found[row] & (levels > 0) & np.isfinite(found.min_gap[row])
    ends = np.flatnonzero((levels > 0) & ~good)
    if ends.size:
        good[ends[0] :] = False
    share, gap = levels[good], found.min_gap[row][good]
    if not share.size:
        return float(levels[levels > 0][0]), np.inf

    def crossing(wanted: float) -> float:
        below = np.flatnonzero(gap <= wanted)
        if not below.size:
            return np.inf
        k = max(int(below[0]), 1)
        near = slice(max(k - 2, 0), k + 1)
        return float(np.interp(-wanted, -gap[near], share[near]))

    closes, slope = crossing(0.0), -np.diff(gap[-2:])
    if np.isinf(closes) and gap[-1] <= left and slope.size and slope[0] > 0:
        closes = float(share[-1] + gap[-1] * (share[-1] - share[-2]) / slope[0])
    return min(crossing(left), float(share[-1])), closes
