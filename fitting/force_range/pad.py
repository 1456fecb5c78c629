"""Cramér-Rao bounds (`bound`) of one round radial contact, over a pad, by its table of states.

Its states pass through the wall: nothing is said of forces beyond first contact.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.force_range.bound import LADDER, TOLD, least_errors, rated_force, smallest_told
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.pad.interpolant import MOST, PadInterpolant
from fitting.inverse_load.pad.parts import table_of_pad
from fitting.inverse_load.pad.table import PadTable, grid
from fitting.inverse_load.readings import noise_of_readings
from fitting.inverse_load.settings import DIAMETER, PAD_MODEL_ERROR
from suas_jax.config import SkinSpec
from suas_jax.sensing.converter import Converter

_NEVER = 1e8  # stands for a force of first contact that the table doesn't know [N]


@dataclass(frozen=True)
class PadForceRange:
    """The range of one round contact over a pad."""

    angle: Floats  # of the contact [angle] [rad], see `suas_jax.skin.section`
    axial: Floats  # of the contact [axial] [m]
    diameter: float  # of the contact [m]
    along: ContactPlaces  # what scenes call places
    # force at which the membrane reaches the wall [angle, axial] [N]; NaN where it is far
    # beyond the table
    first_contact: Floats
    oil_pressure: Floats  # there [angle, axial] [Pa]; NaN beyond the table
    # at which the bound is evaluated [angle, axial, force] [N]; the last one is the same
    # everywhere
    force: Floats
    # least standard deviations of angle [rad], axial position [m] and force [N] [parameter,
    # angle, axial, force]
    error: Floats
    saturated: NDArray[np.int64]  # taxels at the converter's limit [angle, axial, force]
    noise: float  # standard deviation of a reading, rounding included [counts]
    taxels: Floats  # angle [rad] and axial position [m] [taxel, 2]

    @property
    def reference(self) -> float:
        """The force at which errors are compared over the pad [N]."""
        return float(self.force[0, 0, -1])

    @property
    def smallest(self) -> Floats:
        """Force from which on it can be told to `TOLD` of itself [angle, axial] [N]; or NaN."""
        return smallest_told(self.force[..., :-1], self.error[2][..., :-1])

    @property
    def position_error(self) -> Floats:
        """Of the place on the outer face [angle, axial, force] [m]."""
        rate = self.along.outer_rate(self.angle)
        return np.hypot(rate[:, None, None] * self.error[0], self.error[1])

    def report(self) -> dict[str, Any]:
        """What `suas range --json` prints of a pad."""
        return {
            "dimension": 3,
            "noise_counts": self.noise,
            "told_relative_error": TOLD,
            "diameter_m": self.diameter,
            "contact_modelled": False,
            "places": [
                self._row(i, j) for i in range(len(self.angle)) for j in range(len(self.axial))
            ],
        }

    def _row(self, i: int, j: int) -> dict[str, Any]:
        known = bool(np.isfinite(self.first_contact[i, j]))
        touch = {
            "force_N": float(self.first_contact[i, j]),
            "oil_pressure_Pa": float(self.oil_pressure[i, j]),
        }
        points = [
            {
                "force_N": float(self.force[i, j, k]),
                "force_error_N": float(self.error[2, i, j, k]),
                **self.along.error_keys(self.angle[i], self.error[0, i, j, k]),
                "axial_error_m": float(self.error[1, i, j, k]),
                "saturated_taxels": int(self.saturated[i, j, k]),
            }
            for k in range(self.force.shape[2])
        ]
        saturated = self.force[i, j][self.saturated[i, j] > 0]
        return {
            **self.along.keys(self.angle[i]),
            "axial_m": float(self.axial[j]),
            "first_contact": touch if known else None,
            "smallest_force_told_N": float(self.smallest[i, j]),
            "saturation_force_N": float(saturated.min()) if saturated.size else float("nan"),
            "points": sorted(points, key=lambda point: point["force_N"]),
        }


def pad_force_range(
    spec: SkinSpec,  # the pad, with electrodes
    # how many along the arc and along the axis, from edge to edge
    places: tuple[int, int] = (17, 11),
    # standard deviation of a reading [counts]; the skin file's if None
    noise: float | None = None,
    *,
    diameter: float = DIAMETER,  # of the contact [m]
    progress: Callable[[str], None] = lambda text: None,  # called with what is being done
    # that solve the table (`fitting.workers`); None: this process
    workers: Executor | None = None,
) -> PadForceRange:
    """Find the range of a round radial contact over a pad.

    The table of a new skin takes minutes; it is kept. Raises ValueError: the skin has no
    electrodes, or an argument makes no sense.
    """
    if min(places) < 1:
        raise ValueError(f"{places[0]} by {places[1]} places: at least one is needed")
    if not 0 < diameter < spec.geometry.width / 4:
        raise ValueError(
            f"diameter = {diameter:g} m: a length above zero and below a quarter of the pad's "
            "width is needed"
        )
    deviation = noise_of_readings(spec, noise)
    skin, table = table_of_pad(spec, diameter, progress, workers)
    progress("what the taxels tell")
    taxels = skin.electrodes.taxels.places
    along = ContactPlaces.of(spec.geometry, skin.geometry)
    return range_from_table(table, along, taxels, places, deviation)


def range_from_table(
    table: PadTable,
    along: ContactPlaces,  # what scenes call places
    taxels: Floats,  # angle and axial position [taxel, 2]
    places: tuple[int, int],  # how many along the arc and along the axis
    noise: float,  # standard deviation of a reading [counts]
) -> PadForceRange:
    """The range of a contact over a pad whose states are known."""
    angle, axial = (
        np.linspace(-x[-1], x[-1], n) if n > 1 else np.zeros(1)
        for x, n in zip((table.angle, table.axial), places, strict=True)
    )
    interpolant = PadInterpolant(table)
    at = grid(angle, axial)
    most = MOST * interpolant.largest(*at.T)
    touch = table.first_contact_at(*at.T)
    known = touch < _NEVER
    end = np.minimum(touch, most)
    reference = np.minimum(rated_force(end), most)
    force = np.column_stack([end[:, None] * np.array(LADDER), reference])
    loads = np.concatenate([np.repeat(at, force.shape[1], 0), force.reshape(-1, 1)], 1)
    reading = noise**2 + 1 / 12
    so, jacobian = [], []
    for rows in np.array_split(loads, max(1, len(loads) // 256)):
        found = interpolant(rows, 1)
        so.append(found.readings[:, :-1])
        jacobian.append(found.jacobian[..., :-1])
    values = np.concatenate(so)
    saturated = values >= Converter().full_scale
    variance = reading + (PAD_MODEL_ERROR * (values - table.rest)) ** 2
    weight = np.where(saturated, 0.0, 1 / variance)
    error = least_errors(np.moveaxis(np.concatenate(jacobian), 0, -1), weight.T)
    shape = (*places, force.shape[1])
    at_touch = interpolant(np.column_stack([at, end]), 1).readings[:, -1]
    at_touch[end < touch] = np.nan
    return PadForceRange(
        angle,
        axial,
        table.diameter,
        along,
        np.where(known, touch, np.nan).reshape(places),
        at_touch.reshape(places),
        force.reshape(shape),
        error.reshape(3, *shape),
        saturated.sum(1).reshape(shape),
        float(np.sqrt(reading)),
        taxels,
    )
