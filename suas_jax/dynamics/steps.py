"""Equilibria of a membrane that remembers, step by step through time.

At the end of a step the stress is a share of the instantaneous one and a rest that the past
leaves (`suas_jax.constitutive.relaxation`), so that each step is an equilibrium like any other,
continued from the one before. The update is exact where the instantaneous stress S0 changes
linearly over the step. Where it bends, as its rates in one step and the next tell, the stress
is wrong by, to leading order ::

    dS = sum g_i psi(dt / tau_i) S0'' dt^2,
    psi(x) = integral_0^1 exp(-x (1 - v)) (v - 1/2) dv

Steps are as long as that allows, and end at every row of the history. One program serves all
histories of a scene.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax.constitutive.relaxation import Past, Response
from suas_jax.dynamics.driven import (
    AbstractDriven,
    DrivenSkin,
    Step,
    Travels,
    Values,
    answering,
    membrane_of,
    seen,
)
from suas_jax.equilibrium.balance import Problem, State, verify, volume_residual
from suas_jax.equilibrium.continuation import LoadStepping
from suas_jax.equilibrium.equilibrium import Equilibrium
from suas_jax.equilibrium.load_path import follow, settled
from suas_jax.equilibrium.outcomes import PATH_ENDS, index_of
from suas_jax.equilibrium.validity import validity
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.scene.assessment import under_bodies
from suas_jax.scene.build import Inputs, Structure
from suas_jax.scene.contact_zone import touched_by_bodies
from suas_jax.scene.observables import observe

MOST_STEPS = 5_000
"""Steps between two rows before the history is given up."""
_FIRST_STEP = 0.02  # after a jump, over the shortest relaxation time
_LONGER, _SHORTER = 2.0, 0.2  # of the next step, at most
# Error of a state between rows, relative to its displacement, over that of a step's stress.
_ROUGH = 1e-2
_RUNAWAY = 1e-9  # step that is still too long, over a row and the shortest relaxation time
# Outcomes that an unstable state explains.
_ENDS = np.array([index_of(name) for name in ("converged", *PATH_ENDS, "max_steps")])
_SHORTEST = 1e-4  # step over a row, or share of a jump, at which the path counts as ended


class Moment(NamedTuple):
    """Where a history has come to."""

    time: Float[Array, ""]  # [s]
    step: Float[Array, ""]  # that is tried next [s]
    stride: Float[Array, ""]  # share of what is left of a jump that is tried next
    values: Values  # that the history changes
    drive: Values  # their rates over the last step, per second
    travels: Travels  # of bodies that are pressed by forces
    state: State  # the equilibrium
    # of the unknowns over the last step, and of the travels, per
    # second: what is expected of the next one
    pace: tuple[State, Float[Array, " body"]]
    bend: State  # half of that pace's own change per second, within a row
    past: Past  # what the material remembers
    rate: Array  # of the instantaneous stress over the last step [Pa/s]
    last: Float[Array, ""]  # length of that step [s]; zero where a jump makes the rate unknown
    smooth: Float[Array, ""]  # the same; zero before the first step of a row, where rates jump
    made: Float[Array, ""]  # error of the stress in that step; zero where it is unknown
    error: Float[Array, ""]  # sum of the errors of the stress, relative to its largest so far
    largest: Float[Array, ""]  # instantaneous stress so far [Pa]
    iterations: Int[Array, " lane"]  # Newton corrections since the last row
    steps: Int[Array, ""]  # the same of steps, those included that were too long
    result: Int[Array, " lane"]  # index of the outcome


class Rows(NamedTuple):
    """Rows of a history: where each one begins and ends."""

    begin: Float[Array, " row"]  # time of the row before [s]
    end: Float[Array, " row"]  # time of the row [s]
    first: Values  # values at its begin
    final: Values  # the same at its end
    told: Bool[Array, " row"]  # whether it is one of the history: others fill a block up


def followed_part(plan: AbstractPlan) -> AbstractPlan:
    """The part of a mesh that is followed: of a symmetric pad the half or quarter."""
    return plan if plan.dimension == 2 else plan.reduced()


def as_whole(part: AbstractDriven, now: Any) -> Any:
    """A `Moment` of the part of a skin, in motion or not, as one of the whole."""
    membrane = membrane_of(part.problem(now.values, now.travels))
    if not isinstance(membrane, Pad):
        return now
    past = Past(*map(membrane.mirrored_stress, now.past))
    q = membrane.mirrored(now.state.q)
    return now._replace(state=now.state._replace(q=q), past=past)


@eqx.filter_jit
def at_rest(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, time: Array, values: Values
) -> Moment:
    """A skin that has always been at rest.

    `scene`: with the instantaneous response of its material. `plan`: mesh of what is followed.
    `inputs`: the scene's numbers. `time`: [s]. `values`: without loads.
    """
    return begun(DrivenSkin.of(scene, plan, inputs, values), time, values)


def begun(skin: AbstractDriven, time: Array, values: Values) -> Moment:
    """A skin that has always been at rest; see `at_rest`."""
    series, travels = skin.series, skin.no_travels
    none, count = jnp.zeros(()), jnp.zeros(1, jnp.int32)

    def held(rest: Array) -> Problem:
        return skin.answering(values, travels, Response(series.long_term_share, rest))

    membrane = membrane_of(skin.problem(values, travels))
    shape = jax.eval_shape(membrane.deviator, membrane.rest()).shape
    problem = held(jnp.zeros(shape))
    state, result = _unloaded(problem, skin.level(values))
    stress = membrane_of(problem).deviator(state.q)
    past = Past(stress, Past.none(series, stress.shape).parts)
    return Moment(
        jnp.asarray(time, float),
        none + jnp.inf,
        none + 1,
        values,
        jax.tree.map(jnp.zeros_like, values),
        travels,
        state,
        jax.tree.map(jnp.zeros_like, (state, travels.length)),
        jax.tree.map(jnp.zeros_like, state),
        past,
        jnp.zeros_like(past.stress),
        *(none, none, none, none, jnp.max(jnp.abs(stress))),
        count,
        jnp.zeros((), jnp.int32),
        result,
    )


def _unloaded(problem: Problem, level: Array) -> tuple[State, Array]:
    """The state without loads, before bodies come near."""
    free = eqx.tree_at(lambda p: p.mechanics, problem, problem.mechanics.with_bodies(()))
    rest = settled(free, 1, LoadStepping())
    result = rest.result
    if free.prestressed and free.mechanics.touches:
        start = rest.y, rest.level, rest.level
        rest = follow(free, *start, LoadStepping(), near=True, rest=rest.y)
        result = jnp.where((result != 0) | (rest.result != 0), index_of("unstable"), 0)
    state = Equilibrium.of(free, rest).state
    return state._replace(factor=level), result.astype(rest.result.dtype)


@eqx.filter_jit
def through(
    scene: Structure,  # with the instantaneous response of its material
    plan: AbstractPlan,  # mesh of the whole membrane
    inputs: Inputs,  # the scene's numbers
    rows: Rows,  # in the order of time
    start: Moment,  # at the begin of the first one, of the part that is followed
    tolerance: Float[Array, ""],
) -> tuple[dict[str, Any], dict[str, Array], Moment]:
    """Follow a history through some rows.

    `tolerance`: error of the stress that a step may make, relative to the largest so far.
    Returns what is observed at the end of every row, how it was found, and the end of the last
    one.
    """
    skin, part = (
        DrivenSkin.of(scene, mesh, inputs, rows.final) for mesh in (plan, followed_part(plan))
    )

    def observed(now: Moment) -> tuple[dict[str, Any], dict[str, Array]]:
        return observed_at(skin, as_whole(part, now))

    end, (reports, outcomes) = followed(part, rows, start, tolerance, observed)
    return reports, outcomes, end


def followed(
    skin: AbstractDriven,
    rows: Rows,
    start: Moment,
    tolerance: Float[Array, ""],
    read: Callable[[Moment], Any],
) -> tuple[Moment, Any]:
    """Follow a history through some rows; see `through`.

    Returns the end of the last one, and what is read at the end of every row.
    """

    def visit(now: Moment, row: Rows) -> tuple[Moment, Any]:
        now = jax.lax.while_loop(
            lambda now: unfinished(now, row),
            lambda now: attempt(skin, now, row, tolerance),
            entered(now, row),
        )
        late = (now.time < row.end) & (now.steps >= MOST_STEPS)
        result = jnp.where(late & (now.result == 0), index_of("max_steps"), now.result)
        now = now._replace(result=result.astype(now.result.dtype))
        return now, read_where_told(read, now, row)

    return jax.lax.scan(visit, start, rows)


def read_where_told(read: Callable[[Any], Any], now: Any, row: Rows) -> Any:
    """What is read at the end of a row; zeros, which cost nothing, of one that fills up."""
    traced = eqx.filter_closure_convert(read, now)  # once, for its shapes and for itself
    shapes = jax.eval_shape(traced, now)
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    return jax.lax.cond(row.told, lambda now: traced(now), lambda _: nothing, now)


def entered(now: Moment, row: Rows) -> Moment:
    """A moment at the begin of a row, where rates may jump; a row without length is a jump.

    The pace goes on as far as loads do. After a ramp that ends it would lead away from the
    state that is held, and to another one where there are two.
    """
    last = jnp.where(row.end <= row.begin, 0.0, now.last)
    smooth, *counts = map(jnp.zeros_like, (now.smooth, now.iterations, now.steps))
    share = _going_on(now.drive, _pace(row.first, row.final, row.end - row.begin))
    return now._replace(
        last=last,
        smooth=smooth,
        pace=jax.tree.map(lambda x: share * x, now.pace),
        iterations=counts[0],
        steps=counts[1],
    )


def _going_on(before: Values, after: Values) -> Array:
    """Share of rates that goes on in other ones; all of it where nothing was driven."""
    size = sum(jnp.vdot(x, x) for x in before.values())
    along = sum(jnp.vdot(x, after[key]) for key, x in before.items())
    return jnp.where(size > 0, jnp.clip(along / jnp.where(size > 0, size, 1.0), -1, 1), 1.0)


def unfinished(now: Moment, row: Rows) -> Bool[Array, ""]:
    """Whether there is more of a row to follow."""
    apart = jnp.stack([jnp.any(now.values[k] != x) for k, x in row.final.items()])
    left = jnp.where(row.end <= row.begin, jnp.any(apart), now.time < row.end)
    return left & jnp.all(now.result == 0) & (now.steps < MOST_STEPS)


def observed_at(
    skin: DrivenSkin, now: Any, told: Values | None = None
) -> tuple[dict[str, Any], dict[str, Array]]:
    """What is observed, and how it was found, at a `Moment`, of a skin in motion or not.

    `told`: loads of the report, where they have jumped since the state was found.
    The state is judged by the oil's volume and the strains, not by its forces: they are not in
    balance in motion, and fade to nothing at rest.
    """
    relaxed, disturbed = now.past.relaxed(skin.series), now.past.disturbed(skin.series)
    parts, problem = skin.parts(now.values, now.travels)
    settled, other = (answering(problem, x) for x in (relaxed, disturbed))
    check, shown = seen(settled, now.state)
    if told is not None:
        parts = skin.parts(told, now.travels)[0]
        shown = shown._replace(factor=skin.level(told))
    report = observe(parts, settled, shown, now.state)
    for k, i in enumerate(skin.pressed):
        report["loads"][i]["depth_m"] = now.travels.length[k : k + 1]
    report["volume_residual"] = volume_residual(settled, now.state)
    report["stable"] = jax.lax.cond(
        check.stable[0],
        lambda: check.stable,
        lambda: verify(other, now.state, omitted=False)[0].stable,
    )
    strains = report["stretch_min"], report["strain_energy_J"], report.pop("in_domain")
    judged = validity(settled, now.state, (jnp.zeros(1), jnp.zeros(1)), *strains)
    result = jnp.where(now.result == 0, judged.astype(now.result.dtype), now.result)
    if settled.prestressed:
        result = _unless_buckled(result, report["stable"])
    unknowns = settled.mechanics.unknowns() + int(settled.oil.trapped)
    touched = touched_by_bodies(settled, now.state)
    outcome = {
        "result": under_bodies(settled, now.state, result, touched),
        "level": now.state.factor,
        "iterations": now.iterations,
        "time_error": now.error[None],
        "steps": now.steps[None],
        "t_s": now.time[None],
        "unknowns": jnp.full_like(now.result, unknowns),
        "shown": shown.q,
    }
    return report, outcome


def _unless_buckled(
    result: Int[Array, " lane"], stable: Bool[Array, " lane"]
) -> Int[Array, " lane"]:
    """The outcome of a skin with stress at rest: `unstable`, as of a solve, if it buckles."""
    left = ~stable & jnp.isin(result, _ENDS)
    return jnp.where(left, index_of("unstable"), result).astype(result.dtype)


def attempt(skin: AbstractDriven, now: Moment, row: Rows, tolerance: Array) -> Moment:
    """Try a step towards the end of a row, and take it where it is short enough."""
    series = skin.series
    left = row.end - now.time
    fresh = now.last == 0
    fastest = jnp.min(series.tau, initial=jnp.inf)
    wanted = jnp.where(fresh, jnp.minimum(now.step, _FIRST_STEP * fastest), now.step)
    # Rather two even steps than one that leaves next to nothing.
    step = jnp.where(left <= wanted, left, jnp.where(left < 2 * wanted, left / 2, wanted))
    arrived = left <= wanted
    time = jnp.where(arrived, row.end, now.time + step)
    jumps = row.end <= row.begin
    values = _values_at(time, arrived, now, row)
    expected, length = _expected(now, step)
    guessed = (step > 0) & jnp.any(now.pace[0].q != 0)
    # The search for travels needs states as they are read at a row's end: exact ones.
    exact = arrived | (now.travels.length.size > 0)
    rtol = jnp.where(exact, LoadStepping.rtol, _ROUGH * tolerance)
    way = Step(values, now.travels, now.past, step, guessed, rtol)
    found, travels = skin.balanced(expected, now.travels._replace(length=length), way)
    # A step that leads nowhere is tried again without a guess, and then made shorter.
    failed = jnp.any(found.result != 0)
    length = jnp.where(jumps, now.stride, step / jnp.where(jumps, 1.0, row.end - row.begin))
    ends = failed & ~guessed & (length < _SHORTEST)
    lost = failed & ~ends
    stress = membrane_of(skin.problem(values, travels)).deviator(found.state.q)
    largest = jnp.maximum(now.largest, jnp.max(jnp.abs(stress)))
    rate = (stress - now.past.stress) / jnp.where(step > 0, step, 1.0)
    # A rate that jumps at a row's begin may do so after the longest step.
    last = jnp.where(now.smooth > 0, now.last, jnp.minimum(now.last, step))
    bend = 2 * jnp.max(jnp.abs(rate - now.rate)) * step**2 / (step + last + (step == 0))
    error = jnp.sum(series.g * bend_weight(step / series.tau)) * bend
    error = jnp.where(fresh | (largest == 0), 0.0, error / jnp.where(largest > 0, largest, 1.0))
    # Creep that runs away, as a membrane that buckles does, leaves no step short enough.
    span = jnp.minimum(row.end - row.begin, fastest)
    runaway = ~failed & (error > tolerance) & (step < _RUNAWAY * span)
    good = ends | runaway | ((error <= tolerance) & ~lost)
    following = step * _growth(now, step, error, tolerance)
    following = jnp.where(fresh, _LONGER * wanted, following)
    # A step that a row cut short says little of the next one.
    following = jnp.where(good & arrived, jnp.maximum(following, wanted), following)
    following = jnp.where(jnp.isnan(following) | (step == 0), now.step, following)
    stands, flat = jax.tree.map(lambda x: jnp.where(lost, 0.0, x), (now.pace, now.bend))
    shorter = jnp.where(guessed | jumps, now.step, _SHORTER * step)
    tried = now._replace(
        step=jnp.where(lost, shorter, following),
        stride=jnp.where(lost, now.stride / 2, now.stride),
        pace=stands,
        bend=flat,
        iterations=now.iterations + found.iterations,
        steps=now.steps + 1,
    )
    result = jnp.where(ends, found.result, jnp.where(runaway, index_of("limit_point"), 0))
    pace = _pace((now.state, now.travels.length), (found.state, travels.length), step)
    taken = Moment(
        time,
        following,
        jnp.minimum(2 * now.stride, 1.0),
        values,
        _pace(now.values, values, step),
        travels,
        found.state,
        pace,
        _bend(now, pace[0], step),
        now.past.after(series, step, stress),
        rate,
        step,
        step,
        error,
        now.error + error,
        largest,
        tried.iterations,
        tried.steps,
        result.astype(now.result.dtype),
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), taken, tried)


def _values_at(time: Array, arrived: Array, now: Moment, row: Rows) -> Values:
    """Values at a time within a row, or after the next stride of a jump."""
    jumps = row.end <= row.begin
    share = (time - row.begin) / jnp.where(jumps, 1.0, row.end - row.begin)

    def between(now_at: Array, first: Array, final: Array) -> Array:
        over = jnp.where(now.stride < 1, now_at + now.stride * (final - now_at), final)
        return jnp.where(
            jumps, over, jnp.where(arrived, final, first + share * (final - first))
        )

    return jax.tree.map(between, now.values, row.first, row.final)


def _expected(now: Moment, step: Array) -> tuple[State, Array]:
    """State and travels at the end of a step."""
    ahead = jnp.minimum(step, _LONGER * now.last)  # further the pace says nothing
    here = now.state, now.travels.length
    state, length = jax.tree.map(lambda a, b: a + ahead * b, here, now.pace)
    curved = jnp.where(now.smooth > 0, ahead * (ahead + now.smooth), 0.0)
    return jax.tree.map(lambda a, b: a + curved * b, state, now.bend), length


def _growth(now: Moment, step: Array, error: Array, tolerance: Array) -> Array:
    """How much longer than a step the next one is, by the errors of this and the last one."""
    ratio = jnp.sqrt(tolerance / jnp.maximum(error, 1e-300))
    # Where errors grow from step to step, the next one allows for it: a third were too long.
    known = (error <= tolerance) & (now.smooth > 0) & (now.made > 0) & (error > 0)
    trend = jnp.sqrt(now.made / jnp.where(known, error, 1.0)) * step / now.last
    ratio = jnp.where(known, jnp.minimum(trend, 1.0), 1.0) * ratio
    return jnp.clip(0.9 * ratio, _SHORTER, _LONGER)


def _bend(now: Moment, pace: State, step: Array) -> State:
    """Half of a pace's change over the last two steps; none before the second one of a row."""
    by = jnp.where(now.smooth > 0, 1 / (step + now.smooth), 0.0)
    return jax.tree.map(lambda a, b: by * (b - a), now.pace[0], pace)


def _pace(before: Any, after: Any, step: Array) -> Any:
    """Change of unknowns by time; none over a jump."""
    by = jnp.where(step > 0, 1 / jnp.where(step > 0, step, 1.0), 0.0)
    return jax.tree.map(lambda a, b: by * (b - a), before, after)


def bend_weight(x: Array) -> Array:
    """Weight of a bend of the stress in the middle of a step; see the module."""
    short = x < 0.03
    safe = jnp.where(short, 1.0, x)
    lost = -jnp.expm1(-safe) / safe
    return jnp.where(short, x / 12 * (1 - x / 2), (1 - lost) / safe - lost / 2)
