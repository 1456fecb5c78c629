"""Derivatives of any reported quantity by every continuous input, and their error."""

import math
import re
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from suas_jax.config import continuous_inputs
from suas_jax.config.errors import nearest
from suas_jax.equilibrium.balance import State, unknowns_of
from suas_jax.equilibrium.correction import corrected
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.scene.build import Inputs, Structure, problem_of
from suas_jax.scene.choice import FINER_SHARE
from suas_jax.scene.observables import observe
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import unloaded
from suas_jax.scene.solve import Solution, report_with
from suas_jax.scene.travel import Driven, driven_by_force


class UnknownQuantityError(ValueError):
    """The quantity to differentiate is not a real number of the report."""


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
    weights: Float[Array, " row"],
) -> dict[str, Array]:
    """Derivatives of a weighted sum of the quantity and of the forces that bodies are given.

    One row after the other: all at once takes four times as long to compile.
    """

    def weighted(inputs: Inputs) -> Array:
        report = _observed(scene, plan, states, inputs)
        # Here, as no more than the trace is needed to know them.
        require_known(path, quantities(report))
        forces = [
            report["loads"][d.load][f"{d.force}_N"][0] for d in driven_by_force(scene.scene)
        ]
        return weights @ jnp.stack([picked(report, path)[0], *forces])

    return jax.grad(weighted)(inputs)


