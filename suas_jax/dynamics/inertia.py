"""Inertia and viscosity of what moves with a section: film, membrane and water.

The oil between wall and membrane is a thin film of thickness h: with the flux q along it::

    rho dv/dt = -dp/ds - 12 mu v / h^2,   v = q / h,   dq/ds + w = 0,   q = 0 at the clamps

The flux is a sum of the membrane's normal velocities w along the arc, so the film is no
unknown of its own but a mass and a damping of the membrane::

    kinetic energy    1/2 integral rho q^2 / h ds
    dissipation           integral 12 mu q^2 / h^3 ds

Oil that yields makes room evenly over the film. The water outside is that of a potential flow
over a half-space: on an arc of length L, of radius R = L / pi once it is bent to a half-circle,
a normal velocity cos(n psi), with psi from clamp to clamp, carries the mass rho R / n per area.
That is exact for a half-circle whose clamps lie on a wide flat base.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from suas_jax.dynamics.motion import Motion

Matrix = Float[np.ndarray, "unknown unknown"]

THINNEST_FILM = 1e-6
"""A thinner one no longer drains: its asperities bear on one another [m]."""
_HARMONICS = 64


class Densities(NamedTuple):
    """What moves, in SI units.

    Attributes:
        oil: density [kg/m^3].
        viscosity: of the oil, dynamic [Pa s].
        membrane: density [kg/m^3].
        water: density outside, zero in air [kg/m^3].
    """

    oil: float
    viscosity: float
    membrane: float
    water: float


class Inertia(NamedTuple):
    """Quadratic forms of the unknowns' velocities, per width.

    Attributes:
        film: mass of the oil [kg/m].
        membrane: its own mass [kg/m].
        water: added mass outside [kg/m].
        damping: of the film [N s/m^2].
    """

    film: Matrix
    membrane: Matrix
    water: Matrix
    damping: Matrix

    @property
    def mass(self) -> Matrix:
        """All that moves [kg/m]."""
        total: np.ndarray = self.film + self.membrane + self.water
        return total


def inertia_of(motion: Motion, given: Densities) -> Inertia:
    """Masses and damping of small motions.

    Args:
        motion: about a state.
        given: densities and viscosity.
    """
    gap = np.maximum(motion.gap, THINNEST_FILM)
    gap = (gap[1:] + gap[:-1]) / 2
    length = motion.inner.lengths()
    flux = _film_flux(motion, gap * length)
    film = _form(flux, given.oil * length / gap)
    damping = _form(flux, 12 * given.viscosity * length / gap**3)
    membrane = sum(
        share * _form(_mean(moved), given.membrane * motion.mass)
        for share, face in (
            (1 / 6, motion.inner),
            (2 / 3, motion.middle),
            (1 / 6, motion.outer),
        )
        for moved in face.moved
    )
    assert isinstance(membrane, np.ndarray)
    return Inertia(film, membrane, given.water * _outside(motion), damping)


def _film_flux(motion: Motion, areas: np.ndarray) -> np.ndarray:
    """Flux of the oil along the film at the middle of every segment, by the unknowns."""
    passed = np.cumsum(motion.inner.flux(), 0)
    passed -= np.cumsum(areas)[:, None] / np.sum(areas) * passed[-1]
    return -_mean(np.concatenate([np.zeros_like(passed[:1]), passed]))


def _outside(motion: Motion) -> Matrix:
    """Added mass of the fluid outside, per density."""
    flux, lengths = motion.outer.flux(), motion.outer.lengths()
    whole = np.sum(lengths)
    psi = np.pi * (np.cumsum(lengths) - lengths / 2) / whole
    n = np.arange(1, _HARMONICS + 1)
    amplitude = 2 / whole * np.cos(n[:, None] * psi) @ flux
    return _form(amplitude, whole / np.pi / n * whole / 2)


def _mean(nodes: np.ndarray) -> np.ndarray:
    """Values at the middle of segments."""
    mean: np.ndarray = (nodes[1:] + nodes[:-1]) / 2
    return mean


def _form(rows: np.ndarray, weights: np.ndarray) -> Matrix:
    """Sum of the squares of linear forms."""
    form: np.ndarray = rows.T @ (weights[:, None] * rows)
    return form
