"""What `run_time_error` measured, as tables and as a plot."""

import dataclasses
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

REFERENCE = "FElupe, PARDISO"
EQUAL = 1e-3  # error at which programs are compared


@dataclasses.dataclass
class Row:
    """One program on one mesh of one scene."""

    scene: str  # its name
    program: str  # its name
    mesh: str  # elements along the arc and through the thickness
    # solve from rest, return pressure [Pa] and displacement [m]
    call: Callable[[], tuple[float, float]]
    compile: float  # time to compile [s]
    memory: int  # peak of what the solve allocates [byte]
    error: tuple[float, float] = (np.nan, np.nan)  # of pressure and of displacement, relative
    seconds: list[float] = dataclasses.field(default_factory=list)  # of every round

    @property
    def median(self) -> float:
        """Median of the rounds [s]."""
        return statistics.median(self.seconds)


def reference_of(rows: list[Row]) -> Row:
    """FElupe with PARDISO on its finest mesh, else the finest solid."""
    peers = [r for r in rows if r.program == REFERENCE]
    return (peers or [r for r in rows if r.program == "solid"])[-1]


def table_of(rows: list[Row]) -> list[str]:
    """Markdown table, run times relative to the scene's reference."""
    head = (
        "scene",
        "program",
        "mesh",
        "error of pressure",
        "error of displacement",
        "run time",
        "compile [s]",
        "memory [MB]",
    )
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for scene in dict.fromkeys(r.scene for r in rows):
        group = [r for r in rows if r.scene == scene]
        reference = reference_of(group)
        for row in group:
            ratio = statistics.median(
                a / b for a, b in zip(row.seconds, reference.seconds, strict=True)
            )
            cells = (
                scene,
                row.program,
                row.mesh,
                f"{row.error[0]:.0e}",
                f"{row.error[1]:.0e}",
                f"1/{1 / ratio:.3g}" if ratio < 1 else f"{ratio:.3g}",
                f"{row.compile:.1f}" if row.compile else "",
                f"{row.memory / 1e6:.3g}",
            )
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def equal_error(rows: list[Row]) -> list[str]:
    """How much faster each program is than the best peer at the same error."""
    lines = [
        f"| scene | program | error {EQUAL:.0e} in | mesh | faster than the best FElupe mesh |",
        "|---|---|---|---|---|",
    ]
    for scene in dict.fromkeys(r.scene for r in rows):
        for which, quantity in enumerate(("pressure", "displacement")):

            def best(programs: tuple[str, ...], which: int = which, scene: str = scene) -> Any:
                good = [
                    r
                    for r in rows
                    if r.scene == scene and r.program in programs and r.error[which] <= EQUAL
                ]
                return min(good, key=lambda r: r.median, default=None)

            peer = best(("FElupe, PARDISO", "FElupe, SuperLU"))
            for program in ("shell", "solid"):
                own = best((program,))
                text = "not reached" if own is None else "no peer"
                if own and peer:
                    ratios = zip(peer.seconds, own.seconds, strict=True)
                    text = f"{statistics.median(a / b for a, b in ratios):.3g} times"
                    text += f" ({peer.program} {peer.mesh})"
                mesh = own.mesh if own else ""
                lines.append(f"| {scene} | {program} | {quantity} | {mesh} | {text} |")
    return lines


_COLOURS = ("#0072b2", "#e69f00", "#cc79a7", "#000000")  # for colour-blind people, too


def draw(rows: list[Row], path: Path) -> None:
    """Run time relative to the reference against error, both logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scenes = list(dict.fromkeys(r.scene for r in rows))
    figure, axes = plt.subplots(
        1, len(scenes), figsize=(3.2 * len(scenes), 3.6), sharey=True, layout="constrained"
    )
    for axis, scene in zip(np.atleast_1d(axes), scenes, strict=True):
        group = [r for r in rows if r.scene == scene]
        reference = reference_of(group)
        for i, program in enumerate(dict.fromkeys(r.program for r in group)):
            own = [r for r in group if r.program == program]
            for which, style in enumerate(("o-", "s--")):
                axis.loglog(
                    [max(r.error[which], 1e-7) for r in own],
                    [r.median / reference.median for r in own],
                    style,
                    color=_COLOURS[i],
                    markersize=4,
                    label=program if which == 0 else None,
                )
        axis.set_title(scene)
        axis.grid(alpha=0.3)
    figure.supxlabel("relative error (solid line: oil pressure, dashed: displacement)", size=9)
    np.atleast_1d(axes)[0].set_ylabel(f"run time / {REFERENCE} (finest mesh)")
    np.atleast_1d(axes)[0].legend(fontsize=7)
    figure.savefig(path, dpi=110)
