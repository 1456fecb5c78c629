"""Capacitance between an electrode on the wall and the membrane above it.

The membrane's inner face is the grounded plate, the electrode lies on the wall, the oil
and any further dielectric layers stack up between them. Per area of electrode, at a place
where the gap is d::

    parallel plate   c = eps0 / (d / eps_oil + sum_i t_i / eps_i)
    concentric       c = eps0 / (r_w ln(1 + d / r_w) / eps_oil + sum_i t_i / eps_i)

and for a whole taxel, stray capacitance in parallel, C = C_stray + A <c>, the mean taken
over its footprint. The first is the paper's (C = eps0 eps_r A / d without layers); the
second is exact between coaxial cylinders and larger by about d / (2 r_w).
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from suas_jax.numerics.array_types import Lanes

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""Electric constant eps0, CODATA 2022 [F/m]."""


class AbstractCapacitance(eqx.Module):
    """A formula for the capacitance per area of electrode."""

    @abc.abstractmethod
    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """Thickness of the plane film that has the same capacitance as the oil [m]."""

    @abc.abstractmethod
    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """Gap whose oil has the capacitance of a plane film: inverse of `thickness` [m]."""

    def gap_of(
        self,
        density: Float[Array, "*shape lane"],
        wall_radius: Lanes,
        permittivity: Lanes,
        layers: Lanes | float = 0.0,
    ) -> Float[Array, "*shape lane"]:
        """Gap that has a capacitance per area: inverse of `per_area` [m].

        Args:
            density: capacitance per area of electrode [F/m^2], positive.
            wall_radius: of the wall that carries the electrodes [m].
            permittivity: relative, of the oil.
            layers: as for `per_area` [m].
        """
        film = VACUUM_PERMITTIVITY / density - layers
        return self.gap(film * permittivity, wall_radius)

    def per_area(
        self,
        gap: Float[Array, "*shape lane"],
        wall_radius: Lanes,
        permittivity: Lanes,
        layers: Lanes | float = 0.0,
    ) -> Float[Array, "*shape lane"]:
        """Capacitance per area of electrode [F/m^2].

        Args:
            gap: between wall and inner face [m], positive.
            wall_radius: of the wall that carries the electrodes [m].
            permittivity: relative, of the oil.
            layers: sum of thickness over relative permittivity of what else lies between
                electrode and membrane [m].
        """
        film = self.thickness(gap, wall_radius) / permittivity
        return VACUUM_PERMITTIVITY / (film + layers)


class ParallelPlate(AbstractCapacitance):
    """The paper's formula, that of plane electrodes: eps0 eps_r / d."""

    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """The gap itself."""
        del wall_radius
        return gap

    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """The thickness itself."""
        del wall_radius
        return thickness


class Concentric(AbstractCapacitance):
    """Coaxial cylinders: eps0 eps_r / (r_w ln(1 + d / r_w))."""

    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """r_w ln(1 + d / r_w)."""
        return wall_radius * jnp.log1p(gap / wall_radius)

    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_radius: Lanes
    ) -> Float[Array, "*shape lane"]:
        """r_w (exp(t / r_w) - 1)."""
        return wall_radius * jnp.expm1(thickness / wall_radius)


FORMULAS: dict[str, AbstractCapacitance] = {
    "parallel-plate": ParallelPlate(),
    "concentric": Concentric(),
}
"""Formulas by their name in `[electrodes] capacitance`."""
