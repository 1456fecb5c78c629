"""Fields of the solid and of the pad as a VTK unstructured grid, for ParaView."""

from pathlib import Path

import meshio
import numpy as np
from jaxtyping import Array

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.figures.section import solid_fields
from suas_jax.files.writing import written
from suas_jax.mechanics.pad.faces import Faces, PadShape, principal_stretches
from suas_jax.mechanics.pad.pad import Pad
from suas_jax.mechanics.solid.element import NODES
from suas_jax.mechanics.solid.fields import Fields
from suas_jax.scene.solve import Solution
from suas_jax.skin.plain import plain_geometry

# A biquadratic quadrilateral of VTK: corners, middles of the edges, centre.
_VTK_NODES = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))


_PAD_SAMPLES = 3  # quadrilaterals along either side of a pad's element


def write_vtu(solution: Solution, file: Path) -> None:
    """Write the undeformed membrane with its displacement and other fields (.vtu), in SI units.

    "Warp By Vector" with the displacement shows it deformed. The solid's section comes with the
    fields through its thickness, the pad as its inner face. Raises ValueError: the solution is
    a section's shell, or the name has another ending.
    """
    if file.suffix.lower() != ".vtu":
        raise ValueError(f'--vtu {file}: the name of the file has to end in ".vtu"')
    if solution.plan.dimension == 3:
        mesh = _pad_mesh(solution)
    elif solution.plan.model == "solid":
        mesh = _section_mesh(solution.read(solid_fields)[0])
    else:
        raise ValueError("a section's fields come with the solid model only")
    with written(file) as draft:
        mesh.write(draft, file_format="vtu")


def _section_mesh(fields: Fields) -> meshio.Mesh:
    """Elements keep nodes of their own, so that fields may jump between them."""
    order = [NODES.index(node) for node in _VTK_NODES]

    def flat(values: Array) -> Array:
        values = values[:, order]
        return values.reshape(-1, *values.shape[2:])

    def spatial(values: Array) -> np.ndarray:
        return np.pad(flat(values), [(0, 0), (0, 1)])

    cells = np.arange(fields.position.shape[0] * len(NODES)).reshape(-1, len(NODES))
    data = {
        "displacement_m": spatial(fields.displacement),
        "pressure_Pa": flat(fields.pressure),
        "strain_energy_density_J_per_m3": flat(fields.energy_density),
        "hoop_stretch": flat(fields.hoop_stretch),
        "radial_stretch": flat(fields.radial_stretch),
        "dilatation": flat(fields.dilatation),
    }
    return meshio.Mesh(spatial(fields.position), [("quad9", cells)], point_data=data)


def _pad_grid(
    problem: Problem, state: State, shown: State
) -> tuple[Faces, Array, Array, Array, Array]:
    """The faces on a grid; of the inner one principal stretches, place, height, angle now."""
    pad = problem.mechanics.around(state.q)
    assert isinstance(pad, Pad)
    grid = pad.sampled(shown.q, _PAD_SAMPLES)
    rest = pad.section.inner_face(grid.angle)
    height, angle, _ = PadShape(grid).inner_face(pad.section)
    return grid, principal_stretches(grid.inner_strain), rest, height, angle


def _pad_mesh(solution: Solution) -> meshio.Mesh:
    """The inner face as quadrilaterals."""
    geometry = plain_geometry(solution.scene.geometry)
    grid, stretches, place, height, angle = solution.read(_pad_grid)
    axial, energy = (np.asarray(x)[..., 0] for x in (grid.axial, grid.energy_density))
    moved = np.moveaxis(np.asarray(grid.inner_displacement)[..., 0], 0, -1)
    arc, along = axial.shape
    rest = np.stack([*place[..., 0], axial], -1)
    now = grid.axial + grid.inner_displacement[2]
    gap = np.asarray(height + geometry.gap(angle, now))[..., 0]
    index = np.arange(arc * along).reshape(arc, along)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    data = {
        "displacement_m": moved.reshape(-1, 3),
        "gap_m": gap.reshape(-1),
        "strain_energy_density_J_per_m3": energy.reshape(-1),
        "smallest_stretch": stretches[0, ..., 0].reshape(-1),
        "largest_stretch": stretches[1, ..., 0].reshape(-1),
    }
    cells = np.stack(corners, -1).reshape(-1, 4)
    return meshio.Mesh(rest.reshape(-1, 3), [("quad", cells)], point_data=data)
