"""Derivatives of a history's quantities by every continuous input of its scene.

A history is a chain of equilibria, each with a response that the past leaves. With the steps
held, state x_n and past s_n at the end of step n obey ::

    r_n(x_n, s_(n-1), a) = 0,   s_n = h_n(s_(n-1), x_n, a)

with the inputs a, relaxation's shares and times among them. Once the states are known,
each x_n(a) follows from one linear solve with the tangent of its step, and the derivative of a
quantity from one sweep backwards, the adjoint ::

    lambda_n = -(dr_n/dx)^-T (dh_n/dx)^T mu_n
    mu_(n-1) = (dh_n/ds)^T mu_n + (dr_n/ds)^T lambda_n

whose cost is that of about two corrections a step, whatever the number of inputs. States are
recorded; of the past, one copy a step is kept.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config import SceneSpec
from suas_jax.constitutive.relaxation import Past, Response
from suas_jax.dynamics.driven import FACTOR, DrivenSkin, Values, answering, membrane_of
from suas_jax.dynamics.steps import Moment, Rows, at_rest, attempt, entered, unfinished
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import differentiable
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure
from suas_jax.scene.gradient import SingularTangentError, picked, quantities, require_known
from suas_jax.scene.observables import observe
from suas_jax.scene.report_keys import require_reported
from suas_jax.scene.sweep import SweepError
from suas_jax.scene.travel import driven_by_force

Known = tuple[Structure, AbstractPlan, Inputs]
_TOGETHER = 32  # steps that a program is made for, and multiples of it
_WARMTH = "environment.temperature"


class Steps(NamedTuple):
    """Steps that were taken, one after another."""

    length: Float[Array, " step"]  # of each [s]; zero over a part of a jump
    values: Values  # that the history changes, at its end
    state: State  # the equilibrium there


class Record(NamedTuple):
    """A history that can be gone through again."""

    begin: State  # the skin at rest
    values: Values  # there
    steps: Steps  # from there on
    peak: Values  # the largest values of the whole history


def point_asked(quantity: str, rows: int, loads: int) -> tuple[int, str]:
    """Row of a history, and path in its report, of a quantity to differentiate.

    Raises SweepError: there is no such row; ValueError: no report has the quantity.
    """
    number, path = str(rows - 1), quantity
    if quantity.startswith("points."):
        number, _, path = quantity.removeprefix("points.").partition(".")
    if not (number.isdecimal() and int(number) < rows and path):
        raise SweepError(
            f'--gradient "{quantity[:80]}": points.0 to points.{rows - 1} are there, each '
            "with the quantities of `suas solve`, for example "
            f"points.{rows - 1}.oil_pressure_Pa"
        )
    require_reported(path, loads)
    return int(number), path


def require_derivatives(scene: SceneSpec, *, moves: bool) -> None:
    """Refuse to differentiate a history of a scene whose film may move.

    Raises SweepError: says why it can't be differentiated, and what can.
    """
    reason = None
    if moves:
        reason = (
            "the oil's film moves in it, whose steps have no derivatives: leave its viscosity "
            "out, or follow it more slowly"
        )
    elif driven_by_force(scene):
        reason = "a body is pressed by a force: give its travel, depth, instead"
    if reason is not None:
        raise SweepError(f"--gradient: this history can't be differentiated: {reason}")


@eqx.filter_jit
def _attempt(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    row: Rows,
    now: Moment,
    tolerance: Array,
) -> tuple[Moment, Array]:
    skin = DrivenSkin.of(scene, plan, inputs, row.final)
    after = attempt(skin, now, row, tolerance)
    return after, unfinished(after, row)


def record(
    known: Known,  # scene with the instantaneous response of its material, mesh and numbers
    rows: Rows,  # of the history
    rest: dict[str, float],  # values before the first of them
    peak: Values,  # the largest values of the whole history
    tolerance: Float[np.ndarray, ""],  # see `steps.through`
) -> Record | None:
    """Follow a history and keep every step.

    Returns the steps; None where the history has no equilibrium to its end.
    """
    effort = {"once": True, "long": known[1].solves_long}
    values = {key: np.asarray(x, float) for key, x in rest.items()}
    now = begin = COMPILED.run(at_rest, *known, rows.begin[0], values, once=True)
    taken: list[Any] = []
    for i in range(len(rows.end)):
        row = jax.tree.map(lambda x, i=i: np.asarray(x[i]), rows)
        now = entered(now, row)
        more = bool(unfinished(now, row))
        while more:
            after, more = COMPILED.run(_attempt, *known, row, now, tolerance, **effort)
            if np.any(after.result != 0):
                return None
            if after.time > now.time or any(after.values[k] != now.values[k] for k in rest):
                taken.append(Steps(after.time - now.time, after.values, after.state))
            now = after
    if not taken:
        taken.append(Steps(0 * begin.time, begin.values, begin.state))
    left = -len(taken) % _TOGETHER
    nothing = taken[-1]._replace(length=np.zeros(()))
    steps = jax.tree.map(lambda *x: np.stack(x), *taken, *([nothing] * left))
    at_begin: Any = values
    return Record(begin.state, at_begin, steps, peak)


@eqx.filter_jit
def _program(
    scene: Structure, path: str, plan: AbstractPlan, record: Record, inputs: Inputs
) -> dict[str, Array]:
    def quantity(inputs: Inputs) -> Array:
        report = _observed(scene, plan, record, inputs)
        require_known(path, quantities(report))
        return picked(report, path)[0]

    return jax.grad(quantity)(inputs)


def _observed(
    scene: Structure, plan: AbstractPlan, record: Record, inputs: Inputs
) -> dict[str, Any]:
    """What is observed at the end of a history, as a function of the inputs."""
    skin = DrivenSkin.of(scene, plan, inputs, record.values)
    series, travels = skin.series, skin.no_travels
    change = {k: _change(inputs[k]) for k in record.values if k != FACTOR}

    def moved(values: Values) -> Values:
        """With an input all of its rows change: in proportion, temperatures by as much."""
        found = dict(values)
        for key, by in change.items():
            peak = record.peak[key]
            share = values[key] / jnp.where(peak == 0, 1.0, peak)
            found[key] = values[key] + by * (1.0 if key == _WARMTH else share)
        return found

    membrane = membrane_of(skin.problem(record.values, travels))
    like = jax.eval_shape(membrane.deviator, membrane.rest())
    held = Response(series.long_term_share, jnp.zeros(like.shape))
    problem = skin.answering(moved(record.values), travels, held)
    rest = differentiable(problem, record.begin)
    first = membrane_of(problem).deviator(rest.q)
    past = Past(first, Past.none(series, first.shape).parts)

    def visit(past: Past, step: Steps) -> tuple[Past, None]:
        response = past.seen(series, step.length)
        problem = skin.answering(moved(step.values), travels, response)
        state = differentiable(problem, step.state)
        stress = membrane_of(problem).deviator(state.q)
        return past.after(series, step.length, stress), None

    past, _ = jax.lax.scan(jax.checkpoint(visit), past, record.steps)
    last = jax.tree.map(lambda x: x[-1], record.steps)
    parts, problem = skin.parts(moved(last.values), travels)
    settled = answering(problem, past.relaxed(series))
    found = corrected(settled, last.state)
    return observe(parts, settled, found.state, found.root)


def _change(x: Any) -> Array:
    """Zero, with the derivatives of an input."""
    return x - jax.lax.stop_gradient(x)


def history_gradient(known: Known, record: Record, path: str) -> dict[str, float]:
    """Differentiate what is observed at the end of a history by every continuous input.

    Sizes of loads that the history changes are those of its largest row, the others in
    proportion; a temperature that it changes is moved alike in all rows.

    `known`: scene with the instantaneous response of its material, mesh and numbers. `record`:
    of the history, to the point that is asked for. `path`: of the quantity in that point's
    report.
    Returns derivatives by TOML path, in SI units; angles per radian.
    Raises UnknownQuantityError: the path is not a differentiable quantity of the report;
    SingularTangentError: the skin buckles somewhere on the way.
    """
    scene, plan, inputs = known
    effort = {"once": True, "long": plan.solves_long}
    found = COMPILED.run(_program, scene, path, plan, record, inputs, **effort)
    slopes = {name: float(value) for name, value in found.items()}
    if not any(map(math.isfinite, slopes.values())):
        raise SingularTangentError(
            f'"{path}" has no derivative in this history, whose tangent is singular somewhere'
        )
    return slopes
