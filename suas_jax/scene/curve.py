"""A load-displacement curve on one mesh: continuation, first contact with the wall."""

import copy
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from suas_jax.config import SceneSpec, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium_path import beyond_wall, path
from suas_jax.equilibrium.validity import final_result
from suas_jax.mechanics.model import Counts, Meshes
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.assessment import assess
from suas_jax.scene.build import Inputs, Structure, plan_for, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import at_rest, inputs_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.sway import shifted
from suas_jax.skin.prestress import is_prestressed

# Width of the bracket of the first wall contact, relative to the load there.
_CONTACT_TOLERANCE = 1e-7
# Share of an interval in which the gap's zero is looked for, around that of the secant.
_SECANT_SHARE = 0.05
# Points up to which a curve takes less time to follow than to compile for speed.
_FEW = 40
# Points that one call follows, so that curves of any length share one program.
_BLOCK = 8


def total_force(report: dict[str, Any]) -> float:
    """Sum of the magnitudes of the forces in a report [N]."""
    forces = [load["force_N"] for load in report["loads"] if load["kind"] != "pressure"]
    return sum(abs(force) for force in forces)


@eqx.filter_jit
def _program(
    scene: Structure, meshes: Meshes, inputs: Inputs, levels: Array, start: State
) -> tuple[dict[str, Any], State, dict[str, Any], Bool[Array, " lane"]]:
    """Reports, states and outcomes of some points; whether the curve ends at the last."""
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, meshes.solved, wall=scene.wall)
    end = None if scene.wall else parts.skin.wall
    found = path(problem, levels, start, end)

    def one(at: tuple[State, Bool[Array, " lane"]]) -> dict[str, Any]:
        return assess(parts, meshes, problem, at[0], True, at[1], wall=scene.wall)[0]

    reports = jax.lax.map(one, (found.state, found.result != 0))
    result = final_result(found.result, reports.pop("validity"))
    outcome = {"result": result, "level": found.level, "iterations": found.iterations}
    unknowns = problem.mechanics.unknowns() + int(problem.oil.trapped)
    outcome["unknowns"] = jnp.full_like(found.result, unknowns)
    stopped = found.result[-1] != 0
    if end is not None:
        stopped = stopped | beyond_wall(problem.mechanics, found.state.q[-1], end)
    return reports, found.state, outcome, stopped


class Curve:
    """One mesh of a scene and the states found on it."""

    def __init__(self, scene: SceneSpec, model: str, counts: Counts) -> None:
        self.scene, self.plan = scene, plan_for(scene, model, counts)
        self.meshes = self.plan.meshes()
        self.inputs = inputs_of(scene)

    def points(self, levels: np.ndarray) -> list[dict[str, Any]]:
        """Reports at the given levels; a level of zero is the undeformed state."""
        pressures = self.scene.solve.oil_pressure is not None
        visit = levels[levels != 0] if pressures else levels
        rows, states = self.follow(visit, None, wall=False)
        lost = self._below_rest(visit) if pressures and rows[0]["status"] != "converged" else 0
        missed, visit = rows[:lost], visit[lost:]
        if lost:
            rows, states = self.follow(visit, None, wall=False)
        beyond = [row["wall_contact"] for row in rows]
        if self.scene.wall.contact and any(beyond):
            # From the last state that is free of the wall, whatever comes after.
            k = beyond.index(True)
            start = jax.tree.map(lambda x: x[k - 1], states) if k else None
            rows[k:] = self.follow(visit[k:], start, wall=True)[0]
        rows = missed + rows
        if len(rows) < len(levels):
            rest = self._rest_report()
            rows_left = iter(rows)
            rows = [rest if level == 0 else next(rows_left) for level in levels]
        return rows

    def follow(
        self, levels: np.ndarray, start: State | None, *, wall: bool
    ) -> tuple[list[dict[str, Any]], State]:
        """Reports and states at levels that no rest is among, with or without the wall.

        `levels`: in the order to visit. `start`: where to start; None at rest. `wall`: whether
        it is there; without it the first state beyond it is repeated.
        """
        known = at_rest(self.meshes.solved) if start is None else start
        static, once = Structure(self.scene, wall=wall), len(levels) <= _FEW
        effort = {"once": once, "long": self.plan.solves_long}
        # A point more of a pad takes longer than a call.
        size = 1 if self.plan.solves_long else _BLOCK
        rows: list[dict[str, Any]] = []
        blocks: list[State] = []
        for begin in range(0, len(levels), size):
            block = levels[begin : begin + size]
            filled = np.append(block, np.full(size - len(block), block[-1]))
            reports, states, outcomes, stopped = COMPILED.run(
                _program, static, self.meshes, self.inputs, filled, known, **effort
            )
            for i in range(len(block)):
                outcome = plain(outcomes, i) | {"model": self.plan.model, "reason": ""}
                rows.append(report_of(self.scene, plain(reports, i), outcome))
            states = jax.tree.map(np.asarray, states)
            known = jax.tree.map(lambda x: x[-1], states)
            own, left = len(block), len(levels) - len(rows)
            blocks.append(jax.tree.map(lambda x, n=own: x[:n], states))
            if left and np.any(stopped):
                rows += [copy.deepcopy(rows[-1]) for _ in range(left)]
                blocks.append(jax.tree.map(lambda x, n=left: np.stack([x] * n), known))
                break
        return rows, jax.tree.map(lambda *x: np.concatenate(x), *blocks)

    def _rest_report(self) -> dict[str, Any]:
        """The report of the undeformed state, which no pressure control can reach."""
        loads_off = with_solve(self.scene, oil_pressure=None)
        curve = Curve(loads_off, self.plan.model, self.plan.counts)
        return curve.points(np.zeros(1))[0]

    def _below_rest(self, pressures: np.ndarray) -> int:
        """How many of them come first that lie between ambient and the oil's at rest.

        Loads that raise the pressure reach none of these, and those after them all the same.
        """
        if not is_prestressed(self.scene):
            return 0
        rest = self._rest_report()["oil_pressure_Pa"]
        reached = pressures * (pressures - rest) >= 0
        return int(reached.argmax()) if reached.any() else 0

    def _before(self, point: int) -> State | None:
        """What a search between a point and the one before starts from; None at rest."""
        del point
        return None

    def first_contact(
        self, levels: np.ndarray, points: list[dict[str, Any]]
    ) -> dict[str, float] | None:
        """Close in on the load at which the smallest gap vanishes."""
        after = first_touch(points)
        if not after:
            return None if after is None else contact_of(points[0])
        low, high = float(levels[after - 1]), float(levels[after])
        gaps = points[after - 1]["min_gap_m"], None
        best = points[after]
        start = self._before(after)
        while abs(high - low) > _CONTACT_TOLERANCE * abs(high):
            inner = _around_zero(low, high, gaps, _BLOCK)
            rows, states = self.follow(inner, start, wall=False)
            inside = [row["wall_contact"] for row in rows]
            k = inside.index(True) if any(inside) else len(rows)
            above, below = gaps
            if k < len(rows):
                high, best, below = float(inner[k]), rows[k], rows[k]["min_gap_m"]
            if k > 0:
                low, above = float(inner[k - 1]), rows[k - 1]["min_gap_m"]
                start = jax.tree.map(lambda x, k=k: x[k - 1], states)
            gaps = above, below
        return contact_of(best)


