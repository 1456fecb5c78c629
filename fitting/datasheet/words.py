"""The words of a data sheet: keys of its figures, with their SI units, and what they mean."""

from collections.abc import Mapping
from typing import NamedTuple


class Word(NamedTuple):
    """A figure."""

    title: str  # for a person
    meaning: str  # in a sentence
    unit: str = ""  # that a person reads it in
    field: str = ""  # of `fitting.datasheet.figures.Figures`; empty where it has no place
    least: bool = False  # whether the smallest over the region is the worst; else the largest
    missing: str = "no state was found"  # why it may have no value

    @property
    def size(self) -> float:
        """Of its unit in SI."""
        return {"mm": 1e-3, "%": 1e-2}.get(self.unit.split("/")[0], 1.0)

    def told(self, value: float) -> str:
        """A value [SI] with its unit."""
        return f"{value / self.size:.4g} {self.unit}".rstrip()


_BY_REST = "Of an estimated force, readings counted from rest."
_OF_MOST = "Of the taxel that drifts most."
_IN_ONE = (
    "Least standard deviation of {}, at the rated force, of contacts whose direction and "
    "extent are known."
)
_NEVER = "the membrane never reaches the wall, or no state was found on the way"
_SILENT = "no state was found, or every taxel is saturated"
_UNTOLD = "no state was found, or taxels that are not saturated do not tell place and force"
_APART = "two contacts cannot be told apart at any distance that fits on the skin"
WORDS: dict[str, Word] = {
    "range_N": Word(
        "Range",
        "Force at which the membrane reaches the wall; beyond it the wall carries the rest.",
        *("N", "first_contact", True, _NEVER),
    ),
    "min_gap_m": Word(
        "Smallest gap", "To the wall, under the rated force.", "mm", "min_gap", True
    ),
    "sensitivity_counts_per_N": Word(
        "Sensitivity",
        "Change of all taxels together (root of the sum of squares) per newton, at rest.",
        *("counts/N", "sensitivity", True),
    ),
    "detection_limit_N": Word(
        "Detection limit",
        "Smallest force found in the noise of one frame with 5 % false alarms and 5 % misses.",
        *("N", "detection_limit", False, _SILENT),
    ),
    "force_resolution_N": Word(
        "Force resolution",
        _IN_ONE.format("a force estimated from one frame"),
        *("N", "force_resolution", False, _UNTOLD),
    ),
    "place_resolution_m": Word(
        "Place resolution",
        _IN_ONE.format("the place on the outer face"),
        *("mm", "place_resolution", False, _UNTOLD),
    ),
    "two_point_m": Word(
        "Two-point discrimination",
        "Distance at which that of two contacts of half the rated force is known to 1/3.29; "
        "`suas invert`, which tells them from a wide one, needs about four times it.",
        *("mm", "", False, _APART),
    ),
    "nonlinearity": Word(
        "Nonlinearity",
        "Departure of the reading at half of the rated force from the straight line.",
        *("%", "nonlinearity", False, _SILENT),
    ),
    "crosstalk": Word(
        "Crosstalk",
        "Largest change of a taxel farther from the contact than four times membrane and film, "
        "over the largest of those within.",
        *("%", "crosstalk", False, "no taxel is far enough to count"),
    ),
    "force_accuracy": Word(
        "Accuracy of force",
        "Standard deviation of an estimated force by the skin file's tolerances, uncalibrated.",
        "%",
        missing=_UNTOLD,
    ),
    "force_per_kelvin": Word("Temperature coefficient", _BY_REST, "%/K", missing=_UNTOLD),
    "zero_counts_per_kelvin": Word("Zero by temperature", _OF_MOST, "counts/K"),
    "force_per_metre_of_depth": Word("Depth coefficient", _BY_REST, "%/m", missing=_UNTOLD),
    "zero_counts_per_metre_of_depth": Word("Zero by depth", _OF_MOST, "counts/m"),
    "creep_1min": Word(
        "Creep, 1 min",
        "Rise of displacements under a held force since one second after the press.",
        "%",
    ),
    "creep_1h": Word("Creep, 1 h", "The same after an hour.", "%"),
    "lowest_frequency_Hz": Word("Lowest frequency", "Undamped, about rest.", "Hz"),
    "damping_ratio": Word("Damping ratio", "Of that mode, over critical damping."),
    "bandwidth_Hz": Word("Bandwidth", "Up to which statics is right to 1 %.", "Hz"),
    "buckling_share": Word(
        "Buckling at rest", "What the skin carries at rest, of what buckles it.", "%"
    ),
    "buckling_mismatch": Word(
        "Stability margin",
        "How much longer than its seat the membrane may further be before it buckles at rest.",
        "%",
    ),
}
PLACED = {key: word for key, word in WORDS.items() if word.field}
"""Figures that differ from place to place."""
READ_AT_RATED = ("force_resolution_N", "place_resolution_m", "nonlinearity", "crosstalk")
"""Those of readings under the rated force."""


def place_text(own: Mapping[str, float]) -> str:
    """A place by the coordinates of a data sheet; empty where there are none."""
    if not own:
        return ""
    angle = f"{own['angle_deg']:.0f} deg"
    along = f"{1e3 * own['arc_m']:.0f} mm" if "arc_m" in own else angle
    return along + (f", {1e3 * own['axial_m']:.0f} mm" if "axial_m" in own else "")
