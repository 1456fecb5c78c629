"""The model of a calibration's counts: shapes of the membrane in all known states."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.sensor.logs.data import NoCalibration, SensorData
from fitting.sensor.logs.known_loads import WHERE, KnownLoads
from fitting.sensor.model.constants import (
    FILL,
    FORCE_ZERO,
    GAP,
    PATHS,
    PRESS_ERRORS,
    PUSH,
    TOUCH,
    SensorFamily,
    is_gap,
    moves_membrane,
    with_constants,
)
from fitting.sensor.model.counts import SensorModel, counts_at, parts_of
from fitting.sensor.shapes.deformations import Deformed, NoDeformation, deform
from fitting.sensor.shapes.scene_states import SceneStates, Solved
from fitting.sensor.shapes.solid_correction import (
    MOST_PLACES,
    SolidCorrection,
    corrected,
    corrections,
)
from fitting.sensor.shapes.state_programs import shape_slopes
from suas_jax.config import UncertainQuantity, continuous_inputs
from suas_jax.config.inputs import given_inputs
from suas_jax.config.tolerance import deviation_of
from suas_jax.constitutive import AbstractLaw
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.oils.compressible import CompressibleOil
from suas_jax.skin.oils.vented import VentedOil

ATMOSPHERE = 101325.0  # bulk modulus of trapped air, isothermal [Pa]
MODELS = ("auto", "shell", "solid")


@dataclasses.dataclass(frozen=True)
class Shapes:
    """The model with the membrane's shapes at some constants."""

    model: SensorModel  # counts as a function of the constants
    force: np.ndarray  # on each load, given or found [load, state, N]
    displacement: np.ndarray  # of each load [load, state, m]

    def slopes_by(self, other: "Shapes", step: np.ndarray) -> np.ndarray:
        """Counts by an input that is a step further in other shapes [taxel, state].

        The step is zero where the input is exact [state].
        """
        counts = [
            np.asarray(COMPILED.run(counts_at, x.model, self.model.at, once=True))
            for x in (self, other)
        ]
        return np.where(step != 0, counts[1] - counts[0], 0) / np.where(step != 0, step, 1)


