"""A design: the search, the data sheets before and after, what holds it, and its skin file."""

import os
import re
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit
from matplotlib.figure import Figure

from fitting.arrays import Floats
from fitting.datasheet.page import figure_text
from fitting.datasheet.pictures import plot_skin
from fitting.datasheet.sheet import DataSheet, data_sheet
from fitting.datasheet.sheet import Figure as SheetFigure
from fitting.datasheet.words import WORDS, place_text
from fitting.design.front import FrontPoint, front
from fitting.design.pad import PadProblem
from fitting.design.problem import Problem
from fitting.design.search import Found, Kept, Price, search
from fitting.design.section import SectionProblem
from fitting.design.want import Limit, Want
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.report.description import Headline, Part, Remark, ReportTable
from suas_jax import skin_of
from suas_jax.config import continuous_inputs
from suas_jax.config.quantities import ZEROS
from suas_jax.config.tolerance import deviation_start
from suas_jax.config.toml_file import MOST_BYTES
from suas_jax.config.units import find_unit
from suas_jax.figures.style import FIRST, styled
from suas_jax.files.reading import read_bytes

_MISSED = 1e-3  # share of a limit by which it is not kept
_WORSE = 0.02  # share of the goal that is told between the places of the search


class Design(NamedTuple):
    """A design with the data sheets of both skins."""

    problem: Problem  # what was wanted
    found: Found  # the search
    before: DataSheet  # sheet of the skin file
    after: DataSheet  # of the design
    front: list[FrontPoint]  # designs between two goals; empty where one is wanted
    calls: int  # designs evaluated on the way

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
                    "purpose": p.purpose or None,
                }
                for p in found.prices
            ],
            "missed_between": [
                {
                    "name": limit.key,
                    "bound": "at_least" if limit.least else "at_most",
                    "limit": limit.value,
                    "value": figure.value,
                    **self._coordinates(figure.place),
                }
                for limit, figure in self.missed
            ],
            "front": [
                {
                    want.goal: point.goal,
                    **dict.fromkeys(want.against, point.other),
                    "inputs": {path: float(v) for path, v in want.inputs(point.x).items()},
                }
                for point in self.front
            ],
            "evaluations": self.calls,
            "before": self.before.report(),
            "after": self.after.report(),
        }

    def described(self) -> list[Part]:
        """The same for a terminal."""
        want, found = self.problem.want, self.found
        word = WORDS[want.goal]
        first = word.told(found.before) if found.start.found else "of a skin without a state"
        line = f"{word.title.lower()} {first} became {word.told(found.goal)}"
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
            *self._front(),
            *(Remark(self._price(p)) for p in found.prices),
            *(Remark(self._miss(*missed)) for missed in (*self.missed, *self._goal_between())),
            *self._ended(),
            Remark(
                f"{found.agreeing} of {len(found.trials)} starts agree on the goal; "
                f"{self.calls} designs were evaluated."
            ),
        ]

    @property
    def missed(self) -> list[tuple[Limit, SheetFigure]]:
        """Limits that the data sheet does not keep, between the places of the search."""
        told = {f.key: f for f in self.after.figures if f.place is not None}
        pairs = [(x, told[x.key]) for x in self.problem.want.limits if x.key in told]
        return [(x, figure) for x, figure in pairs if x.margin(figure.value) < -_MISSED]

    def _goal_between(self) -> list[tuple[Limit, SheetFigure]]:
        """The goal as the search found it, and the data sheet's figure if one is worse.

        Worse at a place between those of the search.
        """
        want = self.problem.want
        goal = Limit(want.goal, self.found.goal, want.maximise)
        told = [f for f in self.after.figures if f.key == want.goal and f.place is not None]
        worse = (f for f in told if f.place not in self._searched)
        return [(goal, f) for f in worse if goal.margin(f.value) < -_WORSE]

    @property
    def _searched(self) -> np.ndarray:
        """Places of the data sheet that are the search's: every second one of its."""
        own = self.after.measured
        return np.arange(len(own.arc)).reshape(own.grid)[::2, ::2]

    def drawn(self) -> Figure:
        """The front where two goals are traded, else the section with its dimensions."""
        return plot_front(self) if self.front else plot_skin(self.after.spec)

    def _ended(self) -> list[Part]:
        """Why the best search was ended, if it was; then nothing says what holds its design."""
        best = self.found.trials[0]
        return [] if best.multipliers.size else [Remark(f"The best search {best.message}.")]

    def _front(self) -> list[Part]:
        """Its designs, a row each."""
        want = self.problem.want
        if not self.front:
            return []
        words = [WORDS[key] for key in (want.goal, *want.against)]
        names = list(want.inputs(self.found.x))
        rows = [
            (
                *(f"{v / w.size:.4g}" for v, w in zip(point[1:], words, strict=True)),
                *(f"{float(v):.4g}" for v in want.inputs(point.x).values()),
            )
            for point in self.front
        ]
        heads = (
            *(f"{w.title.lower()} [{w.unit or 1}]" for w in words),
            *(f"{n} (SI)" for n in names),
        )
        key = want.against[0]
        return [
            ReportTable("Between both goals", heads, rows),
            Remark(
                f"The file has the first of them. For another one write its {key} as a limit "
                "in [limits], and leave [front] out."
            ),
        ]

    def _place(self, price: Price) -> dict[str, float]:
        """Where a limit is reached, as a data sheet tells places."""
        if price.place is None or not WORDS[price.name].field:
            return {}
        return self._coordinates(int(self._searched.flat[price.place]))

    def _coordinates(self, place: int | None) -> dict[str, float]:
        """Of a place of the data sheet after; none where no place decides."""
        if place is None:
            return {}
        coordinates = self.after.measured.coordinates
        return {key: float(values[place]) for key, values in coordinates.items()}

    def _miss(self, limit: Limit, figure: SheetFigure) -> str:
        """A limit that is kept at the places of the search, and not between them."""
        word = WORDS[limit.key]
        place = place_text(self._coordinates(figure.place))
        side = "at least" if limit.least else "at most"
        return (
            f"{word.title}{f' at {place}' if place else ''} is {word.told(figure.value)}, not "
            f"{side} {word.told(limit.value)}: the search kept that at its "
            f"{self.problem.want.places} places, and this one lies between them. More places "
            "in [at] hold it."
        )

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
        ours = price.purpose and f" The search has this limit itself: it {price.purpose}."
        return (
            f"{word.title}{where} is at its {side} limit of {price.value / word.size:.4g} "
            f"{word.unit}: 1 % {harder} of it costs {price.price:.2g} % of the {goal}.{ours}"
        )


