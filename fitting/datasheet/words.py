"""The words of a data sheet: keys of its figures, with their SI units, and what they mean."""

from typing import NamedTuple


class Word(NamedTuple):
    """A figure.

    Attributes:
        title: for a person.
        meaning: in a sentence.
        unit: that a person reads it in.
        size: of that unit in SI.
        field: of `fitting.datasheet.figures.Figures`; empty where it has no place.
        least: whether the smallest over the region is the worst; else the largest.
        missing: why it may have no value.
    """

    title: str
    meaning: str
    unit: str = ""
    size: float = 1.0
    field: str = ""
    least: bool = False
    missing: str = "no state was found at any place"


_NEVER = "the membrane never reaches the wall, or no state was found on the way"
WORDS: dict[str, Word] = {
    "range_N": Word(
        "Range",
        "Force at which the membrane reaches the wall; beyond it the wall carries the rest.",
        "N",
        field="first_contact",
        least=True,
        missing=_NEVER,
    ),
    "min_gap_m": Word(
        "Smallest gap", "To the wall, under the rated force.", "mm", 1e-3, "min_gap", True
    ),
    "sensitivity_counts_per_N": Word(
        "Sensitivity",
        "Change of all taxels together (root of the sum of squares) per newton, at rest.",
        "counts/N",
        1.0,
        "sensitivity",
        True,
    ),
    "detection_limit_N": Word(
        "Detection limit",
        "Smallest force found in the noise of one frame with 5 % false alarms and 5 % misses.",
        "N",
        1.0,
        "detection_limit",
    ),
    "force_resolution_N": Word(
        "Force resolution",
        "Least standard deviation of a force estimated from one frame, at the rated force.",
        "N",
        1.0,
        "force_resolution",
    ),
    "place_resolution_m": Word(
        "Place resolution",
        "Least standard deviation of the place on the outer face, at the rated force.",
        "mm",
        1e-3,
        "place_resolution",
    ),
    "two_point_m": Word(
        "Two-point discrimination",
        "Distance at which that of two contacts of half the rated force is known to 1/3.29.",
        "mm",
        1e-3,
        missing="two contacts cannot be told apart at any distance that fits on the skin",
    ),
    "nonlinearity": Word(
        "Nonlinearity",
        "Departure of the reading at half of the rated force from the straight line.",
        "%",
        1e-2,
        "nonlinearity",
    ),
    "crosstalk": Word(
        "Crosstalk",
        "Largest change of a taxel farther from the contact than four times membrane and film, "
        "over the largest of all.",
        "%",
        1e-2,
        "crosstalk",
        missing="no taxel is far from any place",
    ),
    "force_accuracy": Word(
        "Accuracy of force",
        "Standard deviation of an estimated force by the skin file's tolerances, uncalibrated.",
        "%",
        1e-2,
    ),
    "force_per_kelvin": Word(
        "Temperature coefficient",
        "Of an estimated force, readings counted from rest.",
        "%/K",
        1e-2,
    ),
    "zero_counts_per_kelvin": Word(
        "Zero by temperature", "Of the taxel that drifts most.", "counts/K"
    ),
    "force_per_metre_of_depth": Word(
        "Depth coefficient", "Of an estimated force, readings counted from rest.", "%/m", 1e-2
    ),
    "zero_counts_per_metre_of_depth": Word(
        "Zero by depth", "Of the taxel that drifts most.", "counts/m"
    ),
    "creep_1min": Word(
        "Creep, 1 min",
        "Rise of displacements under a held force since one second after the press.",
        "%",
        1e-2,
    ),
    "creep_1h": Word("Creep, 1 h", "The same after an hour.", "%", 1e-2),
    "lowest_frequency_Hz": Word("Lowest frequency", "Undamped, about rest.", "Hz"),
    "damping_ratio": Word("Damping ratio", "Of that mode, over critical damping."),
    "bandwidth_Hz": Word("Bandwidth", "Up to which statics is right to 1 %.", "Hz"),
    "buckling_mismatch": Word(
        "Stability margin",
        "How much longer than its seat the membrane may further be before it buckles at rest.",
        "%",
        1e-2,
    ),
}
PLACED = {key: word for key, word in WORDS.items() if word.field}
"""Figures that differ from place to place."""