class ShapeSolver:
    """Solves the known states for constants at hand."""

    def __init__(
        self,
        data: SensorData,
        loads: KnownLoads,  # the known states, the baseline's included
        permittivity: np.ndarray,  # of the fluid [state]
        family: SensorFamily,
        gap_of: tuple[int, ...] | None,  # see `SensorModel`
        *,
        air: str,  # how air answers
        model: str,  # of the shapes
        progress: Callable[[str], None],
        pressed: Sequence[int] = (),
        whole_slopes: bool = True,
    ) -> None:
        """Prepare.

        `pressed` are the states whose only load has errors of its own, which are constants.
        `whole_slopes` is whether what the shell leaves out counts in derivatives.
        Raises ValueError: `air` or `model` is unknown.
        """
        if model not in MODELS:
            raise ValueError(f"--model {model}: unknown; allowed: {', '.join(MODELS)}")
        # SI values by TOML path as the skin file has them
        self.inputs = {
            k: jnp.asarray(v, float) for k, v in continuous_inputs(data.spec).items()
        }
        self.warnings: list[str] = []  # what a person should know of the shapes
        self._data, self._loads, self._permittivity = data, loads, permittivity
        self._beyond: Array | None = None
        self._family, self._gap_of, self._progress = family, gap_of, progress
        self._shell = model == "shell" or (model == "auto" and data.simulated)
        self._air = self._answer_of(air)
        self._corrections: list[SolidCorrection] | None = None
        alone = data.spec.geometry.dimension == 3 or loads.bodies
        self._states = (
            SceneStates(data.spec, loads, progress, whole_slopes=whole_slopes)
            if alone
            else None
        )
        by_gap = FILL in family.names or self._volume_goes_with_gap()
        # positions of the constants that move the membrane
        self.moving = tuple(
            i
            for i, name in enumerate(family.names)
            if moves_membrane(name)
            or (by_gap and (name == GAP or name.startswith(f"{PATHS[GAP]}.")))
        )
        self._latent = {
            kind: tuple(
                family.names.index(f"{kind}.{pressed.index(s)}") if s in pressed else -1
                for s in range(loads.states)
            )
            for kind in PRESS_ERRORS
            if f"{kind}.0" in family.names
        }

    def _volume_goes_with_gap(self) -> bool:
        """Whether the oil yields, or takes a share more or less than the film's volume."""
        oil = parts_of(self._data.spec, self.inputs)[2]
        fluids = [oil] if self._air is None else [oil, self._air]
        excess = oil.expansion(jnp.zeros(1), jnp.ones(1))
        return any(x.yields for x in fluids) or bool(jnp.any(excess != 0))

    def stated(self, name: str) -> float | None:
        """What the skin file says of a constant, SI; None where it says nothing.

        An `UncertainQuantity` where the file states its standard deviation.
        """
        own = GAP if is_gap(name) else name
        path = PATHS.get(own, own)
        value = self.inputs.get(path)
        if value is None:
            return None
        deviation = deviation_of(given_inputs(self._data.spec).get(path))
        return float(value) if deviation is None else UncertainQuantity(value, deviation)

    def at(
        self, constants: np.ndarray, loads: KnownLoads | None = None, *, slopes: bool = True
    ) -> Shapes:
        """Shapes at some constants, under the known loads or others like them.

        `slopes` is whether derivatives by the constants that move the membrane are wanted.
        Raises NoCalibration: a known state has no equilibrium.
        """
        self._progress("deforming the membrane")
        names = self._family.names
        values = [float(x) for x in constants]
        moving = {names[i]: values[i] for i in self.moving}
        kept = {name: jnp.asarray(x) for name, x in zip(names, values, strict=True)}
        kept = {name: x for name, x in kept.items() if name not in moving}
        held = with_constants(self._data.spec, self.inputs, kept, kept.values())
        loads = self._loads if loads is None else loads
        for kind, row in self._latent.items():
            off = np.where(np.array(row) >= 0, constants[np.array(row)], 0.0)
            loads = loads.shifted(
                PRESS_ERRORS[kind], off * loads.force[0] if kind == PUSH else off
            )
        loads = loads.less(loads.zeros(moving.get(TOUCH, 0.0), moving.get(FORCE_ZERO, 0.0)))
        parts = [
            self._part(*group, loads, held, moving, slopes=slopes) for group in self._fluids()
        ]
        order = np.argsort(np.concatenate([part.index for part in parts]))
        counts = [len(part.index) for part in parts]

        def joined(pick: Callable[["_Part"], Array | np.ndarray]) -> Array:
            return _in_order([pick(part) for part in parts], counts, order)

        # All parts have faces of one kind.
        face: AbstractFace = jax.tree.map(
            lambda *x: _in_order(x, counts, order), *(part.shape.face for part in parts)
        )
        own = [part.slope for part in parts]
        slope = jax.tree.map(lambda *x: _in_order(x, counts, order), *own)
        model = SensorModel(
            self.inputs,
            face,
            slope,
            jnp.asarray(constants),
            jnp.asarray(self._permittivity),
            None,
            self._data.spec,
            self._family,
            self.moving if slopes else (),
            self._gap_of,
            tuple(self._latent.values()) if slopes else (),
            self._beyond,
        )
        return Shapes(
            model,
            np.asarray(joined(lambda p: p.shape.force)),
            np.asarray(joined(lambda p: p.shape.displacement)),
        )

    def by_inputs(self, shapes: Shapes) -> np.ndarray:
        """Counts by what is told of each load, SI [column, taxel, state]; zero at rest.

        By its force, displacement or depth, whichever is known; line loads then by places,
        load after load, and by directions.
        """
        at, loads = np.asarray(shapes.model.at), range(len(self._loads.angle))
        steps = [self._loads.stepped(load) for load in loads]
        found = [shapes.slopes_by(self.at(at, *x, slopes=False), s) for *x, s in steps]
        if self._states is None:
            # The solid corrects told places alone.
            shell, self._shell = self._shell, True
            first = shapes if shell else self.at(at, slopes=False)
            steps = [self._loads.turned(load, name) for name in WHERE for load in loads]
            found += [first.slopes_by(self.at(at, *x, slopes=False), s) for *x, s in steps]
            self._shell = shell
        return np.array(found)

    def moved(
        self, constants: np.ndarray, loads: KnownLoads, error: np.ndarray
    ) -> tuple[Shapes, np.ndarray]:
        """Shapes under other loads, from now on, and counts by these [column, taxel, state].

        What was told of their amounts is more by an error [load, state]: the model's counts are
        those under the told ones, to first order.
        """
        self._loads, self._beyond = loads, None
        shapes = self.at(constants)
        slopes = self.by_inputs(shapes)
        self._beyond = jnp.asarray(np.einsum("kts,ks->ts", slopes[: len(error)], error))
        model = dataclasses.replace(shapes.model, beyond=self._beyond)
        return dataclasses.replace(shapes, model=model), slopes

    def less(self, constants: np.ndarray, error: np.ndarray) -> Shapes:
        """Shapes if the loads were less by an error of what was told [load, state]."""
        return self.at(constants, self._loads.less(error))

    def again(self, shapes: Shapes, loads: KnownLoads, constants: np.ndarray) -> Shapes:
        """Shapes of an earlier calibration of the same states.

        Raises ValueError: its states are others, or it moved the membrane.
        """
        model, index = shapes.model, self.alike(loads, np.asarray(shapes.model.permittivity))
        if model.spec != self._data.spec or model.moving or self.moving:
            raise ValueError("like: a calibration of another skin, or one that moved it")
        own = dataclasses.replace(
            model,
            face=jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., index]), model.face),
            beyond=None if model.beyond is None else model.beyond[:, index],
            permittivity=jnp.asarray(self._permittivity),
            at=jnp.asarray(constants),
            factor=None,
            family=self._family,
            gap_of=self._gap_of,
        )
        return Shapes(own, shapes.force[:, index], shapes.displacement[:, index])

    def alike(self, loads: KnownLoads, permittivity: np.ndarray) -> np.ndarray:
        """Which of other states, with their fluids, the solver's own are like [state].

        Raises ValueError: one is like none of them.
        """
        names = [x.name for x in dataclasses.fields(KnownLoads) if x.name != "inner"]

        def keys(loads: KnownLoads, fluid: np.ndarray) -> list[str]:
            rows = np.concatenate([*(getattr(loads, n) for n in names), [fluid]]).T + 0.0
            return [" ".join(f"{x:.10g}" for x in row) for row in rows]

        known = {key: i for i, key in enumerate(keys(loads, permittivity))}
        found = [known.get(key, -1) for key in keys(self._loads, self._permittivity)]
        if -1 in found:
            raise ValueError("like: a calibration of other states")
        return np.array(found)

    def _answer_of(self, air: str) -> AbstractOil | None:
        known = np.isfinite(self._data.permittivity)
        models: dict[str, AbstractOil | None] = {
            "skin": None,
            "trapped": CompressibleOil(jnp.full(1, ATMOSPHERE)),
            "vented": VentedOil(),
        }
        if air not in models:
            raise ValueError(f"--air {air}: unknown; allowed: {', '.join(models)}")
        if air == "skin" and (known & self._data.loaded).any():
            self.warnings.append(
                "a fluid other than the oil is loaded; it is taken to answer as the skin's "
                f'oil does ("{self._data.spec.oil.model}"): for air give --air trapped or '
                "vented"
            )
        return models[air]

    def _fluids(self) -> list[tuple[np.ndarray, AbstractOil | None]]:
        """States that share a model of the fluid's answer."""
        known = np.isfinite(self._permittivity)
        if self._air is None or not known.any():
            return [(np.arange(len(known)), None)]
        groups = [(np.flatnonzero(known), self._air), (np.flatnonzero(~known), None)]
        return [(index, oil) for index, oil in groups if index.size]

    def _part(
        self,
        index: np.ndarray,
        oil: AbstractOil | None,
        loads: KnownLoads,
        held: Mapping[str, Array],
        moving: Mapping[str, float],
        *,
        slopes: bool,
    ) -> "_Part":
        spec, loads = self._data.spec, loads.take(index)
        if loads.bodies and self._latent:
            raise NoCalibration(
                f"{self._data.paths}: a unit as it was built is found from presses of "
                "known force, not from a body's travel"
            )
        try:
            if self._states is not None:
                kinds = tuple(self._latent)
                own = self._states.solve(index, loads, held, moving, kinds, oil, slopes=slopes)
                return _Part(index, own, own.slope)
            inputs = with_constants(spec, held, moving, map(jnp.asarray, moving.values()))
            geometry, law, answer, _ = parts_of(spec, inputs, oil)
            shape = deform(loads, geometry, law, answer)
            if oil is None and not self._shell:
                shape = self._as_solid(shape, loads, geometry, law, answer)
        except NoDeformation as error:
            raise NoCalibration(f"{self._data.paths}: {error}") from None
        moving = {**moving, **dict.fromkeys(self._latent, 0.0)} if slopes else {}
        slope = shape_slopes(shape, loads, spec, held, moving, oil) if moving else None
        return _Part(index, shape, slope)

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
        if self._corrections is None:
            found = corrections(
                self._data.spec, loads, shape, geometry, law, oil, self._progress
            )
            self._corrections = found or []
            if not found:
                self.warnings.append(
                    "shapes are the shell's, exact to about 3e-4 of a displacement: the solid "
                    f"corrects single loads at up to {MOST_PLACES} places"
                )
        if not self._corrections:
            return shape
        return corrected(shape, loads, self._corrections, geometry, law, oil)


def _in_order(
    parts: Sequence[Array | np.ndarray], counts: Sequence[int], order: np.ndarray
) -> Array:
    """Arrays of some states side by side, each as wide as its part has states."""
    arrays = zip(map(np.asarray, parts), counts, strict=True)
    wide = [np.broadcast_to(x, (*x.shape[:-1], n)) for x, n in arrays]
    return jnp.asarray(np.concatenate(wide, -1)[..., order])


@dataclasses.dataclass(frozen=True)
class _Part:
    """States that share a fluid's answer."""

    index: np.ndarray
    shape: Deformed | Solved
    slope: AbstractFace | None
