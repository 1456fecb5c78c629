"""Figure of the taxels' health: a panel a quantity, a row a module, a column a taxel."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from suas_jax.acquisition.health import Health, TaxelHealth
from suas_jax.figures.style import CONTACT, styled, written

_CORRELATION = "correlation with its neighbours"
_PANELS = {
    "noise [counts]": lambda t: t.noise,
    "drift [counts/min]": lambda t: t.drift,
    "lost, stuck or saturated [%]": lambda t: 100 * max(t.lost, t.stuck, t.saturated),
    _CORRELATION: lambda t: t.follows,
}


@styled
def plot_health(health: Health, file: Path | None = None) -> Figure:
    """Draw noise, drift, loss and correlation of every taxel; faulty ones have a cross."""
    modules = sorted({taxel.module for taxel in health.taxels})
    widest = max((taxel.taxel for taxel in health.taxels), default=1)
    height = 1.4 + 0.16 * len(modules)
    figure = Figure(figsize=(9, 2 * height), layout="constrained")
    for axes, (label, value) in zip(figure.subplots(2, 2).flat, _PANELS.items(), strict=True):
        image = np.full((len(modules), widest), np.nan)
        for taxel in health.taxels:
            image[_place(taxel, modules)] = value(taxel)
        limits = {"vmin": 0.0, "vmax": 1.0} if label == _CORRELATION else {}
        values = np.ma.masked_invalid(image)
        shown = axes.imshow(values, aspect="auto", interpolation="nearest", **limits)
        figure.colorbar(shown, ax=axes)
        places = [_place(taxel, modules) for taxel in health.faulty]
        axes.plot([x for _, x in places], [y for y, _ in places], "x", color=CONTACT, ms=6)
        axes.set_title(label)
        axes.set_xticks(range(widest), range(1, widest + 1))
        axes.set_yticks(range(len(modules)), modules)
        axes.set_xlabel("taxel")
        axes.set_ylabel("module")
    return written(figure, file)


def _place(taxel: TaxelHealth, modules: list[int]) -> tuple[int, int]:
    """Row and column of a taxel in the figure."""
    return modules.index(taxel.module), taxel.taxel - 1
