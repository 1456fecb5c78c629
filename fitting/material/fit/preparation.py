"""Preparation of the data of a fit: readings that are kept, artefacts that curves show."""

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.material.experiments.artefacts import Suspect, curve_suspects
from fitting.material.experiments.data_checks import (
    branches,
    contradictions,
    refuse_without_information,
    warnings_of,
)
from fitting.material.experiments.free_zero import without_toe
from fitting.material.experiments.history import HistoryTest, thinned_history, with_history
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.selection import (
    before_break,
    in_cycle,
    thinned,
    without_spikes,
)


def prepared(
    sets: Sequence[Dataset],
    branch: str | None,  # "all" or "loading"; None takes all
    cycle: str,  # "all", "first", "last" or a number
    zero: Sequence[str],
    *,
    cut_break: bool = False,
    cut_spikes: bool = False,
    remembers: bool,  # readings depend on those before them
    thin: int,  # most readings of a curve; zero keeps all
) -> tuple[list[Dataset], list[str], list[Suspect]]:
    """The readings that are fitted, remarks, and artefacts that their curves show.

    Raises ValueError: branch or cycle are not allowed, or a test says nothing.
    """
    if branch and branch not in ("all", "loading"):
        raise ValueError(f"--branch {branch}: unknown; allowed: all, loading")
    used, notes, suspects = [], [], []

    def told(before: Dataset, after: Dataset, what: str) -> Dataset:
        if count := before.size - after.size:
            many = "reading" if count == 1 else "readings"
            notes.append(f"{before.file}: {count} {many} {what} left out")
        return after

    for data in sets:
        what = "of unloading branches"
        if cycle != "all":
            what = f"outside of the {cycle} cycle's loading"
        kept = in_cycle(data, cycle)
        if branch == "loading":
            kept = kept.select(~branches(kept).unloading)
        kept = told(data, kept, what)
        if cut_break:
            kept = told(kept, before_break(kept), "after the break")
        if cut_spikes:
            kept = told(kept, without_spikes(kept), "off the curve of their neighbours")
        if "slack" in zero:
            what = "of the toe, before the curve is steepest,"
            kept = told(kept, without_toe(kept), what)
        if remembers:
            kept = with_history(kept)
        refuse_without_information(kept)
        notes += warnings_of(kept)
        suspects += curve_suspects(kept)
        few: Dataset
        if isinstance(kept, HistoryTest):
            few = thinned_history(kept, thin)
        else:
            few = thinned(kept, thin)
        if few.size < kept.size:
            notes.append(
                f"{data.file}: {kept.size} readings are fitted as {few.size} means of runs; "
                f"--thin 0 keeps all"
            )
        used.append(few)
    return used, [*notes, *contradictions(used)], suspects


def refuse_what_forgets(
    branch: str | None,
    cycle: str,
    zero: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None,
) -> None:
    """Raise a ValueError for options that leave out part of a history, or have none."""
    for option, value in {"--branch": branch or "all", "--cycle": cycle}.items():
        if value != "all":
            raise ValueError(
                f"{option} {value}: leaves out part of the history, and with --prony or "
                f"--mullins a reading depends on all before it"
            )
    if zero:
        raise ValueError(f"--zero {zero[0]}: can't be found with --prony or --mullins")
    if bounds:
        raise ValueError("--bound: can't be used with --prony or --mullins")


def window_of(sets: Sequence[Dataset], prony: int) -> tuple[float, float]:
    """Shortest and longest time that tests of relaxation resolve [s].

    `prony`: number of Prony terms that are asked for.
    Raises ValueError: Prony terms are asked for, and no test states times.
    """
    shortest, longest = [], []
    for data in sets:
        if not isinstance(data, HistoryTest) or not data.is_timed:
            continue
        for rows in data.paths():
            steps = np.diff(data.time[rows])
            steps = steps[steps > 0.0]
            if steps.size:
                first = float(data.time[rows[0]])
                shortest.append(min(float(steps.min()), first) if first > 0.0 else steps.min())
                longest.append(float(np.ptp(data.time[rows])))
    if shortest:
        return float(min(shortest)), float(max(longest))
    if prony:
        raise ValueError(
            "--prony: no file states times; add a column such as time_s, or a rate: "
            '"# strain_rate: 0.1 1/s"'
        )
    return 1.0, 1.0
