"""Small motions of a pad about a state, and what moves with it.

As on a section (`suas_jax.dynamics.inertia`), but the film's flux q is a field over the pad::

    rho dv/dt = -grad p - 12 mu v / h^2,   v = q / h,   div q + w = 0,   none through the edges

Of all fluxes that make room for the membrane's normal velocity w, inertia takes the one of
least kinetic energy, viscosity that of least dissipation: one scalar elliptic problem each,
with the conductances h and h^3, solved by finite volumes on a grid of samples. They are one
flux where the film is even.

The water outside is that of a potential flow around a cylinder: cos(n psi) cos(k z), with z
from one end, where it is taken to be mirrored, to the other, carries per area the mass ::

    rho R K_n(x) / (-x K_n'(x)),   x = k R;   rho R / n for k = 0
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.special
from jaxtyping import Array, Float

from suas_jax.dynamics.inertia import THINNEST_FILM, Densities, Inertia, Matrix, Number
from suas_jax.dynamics.motion import dense, free_unknowns
from suas_jax.dynamics.moving_pad import BATCH, HARMONICS, SAMPLES, Links, MovingPad, areas_of
from suas_jax.equilibrium.balance import State
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.build import Inputs, Structure, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import inputs_of, structure_of
from suas_jax.scene.solve import Solution


class Sheet(NamedTuple):
    """A surface of the pad on the grid of samples."""

    position: Float[np.ndarray, "3 arc axial"]  # in the state [m]
    moved: Float[np.ndarray, "unknown 3 arc axial"]  # displacement by the free unknowns

    def areas(self) -> Float[np.ndarray, "3 arc axial"]:
        """Vectors of the area that a sample stands for, inwards [m^2]."""
        return np.array(areas_of(jnp.asarray(self.position)))

    def swept(self) -> Float[np.ndarray, "sample unknown"]:
        """Volume that every sample sweeps outwards."""
        volumes = -np.einsum("cij,ucij->iju", self.areas(), self.moved, optimize=True)
        return volumes.reshape(-1, volumes.shape[-1])


class PadMotion(NamedTuple):
    """What small motions of a pad are made of, for its free unknowns."""

    # tangent of the membrane under pressure and dead loads [N/m]
    stiffness: Float[np.ndarray, "unknown unknown"]
    volume: Float[np.ndarray, " unknown"]  # derivative of the enclosed volume
    # of the oil, derivative of its volume by its pressure, zero or less [m^3/Pa]
    compliance: float
    inner: Sheet  # the inner face
    middle: Sheet  # the mid-surface
    outer: Sheet  # the outer face
    gap: Float[np.ndarray, "arc axial"]  # thickness of the film [m]
    thickness: Float[np.ndarray, "arc axial"]  # of the membrane [m]
    angle: Float[np.ndarray, " arc"]  # of the samples' rows, as scenes tell it [deg]
    axial: Float[np.ndarray, " axial"]  # of their columns [m]

    def shapes(
        self, vectors: Float[np.ndarray, "unknown mode"]
    ) -> Float[np.ndarray, "mode arc axial"]:
        """Outward displacement of the inner face, the largest one being one."""
        inward = self.inner.areas()
        inward /= np.linalg.norm(inward, axis=0)
        moved = -np.einsum("cij,ucij->uij", inward, self.inner.moved, optimize=True)
        shapes = np.einsum("uij,um->mij", moved, vectors, optimize=True)
        peak = np.argmax(np.abs(shapes).reshape(len(shapes), -1), 1)
        scaled: np.ndarray = shapes / np.take_along_axis(
            shapes.reshape(len(shapes), -1), peak[:, None], 1
        ).reshape(-1, 1, 1)
        return scaled


@eqx.filter_jit
def _program(
    scene: Structure, plan: AbstractPlan, inputs: Inputs, state: State
) -> dict[str, Array]:
    parts = scene_parts(scene.scene, inputs)
    problem = problem_of(parts, plan, wall=scene.wall)
    pad, geometry, q = problem.mechanics, parts.skin.geometry, state.q
    assert isinstance(pad, Pad)
    net = state.pressure - state.factor * problem.external_pressure
    a = pad.assemble(q, net, state.factor)
    free = free_unknowns(pad)
    none = Densities(0.0, 0.0, 0.0, 0.0), jnp.zeros((HARMONICS, HARMONICS))
    near = MovingPad.near(pad, geometry, *none, q)
    grid, section = pad.sampled(q, SAMPLES), geometry.section

    def moved_by(index: Array) -> Array:
        return near.push(jnp.zeros(q.size).at[index].set(1.0).reshape(q.shape))

    return {
        "stiffness": dense(a.tangent, free),
        "volume": a.volume_gradient.reshape(-1)[free],
        "compliance": problem.oil.compliance(state.pressure, pad.film_volume)[0],
        "faces": near.faces,
        "moved": jax.lax.map(moved_by, jnp.asarray(free), batch_size=BATCH),
        "gap": near.gap,
        "thickness": jnp.broadcast_to(section.thickness(grid.angle), grid.angle.shape)[..., 0],
        "axial": grid.axial[0, :, 0],
        "angle": jnp.rad2deg(section.given_angle(grid.angle[:, 0, 0])),
    }


def pad_motion(solution: Solution) -> PadMotion:
    """Small motions about a solved pad.

    `solution`: of a scene in three dimensions, with trapped oil.
    """
    scene = structure_of(solution.scene, wall=solution.wall)
    inputs = inputs_of(solution.scene)
    given = scene, solution.plan, inputs, solution.state
    x = jax.tree.map(np.asarray, COMPILED.run(_program, *given, once=True, long=True))
    inner, middle, outer = (Sheet(x["faces"][k], x["moved"][:, k]) for k in range(3))
    film = x["gap"], x["thickness"], x["angle"], x["axial"]
    found = x["stiffness"], x["volume"], float(x["compliance"])
    return PadMotion(*found, inner, middle, outer, *film)


def pad_inertia(motion: PadMotion, given: Densities) -> Inertia:
    """Masses and damping of small motions.

    `motion`: about a state. `given`: densities and viscosity.
    """
    gap = np.maximum(motion.gap, THINNEST_FILM)
    swept = motion.inner.swept()
    area = np.linalg.norm(motion.inner.areas(), axis=0)
    room = (gap * area).ravel()
    swept -= room[:, None] / np.sum(room) * np.sum(swept, 0)
    source = swept.reshape(*gap.shape, -1)

    def form(oil: Number, viscosity: Number) -> Matrix:
        """Of oil that is kept from flowing by either."""
        fluid = Densities(oil, viscosity, 0.0, 0.0)
        pressure = _driving(motion.inner.position, gap, fluid, source)
        return swept.T @ np.asarray(pressure).reshape(swept.shape)

    mass = motion.thickness * np.linalg.norm(motion.middle.areas(), axis=0)
    moved = (motion.middle.moved * np.sqrt(mass)).reshape(len(swept.T), -1)
    membrane = given.membrane * moved @ moved.T
    water = given.water * _outside(motion)
    return Inertia(form(given.oil, 0.0), membrane, water, form(0.0, given.viscosity))


@jax.jit
def _driving(position: Array, film: Array, fluid: Densities, source: Array) -> Array:
    """Pressures that drive what samples sweep within a second."""
    return Links.over(position, film, fluid, jnp.ones(())).potential(source)


def _outside(motion: PadMotion) -> Matrix:
    """Added mass of the fluid outside, per density."""
    position, swept = motion.outer.position, motion.outer.swept()
    _, arc, axial = position.shape
    middle = position[:, :, axial // 2]
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle, axis=1), axis=0)))
    z = motion.axial - motion.axial[0]
    width = z[-1]
    n, m = np.arange(HARMONICS), np.arange(HARMONICS)
    around = np.cos(n[:, None] * np.pi * s / s[-1])
    along = np.cos(m[:, None] * np.pi * z / width)
    flux = np.einsum(
        "ni,mj,iju->nmu", around, along, swept.reshape(arc, axial, -1), optimize=True
    )
    weights = outside_of(s[-1], width)
    rows = flux.reshape(-1, flux.shape[-1])
    form: np.ndarray = rows.T @ (weights.ravel()[:, None] * rows)
    return form


def outside_of(arc: float, width: float) -> Float[np.ndarray, "harmonic harmonic"]:
    """Added mass of what harmonics along arc and axis sweep, per density [1/m^3].

    `arc`: length of the outer face from clamp to clamp [m]. `width`: of the pad [m].
    """
    n, m = np.arange(HARMONICS), np.arange(HARMONICS)
    norms = np.outer(np.where(n > 0, arc / 2, arc), np.where(m > 0, width / 2, width))
    x = m * arc / width
    return added_mass(n[:, None], x[None]) * arc / np.pi / norms


def added_mass(n: np.ndarray, x: np.ndarray) -> np.ndarray:
    """K_n(x) / (-x K_n'(x)), 1/n for x = 0; zero for n = x = 0, which keeps no volume."""
    safe = np.where(x > 0, x, 1.0)
    slope = (scipy.special.kve(n - 1, safe) + scipy.special.kve(n + 1, safe)) / 2
    far = scipy.special.kve(n, safe) / (safe * slope)
    plane = np.where(n > 0, 1 / np.maximum(n, 1), 0.0)
    found: np.ndarray = np.where(x > 0, far, plane)
    return found
