"""Picture of planned presses: where they are, and what forces over the skin are known to."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from fitting.calibration.next_press import Plan
from fitting.calibration.plan import Press
from suas_jax.figures.style import CONTACT, written


def plot_plan(plan: Plan, file: Path | None = None) -> Figure:
    """Draw the presses on the unrolled skin, and the expected error of forces after each.

    The ending of the file chooses the figure's format.
    """
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    by_arc = plan.candidates[0].by == "arc"
    unit = "arc [mm]" if by_arc else "angle [deg]"
    pad = plan.candidates[0].axial is not None

    def along(presses: tuple[Press, ...]) -> np.ndarray:
        place = np.array([press.place for press in presses])
        return 1e3 * place if by_arc else np.rad2deg(place)

    at, force = along(plan.candidates), np.array([p.force for p in plan.candidates])
    largest = force == force.max()
    if pad:
        axial = 1e3 * np.array([p.axial or 0.0 for p in plan.candidates])
        shown = left.scatter(
            at[largest], axial[largest], c=100 * plan.errors[-1][largest], s=90
        )
        figure.colorbar(shown, ax=left, label="force's error after the presses [%]")
        left.set_ylabel("axial [mm]")
        left.margins(y=0.1)
    else:
        for row, label in ((0, "before"), (-1, "after")):
            left.plot(at[largest], 100 * plan.errors[row][largest], "o-", ms=3, label=label)
        left.set_ylabel(f"standard deviation of {force.max():.3g} N found there [%]")
        left.set_yscale("log")
        left.legend()
    for number, (x, press) in enumerate(zip(along(plan.presses), plan.presses, strict=True)):
        y = 1e3 * press.axial if press.axial is not None else 0.03 + 0.05 * (number % 10)
        left.annotate(
            f"{number + 1}: {press.force:.3g} N",
            (x, y),
            xytext=(0, 7 if pad else 0),  # above the place's dot
            textcoords="offset points",
            xycoords="data" if pad else left.get_xaxis_transform(),
            color=CONTACT,
            ha="center",
            fontsize="small",
        )
    left.set_xlabel(f"{unit} of the press")
    right.plot(range(len(plan.accuracy)), 100 * np.array(plan.accuracy), "o-")
    right.set(
        xlabel="presses", ylabel="deviation of forces, median over the skin [%]", yscale="log"
    )
    right.locator_params(axis="x", integer=True)
    for axes in (left, right):
        axes.grid(alpha=0.3)
        if axes.get_yscale() == "log":  # 6 %, not 6 x 10^0
            axes.yaxis.set_major_formatter(LogFormatter())
            axes.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(2, 0.7)))
    return written(figure, file)
