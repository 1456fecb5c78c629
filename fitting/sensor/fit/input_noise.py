"""How exactly forces and displacements were told: stated, or as the readings show it.

Errors of what was told of a load move all readings of its state along their derivatives, which
noise of the counts does not: their deviation t is the one that makes the residuals most likely.
With the covariance K(t) of `SharedErrors` times a scale s^2 of all noise, and J the derivatives
by the constants and by what moves all states alike, the restricted likelihood is ::

    L(t) = -1/2 [log|K| + log|J^T K^-1 J| + (n - p) log s^2],   s^2 = r^T P r / (n - p)
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import optimize

from fitting.sensor.fit.residuals import SensorProblem
from fitting.sensor.fit.search import Found, robust
from fitting.sensor.logs.known_loads import AMOUNTS, KnownLoads
from fitting.sensor.logs.shared_errors import SharedErrors
from fitting.sensor.shapes.shapes import Shapes, ShapeSolver
from fitting.statistics.residuals import sensitivity

# Gain of the log-likelihood that shows errors of what was told: chance of less than 1e-4.
_GAIN = 7.5
_SMALLEST, _LARGEST = 1e-5, 0.5  # deviations that are tried, of the largest amount
_SAME = 0.05  # of a deviation
_ORDERED = 0.3  # correlation of neighbouring errors that is no noise
_FEWEST = 20  # errors that show one
_ROUNDS, _MOVED = 4, 0.15  # of the errors' deviation, by which the last step moves them
_SUSPECT = 3.0  # standard deviations of the score
_OF_TRAVEL = "displacement-noise", "gauge of travel"
# The option that states the deviation, and what tells the amount.
_KINDS = dict.fromkeys(AMOUNTS, _OF_TRAVEL) | {"force": ("force-noise", "load cell")}


class InputNoise(NamedTuple):
    """Deviations of what was told of loads, by "force", "displacement" and "depth"."""

    deviation: dict[str, float]  # [N] or [m]
    stated: bool = False  # whether the user stated them, beyond the readings


def shared_errors(loads: KnownLoads, slopes: np.ndarray, noise: InputNoise) -> SharedErrors:
    """The errors that readings share, from their derivatives [load, taxel, state]."""
    known = loads.known_by
    deviation = sum((t * noise.deviation.get(name, 0.0) for name, t in known.items()), 0.0)
    return SharedErrors(slopes, np.asarray(deviation))


class Likelihood:
    """L(t) of a problem at its minimum."""

    def __init__(
        self,
        problem: SensorProblem,
        constants: np.ndarray,  # at the minimum, SI [p]
        loads: KnownLoads,  # the known states
        slopes: np.ndarray,  # counts by what was told [load, taxel, state]
        error: np.ndarray,  # the most probable ones of what was told [load, state]
    ) -> None:
        self._problem, self._at = problem, constants
        self._loads, self._slopes = loads, slopes
        own = slopes.sum(0)[:, problem.readings.state]
        amounts = loads.less(error)
        amount = sum(np.nan_to_num(getattr(amounts, name)) for name in AMOUNTS)
        by_amount = np.einsum("kts,ks->ts", slopes, amount)[:, problem.readings.state]
        # A zero or a scale that is off, or an offset of all counts, is no noise of single ones.
        self._common = [own, by_amount, np.ones_like(own)]

    def __call__(self, noise: InputNoise) -> tuple[float, float]:
        """L, and the scale s of all noise."""
        shared = shared_errors(self._loads, self._slopes, noise)
        readings = dataclasses.replace(self._problem.readings, input_errors=shared)
        problem = self._problem.replace(readings=readings)
        r, J = map(np.asarray, sensitivity(problem.residuals(), jnp.asarray(self._at)))
        beside = [r - _residuals(problem, self._at, change) for change in self._common]
        columns = np.column_stack([J, *beside])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        q, triangle = np.linalg.qr(columns / size)
        independent = np.abs(np.diag(triangle))
        seen = independent > 1e-6
        q, independent = q[:, seen], (size * independent)[seen]
        left = r - q @ (q.T @ r)
        used = int(readings.used.sum()) + len(problem.priors)
        free = used - len(independent) - readings.extras * int(readings.used.any(1).sum())
        scale = float(left @ left) / max(free, 1)
        whitening = readings.whitening()
        assert whitening is not None
        value = whitening.log_determinant + free * np.log(scale)
        value += 2 * np.log(independent).sum()
        if readings.extras:
            gram = whitening.gram(readings.state, readings.basis(readings.sigma))
            own = np.linalg.eigvalsh(gram)
            value += np.log(own[own > 1e-12]).sum()
        return -0.5 * float(value), float(np.sqrt(scale))

    def _suspected(self) -> bool:
        """Whether residuals along the derivatives are more than noise, by the score of L at 0.

        It costs nothing, and most fits end with it.
        """
        here = self._problem.readings
        r = self._problem.standardised(self._at, whole=True)
        unit = SharedErrors(self._slopes, np.where(self._slopes.any(1), 1.0, 0.0))
        ones = np.where(here.used, 1 / here.sigma, 0.0)
        columns = unit.slopes[..., here.state] * ones
        along = unit.whitening(here.state, ones).sums(here.state, r * here.used)
        size = np.zeros_like(along)
        np.add.at(size, here.state, np.einsum("ktf,ktf->fk", columns, columns))
        noise = float(np.mean(r[here.used] ** 2))
        score = np.sum(along**2 - noise * size)
        return bool(score > _SUSPECT * noise * np.sqrt(2 * np.sum(size**2)))

    def most_likely(self, start: InputNoise) -> tuple[InputNoise, float]:
        """The most likely deviations, none where they gain little, and the scale s."""
        known = {name: t for name, t in self._loads.known_by.items() if t.any()}
        noise = InputNoise({name: start.deviation.get(name, 0.0) for name in known})
        if not self._suspected():
            return InputNoise(dict.fromkeys(known, 0.0)), 1.0
        none, scale = self(InputNoise({}))
        for name in list(known) * (1 if len(known) == 1 else 2):
            largest = float(np.abs(getattr(self._loads, name)[known[name]]).max())

            def cost(log: float, name: str = name) -> float:
                trial = InputNoise({**noise.deviation, name: float(np.exp(log))})
                return -self(trial)[0]

            ends = np.log([_SMALLEST * largest, _LARGEST * largest])
            found = optimize.minimize_scalar(
                cost, bounds=ends, method="bounded", options={"xatol": 0.01}
            )
            noise.deviation[name] = float(np.exp(found.x))
        value, own = self(noise)
        if value - none < _GAIN:
            return InputNoise(dict.fromkeys(known, 0.0)), scale
        # L has them in units of the scaled noise.
        return InputNoise({k: own * x for k, x in noise.deviation.items()}), own


def _residuals(problem: SensorProblem, constants: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Residuals if readings were more by a change [taxel, frame]."""
    moved = dataclasses.replace(problem.readings, so=problem.readings.so + change)
    own = problem.replace(readings=moved).residuals()
    return np.asarray(sensitivity(own, jnp.asarray(constants))[0])


