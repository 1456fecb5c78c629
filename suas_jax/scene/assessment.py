"""What is observed of a solved state, and how far it can be trusted."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from suas_jax.equilibrium.balance import Problem, State, Verification, verify, volume_residual
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import smallest_gap
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.equilibrium.validity import force_balance, validity
from suas_jax.mechanics.contact.face import BodyContact
from suas_jax.mechanics.model import Meshes
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.build import problem_of
from suas_jax.scene.contact_zone import (
    error_by_bodies,
    error_by_penetration,
    error_by_squeezing,
    touched_by_bodies,
)
from suas_jax.scene.error_estimate import (
    BY_PENETRATION,
    Corrected,
    correction_mesh_changes,
    error_scales,
    key_quantities,
    mesh_changes,
    model_changes,
    relative_error,
    sum_of_sizes,
)
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import SceneParts

# Relative error from which a body's force is not an answer.
_MEANINGLESS = 0.1
# Turn of a tip's surface over half the distance of the points that touch it [rad]. At 0.45 a
# skin hangs on one of them as if friction held it: twice the force at 30 degrees.
_SHARPEST = 0.25
# Relative error by the first-order effect, which is then several times the force that is left.
_BEYOND = 1.0


def assess(
    parts: SceneParts,  # of the scene
    meshes: Meshes,  # of the solve
    solved: Problem,  # the problem that was solved, of the whole or of a part
    found: State,
    # whether the error by the mesh is wanted, NaN otherwise: on a pad it takes longer than the
    # solve
    judged: Bool[Array, ""] | bool,
    lost: Bool[Array, " lane"],  # whether it is the last state before a failure
    *,
    wall: bool,  # whether the wall is there
) -> tuple[dict[str, Any], State, State]:
    """Observe a state on the whole membrane, and check it.

    One assembly on the mesh for the error tells stability and the distance to the exact
    solution. Sway needs the whole membrane: where the error is judged on a part, the state is
    assembled on the whole, too, which gives the first-order effect of what is left out.

    Returns what is observed, the state on the whole membrane, and the one that is observed.
    """
    problem, state = solved, found
    if meshes.solved.symmetric:
        problem = problem_of(parts, meshes.whole, wall=wall)
        state = found._replace(q=solved.mechanics.mirrored(found.q))
    check, change, origin, start = None, None, problem, state
    if meshes.stability is not None:  # the error is judged on a part, which can't sway
        whole, part = (problem, state), (solved, found)
        check, change, forces = _stability(meshes, parts, whole, part, wall=wall)
        shown = state if change is None else jax.tree.map(jnp.add, state, change)
        origin, start = part
    else:
        shown = corrected(problem, state).state
        if problem.mechanics.corrected:
            change = jax.tree.map(lambda a, b: a - b, shown, state)
        forces = force_balance(solved, found)
    # At a limit point, where paths end, the first-order effect is without bound.
    shown = jax.tree.map(lambda a, b: jnp.where(lost, a, b), state, shown)
    report = observe(parts, problem, shown, state)
    report["volume_residual"] = volume_residual(problem, state)  # of the equilibrium
    values = key_quantities(problem.mechanics, state, parts.forces)
    scales = error_scales(problem, values)
    by_model = [jnp.zeros_like(x) for x in values]
    if change is not None:
        by_model = model_changes(Corrected(problem, state, change), parts.forces)

    # The correction's own error, where it was computed with the same assembly.
    with_kinks = check is None and change is not None
    unknown = jnp.full_like(state.pressure, jnp.nan)

    def compared() -> tuple[list[list[Lanes]], list[Lanes], Lanes, Bool[Array, " lane"]]:
        """Changes by each mesh, their errors, the mesh's error, stability on the first mesh."""
        by_mesh, by_kinks, stable = [], [], None
        for plan, share in zip(meshes.compared, origin.mechanics.error_shares, strict=True):
            other = problem_of(parts, plan, wall=wall)
            finer = other.mechanics.with_more_fibres()
            other = dataclasses.replace(other, mechanics=finer)
            q = origin.mechanics.to_comparison_mesh(start.q, plan.counts)
            there = start._replace(q=q)
            its_check, its_change = verify(other, there, omitted=check is None)
            found = key_quantities(other.mechanics, its_check.correction, parts.forces)
            # Those of a part are those of the whole.
            by_mesh.append(mesh_changes(share, values, found, parts.forces))
            if with_kinks and change is not None and its_change is not None:
                pair = Corrected(origin, start, change), Corrected(other, there, its_change)
                by_kinks.append(correction_mesh_changes(*pair, parts.forces))
            stable = its_check.stable if stable is None else stable
        assert stable is not None
        solved_counts = (meshes.whole if check is None else meshes.solved).counts
        if any(plan.counts == solved_counts for plan in meshes.compared):
            return *left_out()[:-1], stable  # a single element joins no other
        parts_of_error = [relative_error(x, scales) for x in by_mesh]
        error = relative_error(sum_of_sizes(by_mesh), scales)
        if by_kinks:
            error += relative_error(sum_of_sizes(by_kinks), scales)
        return by_mesh + by_kinks, parts_of_error, error, stable

    def left_out() -> tuple[list[list[Lanes]], list[Lanes], Lanes, Bool[Array, " lane"]]:
        each = [unknown] * len(meshes.compared)
        rows = [[unknown] * len(values)] * ((1 + with_kinks) * len(each))
        return rows, each, unknown, jnp.full(unknown.shape, True)

    judge = jax.lax.cond if meshes.compared else lambda *_: left_out()
    by_mesh, parts_of_error, error, stable = (
        compared() if judged is True and meshes.compared else judge(judged, compared, left_out)
    )
    report["stable"] = stable if check is None else check.stable
    report["discretisation_error"] = error
    touched, remains = touched_by_bodies(problem, state), relative_error(by_model, scales)
    floor = by_bodies = jnp.zeros_like(error)
    if change is not None:
        by_bodies = error_by_bodies(parts, problem, touched, report)
        floor = by_bodies + beyond_first_order(parts, problem, state, report, touched, remains)
    report["model_error"] = remains + floor
    report |= error_by_penetration(parts, problem, state, touched, report)
    errors = {"values": scales, "errors": [*by_mesh, by_model], "by_mesh": parts_of_error}
    report["key_quantities"] = errors | {"floor": floor}
    bodies = touched, by_bodies
    report["validity"] = _verdict(problem, state, forces, report, bodies, wall=wall)
    return report, state, shown


