"""From a deformed membrane to what its electrodes read: gap, capacitance, sensor output."""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from suas_jax.config import SkinSpec
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.face import AbstractFace
from suas_jax.numerics.array_types import Lanes, StationVector
from suas_jax.sensing.capacitance import FORMULAS, AbstractCapacitance
from suas_jax.sensing.taxels import CHORDS, DISC, Taxels, heights_of, taxels_of
from suas_jax.skin.geometry import SkinGeometry


class Readings(NamedTuple):
    """What the taxels read.

    Attributes:
        gap: along the ray through a taxel's centre [m].
        capacitance: stray included [F]; NaN where nothing parts membrane and electrode, or
            where `touching` is all that is known.
        so: continuous sensor output, C / lsb [counts]: no noise, rounding or saturation.
        touching: whether the membrane reaches the wall somewhere over the footprint, or
            folds over: no capacitance can be told there.
    """

    gap: Float[Array, "taxel lane"]
    capacitance: Float[Array, "taxel lane"]
    so: Float[Array, "taxel lane"]
    touching: Bool[Array, "taxel lane"]


class Electrodes(eqx.Module):
    """Taxels on the wall under a film of oil, and the scale of their converter.

    Permittivity, stray, layers and lsb may also be given taxel by taxel [taxel, lane].

    Attributes:
        taxels: where they are.
        geometry: of the skin.
        permittivity: relative, of the oil.
        stray: capacitance in parallel with each taxel [F].
        layers: sum of thickness over relative permittivity of further dielectrics [m].
        lsb: capacitance of one count [F].
        formula: capacitance per area.
        height: of the electrodes above the wall, towards the membrane [m].
    """

    taxels: Taxels
    geometry: SkinGeometry
    permittivity: Lanes
    stray: Lanes
    layers: Lanes
    lsb: Lanes
    formula: AbstractCapacitance
    height: Float[Array, "taxel #lane"] | float = 0.0

    def read(self, mechanics: AbstractMechanics, q: StationVector) -> Readings:
        """Readings of a deformed membrane.

        C = C_stray + A <c(d)> with the capacitance per area c averaged over the
        electrode's disc, and SO = C / lsb (Eqs. 1 and 2 of the paper without noise).

        Args:
            mechanics: the membrane on the whole arc.
            q: its unknowns.
        """
        face = mechanics.face(q, self.geometry.inner_radius)
        return self.read_face(face, held=mechanics.wall is not None)

    def read_face(self, face: AbstractFace, *, held: bool = False) -> Readings:
        """Readings under a deformed inner face; see `read`.

        Args:
            face: the inner face.
            held: whether the wall holds the membrane: where they touch, the film is gone
                and further dielectrics remain. If there are none, it is a short circuit.
        """
        taxels, wall = self.taxels, self.geometry.wall_radius
        footprint = DISC if face.varies_along_axis else CHORDS
        rays = taxels.rays(footprint, wall)
        gaps = [gap - self.height for gap in face.gaps(rays, wall)]
        clear = functools.reduce(jnp.logical_and, [gap > 0 for gap in gaps])
        parted = clear
        if held:
            known = functools.reduce(jnp.logical_and, [~jnp.isnan(gap) for gap in gaps])
            parted = clear | (known & (self.layers > 0))
            gaps = [jnp.maximum(gap, 0.0) for gap in gaps]
        # Untouched taxels keep their derivatives whatever happens to the others: the
        # formula never sees a gap that it has no value for.
        density = footprint.average(
            self.formula.per_area(
                jnp.where(parted, gap, 1.0), wall, self.permittivity, self.layers
            )
            for gap in gaps
        )
        capacitance = jnp.where(parted, self.stray + taxels.area * density, jnp.nan)
        centre = gaps[footprint.centre]
        return Readings(centre, capacitance, capacitance / self.lsb, ~clear)

    def read_even_film(self, gap: Float[Array, "taxel #lane"]) -> Float[Array, "taxel lane"]:
        """Sensor output under a film as thick over all of a taxel's footprint [counts].

        With the skin's oil gap these are the readings at rest.

        Args:
            gap: between wall and inner face [m].
        """
        wall = self.geometry.wall_radius
        density = self.formula.per_area(gap - self.height, wall, self.permittivity, self.layers)
        return (self.stray + self.taxels.area * density) / self.lsb

    def even_film(self, so: Float[Array, "taxel lane"]) -> Float[Array, "taxel lane"]:
        """Gap of the even film that gives a sensor output: inverse of `read_even_film` [m].

        Args:
            so: sensor output [counts]; a lane a frame.

        Returns:
            Zero where the capacitance is that of a closed film or more; NaN where the output
            is missing, or not above the stray capacitance.
        """
        density = (so * self.lsb - self.stray) / self.taxels.area
        known = density > 0
        gap = self.formula.gap_of(
            jnp.where(known, density, 1.0),
            self.geometry.wall_radius,
            self.permittivity,
            self.layers,
        )
        return jnp.where(known, jnp.maximum(gap, 0.0) + self.height, jnp.nan)


def electrodes_of(
    spec: SkinSpec, numbers: Mapping[str, Any], geometry: SkinGeometry
) -> Electrodes | None:
    """Electrodes of a skin from its numbers by TOML path; None if nothing is sensed."""
    if spec.electrodes is None:
        return None

    def value(path: str) -> Array:
        return jnp.asarray(numbers[path], float)[..., None]

    def reduced(i: int) -> Array:
        path = f"electrodes.layers.{i}."
        return value(path + "thickness") / value(path + "relative_permittivity")

    return Electrodes(
        taxels_of(spec.electrodes, numbers, geometry.wall_radius),
        geometry,
        value("oil.relative_permittivity"),
        value("electrodes.stray"),
        sum((reduced(i) for i in range(len(spec.electrodes.layers))), jnp.zeros(1)),
        value("electrodes.lsb"),
        FORMULAS[spec.electrodes.capacitance],
        heights_of(spec.electrodes, numbers),
    )
