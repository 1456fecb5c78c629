"""The bulk modulus, from volumetric tests.

With the energy K/2 (J - 1)^2 of Abaqus, CalculiX and ANSYS the pressure is p = K (1 - J): the
estimate of K is a weighted mean, its interval Student's. Relative misfits are over predicted
pressures, for readings that noise makes small would count too much.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.noise import Noise, noise_among, noise_remark, with_noise
from fitting.material.fit.preparation import prepared
from fitting.material.fit.problem import reading_scale
from fitting.statistics.diagnostics import Misfit, misfit
from fitting.statistics.identifiability import SMALLEST_NOISE

ENERGY, OTHER_ENERGY = "K/2 (J - 1)^2", "K/2 ln(J)^2"
_NOISE_ROUNDS, _WEIGHINGS = 2, 3
# Below this ratio of bulk and shear modulus a law fitted as incompressible is off by 1 % or so.
_NEARLY_INCOMPRESSIBLE = 30.0


@dataclasses.dataclass(frozen=True)
class BulkModulus:
    """A bulk modulus and how sure it is."""

    sets: tuple[VolumetricTest, ...]  # the tests that were fitted
    value: float  # K [Pa]
    standard_error: float  # of K [Pa], for the misfit's inflation, too
    dof: float  # degrees of freedom; the noise is known where they are infinite
    residual: str  # what misfits are relative to
    misfit: Misfit  # whether what remains is noise
    noise: Noise  # of the tests
    remarks: tuple[str, ...]  # warnings for a person

    def interval(self, level: float) -> tuple[float, float]:
        """Interval of K [Pa], no lower than zero."""
        half = self.standard_error * float(stats.t.ppf(0.5 + 0.5 * level, max(self.dof, 1.0)))
        return max(self.value - half, 0.0), self.value + half

    def predict(self, ratio: np.ndarray) -> np.ndarray:
        """Pressure [Pa] at volume ratios."""
        return self.value * (1.0 - ratio)

    def poisson_ratio(self, shear_modulus: float) -> float:
        """Poisson's ratio at small strain for a shear modulus [Pa]."""
        k, g = self.value, shear_modulus
        return (3.0 * k - 2.0 * g) / (2.0 * (3.0 * k + g))

    def report(self, shear_modulus: float | None = None) -> dict[str, Any]:
        """What `suas fit material` says of it.

        `shear_modulus`: of the law that was fitted beside it [Pa], if there is one.
        """
        ends = {
            f"{side}{name}": end
            for name, level in (("68", 0.6827), ("95", 0.95))
            for side, end in zip(("low", "high"), self.interval(level), strict=True)
        }
        return {
            "bulk_modulus_Pa": {"value": self.value, **ends},
            "volumetric": {
                "energy": ENERGY,
                "standard_error_Pa": self.standard_error,
                "poisson_ratio": (
                    None if shear_modulus is None else self.poisson_ratio(shear_modulus)
                ),
                "residual": self.residual,
                "misfit": self.misfit.report,
                "noise_model": self.noise.report(self.sets),
            },
        }

    def mode_report(self) -> dict[str, Any]:
        """Size of the misfit, as of every mode."""
        error = np.concatenate([self.predict(t.coordinate) - t.value for t in self.sets])
        size = np.concatenate([test.relative_scale() for test in self.sets])
        return {
            "rms_MPa": 1e-6 * float(np.sqrt(np.mean(error**2))),
            "relative_rms": float(np.sqrt(np.mean((error / size) ** 2))),
            "n": len(error),
        }


def compressibility_remark(bulk: BulkModulus, shear_modulus: float) -> list[str]:
    """What to say where an incompressible law stands beside a small bulk modulus."""
    ratio = bulk.value / shear_modulus
    if ratio >= _NEARLY_INCOMPRESSIBLE:
        return []
    return [
        f"the bulk modulus is {ratio:.3g} shear moduli only (Poisson's ratio "
        f"{bulk.poisson_ratio(shear_modulus):.3g}): the law was fitted as if the material were "
        f"incompressible"
    ]


