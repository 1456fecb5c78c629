"""The residuals of one fit: which scale, which tests, which order.

r_i(θ) = √w_i (y_i(θ) − y_i) / s_i; the scale s_i says which misfit counts as one.
"""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fitting.material.experiments.free_zero import Zero, can_be_freed, free_zeros
from fitting.material.experiments.measurements import Dataset, Predictor
from fitting.material.experiments.prediction import AbstractExperiment
from fitting.material.laws.parameters import Family, Scales
from fitting.statistics.residuals import AbstractResiduals, sensitivity

KINDS = ("relative", "absolute", "noise", "estimated")


class Residuals(AbstractResiduals):
    """Misfit of a family of laws to measurements, as a function of θ."""

    experiments: tuple[AbstractExperiment, ...]  # the tests, each predicting a run of readings
    value: Float[Array, " n"]  # measured readings [Pa] with padding
    inverse_scale: Float[Array, " n"]  # √w/s [1/Pa]; zero for padding
    scales: Scales  # sizes that make constants dimensionless
    # errors that all readings of a test share, such as a model's own, in the form that
    # `shared_error` gives them, shape [k, n]; k is zero where there are none
    shared: Float[Array, "k n"]
    family: Family = eqx.field(static=True)  # the law; part of the compiled program

    @property
    def effort(self) -> dict[str, bool]:
        """What one of the tests asks for."""
        asked = (test.effort.items() for test in self.experiments)
        return {key: True for own in asked for key, wanted in own if wanted}

    @property
    def mapping(self) -> Callable[[Float[Array, " p"]], Float[Array, " p"]]:
        """The family's map from θ, with the scales."""
        return Mapping(self.scales, self.family)

    def unconstrained(self, constants: Float[Array, " p"]) -> Float[Array, " p"]:
        """Unconstrained parameters from constants."""
        return self.family.unconstrained(constants, self.scales)

    def predict(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Readings [Pa] for constants in SI units, padding included."""
        law, zeros = self.family.law(constants), self.family.zeros(constants)
        return jnp.concatenate([test.shifted(zeros).predict(law) for test in self.experiments])

    def of_constants(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for constants in SI units."""
        return self.weighed(self.predict(constants) - self.value)

    def linearised(
        self, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Residuals and their derivatives by the constants in SI units."""
        parts = [test.linearised(self.family, constants) for test in self.experiments]
        value, slope = (jnp.concatenate(part) for part in zip(*parts, strict=True))
        return self.weighed(value - self.value), jax.vmap(self.weighed, 1, 1)(slope)

    def weighed(self, misfit: Float[Array, " n"]) -> Float[Array, " n"]:
        """Misfit [Pa] over its scale; exactly zero for padding.

        With e the shared errors in units of the noise, residuals are multiplied by
        (I + e eᵀ)^(-1/2), which makes them independent and of unit variance again.
        """
        used = self.inverse_scale > 0.0
        r = jnp.where(used, misfit, 0.0) * self.inverse_scale
        return r - self.shared.T @ (self.shared @ r)

    def misfit(self, r: Float[Array, " n"]) -> Float[Array, " n"]:
        """Misfit [Pa] from residuals, the inverse of `weighed`; zero for padding."""
        share = 1.0 - jnp.sum(self.shared**2, axis=1)
        plain = r + self.shared.T @ ((self.shared @ r) / share)
        used = self.inverse_scale > 0.0
        return jnp.where(used, plain / jnp.where(used, self.inverse_scale, 1.0), 0.0)


class Mapping(eqx.Module):
    """The map of a family from unconstrained parameters to constants."""

    scales: Scales  # sizes that make constants dimensionless
    family: Family = eqx.field(static=True)  # the law

    def __call__(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units."""
        return self.family.constants(theta, self.scales)


def readings(residuals: Residuals, constants: Float[Array, " p"]) -> tuple[Array, Array]:
    """Predicted readings [Pa] and residuals for constants in SI units, each [n].

    Their derivatives are computed along: every fit needs that program, and a second one
    would take longer to compile than it could save. Padding is predicted as measured.
    """
    r, _ = sensitivity(residuals, constants)
    return residuals.value + residuals.misfit(r), r


def predicted_readings(problem: "MaterialProblem", constants: np.ndarray) -> list[np.ndarray]:
    """Predicted readings of each data set, SI units."""
    predicted, _ = readings(problem.residuals, jnp.asarray(constants))
    return [np.asarray(predicted)[place] for place in problem.places]


def shared_error(error: np.ndarray) -> np.ndarray:
    """A shared error as `Residuals.shared` holds it: d with I − d dᵀ = (I + e eᵀ)^(-1/2).

    `error`: e, its standard deviation in units of each reading's noise, signed alike; zero for
    readings that don't share it, shape [n].
    """
    square = float(error @ error)
    if square == 0.0:
        return error
    return error * np.sqrt((1.0 - 1.0 / np.sqrt(1.0 + square)) / square)


@dataclasses.dataclass(frozen=True)
class MaterialProblem:
    """The residuals of one fit and where each data set is in them."""

    sets: tuple[Dataset, ...]
    residuals: Residuals  # the misfit as a function of θ
    places: tuple[np.ndarray, ...]  # positions of each data set's readings in the residuals
    kind: str  # "relative", "absolute" or "noise"

    @property
    def floors(self) -> list[float]:
        """Smallest scale of relative residuals for each data set [Pa]."""
        return [data.floor if self.kind == "relative" else 0.0 for data in self.sets]

    @property
    def model_error(self) -> float:
        """Standard deviation of a skin's corrected shell's own error, relative."""
        return max(data.model_error for data in self.sets)

    @property
    def tests(self) -> list[tuple[Dataset, np.ndarray]]:
        """Each data set and the positions of its readings."""
        return list(zip(self.sets, self.places, strict=True))


def pose(
    sets: Sequence[Dataset],
    family: Family,
    kind: str,
    *,
    estimate: bool = False,
    zeros: Sequence[Zero] = (),  # of tests, which are unknown; the family's last constants
) -> MaterialProblem:
    """Build the residuals of a fit.

    `kind`: what residuals are relative to: "relative", each reading's own size (or the larger
    stress of the same biaxial state) with a floor; "absolute", the root-mean-square reading;
    "noise", the stated standard deviation. `estimate`: predict bulges by a spherical cap, which
    is fast, instead of a membrane; relaxing stresses by elastic ones.
    Raises ValueError: the kind is unknown, there is no data, or "noise" is asked for and a file
    states none.
    """
    if kind not in KINDS:
        raise ValueError(f"--residual {kind}: unknown; allowed: {', '.join(KINDS)}")
    if not sets:
        raise ValueError("no data: give at least one --data mode=file.csv")
    unknown = (data.file for data in sets if kind == "noise" and np.isnan(data.sigma).any())
    if (file := next(unknown, None)) is not None:
        raise ValueError(
            f"{file}: --residual noise needs the noise: add a column such as "
            f'"sigma_MPa", a line "# sigma: 5 kPa", or --noise "2 %"'
        )
    groups: dict[Predictor, list[int]] = {}
    freed = [i for i, data in enumerate(sets) if zeros and can_be_freed(data)]
    if freed:
        groups[lambda tests: free_zeros(tests, freed, zeros)] = freed
    for i in (i for i in range(len(sets)) if i not in freed):
        groups.setdefault(sets[i].predictor(estimate=estimate), []).append(i)
    predictions = []
    places: list[np.ndarray] = [np.zeros(0, dtype=int)] * len(sets)
    size = 0
    for predictor, members in groups.items():
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
        scales=_scales_of(sets),
        shared=jnp.asarray(_shared_errors(sets, places, value, inverse_scale, kind)),
        family=family,
    )
    return MaterialProblem(tuple(sets), residuals, tuple(places), kind)


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


def _scales_of(sets: Sequence[Dataset]) -> Scales:
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