def settled(before: InputNoise, now: InputNoise) -> bool:
    """Whether deviations change no more."""
    return all(
        abs(x - before.deviation.get(name, 0.0)) <= _SAME * x
        for name, x in now.deviation.items()
    )


class InputErrors(NamedTuple):
    """Errors of what was told of the loads, and what the readings show of them."""

    slopes: np.ndarray  # counts by what was told [load, taxel, state]; empty if not looked for
    noise: InputNoise  # the deviations that count
    warnings: tuple[str, ...] = ()  # what a person should know


NO_INPUT_ERRORS = InputErrors(np.zeros((0, 0, 0)), InputNoise({}))


def stated_errors(
    problem: SensorProblem, loads: KnownLoads, inputs: InputErrors
) -> SensorProblem:
    """The problem with the errors that are stated."""
    if not any(inputs.noise.deviation.values()):
        return problem
    errors = shared_errors(loads, inputs.slopes, inputs.noise)
    return problem.replace(readings=dataclasses.replace(problem.readings, input_errors=errors))


def with_input_errors(
    problem: SensorProblem,
    found: Found,
    loads: KnownLoads,
    inputs: InputErrors,
    solver: ShapeSolver,
    shapes: Shapes,
) -> tuple[SensorProblem, Found, InputErrors, Shapes]:
    """The fit with errors of known inputs, stated or as the readings show them.

    Counts are linear in the errors about the most probable inputs: shapes are solved there, as
    about the stated ones a curved response would bias the constants (by t^2 / 2 times it).
    """
    noise, error = inputs.noise, np.zeros(loads.angle.shape)
    for _ in range(_ROUNDS if inputs.slopes.any() else 0):
        now, scale = noise, 1.0
        if not inputs.noise.stated:
            shown = Likelihood(problem, found.constants, loads, inputs.slopes, error)
            now, scale = shown.most_likely(noise)
        here = problem.readings
        if not any(now.deviation.values()):
            if here.input_errors is not None:
                here = dataclasses.replace(here, input_errors=None)
                problem, found = robust(problem.replace(readings=here), found.constants)
            return problem, found, inputs._replace(noise=now), shapes
        errors = shared_errors(loads, inputs.slopes, now)
        sigma = np.where(here.log >= 0, scale * here.sigma, here.sigma)
        here = dataclasses.replace(here, input_errors=errors, sigma=sigma)
        problem, found = robust(problem.replace(readings=here), found.constants)
        r = problem.standardised(found.constants, whole=True)
        last, error = error, problem.readings.shared(r)
        inputs, steady = inputs._replace(noise=now), settled(noise, now)
        noise, moved = now, np.linalg.norm(error - last)
        if steady and moved <= _MOVED * np.linalg.norm(errors.deviation):
            break
        shapes, slopes = solver.moved(found.constants, loads.less(error), error)
        inputs = inputs._replace(slopes=slopes)
        model = dataclasses.replace(shapes.model, factor=problem.model.factor)
        problem = problem.replace(model=model)
    if inputs.noise.stated and inputs.slopes.any():
        shown = Likelihood(problem, found.constants, loads, inputs.slopes, error)
        inputs = inputs._replace(warnings=_beyond_stated(shown, inputs.noise))
    return problem, found, inputs, shapes


