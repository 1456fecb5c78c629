"""Indentation curves: a scene solved at one travel of its bodies after the other."""

import functools
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np

from suas_jax.config import SceneSpec, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.model import AbstractModel, AbstractPlan
from suas_jax.mechanics.registry import MODELS
from suas_jax.numerics.lanes import number
from suas_jax.numerics.polynomials import lagrange_weights
from suas_jax.scene.choice import carried, choose, difference
from suas_jax.scene.curve import contact_of, first_touch
from suas_jax.scene.program import at_rest, prepared, run_program, structure_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.sway import stressed_last
from suas_jax.scene.travel import on_the_way
from suas_jax.skin.prestress import is_prestressed

_CONTACT_TOLERANCE = 1e-7  # of the travel at first contact with the wall
_MOST_HALVINGS = 40
_COMPARED = 9  # travels at which a coarser mesh tells the error
_MOST_STATES = 4  # that a polynomial ahead goes through


class Point(NamedTuple):
    """A point of the curve: what is observed, how it was found, the state to go on from."""

    report: dict[str, Any]
    outcome: dict[str, Any]
    part: State

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return number(self.outcome["result"]) == 0


class IndentationCurve(NamedTuple):
    """A scene whose bodies travel."""

    scene: SceneSpec  # pressed in most
    shares: Mapping[str, float]  # of the largest travel, by the path of every body's own
    model: AbstractModel  # it is solved with
    plan: AbstractPlan  # the mesh
    wall: bool  # whether the wall is touched where the bodies are in most

    @classmethod
    def of(cls, scene: SceneSpec, shares: Mapping[str, float]) -> Self:
        """With the model and the mesh that the scene needs; see `AbstractModel.for_curves`."""
        models, asked = MODELS[scene.geometry.dimension], scene
        solid = models["solid"]
        if scene.solve.model == "auto" and not (solid.for_curves or solid.given(scene)):
            asked = with_solve(scene, model="shell")
        found, _ = choose(asked, once=True)
        if asked is not scene and not found.converged:  # the solid may know more
            found, _ = choose(scene, once=True)
        return cls(scene, shares, models[found.plan.model], found.plan, found.wall)

    def points(self, depths: np.ndarray) -> list[dict[str, Any]]:
        """Reports at given travels [m]."""
        fine = self._filled(depths) or self.follow(depths, self.plan.counts)
        errors = self._mesh_errors(depths, fine)
        rows = []
        for point, error in zip(fine, errors, strict=True):
            point.report["discretisation_error"] = float(error)
            outcome = plain(point.outcome) | {"model": self.plan.model, "reason": ""}
            rows.append(report_of(self.scene, plain(point.report), outcome))
        return rows

    def _filled(self, depths: np.ndarray) -> list[Point]:
        """Solutions at rising travels, those between a few from the states around them.

        Empty where the few are not all found, or where solves are too short to be shared out.
        """
        rising = depths[0] >= 0 and (np.diff(depths) > 0).all()
        if not (rising and self.plan.solves_long and len(depths) > _COMPARED):
            return []
        # What is close to first touch is found from there.
        few = np.union1d(_few(depths.tolist()), depths[:2])
        known = self.follow(few, self.plan.counts)
        if not all(point.converged for point in known):
            return []
        others = np.setdiff1d(depths, few)
        starts = []
        for depth in others:
            first = np.searchsorted(few, depth) - _MOST_STATES // 2
            first = max(0, min(first, len(few) - _MOST_STATES))
            near = slice(first, first + _MOST_STATES)
            # A zone of contact begins as wide as the root of the travel.
            weights = lagrange_weights(np.sqrt(few[near]), np.sqrt(depth))
            starts.append(_joined(weights, known[near]))
        found = self.follow(others, self.plan.counts, starts)
        at = dict(zip([*few, *others], [*known, *found], strict=True))
        return [at[depth] for depth in depths]

    def _mesh_errors(self, depths: np.ndarray, fine: list[Point]) -> np.ndarray:
        """Errors by the mesh at travels [m]: a coarser one tells them at a few.

        Elsewhere the larger of the neighbours' counts; NaN at an end that the coarser mesh does
        not reach.
        """
        known = {depth: x for depth, x in zip(depths, fine, strict=True) if x.converged}
        chosen = _few(sorted(depth for depth in known if depth > 0) or sorted(known))
        counts, starts = self.model.coarser(self.plan.counts), None
        if self.plan.solves_long:
            meshes = [
                prepared(self.scene, self.plan.model, n).meshes.solved
                for n in (self.plan.counts, counts)
            ]
            starts = [carried(self.model, known[depth].part, *meshes) for depth in chosen]
        coarse = self.follow(chosen, counts, starts)
        found = {
            depth: difference(self.scene, x.report, known[depth].report)
            if x.converged
            else np.nan
            for depth, x in zip(chosen, coarse, strict=True)
        }
        told = [depth for depth, error in found.items() if np.isfinite(error)]
        if not told:
            return np.full(len(depths), np.nan)
        inner = [d for d in found if d in told or not told[0] < d < told[-1]]
        levels, errors = inner, np.array([found[d] for d in inner])
        before = np.maximum(np.searchsorted(levels, depths, "right") - 1, 0)
        after = np.minimum(np.searchsorted(levels, depths), len(levels) - 1)
        return np.maximum(errors[before], errors[after])

    def follow(
        self,
        depths: np.ndarray,
        counts: tuple[int, ...],  # size of the mesh
        # states near the solutions, instead of those before them
        starts: Sequence[State | None] | None = None,
    ) -> list[Point]:
        """Solutions at given travels [m] on one mesh, each from those before."""
        # Whether the skin is at rest where no body is pressed in.
        alone = len(self.shares) == len(self.scene.loads) and not is_prestressed(self.scene)

        def solved(depth: float, start: State | None) -> Point:
            # From elsewhere Newton's method ends at rounding, forces that nothing balances.
            near = None if depth <= 0 and alone else start
            return self._solved(depth, counts, near, wall=self.wall)

        if starts is not None:
            # A program keeps one core busy: points share out the others.
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                return list(pool.map(solved, depths, starts))
        points: list[Point] = []
        for k, depth in enumerate(depths):
            points.append(solved(depth, self._ahead(depths[:k], points, depth)))
        return points

    def _ahead(self, depths: np.ndarray, points: list[Point], depth: float) -> State | None:
        """Where to start at a travel: on a polynomial through the states before it.

        A cubic one at most, and no further ahead than the states are from each other. None
        where the last state was not found.
        """
        found = [point.converged for point in reversed(points)]
        known = found.index(False) if False in found else len(found)
        if not known:
            return None
        for count in range(min(known, _MOST_STATES), 1, -1):
            weights = lagrange_weights(depths[-count:], depth)
            if np.sum(np.abs(weights)) < 2**count:  # as of even steps; never of equal travels
                return _joined(weights, points[-count:])
        return self._near(points[-1].part, depths[-1], depth)

    def _near(self, state: State, before: float, depth: float) -> State:
        """A state at one travel as a start for another."""
        if depth == 0 or len(self.shares) < len(self.scene.loads):
            return state
        return on_the_way(self.scene, state, before / depth)

    def _solved(
        self, depth: float, counts: tuple[int, ...], start: State | None, *, wall: bool
    ) -> Point:
        known = prepared(self.scene, self.plan.model, counts)
        travels = {path: np.asarray(share * depth) for path, share in self.shares.items()}
        rest = at_rest(known.meshes.solved)
        static, inputs = structure_of(self.scene, wall=wall), known.inputs | travels
        run = functools.partial(run_program, static, known.meshes, once=True)
        found = run(inputs, rest if start is None else start)
        if number(found[-1]["result"]) != 0:
            found = stressed_last(self.scene, inputs, rest, run, found)
        report, _, _, part, outcome = found
        return Point(report, outcome, part)

    def first_contact(
        self, depths: np.ndarray, points: list[dict[str, Any]]
    ) -> dict[str, float] | None:
        """Close in on the travel at which the smallest gap vanishes."""
        after = first_touch(points)
        if not after:
            return None if after is None else contact_of(points[0])
        low, high = float(depths[after - 1]), float(depths[after])
        start, best = None, points[after]
        for _ in range(_MOST_HALVINGS):
            if abs(high - low) <= _CONTACT_TOLERANCE * abs(high):
                break
            middle = (low + high) / 2
            near = None if start is None else self._near(start, low, middle)
            point = self._solved(middle, self.plan.counts, near, wall=False)
            if not point.converged:
                break
            found = plain(point.report)
            if found["min_gap_m"] <= 0:
                loads = zip(self.scene.loads, found["loads"], strict=True)
                named = [{"kind": spec.kind, **load} for spec, load in loads]
                high, best = middle, found | {"loads": named}
            else:
                low, start = middle, point.part
        return contact_of(best) | {"depth_m": high}


def _few(travels: list[float]) -> np.ndarray:
    """Some of many travels, evenly over their list, both ends among them."""
    few = np.linspace(0, len(travels) - 1, min(len(travels), _COMPARED))
    return np.array(travels)[few.round().astype(int)]


def _joined(weights: np.ndarray, points: Sequence[Point]) -> State:
    """A state near an equilibrium from weighted ones at other travels."""
    parts = [point.part for point in points]
    found: State = jax.tree.map(lambda *x: jnp.asarray(np.tensordot(weights, x, 1)), *parts)
    return found._replace(factor=jnp.ones(1))
