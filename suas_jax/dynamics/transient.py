"""A skin in motion followed through time: steps as long as their error allows.

What balances is in `suas_jax.dynamics.half_step`, a step of it in
`suas_jax.dynamics.tr_bdf2`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.dynamics.driven import DrivenSkin, Step, Values, membrane_of
from suas_jax.dynamics.half_step import Inverse
from suas_jax.dynamics.motion import free_unknowns
from suas_jax.dynamics.steps import (
    Moment,
    Rows,
    as_whole,
    begun,
    bend_weight,
    followed_part,
    observed_at,
    read_where_told,
)
from suas_jax.dynamics.tr_bdf2 import Moving, MovingSkin, tried
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.scene.build import Inputs, Structure
from suas_jax.skin.prestress import is_prestressed

_LONGER, _WORTH, _SHORTER = 4.0, 2.5, 0.2  # of the next step
_SMALLEST = 1e-12  # step over a row at which the history is given up
# Between two rows: after a blow a skin over thin oil rings for thousands of them.
_MOST_STEPS = 100_000


@eqx.filter_jit
def film_at_rest(
    scene: Structure,  # with the instantaneous response of its material
    plan: AbstractPlan,  # mesh of what is followed
    inputs: Inputs,  # the scene's numbers
    time: Array,  # [s]
    apart: Values,  # without loads, bodies off the skin
    values: Values,  # without loads, bodies where they begin
    scale: Array,  # displacement that counts [m]
    outside: Array,  # added mass of a pad's water, see `pad.outside_of`
) -> Moving:
    """A skin that has always been at rest, before it moves."""
    skin = DrivenSkin.of(scene, plan, inputs, values)
    rest = begun(skin, time, apart)
    if skin.touched and is_prestressed(scene.scene):
        rest = _met(skin, rest, values)
    moving = MovingSkin.of(skin, outside)
    moment = moving.at(values, rest.past.relaxed(skin.series))
    still, bodies = moment.near(rest.state.q).still, len(moving.pressed)
    size = len(free_unknowns(moment.problem.mechanics)) + 1 + bodies
    none = jnp.zeros(bodies, bool)
    return Moving(
        rest.time,
        rest.step,
        rest.values,
        rest.travels,
        jnp.ones(bodies),
        rest.state,
        jnp.zeros_like(rest.state.q),
        still,
        still,
        jnp.asarray(outside, float),
        rest.past,
        jnp.asarray(True),
        Inverse(jnp.zeros((size, size)), jnp.zeros(()), none),
        rest.error,
        jnp.asarray(scale, float),
        rest.largest,
        rest.iterations,
        rest.steps,
        rest.result,
    )


def _met(skin: DrivenSkin, rest: Moment, values: Values) -> Moment:
    """The same, of a skin that long was held back by bodies which it came out to meet."""
    ever, rtol = jnp.asarray(jnp.inf), jnp.asarray(LoadStepping.rtol)
    step = Step(values, rest.travels, rest.past, ever, jnp.asarray(True), rtol)
    found, travels = skin.balanced(rest.state, rest.travels, step)
    stress = membrane_of(skin.problem(values, travels)).deviator(found.state.q)
    past = rest.past.after(skin.series, ever, stress)
    result = jnp.where(rest.result != 0, rest.result, found.result)
    return rest._replace(values=values, state=found.state, past=past, result=result)


@eqx.filter_jit
def through_film(
    scene: Structure,
    plan: AbstractPlan,
    inputs: Inputs,
    rows: Rows,
    start: Moving,
    tolerance: Array,
) -> tuple[dict[str, Any], dict[str, Array], Moving]:
    """Follow a history through some rows; as `steps.through`, of a skin in motion."""
    skin, part = (
        DrivenSkin.of(scene, mesh, inputs, rows.final) for mesh in (plan, followed_part(plan))
    )
    moving = MovingSkin.of(part, start.outside)

    def visit(now: Moving, row: Rows) -> tuple[Moving, Any]:
        now = now._replace(iterations=0 * now.iterations, steps=0 * now.steps)
        apart = jnp.stack([jnp.any(now.values[k] != x) for k, x in row.first.items()])
        now = now._replace(jumped=now.jumped | jnp.any(apart))

        def going(now: Moving) -> Array:
            left = now.time < row.end
            return left & jnp.all(now.result == 0) & (now.steps < _MOST_STEPS)

        now = jax.lax.while_loop(going, lambda now: _step(moving, now, row, tolerance), now)
        late = (now.time < row.end) & (now.result == 0)
        result = jnp.where(late, index_of("max_steps"), now.result)
        now = now._replace(result=result.astype(now.result.dtype))
        # What jumps moves nothing at once, nor what the shell leaves out.
        jumps = row.end <= row.begin
        told = jax.tree.map(lambda a, b: jnp.where(jumps, b, a), now.values, row.final)
        return now, read_where_told(observed, (now, told), row)

    def observed(at: tuple[Moving, Values]) -> tuple[dict[str, Any], dict[str, Array]]:
        return observed_at(skin, as_whole(part, at[0]), at[1])

    end, (reports, outcomes) = jax.lax.scan(visit, start, rows)
    return reports, outcomes, end


def _step(moving: MovingSkin, now: Moving, row: Rows, tolerance: Array) -> Moving:
    """Try a step towards the end of a row, and take it where it is short enough."""
    series, left = moving.skin.series, row.end - now.time
    wanted = jnp.minimum(now.step, left)
    step = left / jnp.ceil(left / wanted - 1e-9)

    def values(share: Array) -> Values:
        """That much of the step later."""
        over = (now.time + share * step - row.begin) / (row.end - row.begin)
        over = jnp.minimum(over, 1.0)
        return jax.tree.map(lambda a, b: a + over * (b - a), row.first, row.final)

    trial = tried(moving, now, step, values)
    end = trial.half
    largest = jnp.maximum(now.largest, moving.size(end.state.q))
    strongest = jnp.maximum(now.stress, trial.stress)
    fades = jnp.sum(series.g * bend_weight(step / series.tau))
    error = moving.size(trial.wrong) / largest
    error += fades * trial.bend / jnp.maximum(strongest, 1e-300)
    good = trial.good & (error <= tolerance)
    ratio = 0.9 * (tolerance / jnp.maximum(error, 1e-300)) ** (1 / 3)
    # A step of another length needs another inverse, so that few are worth it; and one that a
    # row cut short says little of the next.
    longer = jnp.where(ratio > _WORTH, jnp.minimum(ratio, _LONGER) * step, wanted)
    known = jnp.nan_to_num(now.step, posinf=0.0)
    longer = jnp.where(now.step > left, jnp.maximum(longer, known), longer)
    shorter = jnp.where(trial.good, jnp.maximum(ratio, _SHORTER) * step, _SHORTER * step)
    ended = ~good & (shorter < _SMALLEST * (row.end - row.begin))
    result = jnp.where(ended, index_of("no_convergence"), now.result)
    again = jnp.where(trial.good, end.inverse.step, 0.0)
    missed = now._replace(
        step=shorter,
        inverse=end.inverse._replace(step=again),
        iterations=now.iterations + end.corrections,
        steps=now.steps + 1,
        result=result.astype(now.result.dtype),
    )
    taken = Moving(
        jnp.where(step >= left, row.end, now.time + step),
        longer,
        values(jnp.ones(())),
        now.travels._replace(length=end.travel),
        end.share,
        end.state,
        end.velocity,
        end.flow,
        end.rate,
        now.outside,
        trial.past,
        jnp.asarray(False),
        end.inverse,
        now.error + error,
        largest,
        strongest,
        missed.iterations,
        missed.steps,
        now.result,
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), taken, missed)
