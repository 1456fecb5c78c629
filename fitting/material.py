"""Fit a law to test data: constants, how sure they are, and where the law may be used."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from fitting.data_checks import branches, contradictions, warnings_of
from fitting.diagnostics import Misfit, information_criteria, misfit
from fitting.experiments import Homogeneous, mode_factors, padded
from fitting.identifiability import Uncertainty, uncertainty
from fitting.laws import family
from fitting.least_squares import Minima, minimise
from fitting.measurements import PATHS, Dataset
from fitting.parameters import AbstractFamily
from fitting.problem import Problem, pose, settle
from fitting.residuals import readings, sensitivity
from suas_jax.constitutive import AbstractLaw, stable_range

# In order of falling simplicity; `auto` compares them all.
CANDIDATES: tuple[tuple[str, int], ...] = (
    ("neo-hookean", 1),
    ("mooney-rivlin", 2),
    ("mooney-rivlin", 3),
    ("gent", 1),
    ("arruda-boyce", 1),
    ("yeoh", 3),
    ("polynomial", 2),
    ("ogden", 1),
    ("ogden", 2),
    ("ogden", 3),
    ("ogden", 4),
)
_ALL_STATES = frozenset(["biaxial", "biaxial_difference"])
_EQUIBIAXIAL_TESTS = frozenset(["balloon", "bulge"])
_DISTINCT = 0.02
_UNKNOWN = 0.3
_STARTS_IN_BOX = 5
_SKIN_LANES = 4
# A reading is wrong by the square of how far its apex stretch still is from settled.
_BULGE_LANES, _BULGE_ROUNDS, _SETTLED = 2, 8, 3e-3


@dataclasses.dataclass(frozen=True)
class Band:
    """Predicted stress of a mode with its uncertainty.

    Attributes:
        stretch: λ, shape [n].
        nominal: nominal stress [Pa], shape [n].
        half_width: half width of the interval [Pa], shape [n].
    """

    stretch: np.ndarray
    nominal: np.ndarray
    half_width: np.ndarray


@dataclasses.dataclass(frozen=True)
class MaterialFit:
    """A fitted law.

    Attributes:
        sets: the data that were fitted.
        problem: its residuals; a posterior samples `problem.residuals.log_likelihood`.
        constants: fitted constants in SI units, in the order of `family.names`.
        minima: what the starts found.
        uncertainty: covariance and identifiability.
        misfit: whether what remains is noise.
        starts: number of starts.
        remarks: warnings for a person.
        bounded: constants that stopped at a bound.
    """

    sets: tuple[Dataset, ...]
    problem: Problem
    constants: np.ndarray
    minima: Minima
    uncertainty: Uncertainty
    misfit: Misfit
    starts: int
    remarks: tuple[str, ...]
    bounded: tuple[str, ...] = ()

    @property
    def family(self) -> AbstractFamily:
        """The law's family."""
        return self.problem.residuals.family

    @property
    def law(self) -> AbstractLaw:
        """The fitted law."""
        return self.family.law(jnp.asarray(self.constants))

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

    def predict(self, mode: str, stretch: np.ndarray, level: float = 0.95) -> Band:
        """Predict a mode, measured or not, with the uncertainty of the constants.

        Args:
            mode: "uniaxial", "equibiaxial" or "pure_shear".
            stretch: λ > 0, shape [n].
            level: probability that the interval covers the law's mean stress.
        """
        e1, e2, c1, c2 = mode_factors(PATHS[mode], stretch)
        test = Homogeneous(*(padded(x) for x in (e1, e2, c1 / stretch, c2 / stretch)))
        value, slope = _prediction(self.family, test, jnp.asarray(self.constants))
        half = self.uncertainty.spread_of(np.asarray(slope)) * self.uncertainty.quantile(level)
        count = len(stretch)
        return Band(np.asarray(stretch), np.asarray(value)[:count], half[:count])

    def intervals(self, level: float) -> np.ndarray:
        """Intervals of the constants, SI units, shape [2, p]."""
        half = self.uncertainty.quantile(level) * self.uncertainty.standard_errors
        return np.stack([self.constants - half, self.constants + half])

    def shear_modulus(self, level: float = 0.95) -> tuple[float, float, float]:
        """Small-strain shear modulus [Pa] with the ends of its interval.

        It is often known where the constants that add up to it are not.
        """
        value, slope = _modulus(self.family, jnp.asarray(self.constants))
        half = float(self.uncertainty.spread_of(np.asarray(slope)))
        half *= self.uncertainty.quantile(level)
        return float(value), float(value) - half, float(value) + half

    @functools.cached_property
    def stable(self) -> dict[str, tuple[float, float]]:
        """Stretches around one in which the law is stable, by mode."""
        found = {}
        for mode, path in PATHS.items():
            low, high = stable_range(self.law, path)
            found[mode] = (float(low), float(high))
        return found

    @property
    def report(self) -> dict[str, Any]:
        """The JSON of `suas fit material`."""
        family, judged = self.family, self.uncertainty
        aicc, bic = self.criteria
        stable = self.stable
        unknown_modes, extrapolated = self._extrapolations()
        report: dict[str, Any] = {
            "law": family.law_name,
            "parameters": family.tree(map(float, self.constants)),
            "units": family.tree(family.units),
            "standard_errors": family.tree(map(float, judged.standard_errors)),
            "covariance": judged.covariance.tolist(),
            "covariance_order": list(family.names),
            "correlation": judged.correlation.tolist(),
            "intervals": {
                name: family.tree(self.intervals(level).T.tolist())
                for name, level in (("68", 0.6827), ("95", 0.95))
            },
            "shear_modulus_Pa": dict(
                zip(("value", "low95", "high95"), self.shear_modulus(), strict=True)
            ),
            "modes": self._modes(),
            "residual": {
                "kind": self.problem.kind,
                "cost": self.cost,
                "noise": judged.noise,
                "model_error": self.problem.model_error,
                "floor_Pa": {
                    data.file: floor
                    for data, floor in zip(self.sets, self.problem.floors, strict=True)
                },
            },
            "aicc": aicc,
            "bic": bic,
            "condition_number": judged.condition_number,
            "singular_values": judged.singular_values.tolist(),
            "unidentifiable": [*judged.unidentifiable, *self._rivals(), *unknown_modes],
            "stable_range": {mode: list(ends) for mode, ends in stable.items()},
            "misfit": _plain(dataclasses.asdict(self.misfit)),
            "starts": self.starts,
            "starts_converged": int(self.minima.converged.sum()),
            "starts_agreeing": self.minima.agreeing,
            "warnings": [*self.remarks, *self._doubts(stable), *extrapolated],
            "status": self.status,
        }
        if family.law_name == "ogden":
            report["convention"] = "mu/alpha"
            report["terms"] = family.size // 2
        if self.bounded:
            report["at_bounds"] = list(self.bounded)
        return report

    # ---- parts of the report

    def misfits(self) -> list[np.ndarray]:
        """Predicted less measured readings of each data set [Pa]."""
        residuals = self.problem.residuals
        predicted, _ = readings(residuals, jnp.asarray(self.constants))
        difference = np.asarray(predicted - residuals.value)
        return [difference[place] for place in self.problem.places]

    def _modes(self) -> dict[str, dict[str, Any]]:
        by_mode: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for data, error, floor in zip(
            self.sets, self.misfits(), self.problem.floors, strict=True
        ):
            size = np.maximum(np.maximum(np.abs(data.value), data.companion), floor)
            size = np.where(size > 0.0, size, np.max(size) or 1.0)
            by_mode.setdefault(data.mode, []).append((error, error / size))
        report: dict[str, dict[str, Any]] = {
            mode: {
                "rms_MPa": 1e-6 * _rms(np.concatenate([e for e, _ in parts])),
                "relative_rms": _rms(np.concatenate([r for _, r in parts])),
                "n": sum(len(e) for e, _ in parts),
            }
            for mode, parts in by_mode.items()
        }
        if "skin" in report:
            del report["skin"]["rms_MPa"]
            channels = [
                (data.direction, error)
                for data, error in zip(self.sets, self.misfits(), strict=True)
                if data.mode == "skin"
            ]
            for channel, key in ((1, "rms_m"), (2, "rms_Pa")):
                errors = np.concatenate([e[d == channel] for d, e in channels])
                if errors.size:
                    report["skin"][key] = _rms(errors)
        return report

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
            print_ = self._fingerprint(found)
            if all(_apart(print_, other) > _DISTINCT for other in seen):
                seen.append(print_)
                others.append(self.family.ordered(found))
        return others

    def _fingerprint(self, constants: np.ndarray) -> np.ndarray:
        """Stresses of the three modes at a few stretches of the data's range."""
        h = np.asarray(self.problem.residuals.scales.strain) * np.array([0.1, 0.4, 0.7])
        parts = []
        for path in PATHS.values():
            e1, e2, c1, c2 = mode_factors(path, np.exp(h))
            parts.append(np.stack([e1, e2, c1, c2]))
        test = Homogeneous(*(padded(x) for x in np.concatenate(parts, axis=1)))
        value, _ = _prediction(self.family, test, jnp.asarray(constants))
        return np.asarray(value)[: 3 * len(h)]

    def _rivals(self) -> list[str]:
        others = self.rivals
        if not others:
            return []
        everything = np.stack([self.constants, *others])
        parts = [
            f"{name} from {low:.4g} to {high:.4g} {unit}".rstrip(" 1")
            for name, unit, low, high in zip(
                self.family.names,
                self.family.units,
                everything.min(axis=0),
                everything.max(axis=0),
                strict=True,
            )
        ]
        return [
            f"{len(others) + 1} different minima fit as well within the noise: "
            + ", ".join(parts)
        ]

    def _doubts(self, stable: Mapping[str, tuple[float, float]]) -> list[str]:
        doubts = []
        if self.status == "not_converged":
            doubts.append(
                "no start reached a minimum: constants may improve; use fewer terms, more "
                "--starts, or more data"
            )
        elif self.status == "single_minimum":
            doubts.append("only one start reached the lowest minimum: use more --starts")
        if self.misfit.words:
            doubts.append(self.misfit.words)
        for data in self.sets:
            if data.mode not in stable:
                continue
            low, high = stable[data.mode]
            first, last = data.stretch_1.min(), data.stretch_1.max()
            if first < low or last > high:
                doubts.append(
                    f"{data.mode}: the law is stable for stretches from {low:.3f} to "
                    f"{high:.3f}, the data in {data.file} reach from {first:.3f} to {last:.3f}"
                )
        return doubts

    def _extrapolations(self) -> tuple[list[str], list[str]]:
        """Modes that the data leave open, and a warning about all that were not measured.

        The prediction of a mode is as uncertain as its 95 % band, or as far as other
        minima that fit as well predict it, whichever is more.
        """
        modes = {data.mode for data in self.sets}
        measured = modes & set(PATHS)
        if modes & _EQUIBIAXIAL_TESTS:
            measured.add("equibiaxial")
        missing = [mode for mode in PATHS if mode not in measured]
        if not missing or modes & _ALL_STATES:
            return [], []
        largest = float(np.exp(np.asarray(self.problem.residuals.scales.strain)))
        ends = {"uniaxial": largest, "equibiaxial": np.sqrt(largest), "pure_shear": largest}
        parts, unknown = [], []
        for mode in missing:
            stretch = np.linspace(1.0, ends[mode], 9)[1:]
            band = self.predict(mode, stretch)
            half = band.half_width
            for other in self.rivals:
                half = np.maximum(
                    half, np.abs(self._nominal(mode, stretch, other) - band.nominal)
                )
            ratio = float(np.max(half / np.maximum(np.abs(band.nominal), 1e-300)))
            amount = f"+-{100.0 * ratio:.2g} %" if ratio < 10.0 else "no useful accuracy"
            parts.append(f"{mode} to {amount} up to a stretch of {ends[mode]:.2f}")
            if not ratio < _UNKNOWN:
                unknown.append(
                    f"{mode} stress: not measured, and known to {amount} only (95 %, up to "
                    f"a stretch of {ends[mode]:.2f})"
                )
        advice = "measure it" if unknown else "the band assumes that the law itself is right"
        warning = (
            f"only {', '.join(sorted(modes))} was measured, other modes are extrapolated: "
            f"{', '.join(parts)}; {advice}"
        )
        return unknown, [warning]

    def _nominal(self, mode: str, stretch: np.ndarray, constants: np.ndarray) -> np.ndarray:
        """Nominal stress of a mode for other constants of the law [Pa]."""
        changed = dataclasses.replace(self, constants=constants)
        return changed.predict(mode, stretch).nominal


