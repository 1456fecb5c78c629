"""How many elements a solve starts with, and what comes next if the error is too large."""

from typing import NamedTuple

from suas_jax.config import SceneSpec

_MOST_SHELL_ELEMENTS = 512
_MOST_SOLID_ELEMENTS = 1024
_MOST_LAYERS = 8


class Resolution(NamedTuple):
    """Size of a mesh.

    Attributes:
        elements: along the whole arc.
        layers: through the thickness; none for the lumped shell.
    """

    elements: int
    layers: int = 0

    def finer(self) -> "Resolution | None":
        """The next one to try, or None where the limit is reached."""
        most = _MOST_SOLID_ELEMENTS if self.layers else _MOST_SHELL_ELEMENTS
        if 2 * self.elements > most:
            return None
        return Resolution(2 * self.elements, min(2 * self.layers, _MOST_LAYERS))


def forced(scene: SceneSpec) -> Resolution | None:
    """The mesh that the scene insists on, if it does; `mesh` is the solid's."""
    if scene.solve.mesh is not None:
        return Resolution(*scene.solve.mesh)
    return None if scene.solve.elements is None else Resolution(scene.solve.elements)


def first(scene: SceneSpec, model: str) -> Resolution:
    """The mesh to try first for a solve with ``"shell"`` or ``"solid"``."""
    intervals = 2 * (1 + len(scene.loads))
    if model == "shell":
        return Resolution(max(16 if scene.solve.rtol >= 1e-4 else 32, 4 * intervals))
    # Twice as many elements cost less than a second program to compile.
    return Resolution(max(64 if scene.solve.rtol > 2e-3 else 128, 8 * intervals), 2)


def first_of_sweep(scene: SceneSpec, model: str) -> Resolution:
    """The mesh to try first for a curve, where some load is harder than the others."""
    return first(scene, model) if model == "solid" else Resolution(32)
