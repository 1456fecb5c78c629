"""Tension tests with the artefacts of a laboratory, made from a known neo-Hookean rubber."""

import dataclasses
import pathlib
from typing import Any

import numpy as np

LENGTH, WIDTH, THICKNESS = 25e-3, 6e-3, 2e-3
AREA = WIDTH * THICKNESS
MU = 0.4e6
STRETCH = np.linspace(1.0, 2.5, 60)
FORCE = MU * (STRETCH - STRETCH**-2) * AREA
TRAVEL = LENGTH * (STRETCH - 1.0)
HEAD = "# length: 25 mm\n# width: 6 mm\n# thickness: 2 mm\n"


@dataclasses.dataclass(frozen=True)
class Case:
    """An artefact: its file, and what names and mends it."""

    kind: str  # what it is called
    columns: tuple[str, str]  # names in the file
    state: np.ndarray  # first column, in its unit
    load: np.ndarray  # second column without noise, in its unit
    option: str  # what mends it on the command line
    # options of `load_dataset`
    loading: dict[str, Any] = dataclasses.field(default_factory=dict)
    # options of `fit_material`
    fitting: dict[str, Any] = dataclasses.field(default_factory=dict)

    def write(self, file: pathlib.Path, seed: int, *, noise: str = "relative") -> pathlib.Path:
        """One noisy replica: 1 % of each reading, or 0.3 % of the largest."""
        rng = np.random.default_rng(seed)
        largest = np.max(np.abs(self.load))
        scatter = self.load * 0.01 if noise == "relative" else 0.003 * largest
        load = self.load + scatter * rng.standard_normal(len(self.load))
        rows = "".join(f"{x:.7g},{y:.7g}\n" for x, y in zip(self.state, load, strict=True))
        file.write_text(HEAD + ",".join(self.columns) + "\n" + rows)
        return file


def _cycles() -> tuple[np.ndarray, np.ndarray]:
    up = np.linspace(1.0, 2.5, 40)
    stretch = np.concatenate([up, up[::-1]] * 4)
    harder = np.concatenate([np.repeat([k, 0.85 * k], 40) for k in (1.5, 1.2, 1.05, 1.0)])
    return LENGTH * (stretch - 1.0), harder * MU * (stretch - stretch**-2) * AREA


MACHINE = ("displacement_mm", "force_N")
TAIL = TRAVEL[-1] + np.linspace(0.5e-3, 8e-3, 10)
IDLE = np.linspace(0.0, 1.5e-3, 6)[:-1]
CYCLES = _cycles()
CASES = {
    "machine": Case(
        "machine stiffness",
        MACHINE,
        1e3 * (TRAVEL + FORCE / 2e3),
        FORCE,
        "--machine-stiffness",
        loading={"machine_stiffness": "2 N/mm"},
    ),
    "slack": Case(
        "slack",
        MACHINE,
        1e3 * np.concatenate([IDLE, TRAVEL + 1.5e-3]),
        np.concatenate([np.zeros(len(IDLE)), FORCE]),
        "--zero slack",
        fitting={"zero": ("slack",)},
    ),
    "force": Case(
        "force offset",
        MACHINE,
        1e3 * TRAVEL,
        FORCE + 0.3,
        "--zero force",
        fitting={"zero": ("force",)},
    ),
    "preload": Case(
        "tared preload",
        MACHINE,
        1e3 * (TRAVEL - TRAVEL[8])[8:],
        (FORCE - FORCE[8])[8:],
        "--zero slack --zero force",
        fitting={"zero": ("slack", "force"), "residual": "estimated"},
    ),
    "break": Case(
        "break",
        MACHINE,
        1e3 * np.concatenate([TRAVEL, TAIL]),
        np.concatenate([FORCE, np.full(10, 0.05)]),
        "--cut-break",
        fitting={"cut_break": True},
    ),
    "spike": Case(
        "spike",
        MACHINE,
        1e3 * TRAVEL,
        FORCE + 1.5 * (np.arange(60) == 4),
        "--cut-spikes",
        fitting={"cut_spikes": True},
    ),
    "cycles": Case(
        "preconditioning",
        MACHINE,
        1e3 * CYCLES[0],
        CYCLES[1],
        "--cycle last",
        fitting={"cycle": "last"},
    ),
    "percent": Case(
        "percent",
        ("strain", "nominal_stress_MPa"),
        100.0 * (STRETCH - 1.0),
        1e-6 * FORCE / AREA,
        '--columns "strain=strain %"',
        loading={"columns": {"strain": "strain %"}},
    ),
}
