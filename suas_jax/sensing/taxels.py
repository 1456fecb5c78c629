"""Where the taxels are: round electrodes on the wall, one by one or in triangles.

Positions are angles of the section and axial coordinates. A triangular module carries ten
taxels in rows of 1, 2, 3 and 4, a pitch apart, measured along the wall; its single taxel
points along +axial and a row runs towards +angle until the module
is turned (positive from +angle towards +axial).
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.config import (
    ConfigError,
    ElectrodesSpec,
    GeometrySpec,
    ModuleSpec,
    TaxelSpec,
    format_quantity,
)
from suas_jax.config.errors import Mistake
from suas_jax.config.schema_skin import MODULE_TAXELS
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.plain import along_wall

PAPER_NUMBERING = (1, 2, 3, 4, 10, 5, 6, 7, 8, 9)
"""Numbers of a module's places along its rows; the centroid's is 10, as in the paper."""

PLACE_CHANNELS = (9, 8, 11, 7, 3, 0, 5, 4, 2, 1)
"""Converter channel of each place on an iCub's triangle; of its twelve channels 6 and 10 are
thermal pads, which lie under no taxel and are not counts of a log."""


class Footprint(NamedTuple):
    """Quadrature over a disc of unit radius."""

    places: np.ndarray  # along the arc and along the axis [ray, 2]
    weights: np.ndarray  # of the places, their sum one [ray]
    centre: int  # position of the disc's centre among the places

    def average(self, values: Iterable[Float[Array, "taxel lane"]]) -> Array:
        """Mean over the footprints [taxel, lane] of values on the rays, ray by ray."""
        return sum(w * v for w, v in zip(self.weights, values, strict=True))


def _chords(rays: int) -> Footprint:
    """Places along the arc alone, where nothing changes along the axis.

    The disc's chords weigh the points along the arc by sqrt(1 - x^2): Gauss-Chebyshev
    quadrature of the second kind, exact for polynomials of degree 2 rays - 1 in x.
    """
    k = np.arange(1, rays + 1)
    x = -np.cos(k * np.pi / (rays + 1))
    weights = 2 / (rays + 1) * np.sin(k * np.pi / (rays + 1)) ** 2
    return Footprint(np.stack([x, 0 * x], 1), weights, rays // 2)


def _disc() -> Footprint:
    """The centre and a hexagon, exact for polynomials of degree 5 in both directions."""
    turn = np.arange(6) * np.pi / 3
    hexagon = np.sqrt(2 / 3) * np.stack([np.cos(turn), np.sin(turn)], 1)
    places = np.concatenate([np.zeros((1, 2)), hexagon])
    return Footprint(places, np.array([2, 1, 1, 1, 1, 1, 1]) / 8, centre=0)


# Measured on the paper's cases against 41 rays: 3e-5 of the capacitance for 4 mm electrodes,
# 1e-4 for 16 mm.
CHORDS = _chords(5)
"""Rays under a membrane in plane strain."""
DISC = _disc()
"""Rays under a membrane whose gap varies in both directions."""
EVEN = Footprint(np.zeros((1, 2)), np.ones(1), centre=0)
"""The one ray that an even film needs."""


def module_places() -> Float[np.ndarray, "place 2"]:
    """Places of a module's ten taxels about their centroid, in pitches.

    Row by row from the single taxel, each row towards +angle: components along +angle and
    +axial of a module that is not turned. Times 6.533 mm they are the positions measured
    on an iCub's triangle (`tests/data/roboskin_triangle_10taxel_layout.csv`) to 3 um.
    """
    height = np.sqrt(3) / 2
    return np.array(
        [(place - row / 2, (2 - row) * height) for row in range(4) for place in range(row + 1)]
    )


class Taxels(eqx.Module):
    """Round electrodes on the wall."""

    angle: Float[Array, "taxel #lane"]  # of the centres, from the symmetry axis [rad]
    axial: Float[Array, "taxel #lane"]  # of the centres, from mid-width [m]
    diameter: Float[Array, "taxel #lane"]  # [m]
    module: tuple[int, ...] = eqx.field(static=True)  # which module a taxel belongs to, from 0
    number: tuple[int, ...] = eqx.field(static=True)  # of the taxel in its module, from 1

    @property
    def places(self) -> Float[np.ndarray, "taxel 2"]:
        """Angle [rad] and axial position [m] of the centres, where known."""
        return np.stack([np.asarray(x)[:, 0] for x in (self.angle, self.axial)], 1)

    @property
    def area(self) -> Float[Array, "taxel #lane"]:
        """Of the electrodes [m^2]."""
        return jnp.pi / 4 * self.diameter**2

    def positions(
        self, geometry: SkinGeometry, height: Float[Array, "taxel #lane"] | float
    ) -> Float[Array, "taxel 3"]:
        """The centres in space: x towards growing angles, y to the crown, z along the axis [m].

        `geometry`: of the skin whose wall they lie on. `height`: above the wall [m].
        """
        section = geometry.section
        below = geometry.gap(self.angle, self.axial) - height
        x, y = section.inner_face(self.angle) - below * section.inner_normal(self.angle)
        return jnp.stack(jnp.broadcast_arrays(x, y, self.axial), 1)[..., 0]

    def rays(self, footprint: Footprint, geometry: SkinGeometry) -> list[tuple[Array, Array]]:
        """Angle [rad] and axial position [m] of the taxels' rays, [taxel, lane] each.

        `footprint`: where the gap is taken to average over an electrode. `geometry`: of the
        skin whose wall they lie on.
        """
        x, y = jnp.asarray(footprint.places).T[..., None, None] * self.diameter / 2
        # All at once: each call would trace the section anew.
        angles = geometry.along_wall(self.angle, x, self.axial)
        return list(zip(angles, self.axial + y, strict=True))


def taxels_of(
    electrodes: ElectrodesSpec, numbers: Mapping[str, Any], geometry: SkinGeometry
) -> Taxels:
    """Taxels of [electrodes], ordered by module and number.

    `electrodes`: says which layout; its numbers are not used. `numbers`: SI values by TOML
    path.
    """

    def column(table: str, count: int, key: str) -> Array:
        paths = (f"electrodes.{table}.{i}.{key}" for i in range(count))
        return jnp.stack([jnp.asarray(numbers[path], float) for path in paths])[..., None]

    def placed(table: str, specs: Sequence[Any]) -> Array:
        """Angles of taxels or modules, as sections define them."""
        by_arc = np.array([spec.arc is not None for spec in specs])
        given = [
            jnp.asarray(numbers[f"electrodes.{table}.{i}.{'arc' if arc else 'angle'}"], float)
            for i, arc in enumerate(by_arc)
        ]
        places, section = jnp.stack(given)[..., None], geometry.section
        if not by_arc.any():
            return section.from_given_angle(places)
        arcs = section.from_arc(jnp.where(by_arc[:, None], places, 0.0))
        return jnp.where(by_arc[:, None], arcs, section.from_given_angle(places))

    names = electrodes.taxel_names
    if electrodes.layout == "list":
        count = len(electrodes.taxels)
        angle = placed("taxels", electrodes.taxels)
        axial, diameter = (column("taxels", count, key) for key in ("axial", "diameter"))
        return Taxels(angle, axial, diameter, *names)
    modules = electrodes.modules
    angle = placed("modules", modules)
    axial, rotation, pitch, diameter = (
        column("modules", len(modules), key)
        for key in ("axial", "rotation", "pitch", "diameter")
    )
    order = np.stack([_places_by_number(m.numbering) for m in modules])
    x, y = np.moveaxis(module_places()[order], -1, 0)[..., None]  # [module, taxel, 1]
    x, y = x * pitch[:, None], y * pitch[:, None]
    cos, sin = jnp.cos(rotation)[:, None], jnp.sin(rotation)[:, None]
    axial = axial[:, None] + x * sin + y * cos
    angle = geometry.along_wall(angle[:, None], x * cos - y * sin, axial)
    diameter = jnp.broadcast_to(diameter[:, None], axial.shape)

    def flat(x: Array) -> Array:
        return x.reshape(-1, x.shape[-1])

    return Taxels(flat(angle), flat(axial), flat(diameter), *names)


def taxel_places(
    electrodes: ElectrodesSpec, geometry: GeometrySpec
) -> dict[tuple[int, int], tuple[float, float]]:
    """Places of the taxels' centres on the unrolled wall, along arc and axis [m].

    Returns places by module (from 0) and number in it (from 1).
    Raises ConfigError: one of them is beyond the clamped edges.
    """
    own, half = along_wall(geometry, _centres(electrodes))
    places, found = [], []
    for (key, spec), arc in zip(_centres(electrodes).items(), own, strict=True):
        if isinstance(spec, TaxelSpec):
            places.append((arc, spec.axial))
            continue
        x, y = (spec.pitch * module_places()[_places_by_number(spec.numbering)]).T
        cos, sin = np.cos(spec.rotation), np.sin(spec.rotation)
        arcs, axial = arc + x * cos - y * sin, spec.axial + x * sin + y * cos
        if np.abs(arcs).max() > half * (1 + 1e-9):
            lengths = np.abs(arcs - arc).max(), half - abs(arc)
            reach, room = (format_quantity(float(x), "length") for x in lengths)
            advice = (
                f"its taxels reach {reach} along the wall, whose clamped edge is {room} away: "
                "move the module"
            )
            name = "angle" if spec.arc is None else "arc"
            found.append(Mistake("skin", f"{key}.{name}", advice))
        places += list(zip(arcs.tolist(), axial.tolist(), strict=True))
    if found:
        raise ConfigError(found)
    return dict(zip(zip(*electrodes.taxel_names, strict=True), places, strict=True))


@functools.lru_cache(maxsize=64)
def check_taxels(electrodes: ElectrodesSpec, geometry: GeometrySpec) -> None:
    """Refuse taxels off the section; see `taxel_places`."""
    taxel_places(electrodes, geometry)


def _centres(electrodes: ElectrodesSpec) -> dict[str, TaxelSpec | ModuleSpec]:
    """Taxels of a list, or modules, by their keys."""
    table = "taxels" if electrodes.layout == "list" else "modules"
    specs = getattr(electrodes, table)
    return {f"electrodes.{table}.{i}": spec for i, spec in enumerate(specs)}


def by_taxel(
    electrodes: ElectrodesSpec, numbers: Mapping[str, Any], key: str, usual: float
) -> Array | float:
    """Heights above the wall [m] or gains of single taxels [taxel, 1], ten by ten of modules.

    One usual number where none is given.
    """
    if electrodes.layout == "list":
        if not any(key in taxel.model_fields_set for taxel in electrodes.taxels):
            return usual
        paths = [f"electrodes.taxels.{i}.{key}" for i in range(len(electrodes.taxels))]
    else:
        given = [getattr(module, f"{key}s") for module in electrodes.modules]
        if not any(given):
            return usual
        paths = [
            f"electrodes.modules.{i}.{key}s.{k}" if own else ""
            for i, own in enumerate(given)
            for k in range(MODULE_TAXELS)
        ]
    values = [jnp.asarray(numbers[path] if path else usual, float) for path in paths]
    return jnp.stack(values)[..., None]


def _places_by_number(numbering: str | Sequence[int]) -> np.ndarray:
    """Place of each number, from number 1 on."""
    return np.argsort(PAPER_NUMBERING if isinstance(numbering, str) else numbering)
