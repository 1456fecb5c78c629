"""Counts of a skin from its electrical and material constants, state by state.

The membrane's shape under known loads does not depend on the electrodes: it is computed
once, and the counts follow from it in microseconds. Constants that do move the membrane
(its material, or the gap where the oil is compressible) enter through the exact derivative
of the shape; the shape is computed again where a fit has moved them.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fitting.sensor.model.as_built import is_gain
from fitting.sensor.model.constants import LAYERS, SensorFamily, with_constants
from suas_jax.config import SkinSpec
from suas_jax.constitutive import AbstractLaw
from suas_jax.mechanics.section import NormalFace
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.scene.parts import skin_parts
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.field import field_capacitance_under
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil

_RAYS = 181  # from clamp to clamp, along which contact with the wall is looked for


def parts_of(
    spec: SkinSpec, inputs: Mapping[str, Array], oil: AbstractOil | None = None
) -> tuple[SkinGeometry, AbstractLaw, AbstractOil, Electrodes]:
    """Geometry, law, oil and electrodes of a skin for the numbers at hand.

    `spec` says which law and formula. Inputs are SI values by TOML path, every continuous
    input, with `layers` in metres. `oil` is how the fluid answers, if not as the skin file
    says.
    """
    parts = skin_parts(spec, inputs)
    electrodes = parts.sensing()
    if LAYERS in inputs:
        layers = jnp.asarray(inputs[LAYERS], float)[..., None]
        electrodes = eqx.tree_at(lambda e: e.layers, electrodes, layers)
    return parts.geometry, parts.law, oil or parts.oil, electrodes


class SensorModel(eqx.Module):
    """Counts of every taxel in every state as a function of the constants."""

    inputs: dict[str, Array]  # SI values by TOML path of all that is not calibrated
    face: AbstractFace  # inner faces at the constants `at` [..., state]
    # derivatives of the faces' arrays by the constants, along a leading axis; None where no
    # constant moves the membrane
    slope: AbstractFace | None
    at: Float[Array, " p"]  # constants where the faces were computed [p]
    permittivity: Float[Array, " state"]  # of the fluid; NaN where it is the oil [state]
    # capacitances of the field over the formula's [taxel, state]; None for the formula alone
    factor: Float[Array, "taxel state"] | None
    spec: SkinSpec = eqx.field(static=True)
    family: SensorFamily = eqx.field(static=True)  # the constants
    # positions of the constants that the derivatives belong to
    moving: tuple[int, ...] = eqx.field(static=True, default=())
    # position of each taxel's own gap among the constants; None where all share one
    gap_of: tuple[int, ...] | None = eqx.field(static=True, default=None)
    # positions among the constants of the errors of each state's place, -1 where there is none
    # [kind, state]; their derivatives follow those of `moving`
    latent: tuple[tuple[int, ...], ...] = eqx.field(static=True, default=())
    # Counts that are further by so much, to first order, as what was told of the loads is not
    # what the faces were computed for [taxel, state]; None where it is
    beyond: Float[Array, "taxel state"] | None = None

    @property
    def shaping(self) -> list[int]:
        """Positions of all constants that the shapes are linear in."""
        return [*self.moving, *(i for row in self.latent for i in row if i >= 0)]

    @property
    def _gains(self) -> list[int]:
        """Positions of the gains, taxel after taxel, where every taxel has one."""
        gains = [i for i, name in enumerate(self.family.names) if is_gain(name)]
        every = sum(self.spec.sensing.taxels_by_module.values())
        return gains if len(gains) == every else []

    def so_with_slopes(
        self, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, "taxel state"], Float[Array, "p taxel state"]]:
        """Counts and their derivatives by all constants.

        A gain changes the readings of its own taxel alone, and an error of a press those of
        its own state: constants that change no reading in common share one tangent.
        """
        so, push = jax.linearize(self.so, constants)
        tangent = np.arange(self.family.size)  # by which each constant's derivatives are found
        where = np.ones((self.family.size, *so.shape), bool)
        for row in (self._gains, *self.latent):
            own = [i for i in row if i >= 0]
            if own:
                tangent[own], where[own] = own[0], False
        where[self._gains, np.arange(len(self._gains))] = True
        for row in self.latent:
            for state, i in enumerate(row):
                where[i, :, state] |= i >= 0
        kept, tangent = np.unique(tangent, return_inverse=True)
        seeds = np.eye(len(kept))[tangent].T
        slopes = jax.vmap(push)(jnp.asarray(seeds))
        return so, jnp.where(where, slopes[tangent], 0.0)

    def so(self, constants: Float[Array, " p"]) -> Float[Array, "taxel state"]:
        """Continuous counts, without offsets and drift; NaN where the wall is touched."""
        numbers, names = self.numbers(constants), self.family.names
        gains = self._gains
        # Hundreds of gains are one array, not as many inputs.
        numbers |= dict.fromkeys((names[i] for i in gains), jnp.ones(()))
        *_, electrodes = parts_of(self.spec, numbers)
        if gains:
            whole = constants[jnp.array(gains)][:, None]
            electrodes = eqx.tree_at(lambda e: e.lsb, electrodes, electrodes.lsb / whole)
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
        beyond = 0.0 if self.beyond is None else self.beyond
        if self.factor is None:
            return readings.so + beyond
        own = readings.capacitance - electrodes.stray
        return (electrodes.stray + self.factor * own) / electrodes.lsb + beyond

    def through_the_wall(self, constants: Float[Array, " p"]) -> Bool[Array, " state"]:
        """Whether the membrane passes through the wall, of which its shape knows nothing.

        Told along the taxels' rays and, on sections, along rays between them.
        """
        geometry = parts_of(self.spec, self.numbers(constants))[0]
        face = self._face(constants)
        through = jnp.any(jnp.isnan(self.so(constants)), 0)
        if face.varies_along_axis:
            return through
        angle = geometry.half_angle * jnp.linspace(-1, 1, _RAYS)[:, None]
        (gap,) = face.gaps([(angle, jnp.zeros_like(angle))], geometry)
        return through | jnp.any(gap <= 0, 0)

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
        return with_constants(self.spec, self.inputs, self.family.names, constants)

    def _face(self, constants: Array) -> AbstractFace:
        if self.slope is None:
            return self.face
        change = constants - self.at
        common = change[jnp.array(self.moving, int)]
        places = [
            jnp.where(np.array(row) >= 0, change[np.array(row)], 0) for row in self.latent
        ]

        def moved(slope: Array) -> Array:
            own = zip(places, slope[len(self.moving) :], strict=True)
            start = jnp.tensordot(common, slope[: len(self.moving)], 1)
            return sum((by * along for by, along in own), start)

        face: AbstractFace = eqx.apply_updates(self.face, jax.tree.map(moved, self.slope))
        return face


@eqx.filter_jit
def counts_at(model: SensorModel, constants: Float[Array, " p"]) -> Float[Array, "taxel state"]:
    """Counts of a model at some constants; see `SensorModel.so`."""
    return model.so(constants)


@eqx.filter_jit
def _field(electrodes: Electrodes, face: NormalFace) -> Array:
    return field_capacitance_under(electrodes, face)