@styled
def plot_front(design: Design) -> Figure:
    """Draw the designs between two goals, and the skin to start from."""
    want, found = design.problem.want, design.found
    words = [WORDS[key] for key in (*want.against, want.goal)]
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    sizes = [word.size for word in words]
    points = np.array([(p.other, p.goal) for p in design.front]) / sizes
    axes.plot(*points.T, "o-", color=FIRST, label="designs")
    if found.start.found:
        values = found.start.values[want.against[0]]
        start = values.min() if words[0].least else values.max(), found.before
        axes.plot(*(np.array(start) / sizes), "s", color="0.4", label="skin to start from")
    axes.set(
        xlabel=f"{words[0].title} [{words[0].unit or 1}]",
        ylabel=f"{words[1].title} [{words[1].unit or 1}]",
    )
    axes.legend(frameon=False)
    return figure


def design_skin(
    want: Want,
    progress: Callable[[str], None] = lambda text: None,
    workers: Executor | None = None,
    kept: Kept | None = None,
) -> Design:
    """Find the skin that makes a figure of its data sheet as good as it can be.

    Args:
        want: variables, goal and limits: `load_want`.
        progress: called with what is being done.
        workers: that search from several starts at once; None: this process.
        kept: searches that ended before; None: all are made.

    Raises:
        ValueError: the skin has no electrodes, or no design keeps the limits.
    """
    progress("compiling, once for these variables")
    problem = problem_of(want, progress)

    def shown(done: int, goal: float) -> None:
        progress(f"start {min(done + 1, want.starts)} of {want.starts}, best {goal:.4g}")

    def counted(done: int) -> None:
        assert want.front is not None
        progress(f"design {done + 1} of {want.front.points} between both goals")

    found = search(problem, shown, workers, kept)
    between, calls = ([], 0) if want.front is None else front(problem, found, counted, kept)
    # Twice as many places, so that what lies between those of the search is seen.
    along, axially = (2 * n - 1 for n in problem.grid)
    sheets = []
    for name, spec in (("before", want.spec), ("after", problem.spec(found.x))):
        shown_of = partial(_told, progress, f"data sheet {name}")
        how = (along, max(axially, 4)), None, problem.rated, shown_of
        try:
            sheets.append(data_sheet(spec, *how, between=problem.ends))
        except ValueError as error:  # a pad's table ends before the rated force
            shares = zip(want.variables, found.x.tolist(), strict=True)
            values = (f"{v.name} = {v.at(x):.6g}" for v, x in shares)
            raise ValueError(
                f"data sheet {name} the search: {error}. The search found "
                f"{', '.join(values)} (SI units, or factors)"
            ) from error
    before, after = sheets
    return Design(problem, found, before, after, between, found.calls + calls)


def problem_of(want: Want, progress: Callable[[str], None] = lambda text: None) -> Problem:
    """The figures that are asked for, of a section or a pad."""
    if want.spec.geometry.dimension == 3:
        return PadProblem(want, progress)
    return SectionProblem(want)


