"""The loads of a solved scene on the page: arrows at known places, and what bodies do."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting.inverse_load.estimate.estimate import Contact
from fitting.view.grid import Grid
from suas_jax.config import SceneSpec

_HALF_WIDTHS = "contact_half_width_m", "contact_half_width_axial_m"


def known_contacts(
    scene: SceneSpec, grid: Grid, loads: Sequence[dict[str, Any]]
) -> dict[int, Contact]:
    """The scene's loads that have a place, by their number.

    `scene`: says how forces are directed. `loads`: what is observed of them.
    """
    found = {}
    for i, (spec, load) in enumerate(zip(scene.loads, loads, strict=True)):
        if spec.kind == "pressure":
            continue
        angle, arc = np.deg2rad(load["angle_deg"]), load.get("arc_m")
        way = "radial" if spec.kind == "body" else spec.direction
        turn = way if isinstance(way, float) else 0.0
        if way == "vertical":
            told = ("angle", angle) if arc is None else ("arc", arc)
            turn = grid.direction(float(grid.places.from_place(told[0], np.asarray(told[1]))))
        axial = None if spec.kind == "line" else load.get("axial_m")
        found[i] = Contact(angle, load["force_N"], turn, None, axial=axial, arc=arc)
    return found


def body_rows(loads: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Travel, force and zone of contact of each body, for the page's table."""
    return [
        (f"body {i + 1}" if len(loads) > 1 else "body", _body(load))
        for i, load in enumerate(loads)
        if "depth_m" in load
    ]


def _body(load: dict[str, Any]) -> str:
    force, depth = load["force_N"], 1e3 * load["depth_m"]
    if force <= 0:
        return f"{depth:.3f} mm, touches nothing"
    zone = [2e3 * load[key] for key in _HALF_WIDTHS if key in load]
    over = " by ".join(f"{x:.1f}" for x in zone) + " mm"
    if not load["contact_resolved"]:
        over = "a zone smaller than the mesh"
    return f"{depth:.3f} mm, {force:.3f} N, over {over}"
