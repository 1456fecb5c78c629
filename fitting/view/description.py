"""What a page needs to know of a skin once: its dimensions, taxels and controls."""

from typing import Any

from fitting.view.grid import Grid
from suas_jax.config import SkinSpec
from suas_jax.scene.taxel_film import TaxelFilm


def describe(
    spec: SkinSpec, grid: Grid, film: TaxelFilm | None, title: str, **more: Any
) -> dict[str, Any]:
    """A skin as the page takes it, in SI units and radians.

    Args:
        spec: the skin.
        grid: of the points that pictures show.
        film: of its taxels; None where it has none.
        title: what is shown.
        more: controls, such as sliders or a timeline.
    """
    geometry = spec.geometry
    taxels = []
    if film is not None:
        rows = zip(film.module, film.number, film.angle, film.axial, film.diameter, strict=True)
        taxels = [
            {
                "name": f"{module}.{number}",
                "angle": float(angle),
                "axial": float(axial),
                "diameter": float(diameter),
            }
            for module, number, angle, axial, diameter in rows
        ]
    return {
        "title": title,
        "dimension": geometry.dimension,
        "inner_radius": geometry.inner_radius,
        "thickness": geometry.thickness,
        "half_angle": geometry.half_angle,
        "width": geometry.width,
        "oil_gap": geometry.oil_gap,
        "grid_angle": grid.angle.tolist(),
        "grid_axial": grid.axial.tolist(),
        "taxels": taxels,
        **more,
    }