def fit_material(
    sets: Sequence[Dataset],
    law: str | AbstractFamily = "ogden",
    terms: int | None = None,
    *,
    residual: str = "relative",
    starts: int = 64,
    seed: int = 0,
    branch: str = "all",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    remarks: Sequence[str] = (),
) -> MaterialFit:
    """Find the constants of a law that follow test data best.

    Args:
        sets: the data, from `datasets.load_dataset`.
        law: a value of `law` in [material], or a family of one's own.
        terms: number of terms, if the law has any.
        residual: "relative", "absolute" or "noise", see `problem.pose`.
        starts: number of starting points.
        seed: of the random starting points.
        branch: "all", or "loading" to leave unloading branches out.
        bounds: hard bounds by constant, SI units, such as {"alpha.0": (1, 3)}.
        remarks: warnings to carry into the report.

    Raises:
        ValueError: law, terms, residual, branch or bounds are not allowed.
        NoFit: no start gave finite residuals.
    """
    chosen = law if isinstance(law, AbstractFamily) else family(law, terms)
    if starts < 1:
        raise ValueError(f"--starts {starts}: at least one is needed")
    said = [*remarks]
    used = tuple(_on_branch(data, branch) for data in sets)
    for data, kept in zip(sets, used, strict=True):
        said += warnings_of(kept)
        if kept.size < data.size:
            said.append(
                f"{data.file}: {data.size - kept.size} readings of unloading branches left out"
            )
    said += contradictions(used)
    problem, minima = _search(used, chosen, residual, starts, seed)
    if not np.isfinite(minima.cost[0]):
        raise NoFit(
            f"{chosen.title}: none of {starts} starts gave finite stresses; check the units, "
            f"or choose another law"
        )
    if problem.model_error and residual != "noise":
        said.append(
            f"the lumped shell's own error, about {100.0 * problem.model_error:.2g} % of "
            f"displacement and pressure, is in no interval; state the noise and use "
            f"--residual noise, which allows for it"
        )
    scales = problem.residuals.scales
    constants = np.asarray(chosen.constants(jnp.asarray(minima.theta[0]), scales))
    constants = chosen.ordered(constants)
    at_bounds: tuple[str, ...] = ()
    if bounds:
        from fitting.bounded import minimise_in_box

        others = chosen.random(np.random.default_rng(seed + 1), _STARTS_IN_BOX)
        constants, minima, at_bounds = minimise_in_box(
            problem.residuals, constants, others, bounds
        )
        if at_bounds:
            said.append(f"at a bound, and held there in all intervals: {', '.join(at_bounds)}")
    known_noise = residual == "noise"
    shape, smooth = _residual_paths(used, problem, constants)
    typical = float(np.sqrt(np.mean(np.asarray(_weighed_readings(problem)) ** 2)))
    judged_misfit = misfit(
        shape, chosen.size, known_noise=known_noise, exact=1e-4 * typical, smooth=smooth
    )
    judged = uncertainty(
        problem.residuals,
        constants,
        known_noise=known_noise,
        inflation=judged_misfit.inflation,
        held=at_bounds,
    )
    return MaterialFit(
        used, problem, constants, minima, judged, judged_misfit, starts, tuple(said), at_bounds
    )


