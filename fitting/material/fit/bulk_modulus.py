"""The bulk modulus, from volumetric tests.

With the energy K/2 (J - 1)^2 of Abaqus, CalculiX and ANSYS the pressure is p = K (1 - J): the
estimate of K is a weighted mean, its interval Student's. Relative misfits are over predicted
pressures, for readings that noise makes small would count too much.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from fitting.material.experiments.volumetric import VolumetricTest
from fitting.material.fit.noise import Noise, estimated_noise, noise_remark, with_noise
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
    thin: int = 0,  # most readings of a curve; zero keeps all
) -> BulkModulus:
    """Find the bulk modulus that follows volumetric tests best.

    `residual`: "relative", "absolute", "noise" or "estimated", as for `fit_material`.
    Raises ValueError: an option is not allowed, the tests say nothing, or pressure falls with
    compression.
    """
    used, remarks, suspects = prepared(
        sets, branch, cycle, (), cut_break=False, remembers=False, thin=thin
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

    tests: Sequence[VolumetricTest]
    slopes: list[np.ndarray]  # derivatives of the residuals by K, a test each
    measured: list[np.ndarray]  # readings over their scale, a test each
    value: float  # K
    noise: Noise  # estimated from the residuals

    @classmethod
    def of(
        cls, tests: Sequence[VolumetricTest], kind: str, *, logarithmic: bool = False
    ) -> "_Fitted":
        ratios = [test.coordinate for test in tests]
        units = [-np.log(J) / J if logarithmic else 1.0 - J for J in ratios]
        scales = [reading_scale(test, tests, kind) for test in tests]
        for _ in range(_WEIGHINGS if kind == "relative" else 1):
            inverses = [np.sqrt(t.weight) / s for t, s in zip(tests, scales, strict=True)]
            slopes = [unit * inverse for unit, inverse in zip(units, inverses, strict=True)]
            measured = [test.value * inv for test, inv in zip(tests, inverses, strict=True)]
            J, y = np.concatenate(slopes), np.concatenate(measured)
            value = float(J @ y) / float(J @ J)
            sizes = [value * unit for unit in units]
            pairs = zip(tests, sizes, strict=True)
            scales = [np.maximum(np.abs(size), test.floor) for test, size in pairs]
        models = tuple(
            estimated_noise(test, size - test.value, size, inverse)
            for test, size, inverse in zip(tests, sizes, inverses, strict=True)
        )
        excluded = any(model is not None and model.excludes_assumed for model in models)
        deviations = [np.ones(test.size) for test in tests]
        for i, (model, test) in enumerate(zip(models, tests, strict=True)):
            if model is not None and model.excludes_assumed:
                sigma = model.deviation(sizes[i]) * inverses[i] / np.sqrt(test.weight)
                deviations[i] = np.maximum(sigma, 1e-6 * np.max(sigma))
            elif excluded:
                r = value * slopes[i] - measured[i]
                deviations[i] *= float(np.sqrt(np.mean(r**2))) or 1.0
        noise = Noise(models, np.concatenate(deviations), excluded)
        return cls(tests, slopes, measured, value, noise)

    @property
    def whole(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Slopes and residuals of all tests, and the size of what was measured."""
        J, y = np.concatenate(self.slopes), np.concatenate(self.measured)
        return J, self.value * J - y, float(np.sqrt(np.mean(y**2)))

    @property
    def square(self) -> float:
        return float(self.whole[1] @ self.whole[1])

    @property
    def dof(self) -> int:
        """Readings that say anything, less one."""
        J, r, _ = self.whole
        return int(np.sum((np.abs(J) > 1e-10 * np.max(np.abs(J))) | (r != 0.0))) - 1

    def error(self, *, known_noise: bool) -> float:
        """Standard error of K [Pa] under the noise as it is, without inflation."""
        J, r, size = self.whole
        ratio = np.ones(len(J)) if known_noise else self.noise.ratio
        scatter = 1.0
        if not known_noise:
            square = float(np.sum((r / ratio) ** 2))
            scatter = float(np.sqrt(square / self.dof)) if self.dof > 0 else size
            scatter = max(scatter, SMALLEST_NOISE * size / float(np.mean(ratio)))
        return scatter * float(np.linalg.norm(J * ratio)) / float(J @ J)

    def judged(self, *, known_noise: bool) -> Misfit:
        """Whether the residuals are more than noise."""
        J, r, size = self.whole
        ratio = np.ones(len(J)) if known_noise else self.noise.ratio
        places = np.split(np.arange(len(J)), np.cumsum([test.size for test in self.tests])[:-1])
        pairs = zip(self.tests, places, strict=True)
        orders = [place[order] for test, place in pairs for order in test.paths()]
        paths = [(r / ratio)[order] for order in orders]
        smooth = [(path, (J / ratio)[order]) for path, order in zip(paths, orders, strict=True)]
        return misfit(paths, 1, known_noise=known_noise, exact=1e-4 * size, smooth=smooth)