def _beyond_stated(shown: Likelihood, stated: InputNoise) -> tuple[str, ...]:
    """A warning where readings show larger errors than were stated, or nothing."""
    now, _ = shown.most_likely(stated)
    larger = {k: x for k, x in now.deviation.items() if x > stated.deviation.get(k, 0.0)}
    if not larger or shown(now)[0] - shown(stated)[0] < _GAIN:
        return ()
    return tuple(
        f"readings show a deviation of {_text(name, x)} of the known "
        f"{name}s, --{_KINDS[name][0]} states {_text(name, stated.deviation.get(name, 0.0))}"
        for name, x in larger.items()
    )


def noise_sentences(
    problem: SensorProblem, constants: np.ndarray, loads: KnownLoads, inputs: InputErrors
) -> list[str]:
    """What a fit that counted errors of known inputs has to say of them."""
    if problem.readings.input_errors is None or inputs.noise.stated:
        return []
    e = problem.readings.shared(problem.standardised(constants, whole=True))
    found = []
    for name, deviation in inputs.noise.deviation.items():
        if not deviation > 0:
            continue
        own = loads.known_by[name]
        rows = [r[k] - r[k].mean() for r, k in zip(e, own, strict=True) if k.any()]
        pairs = sum(float(row[1:] @ row[:-1]) for row in rows)
        ordered = pairs / sum(float(row @ row) for row in rows) > _ORDERED
        why = (
            "they err alike in neighbouring frames, so they are no noise: look for a delay "
            "between the two clocks, a place or a direction that is not the told one, or a "
            "membrane that creeps; intervals are too narrow for it"
            if ordered and own.sum() >= _FEWEST
            else f"as the noise of a {_KINDS[name][1]} is; it counts in the intervals"
        )
        found.append(
            f"known {name}s are off those that the counts show by {_text(name, deviation)} "
            f"(standard deviation), {why}; --{_KINDS[name][0]} states it"
        )
    return found


def _text(name: str, deviation: float) -> str:
    return f"{deviation:.2g} N" if name == "force" else f"{1e3 * deviation:.2g} mm"
