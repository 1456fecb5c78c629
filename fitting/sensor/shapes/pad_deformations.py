"""The pad's shape in every known state of an experiment, as the taxels see it.

A state is some round contacts whose force is known, or one whose displacement is: then its
force is found by the secant method. The inner face is kept along the taxels' own rays.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.shapes.deformations import NoDeformation
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.correction import corrected
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.face import AbstractFace
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import PAD_ELEMENTS, Skin
from suas_jax.sensing.electrodes import Electrodes
from suas_jax.sensing.taxels import DISC
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil

DIAMETER = 6e-3
"""Of contacts whose diameter no column gives [m]."""
_ACCURACY = 1e-7  # of a displacement that is met [m]
_SECANTS = 12
_FIRST = 1e-4  # first force of a secant, in terms of the shear modulus and the thickness


class TaxelFace(AbstractFace):
    """A deformed inner face that is known along the taxels' own rays alone.

    Attributes:
        heights: over the undeformed face, ray by ray [ray, taxel, state] [m].
    """

    varies_along_axis: ClassVar[bool] = True
    heights: Float[Array, "ray taxel state"]

    def gaps(
        self, rays: Sequence[tuple[Array, Array]], geometry: SkinGeometry
    ) -> list[Float[Array, "taxel state"]]:
        """Gaps along the rays that the heights are of; see the base class."""
        assert len(rays) == len(self.heights)
        pairs = zip(self.heights, rays, strict=True)
        return [height + geometry.gap(angle, axial) for height, (angle, axial) in pairs]

    def height(self, angle: Array, axial: Array) -> Array:
        """See the base class.

        Raises:
            ValueError: always; heights are known along the taxels' own rays alone.
        """
        raise ValueError("a calibration knows the pad along its taxels' own rays alone")


def taxel_face(face: AbstractFace, electrodes: Electrodes, geometry: SkinGeometry) -> TaxelFace:
    """What of a pad's inner face the taxels see."""
    rays = electrodes.taxels.rays(DISC, geometry)
    pairs = zip(face.gaps(rays, geometry), rays, strict=True)
    return TaxelFace(jnp.stack([gap - geometry.gap(*ray) for gap, ray in pairs]))


@dataclasses.dataclass(frozen=True)
class PadDeformed:
    """Solved states.

    Attributes:
        face: the deformed inner faces.
        force: on each load, given or found [load, state] [N].
        displacement: of each load [load, state] [m].
    """

    face: TaxelFace
    force: Floats
    displacement: Floats


def deform_pad(
    loads: KnownLoads,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
    electrodes: Electrodes,
) -> PadDeformed:
    """Find the shape of the pad in every state.

    Raises:
        NoDeformation: a state has no equilibrium, or its displacement is not met.
        ValueError: a load is turned, or several displacements are known at once.
    """
    if np.any(loads.turn):
        raise ValueError("known loads on a pad are radial: leave the direction out")
    skin = Skin(geometry, law, oil, electrodes, elements=PAD_ELEMENTS)
    wanted = np.isfinite(loads.displacement)
    if (wanted.sum(0) > 1).any():
        raise ValueError("on a pad only one displacement at a time can be a known input")
    stiffness = float(np.asarray(law.shear_modulus).reshape(-1)[0])
    first = _FIRST * stiffness * float(geometry.thickness[0]) ** 2
    found = [_state(skin, loads, k, first) for k in range(loads.states)]
    radius, force, moved = (np.stack(x, -1) for x in zip(*found, strict=True))
    return PadDeformed(TaxelFace(jnp.asarray(radius)), force, moved)


def patches_of(loads: KnownLoads, k: int, force: NDArray) -> Loads:
    """The round contacts of a state under some forces [load, N]."""
    diameter = np.where(loads.diameter[:, k] > 0, loads.diameter[:, k], DIAMETER)
    columns = (loads.angle[:, k], loads.axial[:, k], force, diameter)
    return Loads.patch(*(x[:, None] for x in columns))


def _state(
    skin: Skin, loads: KnownLoads, k: int, first: float
) -> tuple[NDArray, NDArray, NDArray]:
    """Radii, forces and displacements of one state."""
    wanted = loads.displacement[:, k]
    force = np.where(np.isfinite(wanted), 0.0, np.nan_to_num(loads.force[:, k]))

    def run(force: NDArray) -> tuple[NDArray, NDArray]:
        patches = patches_of(loads, k, force)
        found = COMPILED.run(_RESPOND, skin.around(patches), patches)
        radius, mid, inner, result = (np.asarray(x) for x in found)
        if int(result):
            name = NAMES[int(result)]
            where = ", ".join(
                f"{f:.4g} N at {np.rad2deg(a):.4g} deg, {1e3 * z:.4g} mm"
                for f, a, z in zip(force, loads.angle[:, k], loads.axial[:, k], strict=True)
            )
            raise NoDeformation(f"{where}: {name}. {advice(name)}; check the columns' units")
        return radius, np.where(loads.inner, inner, mid)

    if not np.isfinite(wanted).any():
        radius, moved = run(force)
        return radius, force, moved
    i = int(np.flatnonzero(np.isfinite(wanted))[0])
    if wanted[i] == 0 and not force.any():
        radius, moved = run(force)
        return radius, force, moved
    return _met(run, force, i, float(wanted[i]), first)


def _met(
    run: Callable[[NDArray], tuple[NDArray, NDArray]],
    force: NDArray,
    i: int,
    wanted: float,
    first: float,
) -> tuple[NDArray, NDArray, NDArray]:
    """The state in which load i has moved as wanted, by the secant method."""
    before, offset = 0.0, -wanted
    force[i] = np.sign(wanted) * first
    for _ in range(_SECANTS):
        radius, moved = run(force)
        missing = float(moved[i]) - wanted
        if abs(missing) < _ACCURACY:
            return radius, force, moved
        slope = (missing - offset) / (force[i] - before)
        before, offset = force[i], missing
        # The pad softens under load: a step doubles the displacement at most.
        step = -missing / slope
        limit = max(abs(float(moved[i])), 0.1 * abs(wanted)) * 2 / abs(slope)
        force[i] = before + float(np.clip(step, -limit, limit))
    raise NoDeformation(
        f"load {i}: no force moves the pad by {1e3 * wanted:.4g} mm; check the column's unit "
        "and sign"
    )


def respond(skin: Skin, patches: Loads) -> tuple[Any, ...]:
    """Heights along the taxels' rays, displacements of mid-surface and inner face, result."""
    problem = skin.problem(patches)
    found = equilibrium(problem)
    q = corrected(problem, found.state).state.q
    pad = problem.mechanics
    heights = taxel_face(pad.face(q), skin.electrodes, skin.geometry).heights[..., 0]
    mid, inner = [], []
    for load in patches.patches():
        moved = pad.under(q, load)
        mid.append(jnp.sum(moved.mid_displacement * load.direction(pad.section)))
        inner.append(jnp.sum(moved.inner_displacement * load.direction(pad.section)))
    return heights, jnp.stack(mid), jnp.stack(inner), found.result[0]


_RESPOND = eqx.filter_jit(respond)
