"""Zeros that are off: which one explains what a fit leaves of the counts.

A touch that is not where displacements were told zero, a load cell that shows a force at no
load, and an offset of all counts leave little of themselves in the residuals, as permittivity
and gap follow them: 0.1 mm of touch makes the gap of the paper's skin 5 % larger. The fit is
repeated without each of them; one is named if what remains is noise.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.sensor.fit.input_noise import InputErrors
from fitting.sensor.fit.residuals import SensorProblem
from fitting.sensor.fit.search import search
from fitting.sensor.logs.data import NoCalibration
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import FORCE_ZERO, SCALE, STRAY, TOUCH
from fitting.sensor.shapes.shapes import ShapeSolver
from fitting.statistics.residuals import sensitivity

OFFSET = "offset"
_SHOWN, _WORTH = 25.0, 9.0  # chi-square of a zero that is named, and of one that is tried
_LEFT = 16.0  # chi-square of another one beside it: what remains is no noise
_ALIKE = 9.0  # difference in chi-square of zeros that explain the counts alike
_ROUNDS, _SAME = 4, 0.1  # of its standard error


class ZeroOff(NamedTuple):
    """A zero that is off, and the fit without it."""

    kind: str  # TOUCH, FORCE_ZERO or OFFSET
    amount: float  # [m], [N] or counts
    error: float  # its standard error
    chi_square: float  # of all residuals without it
    left: float  # of the largest of the others beside it


class Suspects:
    """Looks for zeros that are off, at a fit's minimum."""

    def __init__(
        self,
        problem: SensorProblem,  # with the measured noise
        constants: np.ndarray,  # its minimum, SI [p]
        loads: KnownLoads,  # the known states
        inputs: InputErrors,  # with the derivatives by known inputs
        solver: ShapeSolver,
    ) -> None:
        self._problem, self._constants, self._solver = problem, constants, solver
        state, slopes = problem.readings.state, inputs.slopes[: len(loads.angle)]
        by = {TOUCH: loads.zeros(1.0, 0.0), FORCE_ZERO: loads.zeros(0.0, 1.0)}
        names = problem.family.names
        # Readings that are more by this lack the zero [taxel, frame].
        self._changes = {
            kind: np.einsum("kts,ks->ts", slopes, own)[:, state]
            for kind, own in by.items()
            if own.any() and kind not in names
        }
        if not (problem.readings.offsets or STRAY in names):
            self._changes[OFFSET] = -np.ones_like(problem.readings.so)
        self._loads = loads

    def found(self) -> list[ZeroOff]:
        """Zeros that explain what is left of the counts, the likeliest first."""
        first = self._chi_squares(self._problem, self._constants)
        if max(first.values(), default=0.0) < _SHOWN:
            return []
        tried = [self._without(kind) for kind, gain in first.items() if gain > _WORTH]
        good = sorted((z for z in tried if z is not None), key=lambda z: z.chi_square)
        good = [z for z in good if z.left < _LEFT and abs(z.amount) > 3 * z.error]
        return [z for z in good if z.chi_square < good[0].chi_square + _ALIKE]

    def _without(self, kind: str) -> ZeroOff | None:
        """The fit without a zero that is off."""
        problem, constants, amount = self._problem, self._constants, 0.0
        for _ in range(_ROUNDS):
            step, error = self._step(problem, constants, kind)
            amount += step
            try:
                problem = self._moved(kind, amount, constants)
            except NoCalibration:
                return None
            constants = search(problem, constants).constants
            if abs(step) < _SAME * error:
                break
        r, _ = sensitivity(problem.residuals(), jnp.asarray(constants))
        others = self._chi_squares(problem, constants, kind)
        left = max((x for own, x in others.items() if own != kind), default=0.0)
        return ZeroOff(kind, amount, error, float(jnp.sum(r**2)), left)

    def _moved(self, kind: str, amount: float, constants: np.ndarray) -> SensorProblem:
        problem = self._problem
        if kind == OFFSET:
            here = replace(problem.readings, so=problem.readings.so - amount)
            return problem.replace(readings=here)
        error = self._loads.zeros(amount * (kind == TOUCH), amount * (kind == FORCE_ZERO))
        model = self._solver.less(constants, error).model
        return problem.replace(model=replace(model, factor=problem.model.factor))

    def _step(
        self, problem: SensorProblem, constants: np.ndarray, kind: str
    ) -> tuple[float, float]:
        """How much further a zero is off, to first order, and its standard error."""
        r, _, along = self._projected(problem, constants, kind)
        size = max(float(along @ along), 1e-300)
        return float(along @ r) / size, size**-0.5

    def _chi_squares(
        self, problem: SensorProblem, constants: np.ndarray, beside: str = ""
    ) -> dict[str, float]:
        """By how much each zero would lessen chi-square, beside another that is free."""
        found = {}
        for kind in self._changes:
            r, taken, along = self._projected(problem, constants, kind)
            if beside and kind != beside:
                *_, other = self._projected(problem, constants, beside)
                other = other / max(float(np.linalg.norm(other)), 1e-300)
                along, r = along - other * (other @ along), r - other * (other @ r)
            # What the constants follow but for a thousandth is not told.
            size = float(np.linalg.norm(along))
            found[kind] = float(along @ r) ** 2 / size**2 if size > 1e-3 * taken else 0.0
        return found

    def _projected(
        self, problem: SensorProblem, constants: np.ndarray, kind: str
    ) -> tuple[Floats, float, Floats]:
        """Residuals, and what a zero changes in them beyond the constants, with its size."""
        r, J = map(np.asarray, sensitivity(problem.residuals(), jnp.asarray(constants)))
        here = problem.readings
        moved = problem.replace(readings=replace(here, so=here.so + self._changes[kind]))
        other, _ = sensitivity(moved.residuals(), jnp.asarray(constants))
        change = r - np.asarray(other)
        q, _ = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))
        return r - q @ (q.T @ r), float(np.linalg.norm(change)), change - q @ (q.T @ change)


