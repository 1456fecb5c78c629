"""From data sets to the residuals of one fit: which scale, which tests, which order."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fitting.material.experiments.free_zero import Zero, can_be_freed, free_zeros
from fitting.material.experiments.measurements import Dataset, Predictor
from fitting.material.fit.residuals import KINDS, Residuals, shared_error
from fitting.statistics.parameters import AbstractFamily, Scales


@dataclasses.dataclass(frozen=True)
class MaterialProblem:
    """The residuals of one fit and where each data set is in them.

    Attributes:
        residuals: the misfit as a function of θ.
        places: positions of each data set's readings in the residuals.
        floors: smallest scale of relative residuals for each data set [Pa].
        kind: "relative", "absolute" or "noise".
        model_error: of the corrected shell, where a skin was tested, relative to its
            displacement: a standard deviation.
    """

    residuals: Residuals
    places: tuple[np.ndarray, ...]
    floors: tuple[float, ...]
    kind: str
    model_error: float = 0.0


def pose(
    sets: Sequence[Dataset],
    family: AbstractFamily,
    kind: str,
    *,
    estimate: bool = False,
    zeros: Sequence[Zero] = (),
) -> MaterialProblem:
    """Build the residuals of a fit.

    Args:
        sets: the data.
        family: the law.
        kind: what residuals are relative to: "relative", each reading's own size (or the
            larger stress of the same biaxial state) with a floor; "absolute", the
            root-mean-square reading; "noise", the stated standard deviation.
        estimate: predict bulges by a spherical cap, which is fast, instead of a membrane.
        zeros: of tests, which are unknown; the family's last constants.

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
    groups: list[tuple[Predictor, list[int]]] = []
    freed = [i for i, data in enumerate(sets) if zeros and can_be_freed(data)]
    if freed:
        groups.append((lambda tests: free_zeros(tests, freed, zeros), freed))
    for i, data in enumerate(sets):
        if i in freed:
            continue
        predictor = data.predictor(estimate=estimate)
        members = next((own for other, own in groups if other == predictor), None)
        if members is None:
            groups.append((predictor, [i]))
        else:
            members.append(i)
    predictions = []
    places: list[np.ndarray] = [np.zeros(0, dtype=int)] * len(sets)
    size = 0
    for predictor, members in groups:
        predictions.append(predictor([sets[i] for i in members]))
        begin = size
        for i in members:
            places[i] = np.arange(begin, begin + sets[i].size)
            begin += sets[i].size
        size += predictions[-1].size
    value, inverse_scale = np.zeros(size), np.zeros(size)
    for data, place in zip(sets, places, strict=True):
        value[place] = data.value
        inverse_scale[place] = np.sqrt(data.weight) / reading_scale(data, sets, kind)
    residuals = Residuals(
        experiments=tuple(predictions),
        value=jnp.asarray(value),
        inverse_scale=jnp.asarray(inverse_scale),
        scales=_sizes(sets),
        shared=jnp.asarray(_shared_errors(sets, places, value, inverse_scale, kind)),
        family=family,
    )
    floors = tuple(data.floor if kind == "relative" else 0.0 for data in sets)
    model_error = max(data.model_error for data in sets)
    return MaterialProblem(residuals, tuple(places), floors, kind, model_error)


def settle(problem: MaterialProblem, constants: np.ndarray) -> MaterialProblem:
    """Move tests to the states of a law, from which those of laws near to it are found fast."""
    law = problem.residuals.family.law(jnp.asarray(constants))
    after = tuple(test.settled(law) for test in problem.residuals.experiments)
    residuals = eqx.tree_at(lambda r: r.experiments, problem.residuals, after)
    return dataclasses.replace(problem, residuals=residuals)


def reading_scale(data: Dataset, sets: Sequence[Dataset], kind: str) -> np.ndarray:
    """Which misfit of each reading counts as one."""
    if kind == "noise":
        return data.sigma
    return data.absolute_scale(sets) if kind == "absolute" else data.relative_scale()


def _shared_errors(
    sets: Sequence[Dataset],
    places: Sequence[np.ndarray],
    value: np.ndarray,
    inverse_scale: np.ndarray,
    kind: str,
) -> np.ndarray:
    """Errors of the forward models, which all readings of a series share [k, n]."""
    shared = [np.zeros((0, len(value)))]
    if kind == "noise":
        for data, place in zip(sets, places, strict=True):
            if not data.model_error:
                continue
            for path in data.paths():
                error = np.zeros(len(value))
                error[place[path]] = data.model_error * value[place[path]]
                shared.append(shared_error(error * inverse_scale)[None])
    return np.concatenate(shared)


def _sizes(sets: Sequence[Dataset]) -> Scales:
    """Typical modulus and largest invariants of the data."""
    moduli = np.array([data.modulus for data in sets])
    usable = moduli[np.isfinite(moduli) & (moduli > 0.0)]
    stress = float(np.median(usable)) if usable.size else 1e6
    e1, e2 = np.concatenate([data.states for data in sets], axis=1)
    e3 = -e1 - e2
    i1 = np.max(np.exp(2 * e1) + np.exp(2 * e2) + np.exp(2 * e3)) - 3.0
    i2 = np.max(np.exp(-2 * e1) + np.exp(-2 * e2) + np.exp(-2 * e3)) - 3.0
    strain = np.max(np.abs([e1, e2, e3]))
    sizes = (stress, max(i1, 1e-12), max(i2, 1e-12), max(strain, 1e-6))
    return Scales(*(jnp.asarray(size) for size in sizes))
