"""Calibrate a skin's electrical constants, and its material's, from logs with known inputs.

SO = (C_stray + eps0 eps A <1/d>) / lsb: at rest only permittivity over gap shows; a known
displacement changes d by a known amount and tells the gap itself; a second fluid of known
permittivity tells gap times scale. What the logs at hand determine is read from the
derivatives of the readings; a constant that they leave open keeps the value of the skin
file within a stated tolerance (a prior), and the report says so.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.deformations import Deformed, NoDeformation, deform
from fitting.diagnostics import Misfit, misfit
from fitting.identifiability import Uncertainty, uncertainty
from fitting.known_loads import KnownLoads
from fitting.least_squares import Minima, minimise
from fitting.residuals import sensitivity
from fitting.sensor_data import Masked, SensorData
from fitting.sensor_model import (
    GAP,
    LAYERS,
    PATHS,
    PERMITTIVITY,
    SCALE,
    STRAY,
    Constant,
    SensorFamily,
    SensorModel,
    SensorResiduals,
    parts_of,
    shape_slopes,
)
from fitting.solid_correction import MOST_PLACES, Correction, corrected, corrections
from suas_jax.acquisition.baseline import Baseline, rest_of
from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.constitutive import AbstractLaw
from suas_jax.gap import PolarFace
from suas_jax.geometry import SkinGeometry
from suas_jax.oil import AbstractOil, CompressibleOil, VentedOil
from suas_jax.taxel import taxel_names

ALIASES = {"permittivity": PERMITTIVITY, "gap": GAP, "scale": SCALE}
DEFAULT = (PERMITTIVITY, GAP)
# A constant whose standard error would exceed this share of its size is left open by the
# data: it gets a prior.
OPEN = 0.05
# Tolerance of what a skin file says, where nothing else does: standard deviations relative
# to natural sizes.
TOLERANCE = {PERMITTIVITY: 0.1, GAP: 0.05, SCALE: 0.01, STRAY: 0.1, LAYERS: 0.1}
_MATERIAL_TOLERANCE = 0.1
# What gets a prior first.
_LEAST_KNOWN = (LAYERS, STRAY, SCALE)
ATMOSPHERE = 101325.0  # bulk modulus of trapped air, isothermal [Pa]

_ROUNDING = 1.0 / np.sqrt(12.0)
_OUTLIER = 5.0
_HUBER = 1.5
_HUBER_ROUNDS = 2
_ROUNDS = 8
_LANES = 2
# Readings of a taxel that may be outliers before the taxel is given up.
_BAD_TAXEL = 0.5
_DRIFTING = 5.0
# A taxel-to-taxel misfit beyond this is no tolerance of assembly.
_ANOTHER_SKIN = 0.3
_PLAUSIBLE = (0.9, 200.0)
_FACTOR = 3.0
_LARGEST_MOVE = 0.3
_SAME = 1e-7


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is assumed of a constant.

    Attributes:
        mean: SI.
        sd: standard deviation, SI.
        reason: why it was needed.
    """

    mean: float
    sd: float
    reason: str


@dataclasses.dataclass(frozen=True)
class SensorFit:
    """A calibration.

    Attributes:
        data: the readings.
        residuals: the misfit, in units of the noise; a posterior samples
            `residuals.log_likelihood`.
        constants: fitted, SI [p].
        minima: what the starts found.
        uncertainty: covariance, priors included.
        alone: covariance without priors; infinite where the data leave a constant open.
        ratio: permittivity over gap with its standard error [1/m].
        misfit: whether what remains is noise.
        priors: by constant.
        noise: standard deviation of a reading [taxel, log], counts.
        masked: all that was left out.
        outliers: how many readings were.
        offsets: of every taxel with its standard error [2, taxel], counts; None if not
            asked for.
        drift: of every taxel and log [taxel, log], counts/s; None where there is none.
        loads: the known states, the baseline's included.
        force: on each load, given or found [load, state, N].
        displacement: of each load [load, state, m].
        findings: what the data don't determine, in words.
        tells: what each log, and each fluid, tells.
        warnings: what a person should know.
    """

    data: SensorData
    residuals: SensorResiduals
    constants: np.ndarray
    minima: Minima
    uncertainty: Uncertainty
    alone: np.ndarray
    ratio: tuple[float, float] | None
    misfit: Misfit
    priors: dict[str, Prior]
    noise: np.ndarray
    masked: tuple[Masked, ...]
    outliers: int
    offsets: np.ndarray | None
    drift: np.ndarray | None
    loads: KnownLoads
    force: np.ndarray
    displacement: np.ndarray
    findings: tuple[str, ...]
    tells: tuple[dict, ...]
    warnings: tuple[str, ...]

    @property
    def family(self) -> SensorFamily:
        """The calibrated constants."""
        return self.residuals.family

    @property
    def status(self) -> str:
        """How the search ended, one word."""
        return "converged" if self.minima.converged[0] else "not_converged"

    @property
    def predicted(self) -> np.ndarray:
        """Counts at the constants, offsets and drift included [taxel, frame]."""
        return self.data.so + self.errors

    @property
    def errors(self) -> np.ndarray:
        """Predicted less measured counts of the readings used, NaN elsewhere [taxel, frame]."""
        r = np.asarray(self.residuals.of_constants(jnp.asarray(self.constants)))
        inverse = np.asarray(self.residuals.inverse_scale)
        count = self.data.so.size
        used = inverse[:count] > 0
        errors = np.full(count, np.nan)
        errors[used] = (r[:count] / np.where(used, inverse[:count], 1.0))[used]
        return errors.reshape(-1, self.residuals.basis.shape[1])[:, : self.data.so.shape[1]]