def _verdict(
    problem: Problem,
    state: State,
    forces: tuple[Lanes, Lanes],
    report: dict[str, Any],
    bodies: tuple[list[BodyContact], Lanes],  # contact with them, and their forces' error
    *,
    wall: bool,
) -> Int[Array, " lane"]:
    """Whether a state is an answer, and why it is none."""
    touched, by_bodies = bodies
    stretch, energy = report["stretch_min"], report["strain_energy_J"]
    verdict = validity(problem, state, forces, stretch, energy, report.pop("in_domain"))
    verdict = under_bodies(problem, state, verdict, touched)
    if wall and problem.oil_pressure is not None:
        # Loads that grow against the wall hardly raise the pressure. To reach more of it the
        # solver finds states of a membrane crushed on the wall, which no growing load leads to.
        lost = (verdict == 0) & report["wall_contact"] & ~report["stable"]
        verdict = jnp.where(lost, index_of("unreachable_pressure"), verdict)
    beyond = (verdict == 0) & (by_bodies > _BEYOND)
    return jnp.where(beyond, index_of("beyond_model"), verdict)


def _stability(
    meshes: Meshes,
    parts: SceneParts,
    whole: tuple[Problem, State],
    part: tuple[Problem, State],
    *,
    wall: bool,
) -> tuple[Verification, State | None, tuple[Lanes, Lanes]]:
    """The verdict on a state, the effect of what is left out, and the balance of forces."""
    plan, (problem, state) = meshes.stability, whole
    if plan is None or plan.counts == meshes.whole.counts:
        check, change = verify(problem, state)
        return check, change, (check.unbalanced, check.balanced)
    q = problem.mechanics.to_comparison_mesh(state.q, plan.counts)
    check, _ = verify(problem_of(parts, plan, wall=wall), state._replace(q=q))
    return check, None, force_balance(*part)


def under_bodies(
    problem: Problem,
    state: State,
    verdict: Int[Array, " lane"],
    touched: list[BodyContact],  # see `touched_by_bodies`
) -> Int[Array, " lane"]:
    """The verdict on a state, unless a body meets what does not give way."""
    mechanics = problem.mechanics
    for body, at in zip(mechanics.bodies, touched, strict=True):
        sharp = at.turn_between_points(body.shape.curvature) > _SHARPEST
        sharp |= at.passed_by(body.placed(state.factor))
        verdict = jnp.where(sharp, index_of("sharp_body"), verdict)
        verdict = jnp.where(at.on_clamp, index_of("body_on_clamp"), verdict)
    if touched and mechanics.corrected:
        squeezed = error_by_squeezing(problem, state, touched) > _MEANINGLESS
        verdict = jnp.where(squeezed, index_of("squeezed"), verdict)
    return verdict


def beyond_first_order(
    parts: SceneParts,
    problem: Problem,
    state: State,
    report: dict[str, Any],
    touched: list[BodyContact],  # see `touched_by_bodies`
    remains: Lanes,  # share of the first-order effect that is stated, relative
) -> Lanes:
    """Relative error that this share of the first-order effect doesn't tell."""
    mechanics = problem.mechanics
    floor = mechanics.omitted_floor + error_beyond_wall(
        problem, state, report["min_gap_m"], report["max_displacement_m"]
    )
    # An effect x to first order says nothing of x^2.
    floor += jnp.maximum((remains / mechanics.omitted_margin) ** 2 - remains, 0.0)
    if mechanics.omitted_at_wall and mechanics.wall is not None and parts.forces:
        loads = state.factor * sum(jnp.abs(load.force) for load in parts.forces)
        carried = report["wall"]["force_N"] / jnp.where(loads > 0, loads, 1.0)
        floor += mechanics.omitted_at_wall * jnp.minimum(carried, 1.0)
    if touched:
        floor += error_by_squeezing(problem, state, touched)
    return floor


def error_beyond_wall(
    problem: Problem, state: State, shown_gap: Lanes, displacement: Lanes
) -> Lanes:
    """Relative error where the effect of what is left out moves the face off the wall.

    A membrane in contact is held at a gap of zero, to within the depth to which the
    equilibrium itself goes into the wall. The first-order effect keeps its closed points but
    neither the curvature of the face between them nor those that close or open: the smallest
    gap `shown_gap` [m] is missed in the length, relative to the largest `displacement` [m].
    Just below the load at which the equilibrium reaches the wall nothing holds the effect back
    either, which would touch before.
    """
    mechanics = problem.mechanics
    if mechanics.wall is None:
        return jnp.zeros_like(shown_gap)
    own = jnp.minimum(smallest_gap(mechanics, state.q, mechanics.wall), 0.0)
    touches = (own < 0) | (shown_gap < 0)
    missed = jnp.abs(shown_gap - own)
    return jnp.where(touches, BY_PENETRATION * missed / displacement, 0.0)
