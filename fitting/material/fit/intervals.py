"""Intervals of a fit's constants: by profile likelihood where it can be had."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.material.fit.fitted_law import FittedLaw
from fitting.material.fit.problem import MaterialProblem
from fitting.material.laws.parameters import Family
from fitting.statistics.least_squares import Linearised
from fitting.statistics.profile import Quantity, profile_end
from fitting.statistics.residuals import constants_by_theta, sensitivity

# An end is open at this many e-folds of a constant of one sign, or half widths of another.
_FOLDS, _STEPS = 18.0, 20.0
_NONE = 1e-3  # of a half width: the search did not leave the minimum
_CAN_BE_PROFILED = ("Homogeneous", "FreeZero", "History")


class Intervals(NamedTuple):
    """Intervals of all constants, and of the shear modulus."""

    # lowest and highest value of each constant, SI units, shape [2, p]; infinite, or the
    # constant's own limit, where the data exclude nothing on that side
    ends: np.ndarray
    is_open: np.ndarray  # where that is so, shape [2, p]
    modulus: tuple[float, float]  # of the shear modulus [Pa]
    method: str  # "profile" or "normal"


@dataclasses.dataclass(frozen=True)
class _Search:
    """What the ends of a fit's intervals are searched with."""

    problem: MaterialProblem
    constants: np.ndarray
    at: Linearised
    mapped: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    theta: np.ndarray


def intervals_of(fit: FittedLaw, level: float) -> Intervals:
    """Intervals that cover the truth with a probability, `level`.

    Where readings are expensive, or constants are held at bounds, the likelihood is taken
    as normal in the logarithm of constants of one sign, else in the constants themselves.
    """
    problem, constants, judged, family = fit.problem, fit.constants, fit.uncertainty, fit.family
    quantile = judged.quantile(level)
    value, slope = modulus_and_slope(family, jnp.asarray(constants))
    modulus, half = float(value), float(judged.spread_of(np.asarray(slope))) * quantile
    low, high = family.signs(constants, {})
    one_sign = (low == 0.0) | (high == 0.0)
    one_sign &= constants != 0.0
    errors = judged.standard_errors
    ends = _normal(constants, errors * quantile, one_sign)
    is_open = ~np.isfinite(ends)
    around = (modulus * np.exp(-_ratio(half, modulus)), modulus * np.exp(_ratio(half, modulus)))
    names = {type(test).__name__ for test in problem.residuals.experiments}
    profiled = names <= set(_CAN_BE_PROFILED) and not fit.bounded and not fit.bounds
    if not profiled or judged.dof <= 0 or not judged.noise > 0.0:
        for name, (least, most) in fit.bounds.items():
            column = ends[:, family.names.index(name)]
            np.clip(column, least, most, out=column)
        return Intervals(ends, is_open, around, "normal")
    search = _search(problem, constants)
    _, J = search.at(search.theta)
    _, s, vt = np.linalg.svd(J, full_matrices=False)
    s = np.maximum(s, 1e-14 * s[0])
    for i in range(family.size):
        quantity = _constant(search, i, logarithmic=bool(one_sign[i]))
        found = _ends(
            search, quantity, errors[i] * quantile, constants[i], one_sign[i], (s, vt)
        )
        if found is None:
            continue
        ends[:, i], is_open[:, i] = found
    quantity = _shear_modulus(search)
    found = _ends(search, quantity, half, modulus, True, (s, vt))
    if found is not None:
        around = (float(found[0][0]), float(found[0][1]))
    return Intervals(ends, is_open, around, "profile")


def _ratio(half: float, value: float) -> float:
    return min(half / max(abs(value), 1e-300), 700.0)


