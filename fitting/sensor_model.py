"""From electrical and material constants to counts, state by state, and their misfit.

The membrane's shape under known loads does not depend on the electrodes: it is computed
once, and the counts follow from it in microseconds. Constants that do move the membrane
(its material, or the gap where the oil is compressible) enter through the exact derivative
of the shape; the shape is computed again where a fit has moved them.

What drifts or is offset taxel by taxel is linear: its best value is subtracted from
residuals and derivatives alike (a projection), so it costs no unknowns.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.deformations import Deformed
from fitting.press import Press
from fitting.residuals import AbstractResiduals
from suas_jax.compiled import COMPILED
from suas_jax.config import SkinSpec, structure
from suas_jax.constitutive import AbstractLaw
from suas_jax.electrostatics import field_capacitance_under
from suas_jax.equilibrium import State, equilibrium
from suas_jax.gap import PolarFace, polar_face
from suas_jax.geometry import SkinGeometry
from suas_jax.oil import AbstractOil
from suas_jax.problem import geometry_of, law_of, oil_of
from suas_jax.sensing import Electrodes, electrodes_of

PERMITTIVITY, GAP, SCALE = "relative_permittivity", "oil_gap", "lsb"
STRAY, LAYERS = "stray", "layers"
PATHS = {
    PERMITTIVITY: "oil.relative_permittivity",
    GAP: "geometry.oil_gap",
    SCALE: "electrodes.lsb",
    STRAY: "electrodes.stray",
}
"""TOML paths of the electrical constants. Layers are a sum over several keys."""


@dataclasses.dataclass(frozen=True)
class Constant:
    """One constant to be calibrated.

    Attributes:
        name: key of the skin file; of a material constant with its table.
        unit: SI unit, "1" for a number.
        size: natural size, SI.
        positive: whether it is an exponential of its parameter; else it is linear.
    """

    name: str
    unit: str
    size: float
    positive: bool = True


@dataclasses.dataclass(frozen=True)
class SensorFamily:
    """The constants of a calibration and the bijection to dimensionless parameters.

    c = s exp(theta) for constants that are positive, c = s theta for the others, with the
    natural size s.
    """

    parts: tuple[Constant, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constants."""
        return tuple(part.name for part in self.parts)

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units."""
        return tuple(part.unit for part in self.parts)

    @property
    def size(self) -> int:
        """How many they are."""
        return len(self.parts)

    @property
    def sizes(self) -> np.ndarray:
        """Natural sizes, SI [p]."""
        return np.array([part.size for part in self.parts])

    def constants(self, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Constants in SI units."""
        positive = np.array([part.positive for part in self.parts])
        return jnp.asarray(self.sizes) * jnp.where(positive, jnp.exp(theta), theta)

    def unconstrained(self, constants: Float[Array, " p"]) -> Float[Array, " p"]:
        """Parameters from constants."""
        positive = np.array([part.positive for part in self.parts])
        x = constants / self.sizes
        return jnp.where(positive, jnp.log(jnp.where(positive, x, 1.0)), x)


def parts_of(
    spec: SkinSpec, inputs: Mapping[str, Array], oil: AbstractOil | None = None
) -> tuple[SkinGeometry, AbstractLaw, AbstractOil, Electrodes]:
    """Geometry, law, oil and electrodes of a skin for the numbers at hand.

    Args:
        spec: says which law and formula.
        inputs: SI values by TOML path, every continuous input; `layers` in metres.
        oil: how the fluid answers, if not as the skin file says.
    """
    numbers = {**dict(structure(spec)), **inputs}
    geometry = geometry_of(numbers)
    electrodes = electrodes_of(spec, numbers, geometry)
    assert electrodes is not None
    if LAYERS in inputs:
        layers = jnp.asarray(inputs[LAYERS], float)[..., None]
        electrodes = eqx.tree_at(lambda e: e.layers, electrodes, layers)
    return geometry, law_of(spec, numbers), oil or oil_of(spec, numbers), electrodes


