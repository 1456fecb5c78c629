"""Derivatives of any reported quantity by every continuous input of a scene."""

import math
import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.config.errors import nearest
from suas_jax.equilibrium.balance import State, unknowns_of
from suas_jax.equilibrium.correction import corrected
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.build import problem_of
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.solve import Solution
from suas_jax.scene.structure import Inputs, Structure
from suas_jax.scene.travel import driven_by_force


class UnknownQuantityError(ValueError):
    """The quantity to differentiate is no real number of the report."""


class SingularTangentError(ValueError):
    """No derivative exists at the equilibrium."""


def quantities(report: Any, prefix: str = "") -> list[str]:
    """Paths of the quantities in a report that can be differentiated."""
    if isinstance(report, dict):
        items = [(str(key), value) for key, value in report.items()]
    elif isinstance(report, list):
        items = [(str(i), value) for i, value in enumerate(report)]
    else:
        smooth = eqx.is_array(report) and jnp.issubdtype(report.dtype, jnp.floating)
        if smooth and report.ndim == 2:  # a column over the taxels
            table, _, name = prefix.removesuffix(".").rpartition(".")
            return [f"{table}.{i}.{name}" for i in range(report.shape[0])]
        return [prefix.removesuffix(".")] if smooth else []
    return [name for key, value in items for name in quantities(value, f"{prefix}{key}.")]


def picked(report: Any, path: str) -> Array:
    """A quantity of a report by its path."""
    for key in path.split("."):
        if isinstance(report, dict) and key.isdigit():  # a table of columns over the taxels
            report = {name: column[int(key)] for name, column in report.items()}
        else:
            report = report[int(key)] if isinstance(report, list) else report[key]
    return report


def _observed(
    scene: Structure, plan: AbstractPlan, states: tuple[State, State], inputs: Inputs
) -> dict[str, Any]:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    state, shown = states
    change, _, _ = unknowns_of(problem, jax.tree.map(lambda a, b: a - b, shown, state))
    found = corrected(problem, state, change)
    return observe(parts, problem, found.state, found.root)


@eqx.filter_jit
def _program(
    scene: Structure,
    path: str,
    plan: AbstractPlan,
    states: tuple[State, State],
    inputs: Inputs,
) -> dict[str, Array]:
    def quantity(inputs: Inputs) -> Array:
        report = _observed(scene, plan, states, inputs)
        # Here, as no more than the trace is needed to know them.
        require_known(path, quantities(report))
        return picked(report, path)[0]

    driven = driven_by_force(scene.scene)
    if not driven:
        return jax.grad(quantity)(inputs)

    def with_forces(inputs: Inputs) -> Array:
        loads = _observed(scene, plan, states, inputs)["loads"]
        forces = [loads[d.load][f"{d.force}_N"][0] for d in driven]
        return jnp.stack([quantity(inputs), *forces])

    rows = jax.jacrev(with_forces)(inputs)
    travels = jnp.stack([rows.pop(d.path(d.travel)) for d in driven], -1)
    # The travels change until the forces are the given ones: dF = 0, or that of the input.
    shares = jnp.linalg.solve(travels[1:].T, travels[0])
    for k, d in enumerate(driven):
        rows[d.path(d.force)] = jnp.zeros(1 + len(driven)).at[1 + k].set(-1.0)
    return {path: row[0] - shares @ row[1:] for path, row in rows.items()}


def require_known(path: str, allowed: list[str]) -> None:
    """Refuse what is no quantity of a report.

    Raises:
        UnknownQuantityError: the message lists what is.
    """
    if path in allowed:
        return
    near = nearest(path, allowed)
    advice = f' did you mean "{near}"?' if near else ""
    taxels = [name for name in allowed if re.fullmatch(r"taxels\.\d+\.so", name)]
    raise UnknownQuantityError(
        f'"{path}" is not a quantity that can be differentiated;{advice} use one of '
        + ", ".join(name for name in allowed if not re.match(r"taxels\.[1-9]", name))
        + (f" (and so on, {len(taxels)} taxels)" if taxels else "")
    )


def gradient(solution: Solution, path: str) -> dict[str, float]:
    """Differentiate one reported quantity of a converged solution by every continuous input.

    Costs one linear solve with the tangent at the equilibrium, whatever the number of
    inputs. Stations move with clamps and loads, as they do when the scene is solved again.
    Where the membrane lies on the wall, the derivative is that of the contact law's tangent; at
    the load at which a point just touches, it is that of the open side.

    Args:
        solution: of the scene.
        path: of the quantity in the report, such as ``oil_pressure_Pa`` or
            ``loads.0.displacement_m``.

    Returns:
        Derivatives by TOML path, in SI units; angles per radian.

    Raises:
        UnknownQuantityError: the path is not a differentiable quantity of the report.
        SingularTangentError: the skin buckles at just this load.
        Float64Error: float64 is off.
    """
    require_float64()
    scene = Structure(solution.scene, wall=solution.wall)
    inputs = {k: jnp.asarray(v, float) for k, v in solution.inputs.items()}
    known = (solution.plan, (solution.state, solution.shown), inputs)
    found = COMPILED.run(_program, scene, path, *known, once=True)
    slopes = {name: float(value) for name, value in found.items()}
    if not any(map(math.isfinite, slopes.values())):
        raise SingularTangentError(
            f'"{path}" has no derivative at this equilibrium, whose tangent is singular; '
            "change a load a little"
        )
    return slopes