class SwayedCurve(Curve):
    """The states to which a symmetric skin sways: scenes are solved on the whole mesh."""

    def __init__(self, scene: SceneSpec, model: str, counts: Counts) -> None:
        super().__init__(with_solve(scene, symmetry=False), model, counts)
        self._states: list[State] = []

    def points(self, levels: np.ndarray) -> list[dict[str, Any]]:
        """Reports, each from the state under loads a little aside."""
        wall, exact = self.scene.wall.contact, self.inputs
        self.inputs = shifted(self.scene, exact)
        _, aside = self.follow(levels, None, wall=wall)
        self.inputs, rows = exact, []
        for k, level in enumerate(levels):
            start = jax.tree.map(lambda x, k=k: x[k], aside)
            report, states = self.follow(np.array([level]), start, wall=wall)
            self._states.append(jax.tree.map(lambda x: x[0], states))
            rows += report
            if report[0]["status"] != "converged":  # what lies beyond is not that branch
                left = len(levels) - len(rows)
                return rows + [copy.deepcopy(report[0]) for _ in range(left)]
        return rows

    def _before(self, point: int) -> State | None:
        return self._states[point - 1]


def _around_zero(
    low: float, high: float, gaps: tuple[float, float | None], count: int
) -> np.ndarray:
    """Levels near the secant's root of the gaps [m] between an open and a closed level.

    The second gap is None where it is not known without the wall.
    """
    above, below = gaps
    inner = np.linspace(low, high, count + 2)[1:-1]
    if below is None or not above > 0 > below:
        return inner
    root = low + (high - low) * above / (above - below)
    near = root + _SECANT_SHARE * (inner - (low + high) / 2)
    return np.clip(near, inner[0], inner[-1])


def first_touch(points: list[dict[str, Any]]) -> int | None:
    """The first converged point of a curve where the membrane is on the wall."""
    touching = (p["status"] == "converged" and p["wall_contact"] for p in points)
    return next((i for i, found in enumerate(touching) if found), None)


def contact_of(report: dict[str, Any]) -> dict[str, float]:
    """What is said of a first contact with the wall."""
    contact = {
        "force_N": total_force(report),
        "oil_pressure_Pa": report["oil_pressure_Pa"],
        "angle_deg": report["min_gap_angle_deg"],
    }
    for key in ("arc_m", "axial_m"):
        if f"min_gap_{key}" in report:
            contact[key] = report[f"min_gap_{key}"]
    return contact