class SensorModel(eqx.Module):
    """Counts of every taxel in every state as a function of the constants.

    Attributes:
        inputs: SI values by TOML path of all that is not calibrated.
        face: inner faces at the constants `at` [..., state].
        slope: derivatives of edges and radii of the faces by the constants, along a leading
            axis; its length is zero where no constant moves the membrane.
        at: constants where the faces were computed [p].
        moving: positions of the constants that the derivatives belong to.
        permittivity: of the fluid; NaN where it is the oil [state].
        spec: the skin.
        family: the constants.
        factor: capacitances of the field over the formula's [taxel, state]; None for the
            formula alone.
        gap_of: position of each taxel's own gap among the constants; None where all share
            one.
    """

    inputs: dict[str, Array]
    face: PolarFace
    slope: tuple[Array, Array] | None
    at: Float[Array, " p"]
    permittivity: Float[Array, " state"]
    factor: Float[Array, "taxel state"] | None
    spec: SkinSpec = eqx.field(static=True)
    family: SensorFamily = eqx.field(static=True)
    moving: tuple[int, ...] = eqx.field(static=True, default=())
    gap_of: tuple[int, ...] | None = eqx.field(static=True, default=None)

    def so(self, constants: Float[Array, " p"]) -> Float[Array, "taxel state"]:
        """Continuous counts, without offsets and drift; NaN where the wall is touched."""
        *_, electrodes = parts_of(self.spec, self.numbers(constants))
        if self.gap_of is not None:
            single = electrodes.geometry.oil_gap - constants[jnp.array(self.gap_of)][:, None]
            electrodes = eqx.tree_at(
                lambda e: e.height, electrodes, single, is_leaf=lambda x: x is None
            )
        oil = jnp.isnan(self.permittivity)
        known = jnp.where(oil, 1.0, self.permittivity)
        fluid = jnp.where(oil, electrodes.permittivity, known)
        electrodes = eqx.tree_at(lambda e: e.permittivity, electrodes, fluid)
        readings = electrodes.read_face(self._face(constants))
        if self.factor is None:
            return readings.so
        own = readings.capacitance - electrodes.stray
        return (electrodes.stray + self.factor * own) / electrodes.lsb

    def with_field(self, constants: Float[Array, " p"]) -> "SensorModel":
        """The same with the electrostatic field's capacitances at some constants.

        The formula stays, times the ratio of field to formula, which depends on constants
        so little that a second round at the constants found is enough.
        """
        *_, electrodes = parts_of(self.spec, self.numbers(constants))
        electrodes = eqx.tree_at(
            lambda e: (e.permittivity, e.stray), electrodes, (jnp.ones(1), jnp.zeros(1))
        )
        face = self._face(constants)
        chunks = np.array_split(
            np.arange(len(self.permittivity)), -(-len(self.permittivity) // 32)
        )
        rows = []
        for index in chunks:
            part = jax.tree.map(lambda x: x[..., index], face)  # noqa: B023
            field = _field(electrodes, part)
            rows.append(field / electrodes.read_face(part).capacitance)
        return dataclasses.replace(self, factor=jnp.concatenate(rows, -1))

    def numbers(self, constants: Float[Array, " p"]) -> dict[str, Array]:
        """SI values by TOML path with the calibrated ones in their places."""
        return self.inputs | {
            PATHS.get(name, name): constants[i]
            for i, name in enumerate(self.family.names)
            if not name.startswith(f"{GAP}.")
        }

    def _face(self, constants: Array) -> PolarFace:
        if self.slope is None:
            return self.face
        change = (constants - self.at)[jnp.array(self.moving)]
        edges, radius = (jnp.tensordot(change, slope, 1) for slope in self.slope)
        return PolarFace(self.face.edges + edges, self.face.radius + radius, self.face.folded)


@eqx.filter_jit
def _field(electrodes: Electrodes, face: PolarFace) -> Array:
    return field_capacitance_under(electrodes, face)


@eqx.filter_jit
def _slopes(
    press: Press,
    force: Array,
    start: State,
    wanted: Array,
    inputs: dict[str, Array],
    moving: dict[str, Array],
    spec: SkinSpec,
    oil: AbstractOil | None,
) -> tuple[Array, Array]:
    """Derivatives of edges and radii by each moving constant, what is known kept."""

    def shape(moving: dict[str, Array], force: Array) -> tuple[Array, Array, Array]:
        geometry, law, answer, _ = parts_of(spec, inputs | moving, oil)
        problem = press.problem(geometry, law, answer, force)
        found = equilibrium(problem, start)
        face = polar_face(problem.mechanics, found.state.q, geometry.inner_radius)
        moved = press.displacements(problem.mechanics, found.state.q)
        return moved, face.edges, face.radius

    _, push = jax.linearize(shape, moving, force)
    still = jax.tree.map(jnp.zeros_like, moving)
    loads = force.shape[0]
    unit = jnp.broadcast_to(jnp.eye(loads)[:, :, None], (loads, *force.shape))
    by_force = jax.vmap(lambda f: push(still, f))(unit)
    count = len(moving)
    tangents = {k: jnp.eye(count)[i] for i, k in enumerate(moving)}
    by_constant = jax.vmap(lambda t: push(t, jnp.zeros_like(force)))(tangents)
    # Displacements that are known stay: the forces on them follow.
    compliance = jnp.moveaxis(by_force[0], -1, 0).swapaxes(1, 2)  # [state, of, by]
    both = wanted.T[:, :, None] * wanted.T[:, None, :]
    matrix = compliance * both + jnp.eye(loads) * (1 - wanted.T)[:, :, None]
    change = jnp.moveaxis(by_constant[0], -1, 0) * wanted.T[:, None, :]  # [state, const, of]
    follow = -jnp.linalg.solve(matrix, change.swapaxes(1, 2))  # [state, by, const]
    edges = by_constant[1] + jnp.einsum("sfc,fks->cks", follow, by_force[1])
    radius = by_constant[2] + jnp.einsum("sfc,fpes->cpes", follow, by_force[2])
    return edges, radius


def shape_slopes(
    shape: Deformed,
    wanted: np.ndarray,
    spec: SkinSpec,
    inputs: Mapping[str, Array],
    moving: Mapping[str, float],
    oil: AbstractOil | None,
) -> tuple[Array, Array]:
    """How the faces of solved states change with constants that move the membrane.

    Args:
        shape: the solved states.
        wanted: one where a displacement is known, zero where a force is [load, state].
        spec: the skin.
        inputs: SI values by TOML path.
        moving: the constants, by TOML path.
        oil: how the fluid answers, if not as the skin file says.

    Returns:
        Derivatives of the edges [constant, station, state] and of the radii [constant,
        power, element, state].
    """
    values = {k: jnp.asarray(v, float) for k, v in moving.items()}
    slopes: tuple[Array, Array] = COMPILED.run(
        _slopes,
        shape.press,
        jnp.asarray(shape.force),
        shape.state,
        jnp.asarray(wanted, float),
        dict(inputs),
        values,
        spec,
        oil,
        once=True,
    )
    return slopes


class SensorResiduals(AbstractResiduals):
    """Misfit of the model to the counts of all logs, priors included.

    Attributes:
        model: the counts.
        state: which state a frame is in [frame].
        value: readings, taxel after taxel, then the means of the priors [n].
        inverse_scale: 1 / standard deviation [n]; zero for what is not used.
        basis: orthonormal columns, in units of the noise, of what is taken out of every
            taxel's readings [taxel, frame, column].
        family: the constants.
    """

    model: SensorModel
    state: Int[Array, " frame"]
    value: Float[Array, " n"]
    inverse_scale: Float[Array, " n"]
    basis: Float[Array, "taxel frame column"]

    @property
    def family(self) -> SensorFamily:
        """The constants."""
        return self.model.family

    def predict(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Readings for constants in SI units, and the constants themselves."""
        so = self.model.so(constants)[:, self.state]
        return jnp.concatenate([so.reshape(-1), constants])

    def of_constants(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for constants in SI units."""
        used = self.inverse_scale > 0.0
        misfit = jnp.where(used, self.predict(constants) - self.value, 0.0)
        r = misfit * self.inverse_scale
        if self.basis.shape[-1] == 0:
            return r
        taxels, frames, _ = self.basis.shape
        data = r[: taxels * frames].reshape(taxels, frames)
        along = jnp.einsum("tfk,tf->tk", self.basis, data)
        data = data - jnp.einsum("tfk,tk->tf", self.basis, along)
        return jnp.concatenate([data.reshape(-1), r[taxels * frames :]])

    def __call__(self, theta: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for dimensionless parameters."""
        return self.of_constants(self.family.constants(theta))
