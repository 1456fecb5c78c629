"""How exactly presses were told: stated, or as the readings show it.

Errors of what was told of a load, of its amount and of a line load's place and direction, move
all readings of its state along their derivatives, which noise of the counts does not: their
deviations t are those that make the residuals most likely.
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
from fitting.sensor.logs.known_loads import AMOUNTS, WHERE, KnownLoads
from fitting.sensor.logs.shared_errors import SharedErrors
from fitting.sensor.shapes.shapes import Shapes, ShapeSolver
from fitting.statistics.residuals import sensitivity

# Gain of the log-likelihood that shows errors of what was told: chance of less than 1e-4.
_GAIN = 7.5
_SMALLEST, _LARGEST = 1e-5, 0.5  # deviations that are tried, of the largest amount
_SAME, _CLOSE = 0.05, 0.02  # of a deviation
_ORDERED = 0.3  # correlation of neighbouring errors that is no noise
_FEWEST = 20  # errors that show one
_ROUNDS, _MOVED = 4, 0.15  # of the errors' deviation, by which the last step moves them
_SUSPECT = 3.0  # standard deviations of the score
_OF_TRAVEL = "displacement-noise", "gauge of travel"
# The option that states the deviation, and what tells the amount.
_KINDS = dict.fromkeys(AMOUNTS, _OF_TRAVEL) | {"force": ("force-noise", "load cell")}
# What else may be behind errors of places and directions.
_WHY = {
    "place": "as of a ruler, or of a bar that presses one side harder",
    "direction": "as of friction, or of a rig that is askew (load_0_direction_deg states it)",
}


class InputNoise(NamedTuple):
    """Deviations of what was told of loads, by the names of `KnownLoads.told`."""

    deviation: dict[str, float]  # [N], [m] or [rad]
    stated: bool = False  # whether the user stated them, beyond the readings


def shared_errors(loads: KnownLoads, slopes: np.ndarray, noise: InputNoise) -> SharedErrors:
    """The errors that readings share, from their derivatives [column, taxel, state]."""
    known = loads.told(len(slopes))
    deviation = sum((t * noise.deviation.get(name, 0.0) for name, t in known.items()), 0.0)
    return SharedErrors(slopes, np.asarray(deviation))


class Likelihood:
    """L(t) of a problem at its minimum."""

    def __init__(
        self,
        problem: SensorProblem,
        constants: np.ndarray,  # at the minimum, SI [p]
        loads: KnownLoads,  # the known states
        slopes: np.ndarray,  # counts by what was told [column, taxel, state]
        error: np.ndarray,  # the most probable ones of the amounts [load, state]
    ) -> None:
        self._problem, self._at = problem, constants
        self._loads, self._slopes = loads, slopes
        slopes = slopes[: len(error)]
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

    def _suspected(self, known: np.ndarray) -> bool:
        """Whether residuals along derivatives are more than noise, by the score of L at 0.

        It costs nothing, and most fits end with it. `known`: which count [column, state].
        """
        here = self._problem.readings
        r = self._problem.standardised(self._at, whole=True)
        unit = SharedErrors(self._slopes, known * 1.0)
        ones = np.where(here.used, 1 / here.sigma, 0.0)
        columns = unit.sizes[..., here.state] * ones
        along = unit.whitening(here.state, ones).sums(here.state, r * here.used)
        size = np.zeros_like(along)
        np.add.at(size, here.state, np.einsum("ktf,ktf->fk", columns, columns))
        noise = float(np.mean(r[here.used] ** 2))
        score = np.sum(along**2 - noise * size)
        return bool(score > _SUSPECT * noise * np.sqrt(2 * np.sum(size**2)))

    def most_likely(self) -> tuple[InputNoise, float]:
        """The most likely deviations, of kinds that gain much one after another, and s."""
        told = self._loads.told(len(self._slopes))
        open_ = [name for name, mask in told.items() if mask.any() and self._suspected(mask)]
        noise, scale = InputNoise(dict.fromkeys(told, 0.0)), 1.0
        if not open_:
            return noise, scale
        value, scale = self(noise)
        while open_:
            tried = [self._with(noise, name) for name in open_]
            best = max(tried, key=lambda own: own[0])
            if best[0] - value < _GAIN:
                break
            name = open_.pop(tried.index(best))
            _, noise = best
            for other in [x for x, t in noise.deviation.items() if t > 0 and x != name]:
                _, noise = self._with(noise, other)
            value, scale = self(noise)
        # L has them in units of the scaled noise.
        return InputNoise({k: scale * x for k, x in noise.deviation.items()}), scale

    def _with(self, noise: InputNoise, name: str) -> tuple[float, InputNoise]:
        """L where one deviation is the most likely beside the others, and all of them."""
        largest = 1.0
        if name in AMOUNTS:
            own = getattr(self._loads, name)[self._loads.known_by[name]]
            largest = float(np.abs(own).max())

        def trial(log: float) -> InputNoise:
            return InputNoise({**noise.deviation, name: float(np.exp(log))})

        found = optimize.minimize_scalar(
            lambda log: -self(trial(log))[0],
            bounds=np.log([_SMALLEST * largest, _LARGEST * largest]),
            method="bounded",
            options={"xatol": _CLOSE},
        )
        return -float(found.fun), trial(found.x)


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

    # counts by what was told [column, taxel, state], see `KnownLoads.told`; empty if not looked
    # for
    slopes: np.ndarray
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
            now, scale = shown.most_likely()
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
        last, error = error, problem.readings.shared(r)[: len(error)]
        inputs, steady = inputs._replace(noise=now), settled(noise, now)
        noise, moved = now, np.linalg.norm(error - last)
        if steady and moved <= _MOVED * np.linalg.norm(errors.deviation[: len(error)]):
            break
        if not error.any():  # readings are linear in what else was told
            continue
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
    now, _ = shown.most_likely()
    larger = {k: x for k, x in now.deviation.items() if x > stated.deviation.get(k, 0.0)}
    if not larger or shown(now)[0] - shown(stated)[0] < _GAIN:
        return ()
    return tuple(
        f"readings show a deviation of {_text(name, x)} of the known {name}s, "
        + (
            f"--{_KINDS[name][0]} states {_text(name, stated.deviation.get(name, 0.0))}"
            if name in _KINDS
            else "which intervals do not count beside stated noise"
        )
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
        own = loads.told(len(e))[name]
        rows = [r[k] - r[k].mean() for r, k in zip(e, own, strict=True) if k.any()]
        pairs = sum(float(row[1:] @ row[:-1]) for row in rows)
        ordered = pairs / sum(float(row @ row) for row in rows) > _ORDERED
        why = _WHY.get(name, f"as the noise of a {_KINDS.get(name, _OF_TRAVEL)[1]} is")
        why += "; it counts in the intervals"
        if ordered and own.sum() >= _FEWEST:
            why = (
                "they err alike in neighbouring frames, so they are no noise: look for a delay "
                "between the two clocks, a place or a direction that is not the told one, or a "
                "membrane that creeps; intervals are too narrow for it"
            )
        if name in _KINDS:
            why += f"; --{_KINDS[name][0]} states it"
        else:
            why = f"which are more by {_text(name, -e[own].mean())} in the mean, {why}"
        found.append(
            f"known {name}s are off those that the counts show by {_text(name, deviation)} "
            f"(standard deviation), {why}"
        )
    return found


def _text(name: str, deviation: float) -> str:
    if name in WHERE:
        return f"{np.rad2deg(deviation):.2g} deg"
    return f"{deviation:.2g} N" if name == "force" else f"{1e3 * deviation:.2g} mm"
