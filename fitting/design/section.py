"""Figures of a section as functions of its variables, with exact derivatives through `forward`.

First contact is found by bisection; one step of Newton's method from there, which does not move
it, has its derivatives. Where a share of units is asked for, a figure is the bound
that this share of them keeps: its logarithm moves by z sigma, sigma from the figures of skins
a small step of every tolerance away.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.stats import norm

from fitting.arrays import Floats
from fitting.datasheet.figures import Accuracy, Cases, figures_at
from fitting.datasheet.readings import Readings, far_taxels, picked, read, skins_in_lanes
from fitting.datasheet.variants import Variants, by_changes, variants_of
from fitting.datasheet.words import PLACED
from fitting.design.problem import STEP, Outcome, Problem, without_crosstalk
from fitting.design.want import OwnLimit, Variable, Want
from fitting.force_range.bound import angles_over, first_contacts, rated_force
from fitting.inverse_load.settings import MODEL_ERROR
from suas_jax import Loads, Skin, skin_of
from suas_jax.config import SkinSpec, continuous_inputs, structure
from suas_jax.equilibrium.buckling import stress_effect
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.numerics.length import length
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.content_key import Keyed
from suas_jax.skin.prestress import is_prestressed

_FURTHER = 1e-4  # share of first contact beyond it at which its change is read
# Beyond buckling a skin has no figures, and before it none of them tells that it comes: a
# search that sees no limit ends there.
_NOT_BUCKLED = OwnLimit("buckling_share", 0.95, least=False)


class Numbers(NamedTuple):
    """What a program of figures is given beside the variables."""

    own: dict[str, Any]  # inputs of the skin to start from, by path
    low: Any  # bounds of the variables [variable]
    high: Any  # see `low`
    angle: Any  # of the places [rad]
    rated: Any  # the rated force [N]
    noise: Any  # standard deviation of a reading [counts]
    far: Any  # taxels that count as crosstalk [taxel, place]
    moved: Any  # share by which tolerances move inputs, by path [skin]; none where not asked
    margin: Any  # z of the share of units


class Asked(Keyed):
    """What decides the compiled program of some figures: all but numbers."""

    def __init__(
        self,
        spec: SkinSpec,
        variables: Sequence[Variable],
        keys: tuple[str, ...],
        elements: int,
    ) -> None:
        self.spec, self.keys, self.elements = spec, keys, elements
        self.variables = tuple((v.paths, v.factor) for v in variables)
        self.key = (structure(spec), self.variables, keys, elements)


def figures(asked: Asked, x: Any, touch: Any, numbers: Numbers) -> tuple[Any, Any]:
    """Figures of a design [key, place] and outcomes of its states [skin, case, place].

    Differentiable by the variables x, between 0 and 1; `touch` are forces that close the gap
    [place] [N].
    """
    skin, skins = _skins(asked, _inputs(asked, x, numbers), numbers.moved)
    count = len(numbers.angle)
    zero = jnp.zeros(count)
    forces = [zero, zero + numbers.rated / 2, zero + numbers.rated, touch]
    if skins > 1:
        forces.append(touch * (1 + _FURTHER))
    force, shape = jnp.stack(forces), (skins, len(forces), count)
    lanes = [jnp.broadcast_to(x, shape).reshape(-1) for x in (numbers.angle, force)]
    if skins > 1:
        skin = picked(skin, np.repeat(np.arange(skins), shape[1] * count))
    found = read(skin, Loads.line(*lanes))[0]
    cases = jax.tree.map(lambda x: x.reshape(*x.shape[:-1], *shape), found)
    parts = [Readings(*(column[..., i, :] for column in cases)) for i in range(len(forces))]
    accuracy = Accuracy(numbers.noise, MODEL_ERROR)
    rest, half, rated, near = parts[:4]
    placed = figures_at(Cases(rest, half, rated, near, touch), accuracy, numbers.far)
    own = {key: getattr(placed, PLACED[key].field) for key in asked.keys}
    bounds = {key: bound_of_units(key, x, numbers.margin) for key, x in own.items()}
    if skins > 1 and "range_N" in bounds:
        # The neighbours' contact is read at the design's own, which moves with the design.
        further = forces[4] - parts[4].gap / parts[4].gap_slope
        ahead = bound_of_units("range_N", further, numbers.margin) - bounds["range_N"]
        by_touch = jax.lax.stop_gradient(ahead / (_FURTHER * touch))
        bounds["range_N"] += by_touch * (own["range_N"][0] - touch)
    return jnp.stack(list(bounds.values())), cases.result


def _inputs(asked: Asked, x: Any, numbers: Numbers) -> dict[str, Any]:
    """Inputs of designs by path, from variables between 0 and 1 [variable, ...]."""
    inputs = dict(numbers.own)
    for i, (paths, factor) in enumerate(asked.variables):
        value = numbers.low[i] + (numbers.high[i] - numbers.low[i]) * x[i]
        for path in paths:
            inputs[path] = numbers.own[path] * value if factor else value
    return inputs


@eqx.filter_jit
def _buckling(asked: Asked, x: Any, numbers: Numbers) -> Array:
    """Share of what buckles them that designs [variable, design] carry at rest; else NaN."""
    inputs = {k: jnp.broadcast_to(v, x.shape[1]) for k, v in _inputs(asked, x, numbers).items()}
    skin = skins_in_lanes(asked.spec, inputs, elements=asked.elements)
    none = jnp.zeros((1, x.shape[1]))
    problem = skin.problem(Loads(none, none, none, none[0]))
    rest = equilibrium(problem)
    share = stress_effect(problem, rest.state).share
    # Where nothing stresses the skin it is a ratio of zeros.
    return jnp.where(rest.outcome == 0, jnp.nan_to_num(share), jnp.nan)


def _skins(asked: Asked, inputs: dict[str, Any], moved: dict[str, Any]) -> tuple[Skin, int]:
    """The skin of a design and, in lanes, its neighbours; their number."""
    if not moved:
        return skin_of(asked.spec, inputs, contact=False, elements=asked.elements), 1
    rows = {path: inputs[path] * (1 + share) + step for path, (share, step) in moved.items()}
    skins = len(next(iter(rows.values())))
    every = {path: jnp.broadcast_to(value, skins) for path, value in inputs.items()}
    return skins_in_lanes(asked.spec, every | rows, elements=asked.elements), skins


def bound_of_units(key: str, values: Any, margin: Any) -> Any:
    """A figure [skin, place] that a share of units keeps, worse by the margin [place]."""
    own, slopes = values[0], by_changes(values)
    deviation = length(slopes) if len(slopes) else 0.0
    return own * jnp.exp((-1 if PLACED[key].least else 1) * margin * deviation / own)


def _moved(variants: Variants) -> dict[str, tuple[Floats, Floats]]:
    """How far tolerances move the inputs: as shares of them, and where they are zero [SI]."""
    found = {}
    for path, values in variants.inputs.items():
        own, change = values[0], (values - values[0])[:-4]  # without WARMER and DEEPER
        if change.any():
            found[path] = (change / own, 0 * change) if own else (0 * change, change)
    return found


@eqx.filter_jit
def _slopes(asked: Asked, x: Any, touch: Any, numbers: Numbers) -> tuple[Any, tuple[Any, Any]]:
    def of(x: Any) -> tuple[Any, tuple[Any, Any]]:
        found = figures(asked, x, touch, numbers)
        return found[0], found

    slopes: tuple[Any, tuple[Any, Any]] = jax.jacfwd(of, has_aux=True)(x)
    return slopes


class SectionProblem(Problem):
    """The figures of a section under line loads."""

    def __init__(self, want: Want, elements: int = 32) -> None:
        if is_prestressed(want.spec):
            want = replace(want, limits=(*want.limits, _NOT_BUCKLED))
        super().__init__(want)
        self.elements = elements  # of the mesh
        variants = None if want.units is None else variants_of(want.spec)
        spec = want.spec if variants is None else variants.spec
        skin = skin_of(spec, contact=False, elements=self.elements)
        edge = angles_over(skin, 2)[1]
        low, high = np.clip(want.angles or (-edge, edge), -edge, edge)
        self.angle = np.linspace(low, high, want.places)  # that count [rad]
        self.grid, self.ends = (want.places, 1), (self.angle[:1], self.angle[-1:])
        self.rated = want.force or rated_force(first_contacts(skin, self.angle)[0])
        self._asked = Asked(spec, want.variables, self.keys, self.elements)
        self._numbers = Numbers(
            {path: np.float64(value) for path, value in continuous_inputs(spec).items()},
            np.array([v.low for v in want.variables]),
            np.array([v.high for v in want.variables]),
            self.angle,
            np.float64(self.rated),
            np.float64(spec.sensing.noise),
            far_taxels(skin, self.angle[:, None]),
            {} if variants is None else _moved(variants),
            np.float64(norm.ppf(want.units or 0.5)),
        )

    def first_contacts(self, x: Floats) -> Floats:
        """Forces that close the gap [place] [N]; NaN where none does."""
        return first_contacts(self._skin_at(x), self.angle)[0]

    def _skin_at(self, x: Floats) -> Skin:
        inputs = self.want.inputs(np.asarray(x, float))
        return skin_of(self.want.spec, inputs, contact=False, elements=self.elements)

    def placed(self, x: Floats) -> Outcome:
        """The figures that have places; see the base class."""
        rest = Outcome({}, {}, True)
        if _NOT_BUCKLED in self.want.limits:
            rest = self._buckling_share(x)
            if not rest.found:
                return rest
        touch = self.first_contacts(x)
        known = np.where(np.isfinite(touch), touch, self.rated)
        far = far_taxels(self._skin_at(x), self.angle[:, None])
        by_x, (values, result) = jax.tree.map(
            np.asarray,
            COMPILED.run(_slopes, self._asked, x, known, self._numbers._replace(far=far)),
        )
        none = without_crosstalk(self.keys, far)
        values, by_x = np.where(none, 0.0, values), np.where(none[..., None], 0.0, by_x)
        # Of a contact with the wall that was not found, nothing else is wrong.
        settled = not result[:, :3].any()
        needed = "range_N" not in self.keys or np.isfinite(touch).all()
        found = bool(settled and needed and np.isfinite(values).all())
        return Outcome(
            {**dict(zip(self.keys, values, strict=True)), **rest.values},
            {**dict(zip(self.keys, by_x, strict=True)), **rest.slopes},
            found,
        )

    def _buckling_share(self, x: Floats) -> Outcome:
        """How near the skin at rest is to buckling."""
        steps = STEP * np.eye(len(x))
        rows = np.stack([x, *(x - steps), *(x + steps)], 1)
        share = np.asarray(COMPILED.run(_buckling, self._asked, rows, self._numbers))
        neighbours = np.where(np.isfinite(share[1:]), share[1:], 1.0)  # those that buckle
        before, after = neighbours.reshape(2, -1)
        slopes = (after - before) / (2 * STEP)
        found = bool(np.isfinite(share[0]))
        return Outcome({_NOT_BUCKLED.key: share[:1]}, {_NOT_BUCKLED.key: slopes[None]}, found)
