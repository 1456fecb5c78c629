"""A choice of taxels for a skin: readings over it, the selection, and what it is worth."""

import dataclasses
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from fitting.datasheet.figures import Measured, weighted
from fitting.datasheet.pad import measure_pad
from fitting.datasheet.section import measure_section
from fitting.datasheet.variants import variants_of
from fitting.datasheet.words import WORDS, place_text
from fitting.design.taxels import Selection, Variances, select
from fitting.design.want import Want
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.report.description import Headline, Part, Remark, ReportTable
from suas_jax import skin_of
from suas_jax.figures.pad import plot_pad

_AXIALS = 7  # places along a pad's axis, as in its data sheet
_SLACK = 1e-9  # of a place at the edge of a region [m]


class Choice(NamedTuple):
    """Taxels that are kept, and what they tell."""

    want: Want  # what was wanted
    measured: Measured  # readings of the skin
    places: np.ndarray  # that count, by their numbers in `measured`
    selection: Selection  # of the taxels

    @property
    def kept(self) -> list[int]:
        """Taxels by their places in the layout."""
        return np.flatnonzero(self.selection.kept).tolist()

    def report(self) -> dict[str, Any]:
        """What `suas design --json` prints of a choice."""
        own, names = self.selection, self._names
        return {
            "status": "converged",
            "goal": self.want.goal,
            "rated_force_N": self.measured.rated,
            "taxels": len(names),
            "goal_at_start": float(own.every.max()),
            "goal_value": float(own.chosen.max()),
            "goal_bound": own.bound,
            "kept": [
                {
                    "taxel": k,
                    "module": names[k][0],
                    "number": names[k][1],
                    "loss_without": float(own.costs[k]),
                }
                for k in self.kept
            ],
            "places": [
                {**self._place(i), "every": float(own.every[i]), "kept": float(own.chosen[i])}
                for i in range(len(self.places))
            ],
        }

    def described(self) -> list[Part]:
        """The same for a terminal."""
        own, word, names = self.selection, WORDS[self.want.goal], self._names
        every, chosen, bound = (
            f"{value / word.size:.4g} {word.unit}"
            for value in (own.every.max(), own.chosen.max(), own.bound)
        )
        worst = place_text(self._place(int(own.chosen.argmax())))
        modules: dict[int, list[str]] = {}
        for k in self.kept:
            modules.setdefault(names[k][0], []).append(str(names[k][1]))
        rows = [(str(module), ", ".join(numbers)) for module, numbers in modules.items()]
        return [
            Headline(
                "chosen",
                f"{len(self.kept)} of {len(names)} taxels: {word.title.lower()} {chosen} at "
                f"its worst place, {worst}; with all taxels {every}",
                good=True,
            ),
            ReportTable("Taxels that are kept", ("module", "taxels"), rows),
            Remark(f"No choice of as many taxels is below {bound} at its worst place."),
        ]

    def drawn(self) -> Figure:
        """The taxels that are kept, coloured by what the worst place loses without each."""
        label = f"{WORDS[self.want.goal].title.lower()}: loss without the taxel [%]"
        return plot_pad(self.want.spec, (100 * self.selection.costs).tolist(), label=label)

    @property
    def _names(self) -> list[tuple[int, int]]:
        return list(zip(*self.want.spec.sensing.taxel_names, strict=True))

    def _place(self, i: int) -> dict[str, float]:
        own = self.measured.coordinates
        return {key: float(values[self.places[i]]) for key, values in own.items()}


def choose_taxels(
    want: Want,
    progress: Callable[[str], None] = lambda text: None,
    workers: Executor | None = None,
) -> Choice:
    """Choose taxels of a skin so that the worst bound over a region stays small.

    Args:
        want: says how many and for which figure: `load_want`.
        progress: called with what is being done.
        workers: that solve a pad's table of states; None: this process.

    Raises:
        ValueError: the skin has no electrodes, or as many taxels can't be chosen.
    """
    spec = want.spec
    noise, variants, between = spec.sensing.noise, variants_of(spec), want.angles
    if spec.geometry.dimension == 3:
        measured = measure_pad(
            variants, (want.places, _AXIALS), noise, want.force, progress, workers
        )
        inside = measured.region.copy()
        if between is not None:
            along = ContactPlaces.of(spec.geometry, skin_of(spec, contact=False).geometry)
            first, last = along.outer_arc(np.array(between))
            inside &= (measured.arc >= first - _SLACK) & (measured.arc <= last + _SLACK)
    else:
        # The skin alone: no tolerance moves a choice.
        alone = {path: values[:1] for path, values in variants.inputs.items()}
        variants = dataclasses.replace(variants, inputs=alone)
        measured = measure_section(variants, want.places, noise, want.force, progress, between)
        inside = measured.region
    if not inside.any():
        raise ValueError("at.region: no place of the skin is in it; ask for more `places`")
    if (np.asarray(measured.cases.first_contact)[0, inside] < measured.rated).any():
        raise ValueError(
            f"at.force: the membrane reaches the wall before the rated {measured.rated:g} N at "
            "a place of the region; choose a smaller force or another region"
        )
    progress("choosing taxels")
    columns = np.asarray(weighted(measured.cases, measured.accuracy))[:, :, 0, inside]
    variances = Variances(columns, of_force=want.goal == "force_resolution_N")
    assert want.keep is not None
    return Choice(want, measured, np.flatnonzero(inside), select(variances, want.keep))
