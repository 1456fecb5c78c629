"""A design: the search, the data sheets before and after, and what holds it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from fitting.datasheet.page import figure_text, place_text
from fitting.datasheet.pictures import plot_skin
from fitting.datasheet.sheet import DataSheet, data_sheet
from fitting.datasheet.words import WORDS
from fitting.design.problem import Problem
from fitting.design.search import Found, Price, search
from fitting.design.want import Want
from fitting.report.description import Headline, Part, Remark, ReportTable
from suas_jax.config import continuous_inputs


class Design(NamedTuple):
    """A design with the data sheets of both skins."""

    problem: Problem  # what was wanted
    found: Found  # the search
    before: DataSheet  # sheet of the skin file
    after: DataSheet  # of the design

    def report(self) -> dict[str, Any]:
        """What `suas design --json` prints."""
        want, found = self.problem.want, self.found
        return {
            "status": "converged",
            "goal": want.goal,
            "maximise": want.maximise,
            "goal_at_start": found.before,
            "goal_value": found.goal,
            "rated_force_N": self.problem.rated,
            "inputs": {path: float(v) for path, v in want.inputs(found.x).items()},
            "starts": len(found.trials),
            "starts_agreeing": found.agreeing,
            "trials": [
                {"goal_value": t.goal, "message": t.message, "variables": t.x.tolist()}
                for t in found.trials
            ],
            "active": [
                {
                    "name": p.name,
                    "bound": "at_least" if p.least else "at_most",
                    "value": p.value,
                    **self._place(p),
                    "price": p.price,
                }
                for p in found.prices
            ],
            "evaluations": self.problem.calls,
            "before": self.before.report(),
            "after": self.after.report(),
        }

    def described(self) -> list[Part]:
        """The same for a terminal."""
        want, found = self.problem.want, self.found
        word = WORDS[want.goal]
        first, last = (f"{v / word.size:.4g}" for v in (found.before, found.goal))
        line = f"{word.title.lower()} {first} {word.unit} became {last} {word.unit}".rstrip()
        inputs = want.inputs(found.x)
        own = continuous_inputs(want.spec)
        variables = [
            (path, f"{own[path]:.5g}", f"{float(value):.5g}") for path, value in inputs.items()
        ]
        rows = [
            (WORDS[a.key].title, figure_text(a), figure_text(b))
            for a, b in zip(self.before.figures, self.after.figures, strict=True)
            if np.isfinite(a.value) or np.isfinite(b.value)
        ]
        return [
            Headline("designed", line, good=True),
            ReportTable("Inputs", ("input (SI)", "before", "after"), variables),
            ReportTable("Data sheets", ("figure", "before", "after"), rows),
            *(Remark(self._price(p)) for p in found.prices),
            Remark(
                f"{found.agreeing} of {len(found.trials)} starts agree on the goal; "
                f"{self.problem.calls} designs were evaluated."
            ),
        ]

    def drawn(self) -> Figure:
        """The section with its dimensions."""
        return plot_skin(self.after.spec)

    def _place(self, price: Price) -> dict[str, float]:
        """Where a limit is reached, as a data sheet tells places: every second one of its."""
        if price.place is None or not WORDS[price.name].field:
            return {}
        own = self.after.measured.coordinates
        return {key: float(values[2 * price.place]) for key, values in own.items()}

    def _price(self, price: Price) -> str:
        goal = WORDS[self.problem.want.goal].title.lower()
        side = "lower" if price.least else "upper"
        if price.place is None:
            return (
                f"{price.name} is at its {side} bound: a bound wider by 1 % of the variable's "
                f"range would improve the {goal} by {price.price:.2g} %."
            )
        word = WORDS[price.name]
        place = place_text(self._place(price))
        where = f" at {place}" if place else ""
        harder = "more" if price.least else "less"
        return (
            f"{word.title}{where} is at its {side} limit of {price.value / word.size:.4g} "
            f"{word.unit}: 1 % {harder} of it costs {price.price:.2g} % of the {goal}."
        )


def design_skin(want: Want, progress: Callable[[str], None] = lambda text: None) -> Design:
    """Find the skin that makes a figure of its data sheet as good as it can be.

    Args:
        want: variables, goal and limits: `load_want`.
        progress: called with what is being done.

    Raises:
        ValueError: the skin has no electrodes or is a pad, or no design keeps the limits.
    """
    progress("compiling, once for these variables")
    problem = Problem(want)

    def shown(done: int, goal: float) -> None:
        progress(f"start {min(done + 1, want.starts)} of {want.starts}, best {goal:.4g}")

    found = search(problem, shown)
    progress("data sheets")
    angle = problem.angle
    # Twice as many places, so that what lies between those of the search is seen.
    places, between = (2 * len(angle) - 1, 4), (float(angle[0]), float(angle[-1]))
    before, after = (
        data_sheet(spec, places, force=problem.rated, between=between)
        for spec in (want.spec, problem.spec(found.x))
    )
    return Design(problem, found, before, after)
