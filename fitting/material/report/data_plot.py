"""Figure of a data file: every specimen's readings, in the order of the file."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fitting.material.data.tables import Table
from fitting.material.experiments.measurements import Dataset
from suas_jax.figures.style import written


def plot_data(table: Table, data: Dataset | None, file: Path | None = None) -> Figure:
    """Draw what was read: the test, or where it is incomplete its columns over the rows.

    Args:
        table: of the file.
        data: the test, or None.
        file: where to write the figure; its ending chooses the format.
    """
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    if data is None:
        _draw_columns(figure, table)
    else:
        axes = figure.subplots()
        for channel in data.channels():
            for label in dict.fromkeys(data.specimen):
                rows = channel.rows & (data.specimen == label)
                x, y = data.abscissa[rows], data.value[rows] / channel.unit
                axes.plot(x, y, ".-", ms=3, lw=0.6, label=str(label) or "readings")
            axes.set_ylabel(channel.label)
        axes.set_xlabel(data.abscissa_label)
        axes.axhline(0.0, color="0.7", lw=0.6)
        axes.legend(frameon=False, fontsize="small")
    figure.suptitle(Path(table.file).name)
    return written(figure, file)


def _draw_columns(figure: Figure, table: Table) -> None:
    shown = [
        i for i, name in enumerate(table.names) if name and np.isfinite(table.cells[:, i]).any()
    ]
    axes = figure.subplots(len(shown) or 1, sharex=True, squeeze=False)
    for axis, i in zip(axes[:, 0], shown, strict=False):
        axis.plot(table.lines, table.cells[:, i], ".-", ms=3, lw=0.6)
        axis.set_ylabel(table.names[i], fontsize="small")
    axes[-1, 0].set_xlabel("line of the file")
