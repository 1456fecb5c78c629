"""From data sets to the residuals of one fit: which scale, which tests, which order."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.data_checks import initial_modulus
from fitting.material.experiments.homogeneous import (
    AbstractExperiment,
    Bulge,
    Homogeneous,
    padded,
)
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.skin_curve import SkinCurve, Specimen, specimen
from fitting.material.fit.residuals import KINDS, Residuals, relative_scale, shared_error
from fitting.statistics.parameters import AbstractFamily, Scales

# Relative residuals are relative to no less than these fractions of a file's median
# reading; a difference of two stresses passes through zero without being small itself.
_FLOOR, _FLOOR_DIFFERENCE = 0.01, 0.05


@dataclasses.dataclass(frozen=True)
class Problem:
    """The residuals of one fit and where each data set is in them.

    Attributes:
        residuals: the misfit as a function of θ.
        places: positions of each data set's readings in the residuals.
        floors: smallest scale of relative residuals for each data set [Pa].
        kind: "relative", "absolute" or "noise".
        model_error: of the lumped shell, where a skin was tested, relative to its
            displacement: a standard deviation.
    """

    residuals: Residuals
    places: tuple[np.ndarray, ...]
    floors: tuple[float, ...]
    kind: str
    model_error: float = 0.0


def pose(
    sets: Sequence[Dataset], family: AbstractFamily, kind: str, *, estimate: bool = False
) -> Problem:
    """Build the residuals of a fit.

    Args:
        sets: the data.
        family: the law.
        kind: what residuals are relative to: "relative", each reading's own size (or the
            larger stress of the same biaxial state) with a floor; "absolute", the
            root-mean-square reading; "noise", the stated standard deviation.
        estimate: predict bulges by a spherical cap, which is fast, instead of a membrane.

    Raises:
        ValueError: the kind is unknown, there is no data, or "noise" is asked for and a
            file states none.
    """
    if kind not in KINDS:
        raise ValueError(f"--residual {kind}: unknown; allowed: {', '.join(KINDS)}")
    if not sets:
        raise ValueError("no data: give at least one --data mode=file.csv")
    if kind == "noise":
        for data in sets:
            if np.isnan(data.sigma).any():
                raise ValueError(
                    f"{data.file}: --residual noise needs the noise: add a column such as "
                    f'"sigma_MPa", a line "# sigma: 5 kPa", or --noise "2 %"'
                )
    scales, floors = _scales(sets, kind)
    skins = {
        i: specimen(data.scene, data.coordinate, data.direction - 1, data.value)
        for i, data in enumerate(sets)
        if data.scene is not None
    }
    members = [data.mode == "bulge" and not estimate for data in sets]
    order = [i for i, bulge in enumerate(members) if not bulge and i not in skins]
    order_bulge = [i for i, bulge in enumerate(members) if bulge]
    tests: list[AbstractExperiment] = []
    values, inverse = [], []
    places: list[np.ndarray] = [np.zeros(0, dtype=int)] * len(sets)
    offset = 0
    for group in (order, order_bulge):
        if not group:
            continue
        start = offset
        for i in group:
            places[i] = np.arange(offset, offset + sets[i].size)
            offset += sets[i].size
        factors = np.concatenate([sets[i].factors for i in group], axis=1)
        if group is order:
            tests.append(Homogeneous(*(padded(row) for row in factors)))
            length = len(tests[-1].e1)  # type: ignore[attr-defined]
        else:
            height = np.concatenate([sets[i].coordinate for i in group])
            ratio = np.concatenate([sets[i].bulge for i in group])
            tests.append(Bulge(jnp.asarray(height), jnp.asarray(ratio), jnp.log1p(height**2)))
            length = len(height)
        fill = start + length - offset
        values.append(np.concatenate([*(sets[i].value for i in group), np.zeros(fill)]))
        own = [np.sqrt(sets[i].weight) / scales[i] for i in group]
        inverse.append(np.concatenate([*own, np.zeros(fill)]))
        offset = start + length
    for i, skin in skins.items():
        tests.append(skin.curve)
        places[i] = np.arange(offset, offset + sets[i].size)
        offset += sets[i].size
        values.append(sets[i].value)
        inverse.append(np.sqrt(sets[i].weight) / scales[i])
    measured, weights = np.concatenate(values), np.concatenate(inverse)
    shared = [np.zeros((0, offset))]
    if kind == "noise":
        for i, skin in skins.items():
            for channel in np.unique(sets[i].direction):
                rows = places[i][sets[i].direction == channel]
                error = np.zeros(offset)
                error[rows] = skin.model_error * measured[rows]
                shared.append(shared_error(error * weights)[None])
    residuals = Residuals(
        experiments=tuple(tests),
        value=jnp.asarray(measured),
        inverse_scale=jnp.asarray(weights),
        scales=_sizes([data for data in sets if data.scene is None], list(skins.values())),
        shared=jnp.asarray(np.concatenate(shared)),
        family=family,
    )
    model_error = max((skin.model_error for skin in skins.values()), default=0.0)
    return Problem(residuals, tuple(places), tuple(floors), kind, model_error)


def settle(problem: Problem, constants: np.ndarray) -> tuple[Problem, float]:
    """Move bulge tests to the apex stretches that fit a law's constants.

    Returns:
        The problem, and the largest change of height that this made up for, relative;
        zero without bulge tests.
    """
    law = problem.residuals.family.law(jnp.asarray(constants))
    tests: list[AbstractExperiment] = []
    change = 0.0
    for test in problem.residuals.experiments:
        if isinstance(test, Bulge):
            moved = test.settled(law)
            change = max(change, float(jnp.max(jnp.abs(moved.apex / test.apex - 1.0))))
            tests.append(moved)
        elif isinstance(test, SkinCurve):
            tests.append(test.settled(law))
        else:
            tests.append(test)
    residuals = eqx.tree_at(lambda r: r.experiments, problem.residuals, tuple(tests))
    return dataclasses.replace(problem, residuals=residuals), change


def _scales(sets: Sequence[Dataset], kind: str) -> tuple[list[np.ndarray], list[float]]:
    if kind == "noise":
        return [data.sigma for data in sets], [0.0] * len(sets)
    if kind == "absolute":
        # Pressures and stresses are compared with their own kind.
        found = []
        for data in sets:
            if data.scene is not None:
                found.append(_root_mean_square(data))
                continue
            alike = [
                s
                for s in sets
                if s.scene is None and (s.measure == "pressure") == (data.measure == "pressure")
            ]
            size = float(np.sqrt(np.mean(np.concatenate([s.value for s in alike]) ** 2)))
            found.append(np.full(data.size, size if size > 0.0 else 1.0))
        return found, [0.0] * len(sets)
    floors = []
    for data in sets:
        if data.scene is not None:  # each channel has its own floor, its companion
            floors.append(0.0)
            continue
        share = _FLOOR_DIFFERENCE if data.measure == "difference" else _FLOOR
        sizes = np.abs(data.value[data.value != 0.0])
        floors.append(share * float(np.median(sizes)) if sizes.size else 1.0)
    return [
        relative_scale(data.value, data.companion, floor)
        for data, floor in zip(sets, floors, strict=True)
    ], floors


def _root_mean_square(data: Dataset) -> np.ndarray:
    """Root-mean-square reading of a skin's displacements and of its pressures."""
    scale = np.ones(data.size)
    for channel in np.unique(data.direction):
        rows = data.direction == channel
        scale[rows] = np.sqrt(np.mean(data.value[rows] ** 2))
    return np.where(scale > 0.0, scale, 1.0)


def _sizes(sets: Sequence[Dataset], skins: Sequence[Specimen]) -> Scales:
    """Typical modulus and largest invariants of the data."""
    moduli = np.array(
        [initial_modulus(data) for data in sets] + [skin.modulus for skin in skins]
    )
    usable = moduli[np.isfinite(moduli) & (moduli > 0.0)]
    stress = float(np.median(usable)) if usable.size else 1e6
    bent = np.log([skin.stretch for skin in skins])
    e1, e2 = (
        np.concatenate([*(data.factors[i] for data in sets), along])
        for i, along in ((0, bent), (1, 0.0 * bent))
    )
    e3 = -e1 - e2
    i1 = np.max(np.exp(2 * e1) + np.exp(2 * e2) + np.exp(2 * e3)) - 3.0
    i2 = np.max(np.exp(-2 * e1) + np.exp(-2 * e2) + np.exp(-2 * e3)) - 3.0
    strain = np.max(np.abs([e1, e2, e3]))
    sizes = (stress, max(i1, 1e-12), max(i2, 1e-12), max(strain, 1e-6))
    return Scales(*(jnp.asarray(size) for size in sizes))
