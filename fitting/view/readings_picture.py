"""Pictures of readings and what was estimated from them: of logs and of live ports."""

from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.estimate.estimate import LoadEstimate
from fitting.view.grid import Grid
from fitting.view.membrane import InterpolatedMembrane
from fitting.view.picture import (
    GOOD,
    Picture,
    arrow,
    describe,
    estimate_in_words,
    estimate_values,
    taxel_states,
    total_force,
)
from suas_jax.config import SkinSpec
from suas_jax.scene.taxel_film import TaxelFilm


class ReadingsPictures:
    """Makes pictures of a skin's frames.

    `spec`: the skin. `rest`: readings at rest [taxel] [counts]; those of the model where not
    given.
    """

    def __init__(self, spec: SkinSpec, rest: Floats | None) -> None:
        self._spec, self._grid = spec, Grid.of(spec.geometry)
        self.film = TaxelFilm(spec, rest)
        self._membrane = InterpolatedMembrane(
            spec.geometry, self.film, spec.sensing.noise, self._grid
        )

    def description(self, title: str, **more: Any) -> dict[str, Any]:
        """What a page needs to know once; see `describe`."""
        return describe(self._spec, self._grid, self.film, title, **more)

    def picture(
        self,
        time: float,  # of the frame [s]
        so: Floats,  # readings [taxel] [counts]; NaN where missing
        stuck: Flags,  # taxels that repeat one count beyond chance [taxel]
        estimate: LoadEstimate | None,  # what was estimated; None if nothing was
        values: list[tuple[str, str]],  # further rows of the table
        **more: Any,  # keys of the header
    ) -> Picture:
        """A frame's picture."""
        left_out = set(np.flatnonzero(stuck).tolist())
        left_out |= set(() if estimate is None else estimate.left_out)
        states = taxel_states(so, sorted(left_out))
        status, message = estimate_in_words(estimate)
        gap = self.film.gap(so)[states == GOOD]
        rows = estimate_values(estimate)
        if gap.size:
            rows.append(("smallest gap over a taxel", f"{1e3 * np.nanmin(gap):.3f} mm"))
        return Picture(
            time,
            status,
            message,
            lambda: self._membrane(so, states == GOOD),
            so - self.film.rest,
            states,
            [] if estimate is None else [arrow(c, self._grid) for c in estimate.contacts],
            rows + values,
            total_force(estimate),
            float("nan") if estimate is None else estimate.oil_pressure,
            more,
        )
