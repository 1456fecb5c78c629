"""A fitted law: its constants, what it predicts, how sure that is, and what rivals it."""

import dataclasses
import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats

from fitting.material.experiments.artefacts import Suspect
from fitting.material.experiments.measurements import PATHS
from fitting.material.experiments.prediction import mode_factors
from fitting.material.fit.band import Band, Belief, half_width, nominal_factors
from fitting.material.fit.fitted_law import STABLE_LIMITS, FittedLaw
from fitting.material.fit.intervals import Intervals, intervals_of, modulus_and_slope
from fitting.material.fit.noise import Noise
from fitting.material.fit.problem import readings
from fitting.material.laws.blocks import Relaxation, Softening
from fitting.material.laws.parameters import block_of
from fitting.statistics.diagnostics import Misfit, information_criteria
from fitting.statistics.least_squares import Minima
from suas_jax.config.law import CorrelationSpec, LawSpec
from suas_jax.config.schema_scene import LAWS
from suas_jax.config.tolerance import UncertainQuantity
from suas_jax.constitutive import drucker_modulus

_DISTINCT = 0.02
# A skin stretches by this much where nothing else is asked for.
_STRETCH = 1.05
# Combinations that the data leave open may change by their natural size: the signs of a law's
# constants hold, and so do small steps along them.
_OPEN = 1.0


