"""The imports between folders as a matrix, drawn from the code."""

import graphlib
import sys
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests"))

from import_graph import folder_imports  # noqa: E402

WORDS = (
    "A dot says that the row's folder imports the column's. Folders stand in the order of the "
    "data: every dot lies below the diagonal, so nothing imports in a circle."
)


def draw(file: Path) -> None:
    """Write the matrix as SVG, the same bytes for the same code."""
    graph = folder_imports()
    order = list(graphlib.TopologicalSorter(graph).static_order())
    place = {name: i for i, name in enumerate(order)}
    dots = [(place[other], place[name]) for name, found in graph.items() for other in found]
    settings = {"svg.hashsalt": "folders", "svg.fonttype": "path", "font.size": 8}
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=(9, 8.4), layout="constrained")
        axes = figure.subplots()
        axes.plot([-0.5, len(order) - 0.5], [-0.5, len(order) - 0.5], color="0.8", linewidth=1)
        axes.scatter(*zip(*dots, strict=True), s=18, color="#0a7d91")
        labels = [name.replace(".", "/").replace("suas_jax/", "") for name in order]
        axes.set_xticks(range(len(order)), labels, rotation=90)
        axes.set_yticks(range(len(order)), labels)
        axes.set(xlim=(-0.5, len(order) - 0.5), ylim=(len(order) - 0.5, -0.5))
        axes.xaxis.tick_top()
        axes.grid(color="0.93", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[:].set_visible(False)
        figure.savefig(file, metadata={"Date": None})
