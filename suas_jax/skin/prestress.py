"""What a skin carries before anything touches it: its parts have other sizes than their seats.

Warmth, the water's pressure, filling and mounting change stress-free sizes. With a change of
temperature dT and of absolute pressure dP since the skin was closed, rubber and wall grow by

    s = (1 + alpha dT) (1 - dP / (3 K)),

and the wall takes the clamps with it. That is a change of scale: a skin is described in the
dimensions of its wall as they are now, and what is left for the mechanics is the `Growth` of
the membrane against them. Its law acts on F G^-1, and it keeps the volume det F = det G.
"""

from collections.abc import Callable
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp

from suas_jax.config import SkinSpec
from suas_jax.config.schema_load import EnvironmentSpec, ReferenceSpec
from suas_jax.numerics.array_types import Lanes
from suas_jax.skin.oil import AbstractOil


class Growth(eqx.Module):
    """Stress-free size of the membrane over that of the seat that it is mounted on.

    Logarithms g of the stretches along the arc, along the axis and across the thickness, the
    same everywhere: such a membrane is free of stress on a seat as much longer and wider.
    """

    hoop: Lanes  # along the arc
    axial: Lanes  # along the axis
    radial: Lanes  # across the thickness

    @property
    def volume(self) -> Lanes:
        """Det G: of the membrane, over that of the undeformed one."""
        return jnp.exp(self.hoop + self.axial + self.radial)

    def longer(self, strain: Lanes) -> Self:
        """The same with another growth along the arc."""
        return eqx.tree_at(lambda g: g.hoop, self, self.hoop + strain)

    @classmethod
    def none(cls) -> "Growth":
        """Of a membrane that fits."""
        return cls(*(jnp.zeros(1) for _ in range(3)))


class ContainedOil(AbstractOil):
    """An oil whose volume is another than that of the film that it is in.

    At a pressure p above ambient it takes c V(p + dP), where V is the volume that its model
    gives to a film that it just fills.
    """

    oil: AbstractOil  # the model
    excess: Lanes  # log c: of its stress-free volume over the film's
    ambient: Lanes  # dP, ambient pressure now less that when the skin was closed [Pa]

    @property
    def trapped(self) -> bool:
        """See the base class."""
        return self.oil.trapped

    @property
    def yields(self) -> bool:
        """See the base class."""
        return self.oil.yields

    def expansion(self, pressure: Lanes, film_volume: Lanes) -> Lanes:
        """C V(p + dP) - V0."""
        own = self.oil.expansion(pressure + self.ambient, film_volume)
        return film_volume * jnp.expm1(self.excess) + jnp.exp(self.excess) * own


class Prestress(eqx.Module):
    """Changes of stress-free size since a skin was closed; None for what does not change."""

    # logarithm of the linear size of the wall, and with it of the clamps
    seat: Lanes | None = None
    growth: Growth | None = None  # of the membrane against it
    # logarithm of the oil's volume over the film's when it was closed
    fill: Lanes | None = None
    warmed: Lanes | None = None  # logarithm of the volume that the oil grows to by warmth
    warmth: Lanes | None = None  # absolute temperature over that when it was closed
    ambient: Lanes | None = None  # rise of the ambient pressure, where the oil feels it [Pa]

    @classmethod
    def of(cls, spec: SkinSpec, number: Callable[[str], Lanes]) -> "Prestress":
        """That of a skin in its environment.

        `spec`: says what there is: what it doesn't name costs nothing. `number`: gives values
        by TOML path, with a lane axis [SI].
        """
        environment = spec.environment
        warming = rise = None
        if environment is not None and environment.temperature is not None:
            warming = number("environment.temperature") - number("reference.temperature")
        if environment is not None and environment.depth is not None:
            rise = ambient_pressure(number) - number("reference.pressure")

        def grown(table: str, part: Any) -> Lanes | None:
            """Logarithm of s."""
            size = None
            if warming is not None and part.expansion is not None:
                size = jnp.log1p(number(f"{table}.expansion") * warming)
            if rise is not None and part.bulk_modulus is not None:
                squeezed = jnp.log1p(-rise / (3 * number(f"{table}.bulk_modulus")))
                size = squeezed if size is None else size + squeezed
            return size

        rubber, seat = grown("material", spec.material), grown("wall", spec.wall)
        mounting = {
            key: jnp.log1p(number(f"geometry.{key}"))
            for key in ("mounting", "mounting_axial")
            if getattr(spec.geometry, key) is not None
        }
        growth = None
        if rubber is not None or seat is not None or mounting:
            zero = jnp.zeros(1)
            free = (zero if rubber is None else rubber) - (zero if seat is None else seat)
            hoop, axial = (mounting.get(key, zero) for key in ("mounting", "mounting_axial"))
            growth = Growth(free + hoop, free + axial, free)
        fill = warmed = warmth = None
        if spec.oil.fill is not None:
            fill = jnp.log(number("oil.fill"))
        if warming is not None and spec.oil.expansion is not None:
            warmed = jnp.log1p(number("oil.expansion") * warming)
            warmth = 1 + warming / number("reference.temperature")
        return cls(seat, growth, fill, warmed, warmth, rise if spec.oil.yields else None)

    @property
    def scale(self) -> Lanes | None:
        """Of all lengths of the seat; None where they stay."""
        return None if self.seat is None else jnp.exp(self.seat)

    def contain(self, oil: AbstractOil) -> AbstractOil:
        """The oil as it fills the film now."""
        sizes = (self.seat, self.fill, self.warmed, self.ambient)
        if not oil.trapped or all(x is None for x in sizes):
            return oil
        seat, excess, warmed, ambient = (jnp.zeros(1) if x is None else x for x in sizes)
        if self.warmth is not None:
            oil, warmed = oil.warmed(warmed, self.warmth)
        return ContainedOil(oil, excess + warmed - 3 * seat, ambient)


def is_prestressed(spec: SkinSpec) -> bool:
    """Whether a skin, or a scene, names anything that gives it stress at rest."""
    environment = spec.environment
    solids = (spec.material, spec.wall)
    found = [spec.geometry.mounting, spec.geometry.mounting_axial, spec.oil.fill]
    if environment is not None and environment.temperature is not None:
        found += [part.expansion for part in (*solids, spec.oil)]
    if environment is not None and environment.depth is not None:
        found += [part.bulk_modulus for part in solids]
        found += [environment.depth if spec.oil.yields else None]
    return any(x is not None for x in found)


def water_rise(spec: SkinSpec) -> float:
    """Rise of the ambient pressure over that when the skin was closed [Pa]."""
    environment = spec.environment
    if environment is None or environment.depth is None:
        return 0.0
    return environment.ambient_pressure - spec.reference.pressure


def unloaded_depth(environment: EnvironmentSpec, reference: ReferenceSpec) -> float:
    """Depth at which the water presses as it did when the skin was closed [m]."""
    return (reference.pressure - environment.atmospheric_pressure) / environment.specific_weight


def ambient_pressure(number: Callable[[str], Lanes]) -> Lanes:
    """Absolute pressure of the water at a scene's depth [Pa]; see `Prestress.of`."""
    names = ("specific_weight", "depth", "atmospheric_pressure")
    weight, depth, atmosphere = (number(f"environment.{name}") for name in names)
    return weight * depth + atmosphere
