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

Everything is linear in the velocities, which may have an axis of unknowns behind the others.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config import ConfigError, SceneSpec
from suas_jax.config.errors import Mistake

Matrix = Float[Array, "unknown unknown"] | Float[np.ndarray, "unknown unknown"]
Number = float | Float[Array, ""]

THINNEST_FILM = 1e-6
"""A thinner one no longer drains: its asperities bear on one another [m]."""
WATER_DENSITY = 1000.0
"""Of the water outside [kg/m^3]."""
_HARMONICS = 64
# Simpson's rule across the membrane: inner face, middle, outer face.
_ACROSS = np.array([1 / 6, 2 / 3, 1 / 6])


class Densities(NamedTuple):
    """What moves, in SI units."""

    oil: Number  # density [kg/m^3]
    viscosity: Number  # of the oil, dynamic [Pa s]
    membrane: Number  # density [kg/m^3]
    water: Number  # density outside, zero in air [kg/m^3]


def densities_of(scene: SceneSpec) -> Densities:
    """Densities and viscosity of a scene. Raises ConfigError: names what is missing."""
    needed = {
        "oil.density": scene.oil.density,
        "oil.viscosity": scene.oil.viscosity,
        "material.density": scene.material.density,
    }
    examples = ('"960 kg/m^3"', '"50 cSt"', '"1100 kg/m^3"')
    missing = [
        Mistake(
            "scene", key, f"missing; motion needs it, for example {key.split('.')[1]} = {text}"
        )
        for (key, value), text in zip(needed.items(), examples, strict=True)
        if value is None
    ]
    if missing:
        raise ConfigError(missing)
    environment = scene.environment
    in_water = environment is None or environment.medium == "water"
    oil, viscosity, membrane = (float(x) for x in needed.values() if x is not None)
    return Densities(oil, viscosity, membrane, WATER_DENSITY if in_water else 0.0)


class Water(NamedTuple):
    """The water outside, on the outer face at rest."""

    # of the harmonics of a normal velocity, by what segments sweep [1/m]
    amplitudes: Float[Array, "harmonic segment"]
    weights: Float[Array, " harmonic"]  # mass of the square of each, over the density [m^2]

    @classmethod
    def over(cls, lengths: Float[Array, " segment"]) -> "Water":
        """Over segments of some lengths [m]."""
        n, whole = np.arange(1, _HARMONICS + 1), jnp.sum(lengths)
        psi = jnp.pi * (jnp.cumsum(lengths) - lengths / 2) / whole
        return cls(2 / whole * jnp.cos(n[:, None] * psi), whole**2 / (2 * jnp.pi * n))


class Outline(NamedTuple):
    """Polylines of a section in a state."""

    faces: Float[Array, "3 2 point"]  # points of inner face, mid-line and outer face [m]
    # thickness of the film along the normal of the undeformed inner face [m]
    gap: Float[Array, " point"]

    @property
    def lengths(self) -> Float[Array, "3 segment"]:
        """Of the segments [m]."""
        x, y = jnp.moveaxis(jnp.diff(self.faces), 1, 0)
        return jnp.sqrt(x**2 + y**2)

    @property
    def film(self) -> Float[Array, " segment"]:
        """Thickness of the film that drains [m]."""
        gap = jnp.maximum(self.gap, THINNEST_FILM)
        return _mean(gap)


class Flow(NamedTuple):
    """How a section moves, or what works on such a motion."""

    film: Float[Array, "segment *unknown"]  # flux of the oil along the film [m^2/s]
    # velocities of the segments of inner face, mid-line and outer face [m/s]
    membrane: Float[Array, "3 2 segment *unknown"]
    # amplitudes of the harmonics of the outer face's normal velocity [m/s]
    water: Float[Array, "harmonic *unknown"]


class Inertia(NamedTuple):
    """Quadratic forms of the unknowns' velocities, per width."""

    film: Matrix  # mass of the oil [kg/m]
    membrane: Matrix  # its own mass [kg/m]
    water: Matrix  # added mass outside [kg/m]
    damping: Matrix  # of the film [N s/m^2]

    @property
    def mass(self) -> Matrix:
        """All that moves [kg/m]."""
        return self.film + self.membrane + self.water


def flow_of(at: Outline, moved: Float[Array, "3 2 point *unknown"], water: Water) -> Flow:
    """What flows where the faces move.

    `at`: where they are. `moved`: velocities of their points. `water`: outside.
    """
    lengths = at.lengths
    room = at.film * lengths[0]
    passed = jnp.cumsum(_swept(at.faces[0], moved[0]), 0)
    share = jnp.cumsum(room) / jnp.sum(room)
    passed -= share.reshape(-1, *(1,) * (passed.ndim - 1)) * passed[-1]
    passed = jnp.concatenate([jnp.zeros_like(passed[:1]), passed])
    amplitude = jnp.tensordot(water.amplitudes, _swept(at.faces[2], moved[2]), 1)
    membrane = (moved[:, :, 1:] + moved[:, :, :-1]) / 2
    return Flow(-_mean(passed), membrane, amplitude)


class Weights(NamedTuple):
    """What the squares of a flow weigh."""

    mass: Flow  # of film, membrane and water
    damping: Float[Array, " segment"]  # of the film


def weights_of(
    at: Outline, section: Float[Array, " segment"], water: Water, given: Densities
) -> Weights:
    """Masses and damping, of the flow of a unit of width.

    `at`: where the faces are. `section`: cross-section of the membrane's segments [m^2].
    `water`: outside. `given`: densities and viscosity.
    """
    inner, film = at.lengths[0], at.film
    membrane = given.membrane * _ACROSS[:, None, None] * section
    mass = Flow(
        inner * (given.oil / film),
        jnp.broadcast_to(membrane, (3, 2, section.size)),
        water.weights * given.water,
    )
    return Weights(mass, inner * (12 * given.viscosity / film**3))


@jax.jit
def inertia_of(
    at: Outline,
    moved: Float[Array, "3 2 point unknown"],
    section: Float[Array, " segment"],
    water: Water,
    given: Densities,
) -> Inertia:
    """Masses and damping of small motions; see `flow_of` and `weights_of`."""
    flow, weights = flow_of(at, moved, water), weights_of(at, section, water, given)
    film, membrane, outside = (
        _form(x.reshape(-1, x.shape[-1]), w.ravel())
        for x, w in zip(flow, weights.mass, strict=True)
    )
    return Inertia(film, membrane, outside, _form(flow.film, weights.damping))


def _swept(
    position: Float[Array, "2 point"], moved: Float[Array, "2 point *unknown"]
) -> Float[Array, "segment *unknown"]:
    """Area that each segment sweeps outwards: the normal motion."""
    x, y = jnp.diff(position)
    mean = (moved[:, 1:] + moved[:, :-1]) / 2
    own = (-1, *(1,) * (mean.ndim - 2))
    return x.reshape(own) * mean[1] - y.reshape(own) * mean[0]


def _mean(nodes: Array) -> Array:
    """Values at the middle of segments."""
    return (nodes[1:] + nodes[:-1]) / 2


def _form(rows: Array, weights: Array) -> Matrix:
    """Sum of the squares of linear forms."""
    return rows.T @ (weights[:, None] * rows)
