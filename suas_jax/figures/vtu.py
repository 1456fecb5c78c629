"""Fields of the solid as a VTK unstructured grid, for ParaView."""

from pathlib import Path

import meshio
import numpy as np

from suas_jax.files.writing import written
from suas_jax.mechanics.solid.element import NODES
from suas_jax.mechanics.solid.fields import nodal_fields
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.scene.solve import Solution

# A biquadratic quadrilateral of VTK: corners, middles of the edges, centre.
_VTK_NODES = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))


def write_vtu(solution: Solution, file: Path) -> None:
    """Write the reference mesh with displacement, pressure, energy and stretches, in SI units.

    "Warp By Vector" with the displacement shows the deformed section. Elements keep nodes
    of their own, so that fields may jump between them.

    Args:
        solution: a solution with the solid model.
        file: where to write; the name ends in .vtu.

    Raises:
        ValueError: the solution is not one of the solid, or the name has another ending.
    """
    mechanics = solution.problem().mechanics
    if not isinstance(mechanics, Solid):
        raise ValueError("fields through the thickness come with the solid model only")
    if file.suffix.lower() != ".vtu":
        raise ValueError(f'--vtu {file}: the name of the file has to end in ".vtu"')
    fields = nodal_fields(mechanics, solution.state.q)
    order = [NODES.index(node) for node in _VTK_NODES]

    def flat(values: np.ndarray) -> np.ndarray:
        values = values[:, order]
        return values.reshape(-1, *values.shape[2:])

    def spatial(values: np.ndarray) -> np.ndarray:
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
    mesh = meshio.Mesh(spatial(fields.position), [("quad9", cells)], point_data=data)
    with written(file) as draft:
        mesh.write(draft, file_format="vtu")
