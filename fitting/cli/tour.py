"""`suas tour`: a section and a pad that were solved before, and what to do next."""

import json
from pathlib import Path
from typing import Any

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import AsJson, Plot, check_files
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import new_console, say

STATES = Path(__file__).with_name("tour.json")
"""Solved scenes; `python -m benchmarks.tour_states` writes them."""

NEXT = {
    "design a skin": (
        "suas solve configs/scenes/press.toml --plot section.png",
        "suas datasheet configs/skins/suas.toml -o sheet.html",
    ),
    "calibrate a membrane": (
        "suas data configs/data/treloar1944_uniaxial.csv",
        "suas fit material --law auto --data uniaxial=configs/data/treloar1944_uniaxial.csv",
    ),
    "log and calibrate a sensor": (
        "suas simulate configs/scenes/press_path.csv -o press.csv",
        "suas fit sensor configs/skins/suas.toml press.csv",
    ),
    "find the load": (
        "suas invert configs/skins/suas.toml press.csv --plot loads.png",
        "suas view configs/scenes/pad_crown.toml --open",
    ),
}
"""Command lines of each job, in an order in which each finds the files that it reads."""

_SHADES = "·░▒▓█"
_ROWS, _COLUMNS = 9, 49  # characters of a picture


def tour(as_json: AsJson = False, plot: Plot = None, overwrite: Overwrite = False) -> None:
    """Show a pressed section and a pressed pad at once, and what to do next.

    Both answers are precomputed. Exit status: 0 done, 2 bad input.
    """
    states = json.loads(STATES.read_text(encoding="utf-8"))
    with bad_input():
        check_files(plot, overwrite=overwrite)
        if plot is not None:
            _plot(states, plot)
    if as_json:
        say(json_text({"precomputed": True, "scenes": states, "next": NEXT}))
        return
    console = new_console(markup=False, highlight=False)
    for state in states:
        console.print(f"{_title(state)}\n{_map(state)}\n", soft_wrap=True)
    console.print("These answers were computed before. `suas solve SCENE` computes one anew.\n")
    if not Path("configs").exists():  # as it does in a checkout
        console.print("suas examples    # first: copies skins, scenes and data into configs")
    for job, lines in NEXT.items():
        text = "\n".join([f"\nTo {job}:", *(f"  {line}" for line in lines)])
        console.print(text, soft_wrap=True)


def _title(state: dict[str, Any]) -> str:
    forces = " and ".join(f"{load['force_N']:.3g} N" for load in state["loads"])
    return (
        f"{state['scene']}: {'a pad' if state['dimension'] == 3 else 'a section'} under "
        f"{forces}. Oil {1e-3 * state['oil_pressure_Pa']:.3g} kPa, smallest gap "
        f"{1e3 * state['min_gap_m']:.3g} mm."
    )


def _map(state: dict[str, Any]) -> str:
    """Counts of the taxels on the unrolled wall, angle from left to right, as characters."""
    taxels = state["taxels"]
    counts = [taxel["so"] for taxel in taxels]
    low, high = min(counts), max(counts)
    if state["dimension"] == 2:
        bars = (
            f"{taxel['angle_deg']:+5.0f}°  {taxel['so']:5.0f}  "
            f"{'█' * round(30 * taxel['so'] / high)}"
            for taxel in taxels
        )
        return "\n".join(["angle  counts", *bars])
    edge = max(abs(taxel["angle_deg"]) for taxel in taxels)
    end = max(abs(taxel["axial_m"]) for taxel in taxels)
    cells = [[" "] * _COLUMNS for _ in range(_ROWS)]
    for taxel in sorted(taxels, key=lambda taxel: taxel["so"]):
        column = round((taxel["angle_deg"] / edge + 1) / 2 * (_COLUMNS - 1))
        row = round((1 - taxel["axial_m"] / end) / 2 * (_ROWS - 1))
        shade = (taxel["so"] - low) / (high - low) * (len(_SHADES) - 1)
        cells[row][column] = _SHADES[round(shade)]
    scale = f"{_SHADES[0]} {low:.0f} to {_SHADES[-1]} {high:.0f} counts, angle to the right"
    return "\n".join(["".join(row) for row in cells] + [scale])


def _plot(states: list[dict[str, Any]], file: Path) -> None:
    """Draw the deformed section to scale, and the pad's taxels on its unrolled wall."""
    from matplotlib.figure import Figure

    from suas_jax.figures.style import CONTACT, FILM, FIRST, WALL, styled, written

    @styled
    def draw() -> None:
        figure = Figure(figsize=(10, 4.4), layout="constrained")
        for axes, state in zip(figure.subplots(1, 2), states, strict=True):
            taxels, loads = state["taxels"], state["loads"]
            axes.set_title(_title(state).split(". ")[1], fontsize="medium")
            axes.set_aspect("equal" if state["dimension"] == 2 else "auto")
            if state["dimension"] == 2:
                outer, inner, wall = (state[key] for key in ("outer", "inner", "wall"))
                for face, below, colour in ((outer, inner, FIRST), (inner, wall, FILM)):
                    x, y = ([*a, *b[::-1]] for a, b in zip(face, below, strict=True))
                    axes.fill(x, y, color=colour, lw=0)
                axes.fill(*wall, color=WALL, lw=0)
                axes.set(xlabel="x [mm]", ylabel="y [mm]")
                continue
            places = [[t["angle_deg"] for t in taxels], [1e3 * t["axial_m"] for t in taxels]]
            dots = axes.scatter(*places, c=[t["so"] for t in taxels], s=22, cmap="viridis")
            figure.colorbar(dots, ax=axes, label="sensor output [counts]")
            pressed = [[x["angle_deg"] for x in loads], [1e3 * x["axial_m"] for x in loads]]
            axes.plot(*pressed, "+", color=CONTACT, ms=16, mew=2)
            axes.set(xlabel="angle [°]", ylabel="axial [mm]")
        written(figure, file)

    draw()
