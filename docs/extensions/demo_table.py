"""The front page's demo: gaps and counts of a pad under one finger, from a table of states.

A state is stored on a grid that is denser around the finger and moves with it, so that a coarse
table of places and forces can be interpolated by cubics. Held-out states measure the error.
"""

import base64
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from suas_jax.files.cache_folder import kept_arrays
from suas_jax.runtime.content_key import content_key, source_digest

ROOT = Path(__file__).parents[2]
SKIN = ROOT / "configs" / "skins" / "suas-pad.toml"
TEMPLATE = Path(__file__).with_name("demo.html")
ANGLES = np.deg2rad([0, 12, 24, 36, 48, 60])  # the other quarters are mirror images
AXIALS = np.array([0, 11, 22, 33, 45]) * 1e-3
FORCES = np.array([0, 0.5, 1, 2, 3.5, 5, 7, 10])
SIDES = (14, 10)  # points of the grid on either side of the finger, along the arc and the axis
STEEP = 2.0  # how much denser they are at the finger
UNIT = 1e-7  # of the stored gaps [m]
NODES = {
    "angles": ANGLES, "axials": AXIALS, "forces": FORCES,
    "sides": np.array(SIDES), "steep": STEEP, "unit": UNIT,
}  # fmt: skip
_FINGER = 8e-3  # diameter of the contact [m]
_ELEMENTS = (20, 16)
_HELD_OUT = 24
Floats = NDArray[np.float64]


def page() -> str:
    """The demo as one file of HTML; its table is kept in the user's cache."""
    files = {path.name: path.read_text(encoding="utf-8") for path in (Path(__file__), SKIN)}
    found = kept_arrays(content_key({**files, "source": source_digest()}), make)
    return filled(dict(found))


def filled(data: dict[str, Any]) -> str:
    """The page with a table [angle, axial, force, arc, axis] [units] and what it knows."""
    plain = {name: np.asarray(x).tolist() for name, x in data.items() if name != "table"}
    table = np.asarray(data["table"]).astype("<i2").tobytes()
    text = json.dumps({**plain, "table": base64.b64encode(table).decode()})
    return TEMPLATE.read_text(encoding="utf-8").replace(">DATA<", f">{text}<")


def make() -> dict[str, Any]:
    """The table, its errors, and what the page needs to know of the skin."""
    places = [(a, z, f) for a in ANGLES for z in AXIALS for f in FORCES[1:]]
    most = np.array([ANGLES[-1], AXIALS[-1], FORCES[-1]])
    held_out = np.random.default_rng(0).uniform([0, 0, 0.5], most, (_HELD_OUT, 3))
    states = np.concatenate([places, held_out])
    skin, gap, so = _solved(states)
    size = tuple(2 * n + 1 for n in SIDES)
    change = (gap - skin["oil_gap"]).T.reshape(len(states), *size)
    table = np.zeros((len(ANGLES), len(AXIALS), len(FORCES), *size))
    table[:, :, 1:] = change[: len(places)].reshape(*table.shape[:2], -1, *size)
    stored = np.round(table / UNIT)
    errors = _errors(stored * UNIT, held_out, change[len(places) :], so[len(places) :], skin)
    return {**skin, **NODES, "errors": errors, "held_out": _HELD_OUT, "table": stored}


def along(sides: int, centre: Floats) -> Floats:
    """Places of the grid along one direction, as shares of half the extent [point, state]."""
    share = np.sinh(STEEP * np.linspace(0, 1, sides + 1)[:, None]) / np.sinh(STEEP)
    left, right = centre - (1 + centre) * share[:0:-1], centre + (1 - centre) * share
    return np.concatenate([left, right])


def weights(nodes: Floats, x: float) -> tuple[int, Floats]:
    """Of the cubic through the four nodes around a place: the first node, and its weights."""
    first = int(np.clip(np.searchsorted(nodes, x) - 2, 0, len(nodes) - 4))
    near = nodes[first : first + 4]
    shares = [np.prod([(x - b) / (a - b) for b in near if b != a]) for a in near]
    return first, np.array(shares)