def fit_bulk_modulus(
    sets: Sequence[VolumetricTest],  # the tests, from `datasets.load_dataset`
    residual: str = "relative",
    *,
    branch: str | None = None,  # "all" or "loading"; None takes all
    cycle: str = "all",  # "all", "first", "last" or a number
    cut_spikes: bool = False,  # leave out readings that stand out from their neighbours
    thin: int = 0,  # most readings of a curve; zero keeps all
) -> BulkModulus:
    """Find the bulk modulus that follows volumetric tests best.

    `residual`: "relative", "absolute", "noise" or "estimated", as for `fit_material`.
    Raises ValueError: an option is not allowed, the tests say nothing, or pressure falls with
    compression.
    """
    used, remarks, suspects = prepared(
        sets, branch, cycle, (), cut_spikes=cut_spikes, remembers=False, thin=thin
    )
    tests = [test for test in used if isinstance(test, VolumetricTest)]
    remarks += [suspect.text for suspect in suspects]
    kind = "relative" if residual == "estimated" else residual
    found = _Fitted.of(tests, kind)
    for _ in range(_NOISE_ROUNDS if residual == "estimated" else 0):
        sizes = [found.value * test.unit_stress for test in tests]
        known = with_noise(tests, found.noise, sizes)
        tests = [test for test in known if isinstance(test, VolumetricTest)]
        found = _Fitted.of(tests, "noise")
    if not found.value > 0.0:
        raise ValueError(
            f"{tests[0].file}: pressure does not grow with compression; check the columns"
        )
    stated = residual == "noise"
    excluded = found.noise.excluded and not stated
    judged = found.judged(known_noise=stated)
    if excluded:
        remarks.append(noise_remark(tests, found.noise, residual))
    if judged.description:
        text = f"bulk modulus: {judged.description.replace('the law', ENERGY)}"
        other = _Fitted.of(tests, kind, logarithmic=True)
        if residual != "estimated" and other.square < found.square:
            better = other.judged(known_noise=stated)
            verb = "follows them" if not better.significant else "follows them more closely"
            text += f"; {OTHER_ENERGY} {verb}, with K = {other.value / 1e6:.5g} MPa"
        remarks.append(text)
    return BulkModulus(
        sets=tuple(tests),
        value=found.value,
        standard_error=found.error(known_noise=stated) * judged.inflation,
        dof=np.inf if stated else found.dof,
        residual=residual,
        misfit=judged,
        noise=found.noise,
        remarks=tuple(remarks),
    )


@dataclasses.dataclass(frozen=True)
class _Fitted:
    """Weighted least squares of one constant: r = K J - y over its scale."""

    tests: list[tuple[VolumetricTest, np.ndarray]]  # with the places of their readings
    value: float  # K
    J: np.ndarray  # derivatives of the residuals by K [n]
    r: np.ndarray  # residuals [n]
    size: float  # of what was measured, over its scale
    noise: Noise  # estimated from the residuals

    @classmethod
    def of(
        cls, tests: Sequence[VolumetricTest], kind: str, *, logarithmic: bool = False
    ) -> "_Fitted":
        ends = np.cumsum([0, *(test.size for test in tests)])
        places = [np.arange(*pair) for pair in itertools.pairwise(ends)]
        rows = [
            (
                t.coordinate,
                t.value,
                t.weight,
                t.floor + 0 * t.value,
                reading_scale(t, tests, kind),
            )
            for t in tests
        ]
        ratio, y, weight, floor, scale = map(np.concatenate, zip(*rows, strict=True))
        unit = -np.log(ratio) / ratio if logarithmic else 1.0 - ratio
        for _ in range(_WEIGHINGS if kind == "relative" else 1):
            inverse = np.sqrt(weight) / scale
            J, measured = unit * inverse, y * inverse
            value = float(J @ measured) / float(J @ J)
            scale = np.maximum(np.abs(value * unit), floor)
        r, pairs = value * J - measured, list(zip(tests, places, strict=True))
        noise = noise_among(pairs, value * unit - y, value * unit, inverse, r)
        return cls(pairs, value, J, r, float(np.sqrt(np.mean(measured**2))), noise)

    @property
    def square(self) -> float:
        return float(self.r @ self.r)

    @property
    def dof(self) -> int:
        """Readings that say anything, less one."""
        told = (np.abs(self.J) > 1e-10 * np.max(np.abs(self.J))) | (self.r != 0.0)
        return int(np.sum(told)) - 1

    def error(self, *, known_noise: bool) -> float:
        """Standard error of K [Pa] under the noise as it is, without inflation."""
        J, scatter = self.J, 1.0
        ratio = np.ones(len(J)) if known_noise else self.noise.ratio
        if not known_noise:
            square = float(np.sum((self.r / ratio) ** 2))
            scatter = float(np.sqrt(square / self.dof)) if self.dof > 0 else self.size
            scatter = max(scatter, SMALLEST_NOISE * self.size / float(np.mean(ratio)))
        return scatter * float(np.linalg.norm(J * ratio)) / float(J @ J)

    def judged(self, *, known_noise: bool) -> Misfit:
        """Whether the residuals are more than noise."""
        ratio = np.ones(len(self.J)) if known_noise else self.noise.ratio
        orders = [place[order] for test, place in self.tests for order in test.paths()]
        smooth = [((self.r / ratio)[k], (self.J / ratio)[k]) for k in orders]
        paths, exact = [path for path, _ in smooth], 1e-4 * self.size
        return misfit(paths, 1, known_noise=known_noise, exact=exact, smooth=smooth)
