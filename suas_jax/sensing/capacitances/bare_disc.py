"""Capacitance of a disc without guard: the field beyond its edge counts, too.

A disc of radius a at the distance d from the grounded membrane, with the oil's permittivity
on both sides (a thick plastic wall has about the same). With its mirror image it is
Kirchhoff's capacitor of two discs. Love's equation gives its charge (E. R. Love 1949, Quarterly
Journal of Mechanics and Applied Mathematics 2, 428)::

    f(x) - k/pi integral f(y) / (k^2 + (x - y)^2) dy = 1   on [-1, 1],   k = 2 d / a
    C = 4 eps0 eps_r a integral f(x) dx

At small gaps this is Kirchhoff's eps0 eps_r a (pi a / d + 2 ln(8 pi a / d) - 2), at large
ones the lone disc's 8 eps0 eps_r a.
"""

import functools
from collections.abc import Sequence
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config import ElectrodesSpec
from suas_jax.config.quantities import format_quantity
from suas_jax.numerics.array_types import Lanes
from suas_jax.sensing.capacitance import (
    VACUUM_PERMITTIVITY,
    AbstractCapacitance,
    Dielectric,
    TaxelValues,
)
from suas_jax.sensing.taxels import Footprint, Taxels

# Gaps over radii that the polynomial serves, and its degree: good to 1e-7.
_RANGE = (0.05, 25.0)
_DEGREE = 24
# Gaps at rest over radii that are accepted: deformed ones stay in the range.
_ACCEPTED = (0.1, 10.0)
_NEWTON_STEPS = 6


def disc_capacitance(ratio: float) -> float:
    """Capacitance of a disc over a plane by eps0 eps_r a, from Love's equation.

    `ratio`: distance over radius, not below 0.02.
    """
    nodes, weights = np.polynomial.legendre.leggauss(int(60 + 12 / ratio))
    k = 2 * ratio
    kernel = k / np.pi / (k**2 + (nodes[:, None] - nodes) ** 2)
    charge = np.linalg.solve(np.eye(len(nodes)) - kernel * weights, np.ones(len(nodes)))
    return float(4 * weights @ charge)


@functools.cache
def _polynomial() -> tuple[float, ...]:
    """Chebyshev coefficients of log(C / (eps0 eps_r a)) over log(d / a)."""
    low, high = np.log(_RANGE)

    def function(x: np.ndarray) -> np.ndarray:
        ratios = np.exp(low + (x + 1) / 2 * (high - low))
        return np.log([disc_capacitance(ratio) for ratio in ratios])

    return tuple(np.polynomial.chebyshev.chebinterpolate(function, _DEGREE))


def _log_capacitance(log_ratio: Array) -> Array:
    """log(C / (eps0 eps_r a)) over log(d / a), within the range."""
    low, high = np.log(_RANGE)
    x = 2 * (log_ratio - low) / (high - low) - 1
    last, total = jnp.zeros_like(x), jnp.zeros_like(x)  # Clenshaw's recurrence
    first, *rest = _polynomial()
    for coefficient in reversed(rest):
        last, total = total, coefficient + 2 * x * total - last
    return first + x * total - last


class BareDisc(AbstractCapacitance):
    """A disc on a wall without guard, under a film that is even over the disc and around it."""

    guarded: ClassVar[bool] = False

    def check(self, electrodes: ElectrodesSpec, oil_gap: float) -> None:
        """Refuse layers, and gaps beyond the formula's range; see the base class."""
        name = 'electrodes.capacitance = "bare-disc"'
        if electrodes.layers:
            raise ValueError(
                f"{name}: the oil's field alone is known in closed form; leave out "
                f'electrodes.layers, or take "parallel-plate" or "concentric"'
            )
        for electrode in electrodes.taxels or electrodes.modules:
            low, high = (share * electrode.diameter / 2 for share in _ACCEPTED)
            if not low <= oil_gap <= high:
                raise ValueError(
                    f"{name}: geometry.oil_gap is {format_quantity(oil_gap, 'length')}; under "
                    f"electrodes of {format_quantity(electrode.diameter, 'length')} it must be "
                    f"{format_quantity(low, 'length')} to {format_quantity(high, 'length')}"
                )

    def capacitance(
        self,
        gaps: Sequence[TaxelValues],
        footprint: Footprint,
        taxels: Taxels,
        between: Dielectric,
    ) -> Float[Array, "taxel lane"]:
        """That under the even film with the same mean of 1/d; see the base class."""
        radius = taxels.diameter / 2
        gap = 1 / footprint.average(1 / gap for gap in gaps)
        ratio = gap / radius
        within = jnp.clip(ratio, *_RANGE)
        # Nearer than the range the plate's part grows and the edge's stays as it is.
        edge = jnp.exp(_log_capacitance(jnp.log(within))) - jnp.pi / within
        plate = jnp.pi / jnp.minimum(ratio, _RANGE[1])
        return VACUUM_PERMITTIVITY * between.permittivity * radius * (plate + edge)

    def even_gap(
        self, capacitance: Float[Array, "taxel lane"], taxels: Taxels, between: Dielectric
    ) -> Float[Array, "taxel lane"]:
        """By Newton's method within the formula's range; see the base class."""
        radius = taxels.diameter / 2
        unit = VACUUM_PERMITTIVITY * between.permittivity * radius
        wanted = jnp.log(capacitance / unit)
        low, high = np.log(_RANGE)

        def step(at: Lanes, _: None) -> tuple[Lanes, None]:
            value, slope = jax.jvp(_log_capacitance, (at,), (jnp.ones_like(at),))
            return jnp.clip(at - (value - wanted) / slope, low, high), None

        start = jnp.full_like(wanted, np.log(_ACCEPTED).mean())
        found, _ = jax.lax.scan(step, start, None, length=_NEWTON_STEPS)
        return radius * jnp.exp(found)