class NoCalibration(ValueError):  # noqa: N818
    """The logs don't belong to the skin, or nothing can be told from them."""


def material_unit(key: str) -> str:
    """SI unit of a key of [material], "1" for a number."""
    return "1" if key.split(".")[0] in ("alpha", "Jm", "lambda_m") else "Pa"


def named(spec: SkinSpec, name: str) -> Constant:
    """The constant of a skin that a name stands for.

    Raises:
        ValueError: there is none; names those that there are.
    """
    own = ALIASES.get(name.strip(), name.strip())
    assert spec.electrodes is not None
    gap, permittivity = spec.geometry.oil_gap, spec.oil.relative_permittivity or 2.0
    if own == PERMITTIVITY:
        return Constant(own, "1", permittivity)
    if own == GAP:
        return Constant(own, "m", gap)
    if own == SCALE:
        return Constant(own, "F", spec.electrodes.lsb)
    if own == STRAY:
        # Of the order of a taxel's own capacitance.
        diameter = 4e-3
        return Constant(own, "F", 8.854e-12 * permittivity * diameter**2 / gap, False)
    if own == LAYERS:
        return Constant(own, "m", gap / permittivity, False)
    inputs = continuous_inputs(spec)
    material = {k: v for k, v in inputs.items() if k.startswith("material.")}
    if own not in material:
        raise ValueError(
            f'--fit "{name}": unknown; allowed: permittivity, gap, scale, stray, layers, '
            + ", ".join(material)
        )
    value = material[own]
    unit = material_unit(own.removeprefix("material."))
    size = abs(value) or max(abs(v) for v in material.values())
    return Constant(own, unit, size, value > 0)


def fit_sensor(
    data: SensorData,
    fit: Sequence[str] = DEFAULT,
    *,
    priors: Mapping[str, tuple[float, float]] | None = None,
    baseline: Baseline | None = None,
    offsets: bool = False,
    air: str = "skin",
    gaps: str = "global",
    like: SensorFit | None = None,
    model: str = "auto",
    field: bool = False,
    progress: Callable[[str], None] = lambda text: None,
) -> SensorFit:
    """Find the constants that follow the logs best, and say how far they can be known.

    Args:
        data: the logs.
        fit: names of the constants: permittivity, gap, scale, stray, layers, material.C1 ...
        priors: mean and standard deviation by name, SI, that are always used.
        baseline: counts at rest, which fix an offset of every taxel.
        offsets: give every taxel an offset of its own.
        air: how air in the gap answers: "skin" (as the skin file says), "trapped" or
            "vented".
        gaps: whether all taxels share one gap ("global"), those of a module ("module"), or
            each has its own ("taxel").
        model: "shell", "solid" (the shell with the solid's correction), or "auto": the
            solid, unless the logs say that `suas simulate` made them, which has the shell.
        field: take capacitances from the electrostatic field instead of the formula.
        like: a calibration of the same known states, whose shapes are used again.
        progress: called with what is being done.

    Raises:
        ValueError: an argument is not allowed.
        NoCalibration: the logs don't follow the skin's model at all.
    """
    parts = tuple(dict.fromkeys(named(data.spec, name) for name in fit))
    parts, gap_of = _single_gaps(data.spec, parts, gaps)
    family = SensorFamily(parts)
    if model not in ("auto", "shell", "solid"):
        raise ValueError(f"--model {model}: unknown; allowed: auto, shell, solid")
    if not family.size:
        raise ValueError("--fit: name at least one constant")
    given = {named(data.spec, k).name: v for k, v in (priors or {}).items()}
    for name in given:
        if name not in family.names:
            if name == GAP:
                raise ValueError("--prior gap: name each one, such as oil_gap.0")
            raise ValueError(f"--prior {name}: it is not fitted; fitted: {family.names}")
    return _Calibration(
        data, family, given, baseline, offsets, air, gap_of, like, model, field, progress
    ).run()


def _moves(name: str) -> bool:
    return name.startswith("material.")


def is_gap(name: str) -> bool:
    """Whether a constant is a gap, of all taxels, a module or one taxel."""
    return name.split(".")[0] == GAP


def _single_gaps(
    spec: SkinSpec, parts: tuple[Constant, ...], gaps: str
) -> tuple[tuple[Constant, ...], tuple[int, ...] | None]:
    """Constants with a gap for each module or taxel, and which of them a taxel has."""
    if gaps not in ("global", "module", "taxel"):
        raise ValueError(f"--gap {gaps}: unknown; allowed: global, module, taxel")
    shared = [part for part in parts if part.name == GAP]
    if gaps == "global" or not shared:
        return parts, None
    modules, numbers = taxel_names(spec.electrodes)  # type: ignore[arg-type]
    keys = [
        f"{GAP}.{m}" if gaps == "module" else f"{GAP}.{m}.{k}"
        for m, k in zip(modules, numbers, strict=True)
    ]
    own = list(dict.fromkeys(keys))
    others = tuple(part for part in parts if part.name != GAP)
    single = tuple(dataclasses.replace(shared[0], name=key) for key in own)
    return others + single, tuple(len(others) + own.index(key) for key in keys)


