"""Picture of one moment for the page, and its bytes on the way there.

A message is the length of its header (little-endian, 4 bytes), the header as JSON, padded to
a multiple of four bytes, then the arrays: displacements of the grid's points as three 16-bit
whole numbers each, in units of the header's `scale`; counts above rest as 16-bit whole
numbers; states of the taxels as bytes.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.estimate.estimate import STATUS, Contact, LoadEstimate
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.report.text import contact_text
from fitting.json_text import json_text
from suas_jax.acquisition.log.data import MAX_COUNT
from suas_jax.config import GeometrySpec, SkinSpec
from suas_jax.runtime.compiled import jit
from suas_jax.scene.taxel_film import TaxelFilm
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.plain import plain_geometry

_ARC, _AXIAL = 49, 25  # of a pad; 7 kB a picture
_SECTION = 181
GOOD, MISSING, SATURATED, LEFT_OUT = range(4)
"""States of a taxel."""
_MOST = 32767
_ELLIPSE = 2.447746830680816  # half axes of a 95 % ellipse in two dimensions, in deviations
_INTERVAL = 1.959963984540054  # the same in one


@dataclass(frozen=True)
class Grid:
    """Points of the undeformed membrane, even along the arc and along the axis."""

    angle: Floats  # as sections define it, see `suas_jax.skin.section` [arc, rad]
    # from the middle [axial, m]; one point in plane strain, where nothing changes
    axial: Floats
    place: Floats  # of the inner face [arc, 2] [m]
    normal: Floats  # unit vectors outwards [arc, 2]
    curvature: Floats  # of the inner face [arc] [1/m]
    gap: Floats  # to the wall at rest [arc] [m]
    width: float  # of the skin along its axis [m]
    places: ContactPlaces  # how the skin's scenes tell places

    @classmethod
    def of(cls, spec: GeometrySpec) -> "Grid":
        """The grid of a skin."""
        pad, geometry = spec.dimension == 3, plain_geometry(spec)
        half = float(geometry.half_angle[0])
        angle = np.linspace(-1, 1, _ARC if pad else _SECTION) * half
        axial = np.linspace(-1, 1, _AXIAL) * spec.width / 2 if pad else np.zeros(1)
        rows = (np.asarray(x)[..., 0] for x in _sampled(geometry, jnp.asarray(angle)[:, None]))
        place, normal, curvature, gap = rows
        places = ContactPlaces.of(spec, geometry)
        return cls(angle, axial, place.T, normal.T, curvature, gap, spec.width, places)

    @property
    def points(self) -> tuple[Floats, Floats]:
        """Angle and axial position of every point [arc * axial]."""
        angle, axial = np.meshgrid(self.angle, self.axial, indexing="ij")
        return angle.ravel(), axial.ravel()

    @property
    def outward(self) -> Floats:
        """Unit normals of the inner face [arc * axial, 3]."""
        flat = np.pad(self.normal, ((0, 0), (0, 1)))
        return np.repeat(flat, len(self.axial), axis=0)

    def direction(self, angle: float) -> float:
        """Of the outward normal, from the y axis, clockwise [rad]."""
        x, y = (np.interp(angle, self.angle, side) for side in self.normal.T)
        return float(np.arctan2(x, y))


@jit
def _sampled(geometry: SkinGeometry, angle: jnp.ndarray) -> tuple[jnp.ndarray, ...]:
    section = geometry.section
    middle, thick = section.curvature(angle), section.thickness(angle)
    curvature = middle / (1 - middle * thick / 2)
    inner, normal = section.inner_face(angle), section.inner_normal(angle)
    flat = (jnp.broadcast_to(x, angle.shape) for x in (curvature, geometry.gap(angle)))
    return (inner, normal, *flat)


@dataclass
class Picture:
    """One moment."""

    time: float  # that is shown, by the source's clock [s]
    status: str  # outcome in a word
    message: str  # what it means, in a sentence
    # gives the displacement of the grid's points [point, 3] [m];
    # called only for pictures that are sent
    displacement: Callable[[], Floats]
    change: Floats  # counts above rest [taxel]; NaN where missing
    taxels: NDArray[np.uint8]  # their states [taxel]
    arrows: list[dict[str, Any]]  # contacts as the page draws them
    values: list[tuple[str, str]]  # rows of the table: name and value with unit
    force: float  # sum of the contacts' forces [N]; NaN where unknown
    oil_pressure: float  # [Pa]; NaN where unknown
    more: dict[str, Any] = field(default_factory=dict)  # further keys of the header
    made: float = field(default_factory=monotonic)  # when it was made, by `time.monotonic` [s]

    def encoded(self, number: int) -> bytes:
        """Its message. `number`: of the picture, which the page sends back once it is drawn."""
        moved = np.nan_to_num(self.displacement())
        largest = float(np.abs(moved).max(initial=0.0))
        scale = max(largest, 1e-9) / _MOST
        header = {
            "number": number,
            "t_s": self.time,
            "status": self.status,
            "message": self.message,
            "scale": scale,
            "contacts": self.arrows,
            "values": self.values,
            "force_N": self.force,
            "oil_pressure_Pa": self.oil_pressure,
            **self.more,
        }
        text = json_text(header).encode()
        text += b" " * (-len(text) % 4)
        change = np.clip(np.nan_to_num(np.round(self.change)), -_MOST, _MOST)
        return b"".join(
            (
                struct.pack("<I", len(text)),
                text,
                np.round(moved / scale).astype("<i2").tobytes(),
                change.astype("<i2").tobytes(),
                self.taxels.astype(np.uint8).tobytes(),
            )
        )


def taxel_states(so: Floats, left_out: Sequence[int] = ()) -> NDArray[np.uint8]:
    """States of the taxels from their readings [taxel] and those that were not used."""
    states = np.full(len(so), GOOD, np.uint8)
    states[list(left_out)] = LEFT_OUT
    states[(so <= 0) | (so >= MAX_COUNT)] = SATURATED
    states[~np.isfinite(so)] = MISSING
    return states


def arrow(contact: Contact, grid: Grid) -> dict[str, Any]:
    """A contact as the page draws it: place, force and the ellipse that holds it with 95 %.

    In plane strain the force acts along a line, and the ellipse is a strip.
    """
    places = grid.places
    told = "angle" if contact.arc is None else "arc"
    angle = float(places.from_place(told, np.asarray(getattr(contact, told))))
    rate = float(places.outer_rate(np.asarray(angle)))
    entry: dict[str, Any] = {
        "angle": angle,
        "outer_rate": rate,
        "axial": contact.axial or 0.0,
        "force": contact.force,
        "turn": contact.direction or 0.0,
        "line": contact.axial is None,
        "text": contact_text(contact),
    }
    covariance = contact.covariance
    if covariance is None:
        return entry
    names = [name for name in ("angle", "arc", "axial") if name in contact.names[:2]]
    rows = [contact.names.index(name) for name in names]
    along = rate / float(places.slope(np.asarray(angle)))
    size = np.array([along, 1.0])[: len(names)]
    place = covariance[np.ix_(rows, rows)] * np.outer(size, size)
    if not np.isfinite(place).all():
        return entry
    if len(names) == 1:
        half = _INTERVAL * float(np.sqrt(max(place[0, 0], 0.0)))
        return entry | {"ellipse": [half, grid.width / 2, 0.0]}
    variance, axes = np.linalg.eigh(place)
    half_axes = _ELLIPSE * np.sqrt(np.maximum(variance, 0.0))
    turn = float(np.arctan2(axes[1, 1], axes[0, 1]))
    return entry | {"ellipse": [float(half_axes[1]), float(half_axes[0]), turn]}


def estimate_values(estimate: LoadEstimate | None) -> list[tuple[str, str]]:
    """Rows of the table for an estimate."""
    if estimate is None:
        return []
    rows = [(f"contact {k + 1}", contact_text(c)) for k, c in enumerate(estimate.contacts)]
    if np.isfinite(estimate.oil_pressure):
        rows.append(("oil pressure", f"{1e-3 * estimate.oil_pressure:.3f} kPa"))
    if estimate.at_least is not None:
        rows.append(("force", f"at least {estimate.at_least:.4g} N"))
    if np.isfinite(estimate.chi2_per_dof):
        rows.append(("χ² per degree of freedom", f"{estimate.chi2_per_dof:.2f}"))
    if estimate.left_out:
        rows.append(("taxels left out", str(len(estimate.left_out))))
    return rows


def estimate_in_words(estimate: LoadEstimate | None) -> tuple[str, str]:
    """Status and what it means."""
    if estimate is None:
        return "not_estimated", "The loads of this frame have not been estimated yet."
    return estimate.status, STATUS.get(estimate.status, "")


def total_force(estimate: LoadEstimate | None) -> float:
    """Sum of the contacts' forces [N]; NaN where it isn't known whether there are any."""
    if estimate is None or estimate.contact is None:
        return float("nan")
    return sum((contact.force for contact in estimate.contacts), 0.0)


def describe(
    spec: SkinSpec, grid: Grid, film: TaxelFilm | None, title: str, **more: Any
) -> dict[str, Any]:
    """A skin as the page takes it, in SI units and radians.

    `spec`: the skin. `grid`: of the points that pictures show. `film`: of its taxels; None
    where it has none. `title`: what is shown. `more`: controls, such as sliders or a timeline.
    """
    geometry = spec.geometry
    taxels = []
    if film is not None:
        columns = film.section_angle, film.axial, film.diameter, film.rest_gap
        rows = zip(film.module, film.number, *columns, strict=True)
        taxels = [
            {
                "name": f"{module}.{number}",
                "angle": float(angle),
                "axial": float(axial),
                "diameter": float(diameter),
                "gap": float(gap),
            }
            for module, number, angle, axial, diameter, gap in rows
        ]
    return {
        "title": title,
        "dimension": geometry.dimension,
        "thickness": geometry.mean_thickness,
        "width": geometry.width,
        "oil_gap": geometry.mean_gap,
        "grid_angle": grid.angle.tolist(),
        "grid_axial": grid.axial.tolist(),
        "place": grid.place.tolist(),
        "normal": grid.normal.tolist(),
        "curvature": grid.curvature.tolist(),
        "gap": grid.gap.tolist(),
        "told": {
            "angle": grid.places.angle(grid.angle).tolist(),
            "arc": grid.places.inner_arc(grid.angle).tolist(),
        },
        "taxels": taxels,
        **more,
    }