@dataclasses.dataclass(frozen=True)
class MaterialFit(FittedLaw):
    """A fitted law; `law`, `stress`, `misfits` and `stable` are those of `FittedLaw`."""

    minima: Minima  # what the starts found
    misfit: Misfit  # whether what remains is noise
    starts: int  # number of starts
    remarks: tuple[str, ...]  # warnings for a person
    noise: Noise | None = None  # of the data sets, estimated from the residuals
    suspects: tuple[Suspect, ...] = ()  # artefacts that the data seem to have
    # fits of other laws to the same data, which `predict` averages with this one
    others: tuple["MaterialFit", ...] = ()
    # largest stretch, and inverse of the smallest, asked for; None for those of the data
    up_to: float | None = None

    def material(self) -> LawSpec:
        """The fitted law as the [material] table of a skin, with its deviations.

        Raises ValueError: it is a law of one's own, which no file can name.
        """
        name = self.family.law_name
        if name not in LAWS:
            raise ValueError(f"the law {name} can't stand in a skin's [material]")
        blocks = [block_of(self.family, kind) for kind in (Relaxation, Softening)]
        count = max([self.family.law_size, *(found[1].stop for found in blocks if found)])
        constants = self.constants[:count]
        root = constants_root(self, self.belief, constants, self.up_to)
        covariance = root @ root.T
        sizes = np.sqrt(np.diagonal(covariance))
        held = np.maximum(np.outer(sizes, sizes), 1e-300)
        matrix = np.round(np.clip(covariance / held, -1.0, 1.0), 9)
        np.fill_diagonal(matrix, 1.0)
        stated = np.array([*map(UncertainQuantity, constants, map(float, sizes))], dtype=object)
        whole = np.append(stated, self.constants[count:])
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in self.family.tree(whole).items()
        }
        values |= {**self.family.settings, **self.family.effects(whole)}
        if count > 1:
            names = self.family.names[:count]
            values["correlation"] = CorrelationSpec(
                of=names, matrix=tuple(map(tuple, matrix.tolist()))
            )
        return LAWS[name](law=name, **values)

    @functools.cached_property
    def cost(self) -> float:
        """½ Σ r² at the constants."""
        _, r = readings(self.problem.residuals, jnp.asarray(self.constants))
        return 0.5 * float(jnp.sum(r**2))

    @property
    def status(self) -> str:
        """How the search ended, one word."""
        if not self.minima.converged[0]:
            return "not_converged"
        return "converged" if self.minima.agreeing > 1 else "single_minimum"

    @property
    def criteria(self) -> tuple[float, float]:
        """AICc and BIC."""
        count = int(self.problem.residuals.used.sum())
        known = self.problem.kind == "noise"
        return information_criteria(2.0 * self.cost, count, self.family.size, known_noise=known)

    @functools.cached_property
    def belief(self) -> Belief:
        """What the data say of every mode, averaged over this law and the others."""
        return Belief.of([self, *self.others])

    def predict(self, mode: str, stretch: np.ndarray, level: float = 0.95) -> Band:
        """Stress of a mode, "uniaxial", "equibiaxial" or "pure_shear", with its interval.

        Of stretches λ > 0; no law's form narrows it, and the mode may be measured or not.
        """
        stretch = np.asarray(stretch, float)
        middle, deviation = self.belief.stress(mode, stretch, self.up_to)
        law, _ = self.stress(nominal_factors(mode, stretch))
        return Band(stretch, middle, half_width(deviation, level), law)

    def intervals(self, level: float) -> np.ndarray:
        """Intervals of the constants, SI units, shape [2, p]; see `interval_ends`."""
        return self.interval_ends(level).ends

    def interval_ends(self, level: float) -> Intervals:
        """Intervals by profile likelihood, and which of their ends the data leave open."""
        if level not in self._known_intervals:
            self._known_intervals[level] = intervals_of(self, level)
        return self._known_intervals[level]

    @functools.cached_property
    def _known_intervals(self) -> dict[float, Intervals]:
        return {}

    def shear_modulus(self, level: float = 0.95) -> tuple[float, float, float]:
        """Small-strain shear modulus [Pa] with the ends of its interval.

        It is often known where the constants that add up to it are not.
        """
        return float(self.law.shear_modulus), *self.interval_ends(level).modulus

    def modulus_slope(self) -> np.ndarray:
        """Derivatives of the shear modulus by the constants, shape [p]."""
        _, slope = modulus_and_slope(self.family, jnp.asarray(self.constants))
        return np.asarray(slope)

    @property
    def stable_open(self) -> dict[str, tuple[bool, bool]]:
        """Which ends of the stable stretches were not found before the search ended."""
        low, high = STABLE_LIMITS
        return {
            mode: (first <= low * 1.001, last >= high / 1.001)
            for mode, (first, last) in self.stable.items()
        }

    def instabilities(self, margin: float = 0.0) -> list[str]:
        """Where the law is unstable within the data's range, in words.

        `margin`: share by which the logarithms of the stretches exceed the data's.
        """
        found = []
        for data in self.sets:
            e1, e2 = data.states * (1.0 + margin)
            if data.mode in PATHS:
                low, high = self.stable[data.mode]
                first, last = np.exp(data.states[0].min()), np.exp(data.states[0].max())
                if np.exp(e1.min()) < low or np.exp(e1.max()) > high:
                    found.append(
                        f"{data.mode}: the law is stable for stretches from {low:.3f} to "
                        f"{high:.3f}, the data in {data.file} reach from {first:.3f} to "
                        f"{last:.3f}"
                    )
                continue
            modulus = np.asarray(drucker_modulus(self.law, np.exp(e1), np.exp(e2)))
            if not np.all(modulus > 0.0):
                bad = int(np.argmin(np.where(np.isnan(modulus), -np.inf, modulus)))
                found.append(
                    f"{data.mode}: the law is unstable at stretches {np.exp(e1[bad]):.3f} and "
                    f"{np.exp(e2[bad]):.3f}, which the data in {data.file} reach"
                )
        return found

    @functools.cached_property
    def rivals(self) -> list[np.ndarray]:
        """Constants of other minima that fit as well within the noise.

        As well: cost below the best by the 95 % region of the F distribution. Other: the
        stress predicted in some mode differs by more than 2 %.
        """
        dof, p = self.uncertainty.dof, self.family.size
        if dof <= 0:
            return []
        if self.problem.kind == "noise":
            allowed = self.cost + 0.5 * float(stats.chi2.ppf(0.95, p))
        else:
            allowed = self.cost * (1.0 + p / dof * float(stats.f.ppf(0.95, p, dof)))
        residuals = self.problem.residuals
        seen = [self._fingerprint(self.constants)]
        others: list[np.ndarray] = []
        for theta, cost, good in zip(
            self.minima.theta, self.minima.cost, self.minima.converged, strict=True
        ):
            if not good or cost > allowed:
                continue
            found = np.asarray(self.family.constants(jnp.asarray(theta), residuals.scales))
            own = self._fingerprint(found)
            size = np.maximum(np.abs(own), 1e-300)
            if all(np.max(np.abs(own - other) / size) > _DISTINCT for other in seen):
                seen.append(own)
                others.append(self.family.ordered(found))
        return others

    def _fingerprint(self, constants: np.ndarray) -> np.ndarray:
        """Stresses of the three modes at a few stretches of the data's range."""
        h = np.asarray(self.problem.residuals.scales.strain) * np.array([0.1, 0.4, 0.7])
        parts = [mode_factors(path, np.exp(h)) for path in PATHS.values()]
        return self.stress(np.concatenate(parts, axis=1), constants)[0]


