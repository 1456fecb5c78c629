"""The electric field in the deformed oil film: what the formulas leave out, in numbers.

Laplace's equation for the potential between wall and membrane on a structured mesh of the
film's section, at heights eta d(phi) over the wall, stations along the arc as everywhere in
the project: linear in phi, a polynomial across the film (of fifth degree unless told
otherwise). The stations' unknowns form a block-tridiagonal system for the same solver as the
membrane's.

The membrane is grounded and the electrode at one volt. The wall around it is either a
*guard* at the same potential, as converters drive their shields, or *bare*, where the field
follows the wall. Guarded, fields don't vary along the axis and the section tells the
capacitance of a round electrode exactly; its edge (fringe) field belongs to the guard.
Bare, the section tells that of a strip, and what the field beyond its edges adds.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.mechanics.section import NormalFace, height_at, section_of
from suas_jax.numerics.array_types import StationVector
from suas_jax.numerics.block_tridiagonal import BlockTridiagonal, at_stations
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.sensing.capacitance import VACUUM_PERMITTIVITY
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.section import INVERSE_STEPS

_DEGREE = 5
_ELEMENTS = 720


class Film(NamedTuple):
    """The section of the film between two angles."""

    angle: Float[Array, "station #lane"]  # of the stations [rad]
    # between wall and inner face there, linear in between [m]
    gap: Float[Array, "station lane"]
    # length of the wall per angle, one or one a station [m]
    wall_radius: Float[Array, "*#station #lane"]
    # of the wall's normal per angle, likewise; 1 on a circle
    turn: Float[Array, "*#station #lane"] | float = 1.0


def wall_charge(
    film: Film,  # the section
    driven: Bool[Array, "station #lane"] | Bool[np.ndarray, " station"],
    degree: int = _DEGREE,
) -> Float[Array, "station lane"]:
    """Charge on the wall's stations over permittivity and volt, per unit of width.

    The consistent nodal charges, whose weighted sums converge twice as fast as the field.

    `driven`: stations at one volt; the others' potential is free (a bare wall). `degree`: of
    the polynomial across the film. An electrode's edge on a bare wall is a singularity: it
    wants 12 or more.
    Returns the charge divided by eps0 eps_r, dimensionless; zero on a bare wall.
    """
    driven = jnp.reshape(jnp.asarray(driven), (film.angle.shape[0], -1))
    # The last node across the film is the membrane's, at zero.
    blocks = _stiffness(film, degree)
    free = blocks[:, :, :-1, :-1]
    diagonal = at_stations(free[0, 0], free[1, 1])
    upper = free[0, 1]
    wall = np.zeros((degree, 1, 1))
    wall[0] = 1.0
    shape = (degree, film.angle.shape[0], max(driven.shape[-1], film.gap.shape[-1]))
    held = jnp.broadcast_to(jnp.asarray(wall) * driven, shape)
    loose = 1 - held
    whole = BlockTridiagonal(diagonal, upper)
    inner = diagonal * loose[:, None] * loose[None] + np.eye(degree)[:, :, None, None] * held
    between = upper * loose[:, None, :-1] * loose[None, :, 1:]
    right = held - loose * whole.mv(held)
    potential = BlockTridiagonal(inner, between).solve(right[:, None]).solution[:, 0]
    return (whole.mv(potential) * held)[0]


def field_capacitance(
    electrodes: Electrodes,  # taxels, geometry and permittivity
    mechanics: AbstractMechanics,  # the membrane on the whole arc
    q: StationVector,
    elements: int = _ELEMENTS,  # of the film along the arc
) -> Float[Array, "taxel lane"]:
    """Capacitance of every taxel, guarded, from the field instead of a formula [F].

    Takes some milliseconds where the formulas take microseconds; stray capacitance is
    added as there. NaN for all taxels where the membrane touches the wall or folds.
    """
    face = section_of(mechanics).face(q)
    return field_capacitance_under(electrodes, face, elements)


def field_capacitance_under(
    electrodes: Electrodes, face: NormalFace, elements: int = _ELEMENTS
) -> Float[Array, "taxel lane"]:
    """Capacitance of every taxel under a deformed inner face; see `field_capacitance`.

    Raises ValueError: the electrodes have no guard, or layers of their own; or the gap varies
    along the skin.
    """
    if electrodes.geometry.gap_along is not None:
        raise ValueError(
            "the film's field is solved over a wall that is parallel to the membrane at rest: "
            "oil_gap must not be a table"
        )
    if not electrodes.model.guarded:
        raise ValueError("the section's field is that of electrodes with a guard around them")
    geometry, taxels = electrodes.geometry, electrodes.taxels
    angle, length = _even_along_wall(geometry, elements)
    gap = height_at(face, angle) + geometry.gap(angle)
    clear = jnp.all(gap > 0, 0) & ~face.folded
    one = jnp.ones_like(angle)
    _, wall = jax.jvp(lambda x: _wall_length(geometry, x), (angle,), (one,))
    _, turn = jax.jvp(geometry.section.inner_direction, (angle,), (one,))
    film = Film(angle, jnp.where(clear, gap, 1.0), wall, turn)
    charge = wall_charge(film, np.ones(elements + 1, bool))
    if electrodes.layers.ndim > 1:
        raise ValueError("the field model takes the same layers for all taxels")
    # Thin layers in series: they divide each station's voltage with the film.
    width = jnp.diff(length, axis=0)
    width = (jnp.pad(width, [(0, 1), (0, 0)]) + jnp.pad(width, [(1, 0), (0, 0)])) / 2
    charge = charge / (1 + electrodes.layers * electrodes.permittivity * charge / width)
    centre = _wall_length(geometry, taxels.angle)
    weights = chords(length[:, 0], centre[:, 0], taxels.diameter[:, 0])
    sum_ = jnp.einsum("ts,sl->tl", weights, charge) * taxels.diameter
    permittivity = VACUUM_PERMITTIVITY * electrodes.permittivity
    return jnp.where(clear, electrodes.stray + permittivity * sum_, jnp.nan)


def _wall_length(geometry: SkinGeometry, angle: Array) -> Array:
    """Arc length of the wall from the middle, of one gap [m]."""
    section = geometry.section
    turn = section.inner_direction(angle) - section.inner_direction(0 * angle)
    return section.arc(angle) - geometry.oil_gap * turn


def _even_along_wall(geometry: SkinGeometry, elements: int) -> tuple[Array, Array]:
    """Angles of stations that are even along the wall, and where they are on it [rad, m]."""
    share = jnp.linspace(-1, 1, elements + 1)[:, None]
    angle = share * geometry.half_angle
    ends = (_wall_length(geometry, side * geometry.half_angle) for side in (-1, 1))
    first, last = ends
    length = (first + last) / 2 + share * (last - first) / 2

    def step(angle: Array, _: None) -> tuple[Array, None]:
        one = jnp.ones_like(angle)
        at, rate = jax.jvp(lambda x: _wall_length(geometry, x), (angle,), (one,))
        return angle + (length - at) / rate, None

    return jax.lax.scan(step, angle, None, length=INVERSE_STEPS)[0], length


def chords(
    place: Float[Array, " station"],  # of the stations along the wall, evenly spaced [m]
    centre: Float[Array, " taxel"],  # of the discs [m]
    diameter: Float[Array, " taxel"],  # of the discs [m]
) -> Float[Array, "taxel station"]:
    """Chords of discs at the stations over their diameters, projected on linear elements.

    A chord has a vertical tangent at the disc's edge: plain values at the stations would
    miss some of its area. Each is the mean over the station's two elements, weighed by its
    shape function, in closed form.
    """
    step = place[1] - place[0]

    def twice(x: Array) -> Array:
        """Second antiderivative of sqrt(1 - x^2) on [-1, 1], continued beyond."""
        inside = jnp.clip(x, -1.0, 1.0)
        root = jnp.sqrt(jnp.maximum(1 - inside**2, 0.0))
        value = (inside * jnp.arcsin(inside) + root - root**3 / 3) / 2
        slope = (inside * root + jnp.arcsin(inside)) / 2
        return value + slope * (x - inside)

    half = diameter[:, None] / 2
    x, h = (place - centre[:, None]) / half, step / half
    return (twice(x + h) - 2 * twice(x) + twice(x - h)) / h**2


def _stiffness(film: Film, degree: int) -> Float[Array, "2 2 node node element lane"]:
    """Element matrices of the energy integral of |grad u|^2 over the film."""
    eta, eta_weights = gauss_legendre(degree + 2)
    shape, slope = _radial(eta, degree)  # [node, point]
    span = film.angle[1:] - film.angle[:-1]
    rise = (film.gap[1:] - film.gap[:-1]) / span
    total = jnp.zeros(())

    def between(x: Array | float, xi: float) -> Array | float:
        return x if jnp.ndim(x) < 2 else (1 - xi) * x[:-1] + xi * x[1:]  # type: ignore[index]

    for xi, weight in zip(*gauss_legendre(2), strict=True):
        gap = (1 - xi) * film.gap[:-1] + xi * film.gap[1:]
        wall, turn = between(film.wall_radius, xi), between(film.turn, xi)
        side = np.array([1 - xi, xi])
        for k, eta_weight in enumerate(eta_weights):
            radius = wall + eta[k] * gap * turn
            # u = sum over sides and nodes; derivatives by height, and by phi at one height.
            across = side[:, None] * slope[:, k]
            along = np.array([-1.0, 1.0])[:, None] * shape[:, k]
            by_r = across[..., None, None] / gap
            by_phi = along[..., None, None] / span - across[..., None, None] * (
                eta[k] * rise / gap
            )
            area = weight * eta_weight * span * gap
            total = total + area * (
                radius * _outer(by_r, by_r) + _outer(by_phi, by_phi) / radius
            )
    return total


def _outer(a: Array, b: Array) -> Array:
    return a[:, None, :, None] * b[None, :, None, :]


def _radial(eta: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange polynomials across the film and their derivatives [node, point]."""
    nodes = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
    coefficients = np.linalg.inv(np.vander(nodes, increasing=True))
    powers = np.vander(eta, degree + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, degree + 1)
    return (powers @ coefficients).T, (slopes @ coefficients).T