def _told(progress: Callable[[str], None], name: str, text: str) -> None:
    progress(f"{name}: {text}")


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


def designed_skin(want: Want, x: Floats, output: Path) -> str:
    """Text of the skin file of a design, by its variables x between 0 and 1; comments stay.

    A table of points that it names is found from where the output is to lie. Raises ValueError:
    an input is not in the file itself.
    """
    document = _copied(want, output)
    values = {path: float(value) for path, value in want.inputs(x).items()}
    if "preset" in document["material"] and any(p.startswith("material.") for p in values):
        table = want.spec.material.table()
        table.pop("note", None)  # of a preset, whose constants these are no more
        document["material"] = table
    now = continuous_inputs(want.spec)
    for path, value in values.items():
        *parents, last = (int(k) if k.isdigit() else k for k in path.split("."))
        table = document
        try:
            for key in parents:
                table = table[key]
            table[last] = _changed(table[last], now[path], value)
        except (KeyError, IndexError, TypeError):
            raise ValueError(
                f"{want.skin}: {path}: is not written as a number in the file itself; write it "
                "there"
            ) from None
    return str(tomlkit.dumps(document))


def skin_with_taxels(want: Want, kept: Sequence[int], output: Path) -> str:
    """Text of the skin file with some of its taxels, by their places in the layout, rising."""
    document = _copied(want, output)
    electrodes, spec = document["electrodes"], want.spec.electrodes
    assert spec is not None
    if spec.layout == "list":
        for k in reversed(range(len(spec.taxels))):
            if k not in kept:
                del electrodes["taxels"][k]
        return str(tomlkit.dumps(document))
    skin = skin_of(want.spec, contact=False)
    taxels, places = skin.electrodes.taxels, ContactPlaces.of(want.spec.geometry, skin.geometry)
    angle = np.asarray(taxels.angle)[:, 0]
    arc = places.arc(angle)
    height = np.broadcast_to(np.asarray(skin.electrodes.height), (len(angle), 1))
    gain = np.broadcast_to(spec.lsb / np.asarray(skin.electrodes.lsb), (len(angle), 1))
    rows = tomlkit.array()
    for k in kept:
        row = tomlkit.inline_table()
        if arc is None:
            row["angle"] = f"{np.rad2deg(places.angle(angle)[k]):.9g} deg"
        else:
            row["arc"] = _millimetres(arc[k])
        row["axial"] = _millimetres(taxels.axial[k, 0])
        row["diameter"] = _millimetres(taxels.diameter[k, 0])
        if height[k, 0]:
            row["height"] = _millimetres(height[k, 0])
        if gain[k, 0] != 1:
            row["gain"] = float(f"{gain[k, 0]:.9g}")
        name = f"module {taxels.module[k]}, taxel {taxels.number[k]}"
        rows.add_line(row, indent="  ", comment=name)
    rows.add_line(indent="")
    del electrodes["modules"]
    electrodes["layout"] = "list"
    electrodes["taxels"] = rows
    return str(tomlkit.dumps(document))


def _copied(want: Want, output: Path) -> Any:
    """The skin file of a design as it was; its calibration is another skin's."""
    raw = read_bytes(want.skin, MOST_BYTES).decode("utf-8-sig")
    document: Any = tomlkit.parse(raw)
    points = document["geometry"].get("points")
    if isinstance(points, str):
        where = (want.skin.parent / points).resolve()
        document["geometry"]["points"] = os.path.relpath(where, output.resolve().parent)
    document.pop("calibration", None)
    return document


def _millimetres(value: Any) -> str:
    return f"{1e3 * float(value):.9g} mm"


def _changed(text: Any, now: float, value: float) -> Any:
    """A quantity as the file has it, with another value; its deviation stays the same share.

    Raises KeyError: it is not a number with a unit.
    """
    if not isinstance(text, str):
        return float(f"{value:.9g}")
    start = deviation_start(text)
    own, deviation = text[:start], text[start:]
    unit = _NUMBER.sub("", own).strip()
    if unit in ZEROS:  # of temperature, where a share of the number means nothing
        return f"{value:.9g} K {deviation}".strip()
    if now == 0:
        known = find_unit(unit)
        if known is None or (deviation and not unit):
            raise KeyError(text)
        return _NUMBER.sub(f"{value / known.size:.9g}", own) + deviation
    ratio = value / now
    if "%" in own or "%" not in deviation:
        deviation = _scaled(deviation, abs(ratio))
    return _scaled(own, ratio) + deviation


def _scaled(text: str, ratio: float) -> str:
    """Its first number times a ratio."""
    return _NUMBER.sub(lambda found: f"{float(found[0]) * ratio:.9g}", text, count=1)