class _Calibration:
    """One calibration on its way."""

    def __init__(
        self,
        data: SensorData,
        family: SensorFamily,
        given: Mapping[str, tuple[float, float]],
        baseline: Baseline | None,
        offsets: bool,
        air: str,
        gap_of: tuple[int, ...] | None,
        like: SensorFit | None,
        model: str,
        field: bool,
        progress: Callable[[str], None],
    ) -> None:
        self.gap_of = gap_of
        self.like = like
        self.field = field
        if field and (gap_of is not None or any(_moves(part.name) for part in family.parts)):
            raise ValueError("--field: with one gap for all taxels, and without the material")
        self.model_name = model
        self.corrections: list[Correction] | None = None
        self.model: SensorModel
        if model == "auto" and data.simulated:
            self.model_name = "shell"
        self.data, self.family, self.progress = data, family, progress
        self.warnings = list(data.warnings)
        self.given = {
            k: Prior(mean, sd, "given with --prior") for k, (mean, sd) in given.items()
        }
        self.inputs = {
            k: jnp.asarray(v, float) for k, v in continuous_inputs(data.spec).items()
        }
        self.offsets = offsets or baseline is not None
        self.air = self._air(air)
        spec = data.spec
        compressible = spec.oil.model == "compressible" or isinstance(self.air, CompressibleOil)
        self.moving = tuple(
            i
            for i, name in enumerate(family.names)
            if name.startswith("material.") or (name == GAP and compressible)
        )
        self._with_baseline(baseline)

    def _air(self, air: str) -> AbstractOil | None:
        known = np.isfinite(self.data.permittivity)
        models: dict[str, AbstractOil | None] = {
            "skin": None,
            "trapped": CompressibleOil(jnp.full(1, ATMOSPHERE)),
            "vented": VentedOil(),
        }
        if air not in models:
            raise ValueError(f"--air {air}: unknown; allowed: {', '.join(models)}")
        if air == "skin" and (known & self.data.loaded).any():
            self.warnings.append(
                "a fluid other than the oil is loaded; it is taken to answer as the skin's "
                f'oil does ("{self.data.spec.oil.model}"): for air give --air trapped or vented'
            )
        return models[air]

    def _with_baseline(self, baseline: Baseline | None) -> None:
        """Readings, their states and starting noise, the baseline as one more frame."""
        data = self.data
        so, state, log, time = data.so, data.state, data.log, data.time
        self.loads, self.permittivity = data.loads, data.permittivity
        sigma = np.stack(
            [self._first_noise(so[:, log == k]) for k in range(len(data.files))], 1
        )
        scale = sigma[:, log]
        if baseline is not None:
            modules, numbers = (np.array(x) for x in taxel_names(data.spec.electrodes))  # type: ignore[arg-type]
            rows = np.unique(modules)
            width = int(numbers.max())
            empty = np.full((len(rows), width), np.nan)
            like = Baseline(rows, empty, empty, 0, {})
            at = np.searchsorted(rows, modules), numbers - 1
            rest = rest_of(baseline, like)[at]
            spread = rest_of(dataclasses.replace(baseline, so=baseline.noise), like)[at]
            if not np.isfinite(rest).any():
                raise ValueError("--baseline: has no taxel in common with the skin")
            spread = np.sqrt(np.nan_to_num(spread, nan=1.0) ** 2 + _ROUNDING**2)
            so = np.concatenate([so, rest[:, None]], 1)
            scale = np.concatenate([scale, (spread / np.sqrt(baseline.frames))[:, None]], 1)
            state = np.concatenate([state, [self.loads.states]])
            log, time = np.concatenate([log, [-1]]), np.concatenate([time, [0.0]])
            self.loads = self.loads.with_rest()
            self.permittivity = np.concatenate([self.permittivity, [np.nan]])
        self.so, self.state, self.log, self.time, self.scale = so, state, log, time, scale

    def _first_noise(self, so: np.ndarray) -> np.ndarray:
        """Noise of every taxel to start from: the skin file's, or what neighbours show."""
        assert self.data.spec.electrodes is not None
        stated = self.data.spec.electrodes.noise
        if stated > 0:
            return np.full(len(so), np.hypot(stated, _ROUNDING))
        second = np.diff(so, 2, axis=1) if so.shape[1] > 2 else np.zeros((len(so), 1))
        second = second[np.isfinite(second)]
        spread = 1.4826 * np.median(np.abs(second)) / np.sqrt(6) if second.size else 0.0
        return np.full(len(so), np.hypot(spread, _ROUNDING))

    # ---- the fit

    def run(self) -> SensorFit:
        """Fit, take out outliers, add the priors that are needed, judge."""
        self.at = np.array([part.size for part in self.family.parts])
        for i, part in enumerate(self.family.parts):
            start = self._stated(part.name)
            self.at[i] = part.size if start is None else float(start)
            if start is None and not part.positive:
                self.at[i] = 0.0
        self.used = np.isfinite(self.so)
        self.drifting = False
        self.priors = dict(self.given)
        self._deform()
        self._mask_contact(0.85)
        constants, minima = self._robust(self.at)
        if self.field:
            self.progress("solving the electrostatic field")
            for _ in range(2):
                self.model = self.model.with_field(jnp.asarray(constants))
                constants, minima = self._robust(constants)
        self._refuse_strangers(constants)
        for _ in range(_ROUNDS):
            # A constant that moved the membrane: the shape again, then the fit.
            moved = self.moving and not np.allclose(
                constants[list(self.moving)], self.at[list(self.moving)], rtol=_SAME
            )
            needed = self._needed(constants)
            if not moved and not needed:
                break
            self.priors |= needed
            if moved:
                self.at = constants
                self._deform()
            constants, minima = self._fit(constants)
        if not self.drifting and self._drifts(constants):
            self.drifting = True
            constants, minima = self._robust(constants)
        constants, minima = self._renoise(constants, minima)
        return self._judged(constants, minima)

    def _fluids(self) -> list[tuple[np.ndarray, AbstractOil | None]]:
        """States that share a model of the fluid's answer."""
        known = np.isfinite(self.permittivity)
        if self.air is None or not known.any():
            return [(np.arange(len(known)), None)]
        groups = [(np.flatnonzero(known), self.air), (np.flatnonzero(~known), None)]
        return [(index, oil) for index, oil in groups if index.size]

    @property
    def _names(self) -> str:
        return ", ".join(file.path for file in self.data.files)

    def _deform(self) -> None:
        """Shapes of all states at the constants `at`."""
        if self._alike():
            return
        self.progress("deforming the membrane")
        values = dict(zip(self.family.names, map(float, self.at), strict=True))
        inputs = self.inputs | {PATHS.get(k, k): jnp.asarray(v) for k, v in values.items()}
        moving = {
            PATHS.get(self.family.names[i], self.family.names[i]): float(self.at[i])
            for i in self.moving
        }
        states = self.loads.states
        parts = []
        for index, oil in self._fluids():
            loads = self.loads.take(index)
            geometry, law, answer, _ = parts_of(self.data.spec, inputs, oil)
            try:
                shape = deform(loads, geometry, law, answer)
                if oil is None and self.model_name != "shell":
                    shape = self._as_solid(shape, loads, geometry, law, answer)
            except NoDeformation as error:
                raise NoCalibration(f"{self._names}: {error}") from None
            slopes = None
            if moving:
                wanted = np.isfinite(loads.displacement)
                slopes = shape_slopes(shape, wanted, self.data.spec, inputs, moving, oil)
            parts.append((index, shape, slopes))
        order = np.argsort(np.concatenate([index for index, _, _ in parts]))

        def joined(pick: Callable[[tuple], Array]) -> Array:
            wide = [jnp.broadcast_to(pick(p), (*pick(p).shape[:-1], len(p[0]))) for p in parts]
            return jnp.concatenate(wide, -1)[..., order]

        face = PolarFace(
            joined(lambda p: p[1].face.edges),
            joined(lambda p: p[1].face.radius),
            joined(lambda p: p[1].face.folded),
        )
        slope = (joined(lambda p: p[2][0]), joined(lambda p: p[2][1])) if moving else None
        self.force = np.asarray(joined(lambda p: jnp.asarray(p[1].force)))
        self.displacement = np.asarray(joined(lambda p: jnp.asarray(p[1].displacement)))
        assert self.force.shape[-1] == states
        self.model = SensorModel(
            self.inputs,
            face,
            slope,
            jnp.asarray(self.at),
            jnp.asarray(self.permittivity),
            None,
            self.data.spec,
            self.family,
            self.moving,
            self.gap_of,
        )

    def _as_solid(
        self,
        shape: Deformed,
        loads: KnownLoads,
        geometry: SkinGeometry,
        law: AbstractLaw,
        oil: AbstractOil,
    ) -> Deformed:
        """Add what the shell leaves out, where the solid tells."""
        if not np.any(np.nan_to_num(shape.force)):
            return shape
        if self.corrections is None:
            self.corrections = corrections(
                self.data.spec, loads, shape, geometry, law, oil, self.progress
            )
        if not self.corrections:
            self.corrections = []
            self.warnings.append(
                "shapes are the shell's, exact to about 2e-3 of a displacement: the solid "
                f"corrects single loads at up to {MOST_PLACES} places"
            )
            return shape
        return corrected(shape, loads, self.corrections, geometry, law, oil)

    def _alike(self) -> bool:
        """Take the shapes of an earlier calibration, if its states were the same."""
        if self.like is None or self.moving:
            return False
        model = self.like.residuals.model
        old, new = self.like.loads, self.loads
        same = model.spec == self.data.spec and not model.moving
        names = ("angle", "turn", "force", "displacement")
        pairs = [(getattr(old, n), getattr(new, n)) for n in names]
        pairs.append((np.asarray(model.permittivity), self.permittivity))
        same &= all(
            a.shape == b.shape and np.allclose(a, b, rtol=1e-12, atol=1e-15, equal_nan=True)
            for a, b in pairs
        )
        if not same:
            raise ValueError(
                "like: a calibration of other states, or one that found the material"
            )
        self.model = dataclasses.replace(
            model,
            at=jnp.asarray(self.at),
            factor=None,
            family=self.family,
            gap_of=self.gap_of,
        )
        self.force = self.like.force
        self.displacement = self.like.displacement
        return True

    def _mask_contact(self, margin: float) -> None:
        """Leave out readings of taxels that the membrane touches, or nearly."""
        constants = self.at.copy()
        model = self.model
        own = [i for i, name in enumerate(self.family.names) if is_gap(name)]
        if own:
            constants[own] *= margin
        else:
            gap = model.inputs[PATHS[GAP]]
            model = dataclasses.replace(model, inputs=model.inputs | {PATHS[GAP]: gap * margin})
        so = np.asarray(model.so(jnp.asarray(constants)))
        self.touching = ~np.isfinite(so)[:, self.state] & self.used
        self.used &= ~self.touching
        if not self.used.any():
            raise NoCalibration(
                "the membrane touches the wall in every frame: check the units of the known "
                "displacements or forces, and the skin's oil gap"
            )

    def _basis(self, scale: np.ndarray) -> np.ndarray:
        """What is taken out of every taxel's readings, orthonormal [taxel, frame, column]."""
        columns = []
        if self.offsets:
            columns.append(np.ones(len(self.time)))
        if self.drifting:
            for k in range(len(self.data.files)):
                columns.append(np.where(self.log == k, self.time, 0.0))
        if not columns:
            return np.zeros((len(scale), len(self.time), 0))
        stack = np.stack(columns, -1)
        size = np.abs(stack).max(0)
        stack = stack / np.where(size > 0, size, 1.0)
        weighed = stack * np.where(self.used, 1 / scale, 0.0)[..., None]
        u, s, _ = np.linalg.svd(weighed, full_matrices=False)
        return np.where((s > 1e-9 * s.max(-1, initial=1e-300, keepdims=True))[:, None], u, 0.0)

    def _residuals(self, weight: np.ndarray | float = 1.0) -> SensorResiduals:
        inverse = np.where(self.used, np.sqrt(weight) / self.scale, 0.0)
        means, sds = np.zeros(self.family.size), np.zeros(self.family.size)
        for name, prior in self.priors.items():
            i = self.family.names.index(name)
            means[i], sds[i] = prior.mean, 1 / prior.sd
        value = np.concatenate([np.nan_to_num(self.so).reshape(-1), means])
        scale = self.scale / np.sqrt(np.where(self.used, weight, 1.0))
        return SensorResiduals(
            model=self.model,
            state=jnp.asarray(self.state),
            value=jnp.asarray(value),
            inverse_scale=jnp.asarray(np.concatenate([inverse.reshape(-1), sds])),
            basis=jnp.asarray(self._basis(scale)),
        )

    def _fit(
        self, start: np.ndarray, weight: np.ndarray | float = 1.0
    ) -> tuple[np.ndarray, Minima]:
        residuals = self._residuals(weight)
        centre = np.asarray(self.family.unconstrained(jnp.asarray(start)))
        random = np.random.default_rng(0)
        spread = 0.05 * random.standard_normal((_LANES, len(centre)))
        spread[0] = 0.0
        minima = minimise(residuals, centre + spread, lanes=_LANES)
        if not np.isfinite(minima.cost[0]):
            raise NoCalibration(
                "no constants give finite counts: check the skin file, the units of the known "
                "inputs, and that the log belongs to this skin"
            )
        found = minima.theta[0]
        if self.moving:
            # The shape is linear in these: not too far at once.
            here = np.asarray(self.family.unconstrained(jnp.asarray(self.at)))
            for i in self.moving:
                found[i] = here[i] + np.clip(found[i] - here[i], -_LARGEST_MOVE, _LARGEST_MOVE)
        return np.asarray(self.family.constants(jnp.asarray(found))), minima

    def _standardised(self, constants: np.ndarray) -> np.ndarray:
        """Residuals in units of the noise, zero where not used [taxel, frame]."""
        r = np.asarray(self._residuals().of_constants(jnp.asarray(constants)))
        return r[: self.so.size].reshape(self.so.shape)

    def _robust(self, start: np.ndarray) -> tuple[np.ndarray, Minima]:
        """Fit with little weight on outliers, then without them."""
        self.progress("fitting")
        weight: np.ndarray | float = 1.0
        constants = start
        for _ in range(_HUBER_ROUNDS):
            constants, _ = self._fit(constants, weight)
            r = self._standardised(constants)
            spread = max(1.4826 * float(np.median(np.abs(r[self.used]))), 1e-3)
            weight = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(r), 1e-12))
        return self._trimmed(constants, weight)

    def _trimmed(
        self, constants: np.ndarray, weight: np.ndarray | float
    ) -> tuple[np.ndarray, Minima]:
        constants, minima = self._fit(constants, weight)
        present = np.isfinite(self.so) & ~self.touching
        for _ in range(_ROUNDS):
            self.used = present
            r = self._standardised(constants)
            spread = max(1.4826 * float(np.median(np.abs(r[present]))), 1e-3)
            outlying = np.abs(r) > _OUTLIER * max(spread, 1.0)
            # A taxel that mostly disagrees while others agree is broken; where most do,
            # it is the model that is wrong, and nothing is left out.
            share = outlying.sum(1) / np.maximum(present.sum(1), 1)
            bad = share > _BAD_TAXEL
            if bad.sum() > 0.3 * np.sum(present.any(1)):
                bad[:] = False
                outlying = np.zeros_like(outlying)
            used = present & ~outlying & ~bad[:, None]
            same = np.array_equal(used, self.used) and not isinstance(weight, np.ndarray)
            self.used, self.bad = used, bad
            if same:
                break
            weight = 1.0
            before = constants
            constants, minima = self._fit(constants)
            if np.allclose(constants, before, rtol=1e-12):
                break
        return constants, minima

    def _refuse_strangers(self, constants: np.ndarray) -> None:
        """Refuse logs that don't follow the skin's model at all."""
        so = np.asarray(self.model.so(jnp.asarray(constants)))[:, self.state]
        if self.offsets:
            return
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(self.used, self.so / so, np.nan)
        found = np.array([np.nanmedian(row) for row in ratio if np.isfinite(row).any()])
        if not found.size:
            return
        off = np.abs(found / np.median(found) - 1)
        if len(found) > 2 and np.median(off) > _ANOTHER_SKIN:
            raise NoCalibration(
                f"{self._names}: the taxels read from {100 * found.min():.0f} to "
                f"{100 * found.max():.0f} % of what this skin's model says: another "
                "skin, another layout, or known inputs in other units"
            )
        i = self.family.names.index(PERMITTIVITY) if PERMITTIVITY in self.family.names else None
        if i is not None and not _PLAUSIBLE[0] < constants[i] < _PLAUSIBLE[1]:
            raise NoCalibration(
                f"{self._names}: the counts ask for a relative permittivity of "
                f"{constants[i]:.3g}, which no oil has: check electrodes.lsb, stray and the "
                "electrodes' diameters in the skin file, the units of the log and of the known "
                "inputs, and that the log belongs to this skin"
            )
        for j, name in enumerate(self.family.names):
            factor = constants[j] / self.family.parts[j].size
            open_ = name in self.priors or self._static()
            if is_gap(name) and not open_ and not 1 / _FACTOR < factor < _FACTOR:
                raise NoCalibration(
                    f"{self._names}: the counts ask for a gap of {1e3 * constants[j]:.3g} mm, "
                    f"{factor:.2g} times the skin file's: check the units of the known "
                    "displacements or forces, and that the log belongs to this skin"
                )
        if i is not None and not 0.5 < constants[i] / self.family.parts[i].size < 2.0:
            times = constants[i] / self.family.parts[i].size
            self.warnings.append(
                f"the permittivity found is {times:.2g} times the skin file's: check "
                "electrodes.lsb and the electrodes' diameters"
            )

    # ---- what the data determine

    def _information(self, constants: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """JᵀJ of the readings alone, in natural sizes [p, p]."""
        _, jacobian = sensitivity(self._residuals(), jnp.asarray(constants))  # type: ignore[arg-type]
        count = self.so.size
        data = np.asarray(jacobian)[:count].reshape(*self.so.shape, -1) * self._sizes(constants)
        if rows is not None:
            data = data[:, rows]
        return np.asarray(np.einsum("tfi,tfj->ij", data, data))

    def _sizes(self, constants: np.ndarray) -> np.ndarray:
        linear = ~np.array([part.positive for part in self.family.parts])
        return np.where(linear, self.family.sizes, np.abs(constants))

    def _order(self) -> list[int]:
        """Constants, the one that gets a prior first leading."""
        names = self.family.names
        material = [n for n in names if n.startswith("material.")][::-1]
        last = [*filter(is_gap, names), PERMITTIVITY]
        return [names.index(n) for n in (*_LEAST_KNOWN, *material, *last) if n in names]

    def _needed(self, constants: np.ndarray) -> dict[str, Prior]:
        """Priors that the data ask for."""
        information = self._information(constants)
        sizes = self._sizes(constants)
        for name, prior in self.priors.items():
            i = self.family.names.index(name)
            information[i, i] += (sizes[i] / prior.sd) ** 2
        needed: dict[str, Prior] = {}
        static = self._static()
        for i in self._order():
            name = self.family.names[i]
            if name in self.priors:
                continue
            # What is as well known as a prior that it leans on needs none of its own.
            set_ = {**self.priors, **needed}
            shares = [p.sd / sizes[self.family.names.index(n)] for n, p in set_.items()]
            limit = max([OPEN, *(2.0 * share for share in shares)])
            reason = ""
            if _standard_errors(information)[i] > limit:
                reason = "the logs leave it open"
            elif is_gap(name) and static and not any(map(is_gap, set_)):
                reason = "one static state in one fluid determines permittivity over gap only"
            if not reason:
                continue
            # Its partner is open, too: what it is needs to be assumed of one of them only.
            needed[name] = self._prior(i, reason)
            information[i, i] += (sizes[i] / needed[name].sd) ** 2
        return needed

    def _stated(self, name: str) -> Array | None:
        """What the skin file says of a constant, SI."""
        own = GAP if is_gap(name) else name
        return self.inputs.get(PATHS.get(own, own))

    def _static(self) -> bool:
        frames = self.used.any(0)
        return len(np.unique(self.state[frames])) == 1

    def _prior(self, i: int, reason: str) -> Prior:
        part = self.family.parts[i]
        start = self._stated(part.name)
        mean = float(start) if start is not None else (part.size if part.positive else 0.0)
        share = TOLERANCE.get(part.name.split(".")[0], _MATERIAL_TOLERANCE)
        return Prior(mean, share * part.size, reason)

    def _drifts(self, constants: np.ndarray) -> bool:
        """Whether taxels' residuals grow with time beyond their noise."""
        r = self._standardised(constants)
        score = []
        for k in range(len(self.data.files)):
            here = self.log == k
            if here.sum() < 20:
                continue
            t = self.time[here] - self.time[here].mean()
            for row, used in zip(r[:, here], self.used[:, here], strict=True):
                if used.sum() >= 20:
                    x = t[used] - t[used].mean()
                    y = row[used] - row[used].mean()
                    spread = np.std(np.diff(y)) / np.sqrt(2)
                    score.append((x @ y) / np.sqrt(max(x @ x, 1e-300)) / max(spread, 1e-6))
        if not score:
            return False
        worst = float(np.max(np.abs(score)))
        if worst > _DRIFTING:
            self.warnings.append(
                f"readings drift with time ({worst:.0f} standard errors in the worst taxel): a "
                "steady drift of every taxel is estimated and taken out"
                + ("" if self.data.loaded.any() else "; or the skin was not at rest")
            )
        return worst > _DRIFTING

    def _renoise(self, constants: np.ndarray, minima: Minima) -> tuple[np.ndarray, Minima]:
        """Measure the noise in the residuals, log by log, and fit with it."""
        columns = int(self.offsets) + int(self.drifting) * len(self.data.files)
        r = self._standardised(constants) * self.scale
        self.noise = np.full((len(r), len(self.data.files)), np.nan)
        scale = self.scale.copy()
        for k in range(len(self.data.files)):
            here = self.log == k
            used = self.used[:, here]
            free = used.sum() - self.family.size - columns * np.sum(used.any(1))
            if free < 10:
                self.noise[:, k] = self.scale[:, here][:, 0]
                continue
            together = np.sqrt(np.sum(np.where(used, r[:, here], 0.0) ** 2) / free)
            for i, mine in enumerate(used):
                count = mine.sum() - columns
                own = together
                if count >= 50:
                    own = np.sqrt(np.sum(r[i, here][mine] ** 2) / count)
                # Taxels have the noise of all unless theirs is clearly another.
                if not 0.67 < own / together < 1.5:
                    self.noise[i, k] = own
                else:
                    self.noise[i, k] = together
            self.noise[:, k] = np.maximum(self.noise[:, k], self._smallest())
            scale[:, here] = self.noise[:, k][:, None]
        self.scale = scale
        return self._fit(constants)

    def _smallest(self) -> float:
        """Noise that whole counts have at least."""
        whole = np.all(self.so[self.used] == np.rint(self.so[self.used]))
        return float(_ROUNDING) if whole else 1e-4 * float(np.median(self.so[self.used]))

    def _judged(self, constants: np.ndarray, minima: Minima) -> SensorFit:
        residuals = self._residuals()
        r = self._standardised(constants)
        paths = []
        for k in range(len(self.data.files)):
            here = self.log == k
            paths += [
                row[used] for row, used in zip(r[:, here], self.used[:, here], strict=True)
            ]
        typical = float(np.sqrt(np.mean((self.so / self.scale)[self.used] ** 2)))
        judged_misfit = misfit(
            [p for p in paths if len(p)],
            self.family.size,
            known_noise=False,
            exact=1e-4 * typical,
        )
        judged = uncertainty(
            residuals,  # type: ignore[arg-type]
            constants,
            known_noise=True,
            inflation=judged_misfit.inflation,
        )
        information = self._information(constants) / judged_misfit.inflation**2
        sizes = self._sizes(constants)
        alone = _standard_errors(information) * sizes
        findings = self._findings(information, alone, sizes)
        if judged_misfit.words:
            self.warnings.append(
                judged_misfit.words.replace(
                    "the law does not follow the data", "the model does not follow the counts"
                ).replace("along the tests", "along the logs")
            )
        scatter = self._scatter(constants)
        if scatter:
            self.warnings.append(scatter)
        masked = [*self.data.masked, *self._masked()]
        outliers = int((np.isfinite(self.so) & ~self.touching & ~self.used).sum())
        offsets, drift = self._nuisances(constants)
        return SensorFit(
            self.data,
            residuals,
            constants,
            minima,
            judged,
            alone,
            self._ratio(constants, judged),
            judged_misfit,
            self.priors,
            self.noise,
            tuple(masked),
            outliers,
            offsets,
            drift,
            self.loads,
            self.force,
            self.displacement,
            tuple(findings),
            tuple(self._tells(constants, sizes, judged_misfit.inflation)),
            tuple(dict.fromkeys(self.warnings)),
        )

    def _ratio(self, constants: np.ndarray, judged: Uncertainty) -> tuple[float, float] | None:
        names = self.family.names
        if PERMITTIVITY not in names or self.gap_of is not None:
            return None
        i = names.index(PERMITTIVITY)
        gradient = np.zeros(len(names))
        gap = float(self.inputs[PATHS[GAP]])
        if GAP in names:
            j = names.index(GAP)
            gap = constants[j]
            gradient[j] = -constants[i] / gap**2
        gradient[i] = 1 / gap
        error = float(np.sqrt(gradient @ judged.covariance @ gradient))
        return float(constants[i] / gap), error

    def _findings(
        self, information: np.ndarray, alone: np.ndarray, sizes: np.ndarray
    ) -> list[str]:
        """What the data don't determine, in words."""
        names = self.family.names
        found = []
        open_ = {
            n
            for n, error, size in zip(names, alone, sizes, strict=True)
            if not error < OPEN * size
        }
        automatic = {n for n, p in self.priors.items() if not p.reason.startswith("given")}
        pair = {name for name in names if name == PERMITTIVITY or is_gap(name)}
        gap_open = any(map(is_gap, open_ | automatic))
        if PERMITTIVITY in pair and gap_open and self._coupled(information, pair):
            extra = sorted((open_ | automatic) - pair)
            why = "one static state in one fluid: " if self._static() else ""
            found.append(
                f"{why}only the ratio {PERMITTIVITY}/{GAP} is determined"
                + (f" (with {', '.join(extra)} as assumed)" if extra else "")
                + "; vary a known displacement or load, or add a log in a fluid of known "
                "permittivity (air), to tell them apart"
            )
            named_ = pair
        else:
            named_ = set()
        others = sorted((open_ | automatic) - named_)
        if others:
            values, vectors = np.linalg.eigh(information)
            for name in others:
                i = names.index(name)
                weak = vectors[
                    :, np.argmax(np.abs(vectors[i]) / np.sqrt(np.abs(values) + 1e-30))
                ]
                partners = [
                    n for n, v in zip(names, weak, strict=True) if n != name and abs(v) > 0.1
                ]
                trade = f"; it trades against {', '.join(partners)}" if partners else ""
                found.append(f"{name} is not determined{trade}")
        return found

    def _coupled(self, information: np.ndarray, pair: set[str]) -> bool:
        """Whether the permittivity is known where gaps are, and open where they are."""
        i = self.family.names.index(PERMITTIVITY)
        held = information.copy()
        for name in pair - {PERMITTIVITY}:
            j = self.family.names.index(name)
            held[j, j] += 1e6**2
        for name, prior in self.priors.items():
            j = self.family.names.index(name)
            if name not in pair:
                held[j, j] += (self.family.parts[j].size / prior.sd) ** 2
        alone = _standard_errors(information)[i]
        return bool((_standard_errors(held)[i] < OPEN and not (alone < OPEN)) or self._static())

    def _tells(self, constants: np.ndarray, sizes: np.ndarray, inflation: float) -> list[dict]:
        """Standard errors that each log and each fluid would give alone, without priors."""
        rows: list[tuple[str, np.ndarray]] = []
        for k, file in enumerate(self.data.files):
            if len(self.data.files) > 1:
                rows.append((file.path, self.log == k))
        known = np.isfinite(self.permittivity)[self.state]
        if known.any() and not known.all():
            rows.append(("oil alone", ~known))
            rows.append(("known fluid alone", known))
        rows.append(("all", np.ones(len(self.state), bool)))
        found = []
        for name, here in rows:
            errors = _standard_errors(self._information(constants, here)) * inflation
            fixed = [
                None if not error < OPEN else float(error * size)
                for error, size in zip(errors, sizes, strict=True)
            ]
            found.append(
                {
                    "logs": name,
                    "frames": int((self.used.any(0) & here).sum()),
                    "states": len(np.unique(self.state[here])),
                    "standard_errors": dict(zip(self.family.names, fixed, strict=True)),
                }
            )
        return found

    def _scatter(self, constants: np.ndarray) -> str:
        """A warning where taxels disagree by more than their noise explains."""
        r = self._standardised(constants)
        means, expected = [], []
        for row, used in zip(r, self.used, strict=True):
            if used.sum() >= 5:
                means.append(float(row[used].mean()))
                expected.append(1 / np.sqrt(used.sum()))
        if len(means) < 2:
            return ""
        z = np.array(means) / np.array(expected)
        if np.sqrt(np.mean(z**2)) < 3:
            return ""
        worst = int(np.argmax(np.abs(z)))
        return (
            "taxels differ from the model by more than their noise (the worst by "
            f"{means[worst] * float(np.nanmedian(self.scale)):.3g} counts in the mean): gaps "
            "or electrodes that differ, a load at rest, or offsets; --baseline or --offsets "
            "takes out what is constant"
        )

    def _masked(self) -> list[Masked]:
        modules, numbers = taxel_names(self.data.spec.electrodes)  # type: ignore[arg-type]
        found = []
        frames = self.so.shape[1]
        present = np.isfinite(self.so) & ~self.touching
        for i, (m, k) in enumerate(zip(modules, numbers, strict=True)):
            touching = int(self.touching[i].sum())
            if touching:
                whole = touching == frames
                found.append(Masked(m, k, "the membrane touches the wall", touching, whole, ""))
            if self.bad[i]:
                count = int(present[i].sum())
                found.append(
                    Masked(m, k, "disagrees with the model and the others", count, True, "")
                )
            else:
                count = int((present[i] & ~self.used[i]).sum())
                if count:
                    found.append(Masked(m, k, "outliers", count, False, ""))
        return found

    def _nuisances(self, constants: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Offsets and drift that were taken out."""
        if not (self.offsets or self.drifting):
            return None, None
        so = np.asarray(self.model.so(jnp.asarray(constants)))[:, self.state]
        files = len(self.data.files)
        offsets = np.full((2, len(so)), np.nan)
        drift = np.full((len(so), files), np.nan)
        for i, used in enumerate(self.used):
            if not used.any():
                continue
            columns = [np.ones(used.sum())] if self.offsets else []
            if self.drifting:
                columns += [
                    np.where(self.log[used] == k, self.time[used], 0.0) for k in range(files)
                ]
            weight = 1 / self.scale[i, used]
            a = np.stack(columns, -1) * weight[:, None]
            y = (self.so[i, used] - so[i, used]) * weight
            solved = np.linalg.lstsq(a, y, rcond=None)[0]
            errors = np.sqrt(np.diag(np.linalg.pinv(a.T @ a)))
            if self.offsets:
                offsets[:, i] = solved[0], errors[0]
            if self.drifting:
                drift[i] = solved[-files:]
        return offsets if self.offsets else None, drift if self.drifting else None


def _standard_errors(information: np.ndarray) -> np.ndarray:
    """Square roots of the diagonal of the inverse; infinite along null directions."""
    values, vectors = np.linalg.eigh(information)
    largest = max(float(values[-1]), 1e-300)
    null = values < 1e-14 * largest
    safe = np.where(null, 1.0, np.maximum(values, 1e-300))
    variance = (vectors**2) @ np.where(null, 0.0, 1 / safe)
    reached = (vectors**2) @ null.astype(float)
    return np.where(reached > 1e-10, np.inf, np.sqrt(variance))
