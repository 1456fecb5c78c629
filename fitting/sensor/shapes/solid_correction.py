"""Correction of the shell's shape by a few solutions of the solid.

The corrected shell's shape differs from the continuum's by some 3e-4 of its own displacement,
on thick membranes by more. The difference is small and smooth in the load: the solid is solved
at a few loads of each place, and a polynomial in the displacement adds the difference to every
state.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.shapes.deformations import Deformed, NoDeformation, deform
from suas_jax.config import LineLoadSpec, SceneSpec, SkinSpec, SolveSpec, continuous_inputs
from suas_jax.constitutive import AbstractLaw
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.section import NormalFace, height_at, section_of
from suas_jax.scene.build import Structure, build_problem
from suas_jax.scene.solve import solve
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil

MOST_PLACES = 4
"""Places of a load that the solid is solved for; more are left to the shell."""
_LOADS = 5
# One mesh, one compiled program; to 2e-4 of the displacement, a tenth of the correction.
_MESH = (160, 2)
_GRID = 721


@dataclasses.dataclass(frozen=True)
class SolidCorrection:
    """Solid less shell for one place of one load."""

    angle: float  # of the load [rad]
    turn: float  # of the load [rad]
    scale: float  # displacement that the powers are taken of [m]
    displacement: np.ndarray  # coefficients of powers 1, 2, ... [power, m]
    grid: np.ndarray  # polar angles [point, rad]
    height: np.ndarray  # coefficients of the inner face's height [power, point, m]

    def powers(self, moved: np.ndarray) -> np.ndarray:
        """Powers of the shell's displacement [state, power]."""
        x = moved / self.scale
        return x[:, None] ** np.arange(1, len(self.displacement) + 1)


def corrections(
    spec: SkinSpec,
    loads: KnownLoads,
    shape: Deformed,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
    progress: Callable[[str], None] = lambda text: None,
) -> list[SolidCorrection] | None:
    """Corrections for every place of a load; None where they can't be had cheaply."""
    if loads.angle.shape[0] != 1:
        return None
    moved = np.nan_to_num(shape.force[0]) != 0
    places = np.unique(np.stack([loads.angle[0], loads.turn[0]])[:, moved], axis=1)
    if places.shape[1] > MOST_PLACES:
        return None
    found = []
    for n, (angle, turn) in enumerate(places.T):
        progress(f"solving the solid, place {n + 1} of {places.shape[1]}")
        here = moved & (loads.angle[0] == angle) & (loads.turn[0] == turn)
        one = _correction(spec, loads, shape, here, geometry, law, oil)
        if one is None:
            return None
        found.append(one)
    return found


def _correction(
    spec: SkinSpec,
    loads: KnownLoads,
    shape: Deformed,
    here: np.ndarray,
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
) -> SolidCorrection | None:
    displacement, force = shape.displacement[0, here], shape.force[0, here]
    order = np.argsort(displacement)
    ends = min(displacement.min(), 0.0), max(displacement.max(), 0.0)
    nodes = (1 - np.cos(np.pi * (np.arange(_LOADS) + 1) / _LOADS)) / 2
    if ends[0] < 0:
        nodes = (1 - np.cos(np.pi * np.arange(_LOADS + 1) / _LOADS)) / 2
    wanted = ends[0] + nodes * (ends[1] - ends[0])
    knots = np.concatenate([[0.0], displacement[order]])
    forces = np.concatenate([[0.0], force[order]])
    rank = np.argsort(knots)
    at = np.interp(wanted, knots[rank], forces[rank])
    at = at[np.abs(at) > 1e-9 * np.abs(force).max()]
    count = len(at)
    angle, turn = float(loads.angle[0, here][0]), float(loads.turn[0, here][0])
    arc = float(geometry.section.arc(jnp.array([angle]))[0])
    column = np.ones((1, count))
    try:
        shell = deform(
            KnownLoads(
                angle * column,
                turn * column,
                at[None],
                np.nan * column,
                loads.inner,
                *[0 * column] * 4,
            ),
            geometry,
            law,
            oil,
        )
    except NoDeformation:
        return None
    grid = np.linspace(-1.0, 1.0, _GRID) * float(geometry.half_angle[0])
    difference, height = [], []
    for k, f in enumerate(at):
        scene = SceneSpec(
            geometry=spec.geometry,
            material=spec.material,
            oil=spec.oil,
            load=(LineLoadSpec(kind="line", arc=arc, force=float(f), direction=turn),),
            solve=SolveSpec(model="solid", mesh=_MESH),
        )
        solution = solve(scene)
        if not solution.converged:
            return None
        key = "inner_displacement_m" if loads.inner[0] else "displacement_m"
        difference.append(solution.report["loads"][0][key] - shell.displacement[0, k])
        own = jax.tree.map(lambda x: x[..., k : k + 1], shell.face)  # noqa: B023
        inputs = {key: jnp.asarray(x) for key, x in continuous_inputs(scene).items()}
        more = _height_beyond(
            Structure(scene), solution.plan, inputs, solution.state.q, own, jnp.asarray(grid)
        )
        height.append(np.asarray(more))
    scale = float(np.abs(shell.displacement).max())
    powers = (shell.displacement[0] / scale)[:, None] ** np.arange(1, count + 1)
    return SolidCorrection(
        angle,
        turn,
        scale,
        np.linalg.solve(powers, np.array(difference)),
        grid,
        np.linalg.solve(powers, np.stack(height)),
    )