def zeros_off(
    problem: SensorProblem,
    constants: np.ndarray,
    loads: KnownLoads,
    inputs: InputErrors,
    solver: ShapeSolver,
) -> list[str]:
    """A warning of zeros that are off, or none; see `Suspects`."""
    looked = inputs.slopes.any()
    zeros = Suspects(problem, constants, loads, inputs, solver).found() if looked else []
    return [sentence(zeros, problem)] if zeros else []


def sentence(zeros: Sequence[ZeroOff], problem: SensorProblem) -> str:
    """What is said of zeros that are off, each of which explains all that is left."""
    fitted = ",".join(problem.family.names)
    scale = float(problem.model.inputs["electrodes.lsb"]) if SCALE not in fitted else None
    texts = []
    for zero in zeros:
        size, error = abs(zero.amount), zero.error
        large = "large" if zero.amount > 0 else "small"
        if zero.kind == TOUCH:
            text = (
                f"known displacements are {1e3 * size:.2g} +- {1e3 * error:.1g} mm too "
                f"{large}, zero where the skin is not just touched: --fit {fitted},{TOUCH} "
                "finds that"
            )
        elif zero.kind == FORCE_ZERO:
            text = (
                f"known forces are {size:.2g} +- {error:.1g} N too {large}, the load cell's "
                f"zero: --fit {fitted},{FORCE_ZERO} finds it"
            )
        else:
            stray = f", or stray capacitance of {1e15 * size * scale:.2g} fF" if scale else ""
            text = (
                f"all taxels read {size:.2g} +- {error:.1g} counts too "
                f"{'many' if zero.amount > 0 else 'few'}, an offset{stray}: --offsets, a "
                f"--baseline or --fit {fitted},{STRAY} takes it out"
            )
        texts.append(text)
    return (
        "constants and intervals are wrong as they stand if "
        + "; or if ".join(texts)
        + " (what remains of the counts is noise then)"
    )
