"""A section in motion followed through time: steps as long as their error allows.

What balances is in `suas_jax.dynamics.moving_skin`, a step of it in
`suas_jax.dynamics.tr_bdf2`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.dynamics.driven import DrivenSkin, Values
from suas_jax.dynamics.inertia import flow_of
from suas_jax.dynamics.motion import free_unknowns
from suas_jax.dynamics.moving_skin import Inverse, MovingSkin
from suas_jax.dynamics.steps import MOST_STEPS, Rows, begun, bend_weight, observed_at
from suas_jax.dynamics.tr_bdf2 import LENGTH, Moving, tried
from suas_jax.equilibrium.outcomes import index_of

_SLOW = 0.75  # ratio of corrections from which on an inverse is made anew
_OTHER_STEP = 0.2  # difference of steps that an inverse serves
_LONGER, _WORTH, _SHORTER = 4.0, 2.5, 0.2  # of the next step
_SMALLEST = 1e-12  # step over a row at which the history is given up


@eqx.filter_jit
def film_at_rest(
    scene: Any, plan: Any, inputs: Any, time: Array, values: Values, scale: Array
) -> Moving:
    """A skin that has always been at rest, before it moves.

    `scene`: with the instantaneous response of its material. `plan`: mesh of the whole section.
    `inputs`: the scene's numbers. `time`: [s]. `values`: without loads. `scale`: displacement
    that counts [m].
    """
    skin = DrivenSkin.of(scene, plan, inputs, values)
    rest = begun(skin, time, values)
    moving = MovingSkin.of(skin)
    body = moving.at(values, rest.past.relaxed(skin.series))
    near = body.sampling.near(rest.state.q)
    still = flow_of(near.at, near.push(0 * rest.state.q), body.sampling.water)
    size = len(free_unknowns(body.shell)) + 1
    return Moving(
        rest.time,
        rest.step,
        rest.values,
        rest.travels,
        rest.state,
        jnp.zeros_like(rest.state.q),
        still,
        still,
        rest.past,
        jnp.asarray(True),
        Inverse(jnp.zeros((size, size)), jnp.zeros(())),
        rest.error,
        jnp.asarray(scale, float),
        rest.largest,
        rest.iterations,
        rest.steps,
        rest.result,
    )


@eqx.filter_jit
def through_film(
    scene: Any, plan: Any, inputs: Any, rows: Rows, start: Moving, tolerance: Array
) -> tuple[dict[str, Any], dict[str, Array], Moving]:
    """Follow a history through some rows; as `steps.through`, of a skin in motion."""
    skin = DrivenSkin.of(scene, plan, inputs, rows.final)
    moving = MovingSkin.of(skin)

    def visit(now: Moving, row: Rows) -> tuple[Moving, Any]:
        now = now._replace(iterations=0 * now.iterations, steps=0 * now.steps)
        apart = jnp.stack([jnp.any(now.values[k] != x) for k, x in row.first.items()])
        # What jumps moves nothing at once.
        jumps = row.end <= row.begin
        now = now._replace(
            jumped=now.jumped | jumps | jnp.any(apart),
            values=jax.tree.map(lambda a, b: jnp.where(jumps, b, a), row.first, row.final),
        )

        def going(now: Moving) -> Array:
            left = now.time < row.end
            return left & jnp.all(now.result == 0) & (now.steps < MOST_STEPS)

        now = jax.lax.while_loop(going, lambda now: _step(moving, now, row, tolerance), now)
        late = (now.time < row.end) & (now.result == 0)
        result = jnp.where(late, index_of("max_steps"), now.result)
        now = now._replace(result=result.astype(now.result.dtype))
        return now, observed_at(skin, now)

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

    length = LENGTH * step
    stale = jnp.abs(length / jnp.maximum(now.inverse.step, 1e-300) - 1) > _OTHER_STEP

    def anew() -> Inverse:
        body = moving.at(values(jnp.zeros(())), now.past.seen(series, length))
        return body.inverse(now.state, now.velocity, length)

    inverse = jax.lax.cond(stale, anew, lambda: now.inverse)
    trial = tried(moving, now, step, values, inverse)
    end = trial.half
    largest = jnp.maximum(now.largest, jnp.max(jnp.abs(end.state.q[:2])))
    strongest = jnp.maximum(now.stress, trial.stress)
    fades = jnp.sum(series.g * bend_weight(step / series.tau))
    error = jnp.max(jnp.abs(trial.wrong[:2])) / largest
    error += fades * trial.bend / jnp.maximum(strongest, 1e-300)
    good = trial.good & (error <= tolerance)
    ratio = 0.9 * (tolerance / jnp.maximum(error, 1e-300)) ** (1 / 3)
    # A step of another length needs another inverse, so that few are worth it; and one that a
    # row cut short says little of the next.
    longer = jnp.where(ratio > _WORTH, jnp.minimum(ratio, _LONGER) * step, wanted)
    longer = jnp.where(now.step > left, jnp.maximum(longer, _finite(now.step)), longer)
    shorter = jnp.where(trial.good, jnp.maximum(ratio, _SHORTER) * step, _SHORTER * step)
    # An inverse that fails is made anew before a step is made shorter.
    shorter = jnp.where(trial.good | stale, shorter, wanted)
    poor = ~trial.good | (end.ratio > _SLOW)
    inverse = inverse._replace(step=jnp.where(poor, 0.0, inverse.step))
    ended = ~good & (shorter < _SMALLEST * (row.end - row.begin))
    result = jnp.where(ended, index_of("no_convergence"), now.result)
    missed = now._replace(
        step=shorter,
        inverse=inverse,
        iterations=now.iterations + end.corrections,
        steps=now.steps + 1,
        result=result.astype(now.result.dtype),
    )
    taken = Moving(
        jnp.where(step >= left, row.end, now.time + step),
        longer,
        values(jnp.ones(())),
        now.travels,
        end.state,
        end.velocity,
        end.flow,
        end.rate,
        trial.past,
        jnp.asarray(False),
        inverse,
        now.error + error,
        largest,
        strongest,
        missed.iterations,
        missed.steps,
        now.result,
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), taken, missed)


def _finite(x: Array) -> Array:
    return jnp.where(jnp.isfinite(x), x, 0.0)
