"""From a deformed membrane to what its electrodes read: gap, capacitance, sensor output."""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.config import SkinSpec
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.shape import AbstractFace
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.runtime.registry import model_classes
from suas_jax.sensing.capacitance import AbstractCapacitance, Dielectric
from suas_jax.sensing.taxels import CHORDS, DISC, EVEN, Taxels, by_taxel, taxels_of
from suas_jax.skin.geometry import SkinGeometry

CAPACITANCES = model_classes(
    "suas_jax.sensing.capacitances",
    AbstractCapacitance,  # type: ignore[type-abstract]
)
"""Models by their name in `[electrodes] capacitance`, one for each file of the folder."""


class Readings(NamedTuple):
    """What the taxels read."""

    gap: Float[Array, "taxel lane"]  # along the ray through a taxel's centre [m]
    # stray included [F]; NaN where nothing parts membrane and electrode, or where `touching` is
    # all that is known
    capacitance: Float[Array, "taxel lane"]
    # continuous sensor output, C / lsb [counts]: no noise, rounding or saturation
    so: Float[Array, "taxel lane"]
    # whether the membrane reaches the wall somewhere over the footprint, or folds over: no
    # capacitance can be told there
    touching: Bool[Array, "taxel lane"]


class Electrodes(eqx.Module):
    """Taxels on the wall under a film of oil, and the scale of their converter.

    Permittivity, stray, layers and lsb may also be given taxel by taxel [taxel, lane].
    """

    taxels: Taxels  # where they are
    geometry: SkinGeometry  # of the skin
    permittivity: Lanes  # relative, of the oil
    stray: Lanes  # capacitance in parallel with each taxel [F]
    layers: Lanes  # sum of thickness over relative permittivity of further dielectrics [m]
    lsb: Lanes  # capacitance of one count [F]
    model: AbstractCapacitance  # of the capacitance
    # of the electrodes above the wall, towards the membrane [m]
    height: Float[Array, "taxel #lane"] | float = 0.0

    @property
    def between(self) -> Dielectric:
        """What lies between electrodes and membrane."""
        curvature = self.geometry.wall_curvature(self.taxels.angle, self.taxels.axial)
        return Dielectric(self.permittivity, self.layers, curvature)

    def read(self, mechanics: AbstractMechanics, q: StationVector) -> Readings:
        """Readings of a deformed membrane.

        C = C_stray + the model's capacitance, and SO = C / lsb (Eqs. 1 and 2 of the paper
        without noise).

        `mechanics`: the membrane on the whole arc.
        """
        face = mechanics.face(q)
        return self.read_face(face, held=mechanics.wall is not None)

    def read_face(self, face: AbstractFace, *, held: bool = False) -> Readings:
        """Readings under a deformed inner face; see `read`.

        `held`: whether the wall holds the membrane: where they touch, the film is gone and
        further dielectrics remain. If there are none, it is a short circuit.
        """
        taxels, geometry = self.taxels, self.geometry
        footprint = DISC if face.varies_along_axis else CHORDS
        rays = taxels.rays(footprint, geometry)
        gaps = [gap - self.height for gap in face.gaps(rays, geometry)]
        clear = functools.reduce(jnp.logical_and, [gap > 0 for gap in gaps])
        parted = clear
        if held:
            known = functools.reduce(jnp.logical_and, [~jnp.isnan(gap) for gap in gaps])
            parted = clear | (known & (self.layers > 0))
            gaps = [jnp.maximum(gap, 0.0) for gap in gaps]
        # Untouched taxels keep their derivatives whatever happens to the others: the
        # model never sees a gap that it has no value for.
        known_gaps = [jnp.where(parted, gap, 1.0) for gap in gaps]
        own = self.model.capacitance(known_gaps, footprint, taxels, self.between)
        capacitance = jnp.where(parted, self.stray + own, jnp.nan)
        centre = gaps[footprint.centre]
        return Readings(centre, capacitance, capacitance / self.lsb, ~clear)

    def read_even_film(self, gap: Float[Array, "taxel #lane"]) -> Float[Array, "taxel lane"]:
        """Sensor output under a film as thick over all of a taxel's footprint [counts].

        With the skin's oil gap these are the readings at rest.

        `gap`: between wall and inner face [m].
        """
        film = jnp.broadcast_to(gap - self.height, self.taxels.area.shape[:1] + gap.shape[-1:])
        own = self.model.capacitance([film], EVEN, self.taxels, self.between)
        return (self.stray + own) / self.lsb

    def even_film(self, so: Float[Array, "taxel lane"]) -> Float[Array, "taxel lane"]:
        """Gap of the even film that gives a sensor output: inverse of `read_even_film` [m].

        `so`: sensor output [counts]; a lane a frame.
        Returns zero where the capacitance is that of a closed film or more; NaN where the
        output is missing, or not above the stray capacitance.
        """
        own = so * self.lsb - self.stray
        known = own > 0
        gap = self.model.even_gap(jnp.where(known, own, 1e-12), self.taxels, self.between)
        return jnp.where(known, jnp.maximum(gap, 0.0) + self.height, jnp.nan)


def warmed_permittivity(permittivity: Lanes, growth: Lanes) -> Lanes:
    """Relative permittivity of an oil at another density, by Clausius and Mossotti.

    Molecules without a permanent dipole, as mineral and silicone oils have, keep their
    polarisability, so (e - 1)/(e + 2) goes with the density.

    `permittivity`: e, before. `growth`: logarithm of the volume over what it was.
    """
    share = (permittivity - 1) / (permittivity + 2) * jnp.exp(-growth)
    return (1 + 2 * share) / (1 - share)


def electrodes_of(
    spec: SkinSpec,  # says which layout and formula
    numbers: Mapping[str, Any],  # SI values by TOML path
    geometry: SkinGeometry,
    # logarithm of the volume that the oil has grown to by warmth, since it had the permittivity
    # of the file; None where it has not
    warmed: Lanes | None = None,
) -> Electrodes | None:
    """Electrodes of a skin from its numbers by TOML path; None if nothing is sensed."""
    if spec.electrodes is None:
        return None

    def value(path: str) -> Array:
        return jnp.asarray(numbers[path], float)[..., None]

    def reduced(i: int) -> Array:
        path = f"electrodes.layers.{i}."
        return value(path + "thickness") / value(path + "relative_permittivity")

    model = CAPACITANCES[spec.electrodes.capacitance]()
    model.check(spec.electrodes, spec.geometry.mean_gap)
    permittivity = value("oil.relative_permittivity")
    if warmed is not None:
        permittivity = warmed_permittivity(permittivity, warmed)
    return Electrodes(
        taxels_of(spec.electrodes, numbers, geometry),
        geometry,
        permittivity,
        value("electrodes.stray"),
        sum((reduced(i) for i in range(len(spec.electrodes.layers))), jnp.zeros(1)),
        value("electrodes.lsb") / by_taxel(spec.electrodes, numbers, "gain", 1.0),
        model,
        by_taxel(spec.electrodes, numbers, "height", 0.0),
    )