def _with_forces(
    driven: list[Driven], rows: dict[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Derivatives by all inputs but the travels, which keep the forces that bodies are given.

    `rows`: derivatives of the quantity, then of the forces [row], by input, travels among them.
    """
    if not driven:
        return {path: row[0] for path, row in rows.items()}
    slopes = np.stack([rows[d.path(d.travel)] for d in driven], -1)
    # The travels change until the forces are the given ones: dF = 0, or that of the input.
    shares = _of_travels(slopes)
    left = {path: row[0] - shares @ row[1:] for path, row in rows.items()}
    for d, share in zip(driven, shares, strict=True):
        del left[d.path(d.travel)]
        left[d.path(d.force)] = share
    return left


def _of_travels(slopes: Float[np.ndarray, "row travel"]) -> Float[np.ndarray, " travel"]:
    """How far a quantity follows each force when travels keep the other forces.

    `slopes`: of the quantity, then of the forces, by the travels; a body that touches nothing
    has none. NaN where the forces do not tell the travels.
    """
    quantity, forces = slopes[0], slopes[1:]
    off = ~forces.any(1)
    try:
        return np.linalg.solve((forces + np.diag(off)).T, quantity)
    except np.linalg.LinAlgError:
        return np.full(len(quantity), np.nan)


def require_known(path: str, allowed: list[str]) -> None:
    """Refuse what is not a quantity of a report.

    Raises UnknownQuantityError: the message lists what is.
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
    known = (scene, path, solution.plan, (solution.state, solution.shown), inputs)
    driven = driven_by_force(solution.scene)
    unit = np.eye(1 + len(driven))
    found = [COMPILED.run(_program, *known, weights, once=True) for weights in unit]
    rows = {name: np.stack([row[name] for row in found]) for name in inputs}
    slopes = {name: float(value) for name, value in _with_forces(driven, rows).items()}
    if not any(map(math.isfinite, slopes.values())):
        raise SingularTangentError(
            f'"{path}" has no derivative at this equilibrium, whose tangent is singular; '
            "change a load a little"
        )
    return slopes


_DIRECTIONS = 4
_STEP = 1e-3  # of the inputs


def gradient_error_estimate(solution: Solution, path: str) -> float | None:
    """Estimate the relative error of a gradient by mesh and model, in the norm of D grad.

    The errors that are estimated of oil pressure and displacements are quantities of the solve
    like any other, so their derivatives by the inputs are the errors of the gradients, which
    need not be as small. With D the inputs themselves as their scales, a random vector r of
    signs and d/dr the derivative along D r::

        |D grad e|^2 = E[(de/dr)^2],    estimate = |D grad e| / |D grad y|

    Derivatives along r are differences (central; on a pad, whose solves take longest,
    one-sided) of the program that the solution had compiled, from the solution's own state: one
    of second derivatives would take longer to compile than all of them to run.

    Oil pressure and displacement under a line or patch have estimates of their own; the
    gradients of others take the largest of these. Under bodies see `_error_between_meshes`.
    None where it is unknown.
    """
    if unloaded(solution.scene):
        return None
    if solution.scene.bodies:
        return _error_between_meshes(solution, path)
    known = continuous_inputs(solution.scene)
    random = np.random.default_rng(0)
    slopes, errors, floor = [], [], 0.0
    one_sided = solution.scene.geometry.dimension == 3
    here = _moved(solution, known, dict.fromkeys(known, 0.0)) if one_sided else None
    for _ in range(_DIRECTIONS):
        steps = dict(zip(known, random.choice([-_STEP, _STEP], len(known)), strict=True))
        back = {path: -step for path, step in steps.items()}
        high = _moved(solution, known, steps)
        low = here if one_sided else _moved(solution, known, back)
        if low is None or high is None:
            return None
        distance = _STEP if one_sided else 2 * _STEP
        slopes.append((high.values - low.values) / distance)
        errors.append(np.abs(high.errors - low.errors).sum(0) / distance)
        floor = high.floor
    size = np.sqrt(np.square(slopes).mean(0))
    error = np.sqrt(np.square(errors).mean(0))
    own = _position(solution, path)
    if own is None:
        size[1:] = size[1:].max()
    share = np.divide(error, size, out=np.zeros_like(error), where=size > 0)
    found = floor + float(share.max() if own is None else share[own])
    return found if math.isfinite(found) else None


def _error_between_meshes(solution: Solution, path: str) -> float | None:
    """The same of a body's scene, whose errors are told by another solve, on a coarser mesh.

    Where a body touches a few points, its force ripples as it moves over them: by little, but
    so does its derivative by much. On each mesh points lie elsewhere.
    """
    scene = solution.scene
    if solution.coarsest.plan.counts == solution.plan.counts:
        return None
    known, random = continuous_inputs(scene), np.random.default_rng(0)

    def on_both(shares: dict[str, float]) -> NDArray[np.float64] | None:
        inputs = {name: value * (1 + shares[name]) for name, value in known.items()}
        reports = [report_with(solution, inputs, judged=judged) for judged in (False, True)]
        found = [None if report is None else picked(report, path) for report in reports]
        return None if None in found else np.array(found, float)

    here, slopes = on_both(dict.fromkeys(known, 0.0)), []
    if here is None:
        return None
    for _ in range(_DIRECTIONS):
        steps = dict(zip(known, random.choice([-_STEP, _STEP], len(known)), strict=True))
        there = on_both(steps)
        if there is None:
            return None
        slopes.append((there - here) / _STEP)
    coarse, fine = np.stack(slopes, -1)
    size, error = np.linalg.norm(fine), FINER_SHARE * np.linalg.norm(fine - coarse)
    return float(solution.report["model_error"] + error / size) if size > 0 else None


class _KeyQuantities(NamedTuple):
    """What errors are judged by."""

    values: NDArray[np.float64]  # of the quantities [quantity]
    # by each mesh compared, the correction's and the model [cause, quantity]
    errors: NDArray[np.float64]
    floor: float  # relative error that no input changes


def _moved(
    solution: Solution, known: dict[str, float], shares: dict[str, float]
) -> _KeyQuantities | None:
    """Key quantities where every input has moved by a share of itself."""
    inputs = {path: value * (1 + shares[path]) for path, value in known.items()}
    report = report_with(solution, inputs, judged=True)
    if report is None:
        return None
    found = report["key_quantities"]
    return _KeyQuantities(np.array(found["values"]), np.array(found["errors"]), found["floor"])


def _position(solution: Solution, path: str) -> int | None:
    """Which of the key quantities a path is."""
    if path == "oil_pressure_Pa":
        return 0
    match = re.fullmatch(r"loads\.(\d+)\.displacement_m", path)
    if match is None:
        return None
    kinds = [load.kind for load in solution.scene.loads]
    if kinds[int(match[1])] == "pressure":
        return None
    return 1 + sum(kind != "pressure" for kind in kinds[: int(match[1])])