def constants_root(
    fit: FittedLaw, belief: Belief, constants: Float[np.ndarray, " p"], up_to: float | None
) -> Float[np.ndarray, "k n"]:
    """R of the constants that a file states, with R Rᵀ their covariance, SI units.

    Three errors add: what the readings leave open of the constants together, zeros of the tests
    included; how specimens of one rubber scatter, for a skin is a further one; and how far the
    law is off in plane strain, the skin's own state, if that was not measured or the law does
    not follow it. The last two are factors on all stresses.

    `constants`: of the law and of what is beside
    it, but for the tests' zeros, shape [k]. `up_to`: largest stretch of the skin; None for
    1.05.
    """
    count = len(constants)
    # A file's deviations are read as normal: Student's t of few readings is wider.
    normal = float(stats.norm.ppf(0.975))
    wider = fit.uncertainty.quantile(0.95) / normal
    own = wider * fit.uncertainty.root[:count]
    size = np.maximum(np.abs(constants), 1e-300)
    u, s, _ = np.linalg.svd(own / size[:, None], full_matrices=False)
    own = size[:, None] * (u * np.minimum(s, _OPEN))
    largest = _STRETCH if up_to is None else up_to
    stretch = np.array([largest])
    # What is known of the stresses there is known of the constants, however ill the law follows
    # the data elsewhere.
    off, slopes = {}, {}
    for mode in PATHS:
        middle, deviation = belief.stress(mode, stretch, largest)
        law, slope = fit.stress(nominal_factors(mode, stretch))
        off[mode] = float(np.hypot(deviation[0], middle[0] - law[0]) / law[0])
        slopes[mode] = slope[0, :count] / law[0]
    seen = np.stack([slopes[mode] @ own / off[mode] for mode in PATHS])
    _, s, vt = np.linalg.svd(seen)
    shrunk = np.ones(own.shape[1])
    shrunk[: len(s)] = 1.0 / np.sqrt(1.0 + s[: own.shape[1]] ** 2)
    own = own @ vt.T * shrunk
    told = float(np.linalg.norm(slopes["pure_shear"] @ own))
    scatter = 0.0 if fit.specimens is None else fit.specimens.scatter.further / normal
    # How tests of two modes repeat is how their specimens scatter, where that is not known.
    repeats = 0.0 if "pure_shear" in belief.measured else belief.repeats
    factor = max(off["pure_shear"] ** 2 - told**2 - repeats**2, 0.0)
    factor = np.sqrt(factor + max(scatter, repeats) ** 2)
    stresses = fit.family.stresses[:count] & (np.arange(count) < fit.family.law_size)
    return np.column_stack([own, np.where(stresses, factor * constants, 0.0)])
