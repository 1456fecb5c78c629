"""Labelled drawings of the skin, from the project's own sections, bodies and taxels.

    python docs/extensions/drawings.py

writes them to docs/drawings; a test draws them again and compares.
"""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from svg import Drawing, polar

from suas_jax import configure
from suas_jax.config import SceneSpec, load_scene, load_skin, scene_from_dict
from suas_jax.figures.outline import Outline, outline
from suas_jax.sensing.taxels import PAPER_NUMBERING, module_places, taxel_places

ROOT = Path(__file__).parents[2]
SKINS = ROOT / "configs" / "skins"
FOLDER = ROOT / "docs" / "drawings"
_RADIUS, _OUTER, _WALL = 57.5, 59.0, 52.5  # of suas.toml [mm], where a label belongs


def _scene(*loads: dict[str, Any]) -> SceneSpec:
    table = {"skin": str(SKINS / "suas.toml"), "load": list(loads)}
    return scene_from_dict(table)


def _line(angle: str, direction: str = "radial") -> dict[str, Any]:
    return {"kind": "line", "angle": angle, "force": "10 N", "direction": direction}


def _millimetres(drawn: Outline) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outer face, inner face and wall [point, 2]."""
    return 1e3 * drawn.outer.T, 1e3 * drawn.inner.T, 1e3 * drawn.wall.T


def _skin(picture: Drawing, drawn: Outline) -> None:
    """Membrane, film, wall and clamps, across the axis."""
    outer, inner, wall = (x[::4] for x in _millimetres(drawn))
    picture.area([*wall, wall[0]], "wall")
    picture.area([*inner, *wall[::-1]], "film")
    picture.area([*outer, *inner[::-1]], "membrane")
    for end in (0, -1):
        left, right = sorted((wall[end, 0], outer[end, 0]))
        picture.area([(left, 0), (right, 0), (right, -4), (left, -4)], "clamp")


def section() -> Drawing:
    """The parts of a skin across its axis."""
    drawn = outline(_scene(_line("45 deg")))
    picture = Drawing("A section with the names of its parts", (720, 335), 3.7, (360, 282))
    _skin(picture, drawn)
    wall, given = _millimetres(drawn)[2], drawn.given
    for taxel in load_skin(SKINS / "suas.toml").electrodes.taxels:
        middle = np.degrees(taxel.angle)
        reach = np.degrees(taxel.diameter * 1e3 / 2 / _WALL)
        ends = [middle - reach, middle, middle + reach]
        picture.curve([[np.interp(a, given, x) for x in wall.T] for a in ends], "strip")
    picture.curve([(0, 0), (0, 70)], "dashed")
    picture.words((2, 69), "symmetry axis", "start", "small")
    picture.note(polar(_OUTER, 0), (-10, 66), "crown", "end")
    picture.note(polar(_RADIUS + 0.7, -40), (-52, 56), "membrane", "end")
    picture.note(polar(55, -62), (-60, 38), "oil film", "end")
    picture.note(polar(_WALL, -30), (-21, 30), "taxel")
    picture.words((-22, 9), "rigid wall")
    picture.note((-57, -2.5), (-62, -9), "clamped edge", "end")
    picture.arrow([(0, 0), polar(_RADIUS, 38)])
    picture.words((22, 24), "inner_radius", "start")
    turn = np.linspace(0, 90, 31)
    picture.arrow(polar(15, turn), "arc")
    picture.words((16, 9), "half_angle", "start")
    picture.note(polar(55, 58), (58, 41), "oil_gap", "start")
    picture.arrow([polar(_WALL, 58), polar(_RADIUS, 58)], both=True)
    picture.note(polar(_RADIUS + 0.7, 40), (52, 56), "thickness", "start")
    picture.note(polar(_OUTER, 70), (64, 26), "outer face", "start")
    picture.note(polar(_RADIUS, 78), (66, 12), "inner face", "start")
    return picture


def directions() -> Drawing:
    """Angles, arcs and the directions of loads."""
    loads = (_line("50 deg"), _line("-25 deg", "25 deg"), _line("-60 deg", "vertical"))
    drawn = outline(_scene(*loads))
    picture = Drawing(
        "Angles, arc lengths and directions of loads", (720, 370), 3.7, (360, 322)
    )
    _skin(picture, drawn)
    outer = _millimetres(drawn)[0]
    picture.curve([(0, 0), (0, 76)], "dashed")
    picture.arrow([(0, 0), (22, 0)])
    picture.arrow([(0, 0), (0, 22)])
    picture.words((25, 0), "x")
    picture.words((-3.5, 21), "y")
    for place, push in zip(drawn.load_angle, drawn.load_push, strict=True):
        at = np.array([np.interp(place, drawn.angle, x) for x in outer.T])
        picture.arrow([at - 17 * push, at], "load")
    picture.curve([(0, 0), polar(_OUTER, 50)], "dashed")
    picture.arrow(polar(34, np.linspace(0, 50, 31)), "arc")
    picture.words((16, 38), "angle", "start")
    picture.curve([polar(_OUTER, -25), polar(80, -25)], "dashed")
    picture.words(polar(84, 50), "radial", "start")
    picture.words(np.add(polar(90, -25), (-7, -5)), '"25 deg": counter-clockwise', "middle")
    picture.words(np.add(polar(_OUTER, -60), (-4, 17)), "vertical", "end")
    picture.arrow(polar(_RADIUS, np.linspace(0, 28, 21)), "arc")
    picture.note(polar(_RADIUS, 20), (26, 70), "arc: along the inner face", "start")
    picture.words((0, -9), "positive angles and arcs lie towards +x", "middle", "small")
    return picture


def _view(points: np.ndarray) -> np.ndarray:
    """Places (x, y, axial) seen from above and to the left of the near end [point, 2]."""
    turn, rise = np.radians(38.0), np.radians(28.0)
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    across = x * np.cos(turn) + z * np.sin(turn)
    depth = z * np.cos(turn) - x * np.sin(turn)
    return np.stack([across, y * np.cos(rise) + depth * np.sin(rise)], -1)


def _on_pad(radius: float, angle: Any, axial: Any) -> np.ndarray:
    angle, axial = np.broadcast_arrays(np.asarray(angle, float), np.asarray(axial, float))
    return _view(np.concatenate([polar(radius, angle), axial[..., None]], -1))


def pad() -> Drawing:
    """A pad with its coordinates and a patch of load."""
    picture = Drawing("A pad with its coordinates", (720, 420), 2.9, (280, 262))
    half, near = 61.5, -61.5
    grid = np.linspace(-90, 90, 19)
    # Far strips first: what is nearer covers them.
    for high, low in itertools.pairwise(np.linspace(half, -half, 7)):
        for left, right in itertools.pairwise(grid[::-1]):
            corners = [(left, low), (right, low), (right, high), (left, high)]
            picture.area([_on_pad(_OUTER, *corner) for corner in corners], "skin")
    turn = np.linspace(-90, 90, 61)
    rings = [_on_pad(radius, turn, near) for radius in (_OUTER, _RADIUS, _WALL)]
    picture.area([*rings[2], rings[2][0]], "wall")
    picture.area([*rings[1], *rings[2][::-1]], "film")
    picture.area([*rings[0], *rings[1][::-1]], "membrane")
    load = load_scene(ROOT / "configs" / "scenes" / "pad_fingers.toml").loads[0]
    angle, axial = float(np.degrees(load.angle)), 1e3 * load.axial
    around = np.linspace(0, 2 * np.pi, 41)
    reach = 7.0
    patch = _on_pad(
        _OUTER,
        angle + np.degrees(reach / _OUTER) * np.cos(around),
        axial + reach * np.sin(around),
    )
    picture.area(patch, "patch")
    picture.arrow([_on_pad(_OUTER + 26, angle, axial), _on_pad(_OUTER, angle, axial)], "load")
    picture.words(_on_pad(_OUTER + 30, angle, axial), "force on a patch", "end")
    picture.curve(_on_pad(_OUTER, 0.0, np.linspace(near, half, 3)), "dashed")
    picture.arrow(_on_pad(_OUTER, np.linspace(0, angle, 21), axial), "arc")
    picture.note(_on_pad(_OUTER, angle / 2, axial), (-22, 82), "angle", "start")
    picture.arrow(_on_pad(_OUTER, 0.0, np.array([0.0, axial])), "arc")
    picture.note(_on_pad(_OUTER, 0.0, axial / 2), (62, 82), "axial", "start")
    picture.disc(_on_pad(_OUTER, 0.0, 0.0), 1.0, "head")
    picture.note(_on_pad(_OUTER, 0.0, 0.0), (62, 75), "crown, middle of the pad", "start")
    picture.note(_on_pad(_OUTER - 1, 78.0, near), (-26, -42), "clamped curved end", "end")
    picture.note(_on_pad(_OUTER, 90.0, 45.0), (86, -6), "clamped straight edge", "start")
    picture.arrow(_on_pad(_OUTER + 6, 90.0, np.array([near, half])), both=True)
    picture.words(np.add(_on_pad(_OUTER + 12, 90.0, -20.0), (0, -6)), "width", "start")
    picture.words(_on_pad(26, 0.0, near), "rigid wall")
    return picture


def taxels() -> Drawing:
    """Taxels of a pad on its unrolled wall, and one of its triangles."""
    skin = load_skin(SKINS / "suas-pad.toml")
    picture = Drawing("Taxels of a pad and of one triangle", (720, 320), 2.05, (180, 150))
    half, end = _WALL * np.pi / 2, 61.5
    picture.area([(-half, -end), (half, -end), (half, end), (-half, end)], "wall")
    for module in skin.electrodes.modules:
        centre = np.array([_WALL * module.angle, 1e3 * module.axial])
        picture.area([centre + x for x in _triangle(24.0, module.rotation)], "module")
    for place in taxel_places(skin.electrodes, skin.geometry).values():
        picture.disc(1e3 * np.array(place), 2.0, "taxel")
    picture.words((0, 66), "the pad's wall, unrolled", "middle", "title")
    picture.arrow([(-40, -67), (40, -67)])
    picture.words((0, -73), "angle or arc")
    picture.arrow([(half + 4, -20), (half + 4, 20)])
    picture.words((half + 6, 0), "axial", "start")
    picture.scale, picture.origin = 8.2, (575, 165)
    _module(picture)
    return picture


def _triangle(edge: float, rotation: float) -> np.ndarray:
    """Corners about the centroid [mm]; without rotation one points along +axial."""
    places = edge / np.sqrt(3) * polar(1.0, np.array([0.0, 120.0, 240.0]))
    cos, sin = np.cos(rotation), np.sin(rotation)
    return places @ np.array([[cos, sin], [-sin, cos]])


def _module(picture: Drawing) -> None:
    """One triangle with the numbers of its taxels."""
    pitch = 5.2264
    picture.area(_triangle(24.0, 0.0), "module")
    places = pitch * module_places()
    for place, number in zip(places, PAPER_NUMBERING, strict=True):
        picture.disc(place, 2.0, "taxel")
        picture.words(place, str(number), "middle", "small")
    picture.words((0, 17), "a ROBOSKIN triangle", "middle", "title")
    low = places[-1][1] - 4.5
    picture.arrow([(places[-2][0], low), (places[-1][0], low)], both=True)
    picture.words((places[-1][0] - pitch / 2, low - 1.8), "pitch")
    picture.arrow([(-14, low), (-7, low)])
    picture.words((-10, low - 1.8), "+angle")
    picture.arrow([(-14, low), (-14, low + 7)])
    picture.words((-14, low + 8.2), "+axial")
    picture.arrow(polar(6.5, np.linspace(75, 25, 21)) + places[4] + (4.6, 2.6), "arc")
    picture.words((9, 9.5), "rotation", "start")


def bodies() -> Drawing:
    """Bodies as they touch a section, and how they lie on a pad."""
    body = {"kind": "body", "depth": "0 mm"}
    drawn = outline(
        _scene(
            {**body, "shape": "cylinder", "radius": "10 mm", "angle": "-50 deg"},
            {**body, "shape": "wedge", "radius": "2 mm", "opening": "60 deg", "angle": "0 deg"},
            {**body, "shape": "plate", "angle": "50 deg"},
        )
    )
    picture = Drawing("Bodies that press on a skin", (720, 510), 3.1, (360, 300))
    _skin(picture, drawn)
    behind = {"cylinder": 20.0, "wedge": 23.6, "plate": 4.0}  # from tip to back [mm]
    for (name, back), surface, way in zip(
        behind.items(), drawn.bodies, drawn.body_way, strict=True
    ):
        shape = 1e3 * surface.T[::6]
        if name == "cylinder":
            centre = shape[len(shape) // 2] - 10 * way
            shape = centre + polar(10.0, np.linspace(0, 360, 61))
        elif name == "plate":
            shape = np.concatenate([shape[[0, -1]], shape[[-1, 0]] - 4 * way])
        picture.area(shape, "body")
        tip = _OUTER * -way
        picture.arrow([tip - (back + 14) * way, tip - (back + 1.5) * way], "load")
        beside = {"wedge": (17.0, 6.0)}.get(name, (0.0, 0.0))
        picture.words(tip - (back + (0 if name == "wedge" else 19)) * way + beside, name)
    picture.words((0, 32), "depth: travel along the arrow,")
    picture.words((0, 25), "from first touch on")
    picture.disc(polar(_OUTER, -50), 0.9, "load-head")
    picture.note(polar(_OUTER, -50), (-30, 12), "reference point")
    _plans(picture)
    return picture


def _plans(picture: Drawing) -> None:
    """Sphere, cylinder and box from above, on the unrolled pad."""
    middle = -42.0
    picture.words((0, -17), "on a pad, seen from outside", "middle", "title")
    picture.disc((-66, middle), 9.0, "body")
    picture.arrow([(-66, middle), (-57, middle)])
    picture.words((-66, middle - 15), "sphere: radius")
    turn = np.radians(30.0)
    along = np.array([np.cos(turn), -np.sin(turn)])  # as `suas_jax.skin.body.Body.of` turns
    side = np.array([np.sin(turn), np.cos(turn)])

    def rounded(length: float, width: float, edge: float) -> list[np.ndarray]:
        corners = [(1, 1, 0), (-1, 1, 90), (-1, -1, 180), (1, -1, 270)]
        found = []
        for x, y, first in corners:
            for angle in np.radians(np.linspace(first, first + 90, 9)):
                a = x * (length / 2 - edge) + edge * np.cos(angle)
                b = y * (width / 2 - edge) + edge * np.sin(angle)
                found.append(a * along + b * side)
        return found

    for centre, shape, name in (
        ((-2.0, middle), rounded(12, 36, 6), "cylinder: radius, length, turn"),
        ((62.0, middle), rounded(30, 16, 2), "box: size, edge, turn"),
    ):
        place = np.array(centre)
        picture.area([place + x for x in shape], "body")
        picture.curve([place, np.add(place, (0, 20))], "dashed")
        picture.arrow(place + polar(15, np.linspace(0, 30, 13)), "arc")
        picture.words(np.add(place, (0, -22)), name)
    picture.arrow([(-104, middle - 10), (-94, middle - 10)])
    picture.arrow([(-104, middle - 10), (-104, middle)])
    picture.words((-93, middle - 10), "arc", "start", "small")
    picture.words((-104, middle + 3), "axis", "middle", "small")


DRAWINGS: dict[str, Callable[[], Drawing]] = {
    "section": section,
    "directions": directions,
    "pad": pad,
    "taxels": taxels,
    "bodies": bodies,
}


def main() -> None:
    """Write all drawings."""
    configure()
    FOLDER.mkdir(exist_ok=True)
    for name, draw in DRAWINGS.items():
        draw().write(FOLDER / f"{name}.svg")


if __name__ == "__main__":
    main()