def interpolated(
    table: Floats,  # [angle, axial, force, arc, axis] [m]
    # angle, axial position and force, within the table, none of them negative
    place: tuple[float, float, float],
) -> Floats:
    """Change of the gap on the finger's grid [arc, axis] [m]."""
    for nodes, x in zip((ANGLES, AXIALS, FORCES), place, strict=True):
        first, share = weights(nodes, x)
        table = np.tensordot(share, table[first : first + 4], 1)
    return table


def counts(change: Floats, skin: dict[str, Any], place: Floats) -> Floats:
    """Counts of all taxels: parallel plates over seven points of each footprint."""
    turn = np.arange(6) * np.pi / 3
    reach = skin["diameter"] / 2 * np.sqrt(2 / 3)
    x = np.concatenate([[0], reach * np.cos(turn)]) / skin["wall"]
    y = np.concatenate([[0], reach * np.sin(turn)])
    a = np.asarray(skin["taxel_angle"])[:, None] + x
    z = np.asarray(skin["taxel_axial"])[:, None] + y
    arc = skin["half_angle"] * along(SIDES[0], place[:1] / skin["half_angle"])[:, 0]
    axis = skin["width"] / 2 * along(SIDES[1], 2 * place[1:2] / skin["width"])[:, 0]
    gap = skin["oil_gap"] + RegularGridInterpolator((arc, axis), change)(np.stack([a, z], -1))
    return skin["plate"] * (np.array([2, 1, 1, 1, 1, 1, 1]) / 8 / gap).sum(1)


def _solved(states: Floats) -> tuple[dict[str, Any], Floats, Floats]:
    """The skin, gaps on the finger's grid [point, state], and counts [state, taxel]."""
    from suas_jax import Loads, configure, forward, load_skin, skin_of
    from suas_jax.sensing.taxels import Taxels

    configure()
    spec = load_skin(SKIN)
    assert spec.electrodes is not None
    skin = skin_of(spec, elements=_ELEMENTS, contact=False)
    half, width, film = spec.geometry.half_angle, spec.geometry.width, spec.geometry.mean_gap
    angle, axial, force = states.T
    grid = np.broadcast_arrays(
        half * along(SIDES[0], angle / half)[:, None],
        width / 2 * along(SIDES[1], 2 * axial / width)[None],
    )
    own = skin.electrodes.taxels
    count, shape = len(own.module), (-1, len(states))
    rows = [
        np.concatenate([np.broadcast_to(x, (count, len(states))), g.reshape(shape)])
        for x, g in zip((own.angle, own.axial), grid, strict=True)
    ]
    more = len(rows[0]) - count  # tiny taxels that read the gap on the grid
    diameter = np.concatenate([own.diameter, np.full((more, 1), 1e-4)])
    every = Taxels(*rows, diameter, own.module + (0,) * more, own.number + (0,) * more)
    sensing = dataclasses.replace(skin.electrodes, taxels=every)
    loads = Loads.patch(angle, axial, force, _FINGER)
    output = forward(dataclasses.replace(skin, electrodes=sensing), loads)
    assert not np.any(output.result), "a state of the demo has no equilibrium"
    assert np.min(output.min_gap) > 0, "a state of the demo lies on the wall"
    known = {
        "half_angle": half, "width": width, "oil_gap": film,
        "wall": spec.geometry.inner_radius - film, "noise": spec.electrodes.noise,
        "plate": float(sensing.read_even_film(np.full((1, 1), film))[0, 0]) * film,
        "diameter": float(own.diameter[0, 0]),
        "taxel_angle": np.asarray(own.angle)[:, 0], "taxel_axial": np.asarray(own.axial)[:, 0],
    }  # fmt: skip
    return known, np.asarray(output.readings.gap)[count:], np.asarray(output.so)[:count].T


def _errors(
    table: Floats, held_out: Floats, change: Floats, so: Floats, skin: dict[str, Any]
) -> Floats:
    """Of states that were held out, what 95 % of all errors are below: gap, counts, dent.

    That of a dent, the largest change of the gap in a state, is relative.
    """
    found = np.stack([interpolated(table, tuple(place)) for place in held_out])
    read = np.stack([counts(x, skin, place) for x, place in zip(found, held_out, strict=True)])
    dent = np.abs(found.min((1, 2)) / change.min((1, 2)) - 1)
    own = np.abs(found - change), np.abs(read - so), dent
    return np.array([np.quantile(x, 0.95) for x in own])
