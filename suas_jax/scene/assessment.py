"""What is observed of a solved state, and how far it can be trusted."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.equilibrium.balance import Problem, State, verify, volume_residual
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import force_balance, validity
from suas_jax.mechanics.model import Meshes
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.build import problem_of
from suas_jax.scene.error_estimate import (
    correction_mesh_error,
    discretisation_error,
    model_error,
)
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import SceneParts


def assess(
    parts: SceneParts,
    meshes: Meshes,
    solved: Problem,
    found: State,
    judged: Bool[Array, ""] | bool,
    *,
    wall: bool,
) -> tuple[dict[str, Any], State, State]:
    """Observe a state on the whole membrane, and check it.

    One assembly on the mesh for the error answers two questions: whether the state is stable
    and how far it is from the exact solution. Sway needs the whole membrane: where the error
    is judged on a part, the state is assembled on the whole as well, which also gives the
    first-order effect of what the mechanics leaves out.

    Args:
        parts: of the scene.
        meshes: of the solve.
        solved: the problem that was solved, of the whole or of a part.
        found: its state.
        judged: whether the error by the mesh is wanted, NaN otherwise: on a pad it takes
            longer than the solve.
        wall: whether the wall is there.

    Returns:
        What is observed, the state on the whole membrane, and the one that is observed.
    """
    problem, state = solved, found
    if meshes.solved.symmetric:
        problem = problem_of(parts, meshes.whole, wall=wall)
        state = found._replace(q=solved.mechanics.mirrored(found.q))
    check = None
    if meshes.stability is not None:  # the error is judged on a part, which can't sway
        check, change = verify(problem, state)
        if problem.mechanics.corrected:
            assert change is not None
            shown = jax.tree.map(lambda a, b: a + b, state, change)
        report = observe(parts, problem, shown, state)
        report["volume_residual"] = volume_residual(problem, state)  # of the equilibrium
        report["model_error"] = model_error(problem, state, change, parts)
        forces = check.unbalanced, check.balanced
        origin, start = solved, found
    else:
        shown = corrected(problem, state).state
        report = observe(parts, problem, shown, state)
        report["volume_residual"] = volume_residual(problem, state)
        change = None
        if problem.mechanics.corrected:
            change = jax.tree.map(lambda a, b: a - b, shown, state)
        report["model_error"] = model_error(problem, state, change, parts)
        forces = force_balance(solved, found)
        origin, start = problem, state

    def compared() -> tuple[Lanes, Bool[Array, " lane"]]:
        """Error by the mesh, and stability on the mesh that it is compared with."""
        finer = problem_of(parts, meshes.error, wall=wall)
        begin = start._replace(q=origin.mechanics.to_comparison_mesh(start.q))
        finer_check, finer_change = verify(finer, begin, omitted=check is None)
        better = finer_check.correction
        error = discretisation_error(origin, start, finer, better, parts.forces)
        if check is None and change is not None and finer_change is not None:
            pair = (origin, change), (finer, finer_change)
            error = error + correction_mesh_error(*pair, better, parts.forces)
        same = meshes.whole.counts == meshes.error.counts
        return jnp.full_like(error, jnp.nan) if same else error, finer_check.stable

    def left_out() -> tuple[Lanes, Bool[Array, " lane"]]:
        return jnp.full_like(state.pressure, jnp.nan), jnp.full(state.pressure.shape, True)

    error, stable = compared() if judged is True else jax.lax.cond(judged, compared, left_out)
    report["stable"] = stable if check is None else check.stable
    report["discretisation_error"] = error
    verdict = validity(problem, state, forces, report["stretch_min"], report["strain_energy_J"])
    if wall and problem.oil_pressure is not None:
        # Loads that grow against the wall hardly raise the pressure. To reach more of it the
        # solver finds states of a membrane crushed on the wall, which no growing load leads to.
        lost = (verdict == 0) & report["wall_contact"] & ~report["stable"]
        verdict = jnp.where(lost, index_of("unreachable_pressure"), verdict)
    report["validity"] = verdict
    return report, state, shown