@eqx.filter_jit
def _height_beyond(
    structure: Structure,
    plan: AbstractPlan,
    inputs: dict[str, Array],
    q: Array,
    shell: NormalFace,
    grid: Array,
) -> Float[Array, " point"]:
    """Height of a solid's inner face less a shell's along rays at angles [m]."""
    mechanics = build_problem(structure.scene, plan, inputs).mechanics
    solid = section_of(mechanics).face(q)
    rays = grid[:, None]
    return (height_at(solid, rays) - height_at(shell, rays))[:, 0]


def corrected(
    shape: Deformed,
    loads: KnownLoads,
    found: list[SolidCorrection],
    geometry: SkinGeometry,
    law: AbstractLaw,
    oil: AbstractOil,
) -> Deformed:
    """States with the corrections added; known displacements are met by the solid's."""
    wanted = np.isfinite(loads.displacement[0])
    if wanted.any():
        less = loads.displacement.copy()
        # The correction is a thousandth: its own change with the load is a millionth.
        for _ in range(2):
            moved = np.where(wanted, less[0], shape.displacement[0])
            more = sum((_of(c, loads, moved) @ c.displacement for c in found), np.zeros(1))
            less[0] = np.where(wanted, loads.displacement[0] - more, np.nan)
        reached = dataclasses.replace(loads, displacement=less)
        shape = deform(reached, geometry, law, oil)
    height = np.array(shape.face.powers)
    edges = np.asarray(shape.face.edges)
    # Powers of the local coordinate -1 ... 1 of an element through five samples.
    order = height.shape[0]
    t = np.cos(np.pi * np.arange(order) / (order - 1))
    inverse = np.linalg.inv(t[:, None] ** np.arange(order))
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    rays = middle + t[:, None, None] * half  # [sample, element, state]
    total = np.array(shape.displacement)
    for c in found:
        powers = _of(c, loads, shape.displacement[0])
        total[0] += powers @ c.displacement
        for j, row in enumerate(c.height):
            spline = CubicSpline(c.grid, row)
            height += (
                np.einsum("ps,sel->pel", inverse, spline(np.clip(rays, c.grid[0], c.grid[-1])))
                * powers[:, j]
            )
    face = NormalFace(shape.face.edges, jnp.asarray(height), shape.face.fold)
    return dataclasses.replace(shape, face=face, displacement=total)


def _of(c: SolidCorrection, loads: KnownLoads, moved: np.ndarray) -> np.ndarray:
    """Powers of the displacement in the states of a place, zero elsewhere [state, power]."""
    here = (loads.angle[0] == c.angle) & (loads.turn[0] == c.turn)
    return np.where(here[:, None], c.powers(np.where(here, moved, 0.0)), 0.0)
