"""Readings of a pad that nothing touches, and what a displacement of its membrane adds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fitting.arrays import Floats
from suas_jax.config import SkinSpec, continuous_inputs

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

_GAP = "geometry.oil_gap"


def film_readings(skin: "Skin") -> Floats:
    """Readings of the undeformed pad [taxel] [counts]."""
    taxels = skin.electrodes.taxels
    gap = skin.geometry.gap(taxels.angle, taxels.axial)
    so = skin.electrodes.read_even_film(gap)
    return np.broadcast_to(np.asarray(so)[:, 0], (len(taxels.angle),)).copy()


def stray_counts(skin: "Skin") -> Floats:
    """Part of the readings that no gap changes [taxel] [counts]."""
    taxels = len(skin.electrodes.taxels.angle)
    counts = np.asarray(skin.electrodes.stray / skin.electrodes.lsb, float).reshape(-1)
    return np.broadcast_to(counts, (taxels,)).copy()


class GapLine(NamedTuple):
    """1 / (SO - stray) = at + slope w of every taxel, w the membrane's displacement over it."""

    stray: Floats  # [taxel] [counts]
    at: Floats  # where w is zero: undeformed, or at rest [taxel] [1/counts]
    slope: Floats  # [taxel] [1/counts/m]

    def seen_by(self, other: "GapLine", so: Floats) -> Floats:
        """What another pad reads where the membrane is as this one reads [..., taxel]."""
        moved = (1 / np.maximum(so - self.stray, 1e-9) - self.at) / self.slope
        return other.readings(moved)

    def film(self, so: Floats) -> Floats:
        """Displacements that give readings [..., taxel] [m]; NaN where they are missing."""
        above = np.where(so > self.stray, so - self.stray, np.nan)
        return np.asarray((1 / above - self.at) / self.slope)

    def readings(self, film: Floats) -> Floats:
        """Readings under displacements [..., taxel] [counts]: the inverse of `film`."""
        return np.asarray(self.stray + 1 / (self.at + self.slope * film))


def gap_line(spec: SkinSpec, inputs: Mapping[str, float]) -> GapLine:
    """The line of a pad from its undeformed shape.

    The inputs are electrical ones that replace the pad's own, by TOML path.
    """
    from suas_jax.scene.skin import skin_of

    own = {**continuous_inputs(spec), **inputs}
    gaps = {p: x for p, x in own.items() if p == _GAP or p.startswith(f"{_GAP}.value.")}
    step = 1e-4 * spec.geometry.mean_gap
    values = []
    for shift in (-step, 0.0, step):
        moved = {path: gap + shift for path, gap in gaps.items()}
        skin = skin_of(spec, {**inputs, **moved}, contact=False)
        stray = stray_counts(skin)
        values.append(1 / (film_readings(skin) - stray))
    return GapLine(stray, values[1], (values[2] - values[0]) / (2 * step))
