"""Random scenes pressed to twice their first contact with the wall.

The scenes are those of `benchmarks.random_scenes`. The load grows, its pattern kept, until
the membrane reaches the wall, and on to twice that. Every scene must end in equilibrium with
finite numbers, the wall's force among them, and keep the balance of energy: what a little
more load would store in membrane and wall is the work that load and oil would do, with the
energies and the work as they are reported and the exact derivatives of the solution.
Run: ``python -m benchmarks.contact_scenes [COUNT]``.
"""

import dataclasses
import functools
import sys
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from benchmarks.random_scenes import ALL_PATTERNS, draw, pattern
from suas_jax.equilibrium.balance import Problem, residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.equilibrium import differentiable, equilibrium, smallest_gap
from suas_jax.equilibrium.load_path import step_to
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.bordered_solve import BorderedVector
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.runtime.settings import configure
from suas_jax.scene.build import Structure, problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.scene.report import plain

# Of a step of the load, relative to the displacement: first contact is met that closely.
_STRIDE = 0.2
_ONCE: dict[str, bool | int] = {"xla_backend_optimization_level": 0, **OPTIONS}


@dataclasses.dataclass(frozen=True)
class Pressed:
    """One scene at twice its first contact."""

    law: str  # of the membrane
    oil: str  # model of the oil
    inputs: dict[str, float]  # continuous inputs, SI; the loads' forces give their pattern
    touch: float | None  # factor on the loads at first contact; None if they don't get there
    result: str  # name of the result at twice that
    iterations: int  # Newton corrections
    imbalance: float  # force residual relative to the load
    energy_error: float  # of the balance of energy, relative to the work
    report: dict[str, Any]  # observables


def first_touch(problem: Problem, parts: SceneParts) -> tuple[Lanes, Array]:
    """Factor on the loads just beyond first contact, and how the way there ended."""
    wall = parts.skin.wall
    assert wall is not None
    mechanics = problem.mechanics
    rest, zero = mechanics.rest(), jnp.zeros(1)
    stepping = LoadStepping(
        first_radius=0.1,
        largest_step=_STRIDE,
        until=lambda y: smallest_gap(mechanics, y.stations, wall) < 0,
    )
    y = BorderedVector(rest, zero if problem.oil.trapped else None)
    # Away from rest, where steps relative to the displacement are none.
    first = step_to(problem, y, zero, zero + 1e-3, LoadStepping())
    found = step_to(problem, first.y, first.level, zero + 1e3, stepping)
    return found.level, found.result


def press(
    parts: SceneParts,  # of the scene
    plan: AbstractPlan,  # the mesh
    beyond: float = 2.0,  # the multiple
) -> dict[str, Any]:
    """Everything about one scene at a multiple of its first contact."""
    free = problem_of(parts, plan)
    touch, way = first_touch(free, parts)
    held = problem_of(parts, plan, wall=True)

    def loaded(factor: Array) -> Problem:
        forces = [dataclasses.replace(f, force=f.force * factor) for f in parts.forces]
        return problem_of(parts._replace(forces=forces), plan, wall=True)

    problem = loaded(beyond * touch)
    found = equilibrium(problem)
    state = found.state
    border = state.pressure if problem.oil.trapped else None
    force, _ = residual(problem, BorderedVector(state.q, border), found.level)
    load = problem.mechanics.assemble(state.q, 0 * found.level, found.level).load

    def energies(factor: Array) -> tuple[Array, Array, Array]:
        """Stored energy, work of the loads at unit factor, enclosed volume."""
        state = differentiable(loaded(factor), found.state)
        stored = held.mechanics.strain_energy(state.q) + held.mechanics.contact_energy(state.q)
        return stored, held.mechanics.work(state.q), held.mechanics.volume_change(state.q)

    factor = beyond * touch
    _, (stored, work, volume) = jax.jvp(energies, (factor,), (jnp.ones_like(factor),))
    gained = factor * work + state.pressure * volume
    outcome = {
        "touch": touch,
        "way": way,
        "result": found.result,
        "iterations": found.iterations,
        "imbalance": jnp.max(jnp.abs(force.stations)) / jnp.max(jnp.abs(load))[None],
        "energy_error": jnp.abs(stored - gained) / jnp.abs(factor * work),
        "report": observe(parts, problem, state),
    }
    return jax.tree.map(lambda x: x[0], outcome)


@functools.partial(eqx.filter_jit, compiler_options=_ONCE)
def _press(
    structure: Structure, plans: AbstractPlan, inputs: dict[str, Array]
) -> dict[str, Any]:
    def one(plan: AbstractPlan, inputs: dict[str, Array]) -> dict[str, Any]:
        return press(scene_parts(structure.scene, inputs), plan)

    return jax.lax.map(lambda arguments: one(*arguments), (plans, inputs))


def study(
    count: int, seed: int = 1, patterns: Sequence[tuple[str, str, int]] = ALL_PATTERNS
) -> list[Pressed]:
    """Press `count` random scenes of each pattern: law, oil, number of loads."""
    rng = np.random.default_rng(seed)
    outcomes = []
    for law, oil, loads in patterns:
        structure = pattern(law, oil, loads)
        plans, inputs, lanes = draw(rng, structure, count)
        solved = _press(Structure(structure), plans, lanes)
        for i, values in enumerate(inputs):
            one = plain(solved, i)
            result, way = NAMES[one.pop("result")], one.pop("way")
            touch = one.pop("touch")
            one["touch"] = touch if way == 0 and touch < 1e3 else None
            outcomes.append(Pressed(law, oil, values, result=result, **one))
    return outcomes


def main() -> None:
    """Print a table of outcomes."""
    configure()
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    outcomes = study(-(-total // len(ALL_PATTERNS)))
    reached = [o for o in outcomes if o.touch is not None]
    table = Table("law", "oil", "scenes", "reach the wall", "converged", "most corrections")
    for law, oil in sorted({(o.law, o.oil) for o in outcomes}):
        group = [o for o in outcomes if (o.law, o.oil) == (law, oil)]
        touching = [o for o in group if o.touch is not None]
        converged = [o for o in touching if o.result == "converged"]
        most = max((o.iterations for o in touching), default=0)
        numbers = (len(group), len(touching), len(converged), most)
        table.add_row(law, oil, *map(str, numbers))
    console = Console()
    console.print(table)
    good = [o for o in reached if o.result == "converged"]
    console.print(
        f"converged {len(good)} of {len(reached)}; "
        f"largest imbalance {max(o.imbalance for o in good):.1e} of the load, "
        f"largest error of the energy balance {max(o.energy_error for o in good):.1e}; "
        f"touching at twice the load: {sum(o.report['wall_contact'] for o in good)}; "
        f"deepest penetration {1e6 * max(o.report['gap_tolerance_m'] for o in good):.2f} um"
    )
    for o in reached:
        stable = o.report["material_stable"]
        if o.result != "converged":
            console.print(f"{o.result}: {o.law}, {o.oil}, {stable=}, {o.touch}, {o.inputs}")


if __name__ == "__main__":
    main()