def _normal(constants: np.ndarray, half: np.ndarray, one_sign: np.ndarray) -> np.ndarray:
    """Intervals of a Gaussian in the constants, or in the logarithms of those of one sign."""
    ends = np.stack([constants - half, constants + half])
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        factor = np.exp(np.minimum(half / np.abs(constants), 700.0))
        pair = np.sort(np.stack([constants / factor, constants * factor]), axis=0)
    # Where the interval is short both agree.
    return np.where(one_sign, pair, ends)


def _ends(
    search: _Search,
    quantity: Quantity,
    half: float,
    value: float,
    logarithmic: bool,
    svd: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Ends of a quantity's interval in SI units, and which are open."""
    s, vt = svd
    _, gradient = quantity(search.theta)
    if not np.all(np.isfinite(gradient)) or not np.any(gradient):
        return None
    naive = float(np.linalg.norm((vt @ gradient) / s))
    step = half / abs(value) if logarithmic else half
    # The half width of the interval sets the rise of the cost, whatever noise it includes.
    excess = 0.5 * (step / naive) ** 2
    if not np.isfinite(excess) or excess <= 0.0:
        return None
    farthest = _FOLDS if logarithmic else _STEPS * step
    found = [
        profile_end(search.at, quantity, search.theta, side, excess, step, farthest)
        for side in (-1.0, 1.0)
    ]
    values = np.array([end.value for end in found])
    middle = np.log(abs(value)) if logarithmic else value
    failed = np.isnan(values) | (np.abs(values - middle) < _NONE * step)
    is_open = np.array([end.is_open for end in found]) & ~failed
    step = min(step, farthest)
    values = np.where(failed, middle + np.array([-step, step]), values)
    if not logarithmic:
        return np.where(is_open, [-np.inf, np.inf], values), is_open
    with np.errstate(over="ignore"):
        sizes = np.exp(values)
    sizes = np.where(is_open & (np.abs(values - middle) > 0.9 * _FOLDS), [0.0, np.inf], sizes)
    if value < 0.0:
        return -sizes[::-1], is_open[::-1]
    return sizes, is_open


def _search(problem: MaterialProblem, constants: np.ndarray) -> _Search:
    residuals, used = problem.residuals, problem.residuals.used
    theta = np.asarray(residuals.unconstrained(jnp.asarray(constants)))

    @functools.lru_cache(maxsize=4)
    def mapped(key: bytes) -> tuple[np.ndarray, np.ndarray]:
        return constants_by_theta(residuals, np.frombuffer(key))

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, slope = mapped(x.tobytes())
        r, J = sensitivity(residuals, jnp.asarray(c))
        return np.asarray(r)[used], (np.asarray(J) @ slope)[used]

    return _Search(problem, constants, at, lambda x: mapped(x.tobytes()), theta)


def _constant(search: _Search, i: int, *, logarithmic: bool) -> Quantity:
    def quantity(x: np.ndarray) -> tuple[float, np.ndarray]:
        c, slope = search.mapped(x)
        value, gradient = float(c[i]), slope[i]
        return _logarithm(abs(value), gradient, value) if logarithmic else (value, gradient)

    return quantity


def _shear_modulus(search: _Search) -> Quantity:
    def quantity(x: np.ndarray) -> tuple[float, np.ndarray]:
        c, slope = search.mapped(x)
        found, by_constant = modulus_and_slope(search.problem.residuals.family, jnp.asarray(c))
        value = float(found)
        return _logarithm(value, np.asarray(by_constant) @ slope, value)

    return quantity


def _logarithm(size: float, gradient: np.ndarray, value: float) -> tuple[float, np.ndarray]:
    """Logarithm of a quantity's size, and its gradient from the quantity's."""
    if not size > 0.0:
        return -np.inf, gradient * np.nan
    return float(np.log(size)), gradient / value


@eqx.filter_jit
def modulus_and_slope(family: Family, constants: Array) -> tuple[Array, Array]:
    """Small-strain shear modulus of a law [Pa] and its derivatives by the constants [p]."""
    return jax.value_and_grad(lambda c: family.law(c).shear_modulus)(constants)
