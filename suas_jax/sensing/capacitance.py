"""Capacitance between an electrode on the wall and the membrane above it.

The membrane's inner face is the grounded plate, the electrode lies on the wall, the oil
and any further dielectric layers stack up between them. A model gets the gaps over every
taxel's footprint and all that there is to know of the electrodes: size, place, neighbours. Most
are a formula per area of electrode, averaged over the footprint::

    C = A <eps0 / (t(d) / eps_oil + sum_i t_i / eps_i)>

with t(d) the thickness of the plane film that has the same capacitance as a film of gap d.
The models are the files of `suas_jax.sensing.capacitances`. Stray capacitance comes on top.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from suas_jax.config import ElectrodesSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.sensing.taxels import Footprint, Taxels

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""Electric constant eps0, CODATA 2022 [F/m]."""

TaxelValues = Float[Array, "taxel #lane"]


class Dielectric(NamedTuple):
    """What lies between electrodes and membrane."""

    permittivity: TaxelValues | Lanes  # relative, of the oil
    # sum of thickness over relative permittivity of what else lies there [m]
    layers: TaxelValues | Lanes | float
    wall_curvature: TaxelValues | Lanes  # of the wall that carries the electrodes [1/m]


class AbstractCapacitance(eqx.Module):
    """A model of the capacitance of electrodes under a deformed membrane."""

    guarded: ClassVar[bool] = True  # whether the wall around an electrode has its potential

    def check(self, electrodes: ElectrodesSpec, oil_gap: float) -> None:
        """Refuse electrodes that the model has no value for.

        `electrodes`: the table that names the model. `oil_gap`: of the skin at rest [m].
        Raises ValueError: names the key, its value and what is allowed.
        """
        del electrodes, oil_gap

    @abc.abstractmethod
    def capacitance(
        self,
        # between electrode and inner face at the footprint's places [m], positive
        gaps: Sequence[TaxelValues],
        footprint: Footprint,  # those places and their weights
        taxels: Taxels,  # size and place of every electrode
        between: Dielectric,  # what lies between them and the membrane
    ) -> Float[Array, "taxel lane"]:
        """Capacitance of every taxel, stray left out [F]."""

    @abc.abstractmethod
    def even_gap(
        self, capacitance: Float[Array, "taxel lane"], taxels: Taxels, between: Dielectric
    ) -> Float[Array, "taxel lane"]:
        """Gap of the even film that has a capacitance [m]; not above zero for a closed one.

        `capacitance`: without stray [F], positive. `taxels`: size and place of every electrode.
        `between`: what lies between them and the membrane.
        """


class AbstractFilmFormula(AbstractCapacitance):
    """A formula for the capacitance per area of electrode."""

    @abc.abstractmethod
    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """Thickness of the plane film that has the same capacitance as the oil [m]."""

    @abc.abstractmethod
    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """Gap whose oil has the capacitance of a plane film: inverse of `thickness` [m]."""

    def per_area(
        self, gap: Float[Array, "*shape lane"], between: Dielectric
    ) -> Float[Array, "*shape lane"]:
        """Capacitance per area of electrode [F/m^2].

        `gap`: between electrode and inner face [m], positive. `between`: what lies there.
        """
        film = self.thickness(gap, between.wall_curvature) / between.permittivity
        return VACUUM_PERMITTIVITY / (film + between.layers)

    def capacitance(
        self,
        gaps: Sequence[TaxelValues],
        footprint: Footprint,
        taxels: Taxels,
        between: Dielectric,
    ) -> Float[Array, "taxel lane"]:
        """A <c>, the mean taken over the footprint; see the base class."""
        return taxels.area * footprint.average(self.per_area(gap, between) for gap in gaps)

    def even_gap(
        self, capacitance: Float[Array, "taxel lane"], taxels: Taxels, between: Dielectric
    ) -> Float[Array, "taxel lane"]:
        """In closed form; see the base class."""
        film = VACUUM_PERMITTIVITY * taxels.area / capacitance - between.layers
        return self.gap(film * between.permittivity, between.wall_curvature)