class NoFit(ArithmeticError):  # noqa: N818
    """No constants can be returned: every start failed."""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Laws compared on the same data.

    Attributes:
        fits: one per law that could be fitted, lowest AICc first.
        failed: reasons, by law, of those that could not.
    """

    fits: tuple[MaterialFit, ...]
    failed: dict[str, str]

    @property
    def best(self) -> MaterialFit:
        """The lowest AICc among converged fits that determine all their constants.

        A law with a combination of constants that the data leave free has terms to spare;
        it is chosen only where every law has one.
        """
        return min(self.fits, key=lambda fit: bool(fit.uncertainty.unidentifiable))

    @property
    def table(self) -> list[dict[str, Any]]:
        """One line per law."""
        return [
            {
                "law": fit.family.law_name,
                "title": fit.family.title,
                "constants": fit.family.size,
                "aicc": fit.criteria[0],
                "bic": fit.criteria[1],
                "cost": fit.cost,
                "condition_number": fit.uncertainty.condition_number,
                "unidentifiable": len(fit.uncertainty.unidentifiable),
                "status": fit.status,
            }
            for fit in self.fits
        ]


def compare_laws(
    sets: Sequence[Dataset],
    candidates: Sequence[tuple[str, int]] = CANDIDATES,
    progress: Callable[[str], None] = lambda title: None,
    **options: Any,
) -> Comparison:
    """Fit several laws and rank them by AICc.

    Args:
        sets: the data.
        candidates: laws and numbers of terms.
        progress: called with each law's title before it is fitted.
        options: as for `fit_material`.
    """
    fits, failed = [], {}
    count = sum(data.size for data in sets)
    for law, terms in candidates:
        chosen = family(law, terms)
        if chosen.size + 2 > count:
            failed[chosen.title] = f"{chosen.size} constants for {count} readings"
            continue
        progress(chosen.title)
        try:
            fits.append(fit_material(sets, chosen, **options))
        except NoFit as error:
            failed[chosen.title] = str(error)
    if not fits:
        raise NoFit("no law could be fitted: " + "; ".join(failed.values()))

    def rank(fit: MaterialFit) -> tuple[bool, float]:
        aicc = fit.criteria[0]
        return fit.status == "not_converged", aicc if np.isfinite(aicc) else np.inf

    return Comparison(tuple(sorted(fits, key=rank)), failed)


def _search(
    sets: Sequence[Dataset], chosen: AbstractFamily, kind: str, starts: int, seed: int
) -> tuple[Problem, Minima]:
    points = chosen.random(np.random.default_rng(seed), starts)
    problem = pose(sets, chosen, kind)
    if any(data.mode == "skin" for data in sets):
        # Every residual is an equilibrium, and the modulus is known from the start.
        return problem, minimise(problem.residuals, points[:_SKIN_LANES], lanes=_SKIN_LANES)
    if not any(data.mode == "bulge" for data in sets):
        return problem, minimise(problem.residuals, points)
    # Membranes are expensive: explore with spherical caps, then fit the best with
    # membranes, whose apex stretches follow the constants.
    found = minimise(pose(sets, chosen, kind, estimate=True).residuals, points)
    for _ in range(_BULGE_ROUNDS):
        if not np.isfinite(found.cost[0]):
            break
        best = chosen.constants(jnp.asarray(found.theta[0]), problem.residuals.scales)
        problem, change = settle(problem, np.asarray(best))
        if change < _SETTLED:
            break
        lanes = _BULGE_LANES
        nearer = minimise(problem.residuals, found.theta[:lanes], lanes=lanes, passes=0)
        if not np.isfinite(nearer.cost[0]):
            break
        found = nearer
    return problem, found


def _on_branch(data: Dataset, branch: str) -> Dataset:
    if branch == "all":
        return data
    if branch != "loading":
        raise ValueError(f"--branch {branch}: unknown; allowed: all, loading")
    return data.select(~branches(data).unloading)


def _residual_paths(
    sets: Sequence[Dataset], problem: Problem, constants: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Residuals of each test in the order in which it deforms.

    Returns:
        Them, and of tests that are one curve also residuals and derivatives on a scale that
        changes smoothly along it: where the scale is a share of the reading, noise and all,
        the same share of the prediction.
    """
    residuals = problem.residuals
    r, J = (np.asarray(x) for x in sensitivity(residuals, jnp.asarray(constants)))
    size = np.abs(np.asarray(residuals.value))
    predicted = np.abs(np.asarray(residuals.value + residuals.misfit(jnp.asarray(r))))
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.nan_to_num(np.clip(size / predicted, 0.5, 2.0), nan=1.0)
    share = size * np.asarray(residuals.inverse_scale)
    paths, smooth = [], []
    for data, place in zip(sets, problem.places, strict=True):
        for direction in np.unique(data.direction):
            rows = np.flatnonzero(data.direction == direction)
            keys = (data.stretch_2[rows], data.coordinate[rows])
            if data.mode not in _ALL_STATES:
                keys = (data.coordinate[rows],) * 2
            order = place[rows[np.lexsort(keys)]]
            paths.append(r[order])
            if data.mode not in _ALL_STATES:
                alike = np.isclose(share[order], np.median(share[order]), rtol=1e-6)
                w = np.where(alike & (alike.mean() > 0.5), factor[order], 1.0)
                smooth.append((w * r[order], w[:, None] * J[order]))
    return paths, smooth


def _weighed_readings(problem: Problem) -> np.ndarray:
    residuals = problem.residuals
    return np.asarray(residuals.value * residuals.inverse_scale)[residuals.used]


@eqx.filter_jit
def _prediction(
    family: AbstractFamily, test: Homogeneous, constants: jax.Array
) -> tuple[jax.Array, jax.Array]:
    def stress(c: jax.Array) -> jax.Array:
        return test.predict(family.law(c))

    return stress(constants), jax.jacfwd(stress)(constants)


@eqx.filter_jit
def _modulus(family: AbstractFamily, constants: jax.Array) -> tuple[jax.Array, jax.Array]:
    return jax.value_and_grad(lambda c: family.law(c).shear_modulus)(constants)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.max(np.abs(a - b) / np.maximum(np.abs(a), 1e-300)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {
        key: value.item() if isinstance(value, np.generic) else value
        for key, value in values.items()
    }
